"""The ladder: the law, and effect after effect in the order of what each takes off the held-out error."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import torch
from torch import Tensor

from contactlearn.diagnosis.failure.regions import Region, improvement_by_region
from contactlearn.diagnosis.search.selection import Fitted, Selection, identities, paired_gain, without
from contactlearn.effects import Effect, EffectId
from contactlearn.evaluation.metrics import Interval, bootstrap, outside_admissible

RESAMPLES = 1000


@dataclass(frozen=True)
class Missing:
    """An effect that is missing: errors before and after it in the ladder, and its fitted parameters."""

    id: EffectId
    effect: Effect
    error_before: Interval
    error_after: Interval
    takes_off: float  # mass error without it, the others staying, less that with it
    confidence: float  # that its held-out gain is not chance
    parameters: dict[str, dict[str, Any]]
    inadmissible: tuple[float, float]  # share of impulses that no rigid contact can give, before and after it
    helps: tuple[str, ...] = ()  # regions in which the error falls

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.id.name,
            "form": self.id.form,
            "error_before": self.error_before.mean,
            "error_after": self.error_after.mean,
            "takes_off": self.takes_off,
            "confidence": self.confidence,
            "parameters": self.parameters,
            "inadmissible_before": self.inadmissible[0],
            "inadmissible_after": self.inadmissible[1],
            "helps": list(self.helps),
        }


def ladder(
    selection: Selection, regions: tuple[Region, ...], generator: torch.Generator
) -> tuple[tuple[tuple[str, Interval], ...], tuple[Missing, ...]]:
    """Law, and effect after effect in the order of what each takes off; and the effects."""
    final = selection.present
    ids = {one.name: one for one in identities(final.effects)}
    names = [name for name in final.effects if name not in selection.given]
    less = {name: selection.without(name) for name in names}
    takes_off = {name: (less[name].error - final.error).nanmean().item() for name in names}
    names.sort(key=takes_off.get, reverse=True)
    rungs = [final]
    for name in reversed(names[1:]):
        others, values = without(rungs[0], name)
        rungs.insert(0, less[name] if rungs[0] is final else selection.validated(others, selection.fit(others, values)))
    rungs = [selection.base, *rungs] if names else rungs
    intervals = [interval(rung.error, generator) for rung in rungs]
    impulses = [rung.fit.model.predict(selection.impacts).wrench[..., :2] for rung in rungs]
    outside = [outside_admissible(selection.impacts, impulse).double().mean().item() for impulse in impulses]
    found = []
    for k, name in enumerate(names):
        gain, error = paired_gain(less[name], final)
        helped = improvement_by_region(list(regions), _filled(rungs[k].error), _filled(rungs[k + 1].error))
        confidence = NormalDist().cdf(gain / error) if error > 0 else 0.0
        found.append(
            Missing(
                ids[name],
                final.fit.model.effects[name],
                intervals[k],
                intervals[k + 1],
                takes_off[name],
                confidence,
                _parameters(final, name),
                (outside[k], outside[k + 1]),
                tuple(str(change) for change in helped if change.helped),
            )
        )
    steps = zip((selection.law.name, *(f"+ {ids[name]}" for name in names)), intervals, strict=True)
    return tuple(steps), tuple(found)


def interval(error: Tensor, generator: torch.Generator) -> Interval:
    """Mean and 95 % interval of the errors of those trials that were held out."""
    return bootstrap(error[error.isfinite()], generator, RESAMPLES)


def _filled(error: Tensor) -> Tensor:
    """Errors [N] with the mean where a trial was never held out."""
    return torch.where(error.isfinite(), error, error.nanmean())


def _parameters(fitted: Fitted, name: str) -> dict[str, dict[str, Any]]:
    """Value, standard error and unit of each parameter of one effect."""
    entries = {}
    fit = fitted.fit
    for p, value, error in zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True):
        if p.name.startswith(f"{name}."):
            own = p.name.removeprefix(f"{name}.")
            entries[own] = {"symbol": p.symbol, "value": value, "standard_error": error, "unit": p.unit}
    return entries
