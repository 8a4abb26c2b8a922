"""The ladder: the law, and effect after effect in the order of their error reductions, with held-out errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.failure.regions import improvement_by_region
from contactlearn.diagnosis.result.effects import FittedParameter, MissingEffect, Rung, RungKind
from contactlearn.diagnosis.result.regions import Region
from contactlearn.diagnosis.search.selection import Selection, identities, without
from contactlearn.diagnosis.validation import ValidatedFit, interval, paired_gain
from contactlearn.evaluation.metrics import outside_admissible


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """Rungs of the law and of each missing effect, and the effects, in the same order."""

    rungs: tuple[Rung, ...]
    missing: tuple[MissingEffect, ...]


def ladder(selection: Selection, regions: Sequence[Region], generator: torch.Generator) -> Ladder:
    """Order the chosen effects by their error reductions, and fit and validate the models between law and all of them.

    Args:
        selection: after its run.
        regions: in which the law fails.
        generator: of the bootstrap.
    """
    final = selection.present
    ids = {one.name: one for one in identities(final.effects)}
    names = [name for name in final.effects if name not in selection.given]
    less = {name: selection.without(name) for name in names}
    reductions = {name: (less[name].error - final.error).nanmean().item() for name in names}
    names.sort(key=reductions.__getitem__, reverse=True)
    models = _models(selection, names, less)
    errors = [interval(model.error, generator) for model in models]
    outside = [_inadmissible(selection, model) for model in models]
    missing = tuple(
        MissingEffect(
            effect=ids[name],
            equation=final.fit.model.effects[name].equation,
            parameters=_parameters(final, name),
            error_before=errors[k],
            error_after=errors[k + 1],
            error_reduction=reductions[name],
            confidence=_confidence(less[name], final),
            inadmissible_before=outside[k],
            inadmissible_after=outside[k + 1],
            improvements=improvement_by_region(regions, _filled(models[k].error), _filled(models[k + 1].error)),
        )
        for k, name in enumerate(names)
    )
    effects = (
        Rung(kind=RungKind.EFFECT, effect=ids[name], error=error) for name, error in zip(names, errors[1:], strict=True)
    )
    return Ladder(rungs=(Rung(kind=RungKind.LAW, error=errors[0]), *effects), missing=missing)


def _models(selection: Selection, names: Sequence[str], less: dict[str, ValidatedFit]) -> list[ValidatedFit]:
    """The model of each rung: the law, and one more of the effects on each."""
    final = selection.present
    models = [final]
    for name in reversed(names[1:]):
        others, values = without(models[0], name)
        first = models[0] is final
        rung = less[name] if first else selection.models.validated(others, selection.models.fit(others, values))
        models.insert(0, rung)
    return [selection.base, *models] if names else models


def _inadmissible(selection: Selection, model: ValidatedFit) -> float:
    """Share of the predicted impulses that gain energy, pull or leave penetration."""
    impulse = model.fit.model.predict(selection.impacts).wrench[..., :2]
    return outside_admissible(selection.impacts, impulse).double().mean().item()


def _confidence(without_it: ValidatedFit, final: ValidatedFit) -> float:
    """Probability that the held-out gain of an effect is above 0."""
    gain, error = paired_gain(without_it, final)
    return NormalDist().cdf(gain / error) if error > 0 else 0.0


def _filled(error: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Errors with the mean where a trial was never held out."""
    return torch.where(error.isfinite(), error, error.nanmean())


def _parameters(fitted: ValidatedFit, name: str) -> tuple[FittedParameter, ...]:
    """The parameters of one effect of a model."""
    fit = fitted.fit
    return tuple(
        FittedParameter(
            name=p.name.removeprefix(f"{name}."), symbol=p.symbol, unit=p.unit, value=value, standard_error=error
        )
        for p, value, error in zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True)
        if p.name.startswith(f"{name}.")
    )
