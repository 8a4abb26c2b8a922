"""The ladder: the law, and effect after effect in the order of their error reductions, with held-out errors.

The confidence in a name is calibrated.  The shares of the plausible models only compare effects of the catalogue, and
the true effect may not be one of them: where an effect removes little of the error beside what is left and predictable,
or the residual depends on something unknown, it may be a proxy for what another effect's form leaves.  A
logistic regression turns that into the probability that one of the effects compared is right; the share says which.
It is fitted to tables of `benchmarks/blind` by several authors, in the plane and in space, with known and unknown
physics, soft contacts and scatter, and tested on other tables.
Source: Platt 1999, for the calibration.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.regions import improvement_by_region
from contactlearn.diagnosis.result.effects import FittedParameter, Level, MissingEffect, Region, Rung, RungKind
from contactlearn.diagnosis.search.selection import Selection, inclusion, predict_held_out, smaller
from contactlearn.effects import State
from contactlearn.effects.base import ChangesFriction
from contactlearn.effects.parameter_drift import ParameterDrift
from contactlearn.inference.evaluation.metrics import outside_admissible
from contactlearn.inference.validation import ValidatedFit, held_out_interval
from contactlearn.mechanics.impacts import Impacts

COEFFICIENTS = (-1.15, 1.19, -0.99)
"""Coefficients of `regressors`, fitted by `benchmarks/blind/calibrate.py`."""
SUREST = 0.99
"""Probability of a name beyond which the number of judged names tells no more."""
_UNCERTAINTY = 0.2
"""Part of the squared error to which noise is known, times √n of n trials; from 0.1 to 0.35 does as well."""


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """Rungs of the law and of each missing effect, and the effects, in the same order."""

    rungs: tuple[Rung, ...]
    missing: tuple[MissingEffect, ...]


def ladder(selection: Selection, regions: Sequence[Region], generator: torch.Generator) -> Ladder:
    """Order the chosen effects by their error reductions, and fit and validate the models between law and all of them.

    Args:
        selection: the chosen model and what it was chosen from.
        regions: in which the law fails.
        generator: of the bootstrap.
    """
    final, effects = selection.present, selection.missing
    less = dict(zip(effects, selection.without_each(effects), strict=True))
    reductions = {effect: (less[effect].error - final.error).nanmean().item() for effect in effects}
    effects.sort(key=reductions.__getitem__, reverse=True)
    path = [selection.chosen]  # of each rung: the law, and one more of the effects on each
    for effect in reversed(effects):
        path = [*smaller(selection.pool, path[0], effect), *path]
    predict_held_out(selection.pool, selection.folds, path)
    models = [*(selection.validated(model.spec) for model in path[:-1]), final]
    errors = [held_out_interval(model.error, generator) for model in models]
    impulses = (model.fit.model.predict(selection.impacts).wrench[..., : selection.impacts.space.d] for model in models)
    outside = [outside_admissible(selection.impacts, impulse).double().mean().item() for impulse in impulses]
    missing = tuple(
        MissingEffect(
            effect=effect,
            equation=final.fit.model.effects[effect.name].shown_equation,
            parameters=fitted_parameters(final, effect.name),
            error_before=errors[k],
            error_after=errors[k + 1],
            error_reduction=reductions[effect],
            share=inclusion(selection.plausible, effect),
            confidence=inclusion(selection.plausible, effect),
            level=Level.of(inclusion(selection.plausible, effect)),
            inadmissible_before=outside[k],
            inadmissible_after=outside[k + 1],
            coefficient_ends=coefficient_ends(final, selection.impacts, effect.name),
            improvements=improvement_by_region(regions, _filled(models[k].error), _filled(models[k + 1].error)),
        )
        for k, effect in enumerate(effects)
    )
    rungs = [Rung(kind=RungKind.EFFECT, effect=e, error=error) for e, error in zip(effects, errors[1:], strict=True)]
    return Ladder(rungs=(Rung(kind=RungKind.LAW, error=errors[0]), *rungs), missing=missing)


def _filled(error: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Errors with the mean where a trial was never held out."""
    return torch.where(error.isfinite(), error, error.nanmean())


def fitted_parameters(fitted: ValidatedFit, name: str | None = None) -> tuple[FittedParameter, ...]:
    """Return the parameters of one effect of a model, or of its law; places and lengths on the floor in m."""
    fit, ends, parameters = fitted.fit, fitted.fit.at_ends(), list[FittedParameter]()
    for p, value, error in zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True):
        owner, _, short_name = p.name.rpartition(".")
        if owner == (name or ""):
            shown = value, error, p.unit
            if owner:
                shown = fit.model.effects[owner].in_shown_unit(short_name, value, error, p.unit)
            parameters.append(
                FittedParameter(
                    name=short_name,
                    symbol=p.symbol,
                    unit=shown[2],
                    value=shown[0],
                    standard_error=shown[1],
                    at_end=p.name in ends,
                    undetermined=error > p.high - p.low,
                )
            )
    return tuple(parameters)


def coefficient_ends(fitted: ValidatedFit, impacts: Impacts, name: str) -> tuple[float, float] | None:
    """Return the coefficient that drifts at the first and the last trial; None of an effect that is no drift."""
    effect = fitted.fit.model.effects[name]
    if not isinstance(effect, ParameterDrift):
        return None
    ends = impacts[impacts.order.argsort(stable=True)[[0, -1]]]
    mu, eps = effect.law(State.of(ends), *fitted.fit.model.law.coefficients)
    first, last = (mu if isinstance(effect, ChangesFriction) else eps).tolist()
    return first, last


# --- Confidence --------------------------------------------------------------------------------


def name_probability(share: float, removed: float, reducible: float, trials: int, unknown: bool) -> float:
    """Compute the probability that a named effect is right.

    Args:
        share: of the plausible models that have it.
        removed: squared held-out error that it removes, the other effects in the model, over that of the model.
        reducible: part of the model's squared error that something predictable makes.
        trials: their number.
        unknown: whether the residual shows that something unknown is missing.
    """
    values = regressors(removed, reducible, trials, unknown)
    return share * SUREST / (1 + math.exp(-sum(x * b for x, b in zip(values, COEFFICIENTS, strict=True))))


def regressors(removed: float, reducible: float, trials: int, unknown: bool) -> tuple[float, float, float]:
    """Compute 1, the logarithm of what is removed over what is left, and whether something unknown is missing.

    What is left is known no better than the noise, which is estimated from the trials.
    """
    uncertain = max(reducible, 0.0) + _UNCERTAINTY * trials**-0.5
    return 1.0, math.log(min(max(removed, 1e-3), 1e3) / uncertain), float(unknown)
