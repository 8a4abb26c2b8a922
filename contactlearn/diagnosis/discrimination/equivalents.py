"""What cannot be told apart: effects that could stand in the place of a chosen one on this data.

    change     what the chosen effect does to the predicted v_post of each trial, at its fitted values, in units of the
               scatter: the model without it minus the model with it
    screen     the share of the change that a candidate can mimic to first order, R².  What the law's own parameters
               and the other chosen effects could do as well is taken out of both, since a refit would let them do it
    refit      the candidates that mimic half of it or more are fitted in the effect's place
    compare    on the same folds, trial by trial against the chosen model, in the scatter of what that leaves

A candidate is an equivalent if its held-out loss is no higher by more than chance (two standard errors of the paired
difference) and by no more than is worth telling apart: a little loss a trial or a little mass error, or, where trials
are few, less than the logarithm of `ODDS` over all of them.  So "equivalent" is about these trials and not about
physics: where drops come from one height, most effects of the speed are; `next_experiment` says which drops would
separate them.  Forms of one effect are not reported as equivalents of each other.
"""

import math
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from contactlearn.diagnosis.discrimination.contest import ODDS, robust_covariance
from contactlearn.diagnosis.search.selection import Fitted, Selection, paired_gain, without
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.identification.joint import Linearisation, linearise

ALIKE = 0.5
"""Share of the change that a candidate must be able to mimic to be refitted."""
_SIGMAS = 2.0
_LOSS = 0.02  # nats a trial
_ERROR = 0.02  # of the held-out mass error


@dataclass(frozen=True)
class Equivalent:
    """An effect that could stand in the place of a chosen one.

    `alike` is the share of the chosen effect's change that it can mimic to first order; `worse` how much higher its
    held-out loss is, in nats a trial, with its standard `error`; `fitted` the model that has it in that place.
    """

    id: EffectId
    alike: float
    worse: float
    error: float
    fitted: Fitted

    def __str__(self) -> str:
        return f"{self.id}: R² = {self.alike:.2f}, held-out loss {self.worse:+.3f} ± {self.error:.3f} nats a trial"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        numbers = {name: getattr(self, name) for name in ("alike", "worse", "error")}
        return {"name": self.id.name} | numbers | {"sentence": str(self)}


def equivalents(selection: Selection, progress: Callable[[Iterable], Iterable] = iter) -> dict[str, list[Equivalent]]:
    """For each effect of `selection.present` that was not given: who could stand in its place, the best first."""
    chosen = [name for name in selection.present.effects if name not in selection.given]
    tasks = [
        (name, other, alike, start)
        for name in chosen
        for other, (alike, start) in similarity(selection, name).items()
        if alike >= ALIKE
    ]
    found, judge = {name: [] for name in chosen}, _judge(selection) if tasks else selection
    for name, other, alike, start in progress(tasks):
        fitted = _replaced(judge, name, other, start)
        gain, error = paired_gain(judge.present, fitted)
        if _as_good(judge.present, fitted, -gain, error):
            found[name].append(Equivalent(other, alike, -gain, error, fitted))
    return {name: sorted(others, key=lambda e: e.worse) for name, others in found.items()}


def similarity(selection: Selection, name: str) -> dict[EffectId, tuple[float, Tensor]]:
    """Of each candidate for the place of a chosen effect: R², and the parameters [K] that reach it to first order."""
    present, found = selection.present, {}
    others, values = without(present, name)
    whole = _about(selection, present.effects, present.fit.values)
    for candidate, effect in selection.candidates.items():
        if candidate.name in present.effects:
            continue
        start = torch.cat((values, columns(*effect.vanished().values)))
        less = _about(selection, {**others, candidate.name: effect}, start)
        root = whole.weight.sqrt()[:, None]
        change = (root * (less.residual - whole.residual)).flatten()
        slope = (root[..., None] * -less.slope).flatten(0, 1)  # of the prediction
        _, before = _fitted(slope[:, : len(values)], change)
        step, after = _fitted(slope, change)
        found[candidate] = (1 - (after / before).item() if before > 0 else 0.0, start + step)
    return found


def _judge(selection: Selection) -> Selection:
    """The same selection with losses in the scatter of what its present model leaves; the first model's is too wide."""
    judge, present = copy(selection), selection.present
    left = selection.impacts.v_post - present.fit.model.predict(selection.impacts).v_post
    judge.scatter = robust_covariance(left)
    judge.present = judge.validated(present.effects, present.fit)
    return judge


def _as_good(chosen: Fitted, other: Fitted, worse: float, error: float) -> bool:
    trials = int(chosen.loss.isfinite().sum())
    harm = other.error.nanmean().item() / chosen.error.nanmean().item() - 1
    small = worse < max(_LOSS, math.log(ODDS) / trials) or harm < _ERROR
    return worse <= _SIGMAS * error and small


def _replaced(selection: Selection, name: str, candidate: EffectId, start: Tensor) -> Fitted:
    """The chosen model with a candidate in the place of one effect, refitted and validated on the same folds."""
    others, _ = without(selection.present, name)
    effects = {**others, candidate.name: selection.candidates[candidate]}
    near, far = selection.fit(effects, start=start), selection.fit(effects)
    return selection.validated(effects, near if near.loss <= far.loss + 1e-6 else far)


def _about(selection: Selection, effects: dict[str, Effect], theta: Tensor) -> Linearisation:
    scatter = selection.present.fit.scatter
    return linearise(selection.law, effects, selection.impacts, theta, scatter, options=selection.options)


def _fitted(slope: Tensor, change: Tensor) -> tuple[Tensor, Tensor]:
    """Least-squares step [K], and the sum of squares that is left; a column of zeros gets no step."""
    scale = slope.norm(dim=0).clamp_min(1e-300)
    step = torch.linalg.lstsq(slope / scale, change[:, None]).solution[:, 0]
    return step / scale, (change - slope / scale @ step).square().sum()
