"""Rivals: effects that explain these data as well as a chosen one.

    change     the chosen effect's change of the predicted v_post of each trial, at its fitted values, in units of the
               scatter: the model without it minus the model with it
    screen     the share of the change that a candidate can mimic to first order, R².  The part that the law's own
               parameters and the other chosen effects could do as well is taken out of both, since a refit would do it
    refit      the candidates that mimic half of it or more are fitted in the effect's place
    compare    on the same folds, trial by trial against the chosen model, in the scatter of its residual

A candidate is a rival if its held-out loss is no higher by more than chance (two standard errors of the paired
difference) and by too little to decide: a little loss a trial or a little mass error, or, where trials are few, less
than the logarithm of the odds over all of them.  So a rival is about these trials and not about physics: where drops
come from one height, most effects of the speed are rivals; `next_experiment` says which drops would separate them.
Forms of one effect are not reported as rivals of each other.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.rivals import Rival
from contactlearn.diagnosis.search.selection import Selection, without
from contactlearn.diagnosis.thresholds import RivalThresholds
from contactlearn.diagnosis.validation import ValidatedFit, paired_gain, robust_covariance
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.identification.joint import Linearisation, linearise


@dataclass(frozen=True, kw_only=True)
class FittedRival:
    """A rival, and the model that has it in the place of the chosen effect."""

    rival: Rival
    fitted: ValidatedFit


@dataclass(frozen=True, kw_only=True)
class Mimicry:
    """The share R² of an effect's change that a candidate mimics to first order, and the parameters that do so."""

    similarity: float
    start: Float[Tensor, " k"]


def find_rivals(
    selection: Selection,
    thresholds: RivalThresholds = RivalThresholds(),
    progress: Callable[[Iterable], Iterable] = iter,
) -> dict[str, tuple[FittedRival, ...]]:
    """Find the rivals of each effect of the chosen model that was not given, the best first.

    Args:
        selection: after its run.
        thresholds: limits within which two effects are indistinguishable.
        progress: wraps the candidates that are refitted.
    """
    names = [name for name in selection.present.effects if name not in selection.given]
    tasks = [
        (name, candidate, mimicry)
        for name in names
        for candidate, mimicry in similarity(selection, name).items()
        if mimicry.similarity >= thresholds.similarity
    ]
    found: dict[str, list[FittedRival]] = {name: [] for name in names}
    if not tasks:
        return dict.fromkeys(names, ())
    scatter, chosen = _yardstick(selection)
    for name, candidate, mimicry in progress(tasks):
        fitted = _replaced(selection, name, candidate, mimicry.start, scatter)
        gain, error = paired_gain(chosen, fitted)
        if _as_good(chosen, fitted, -gain, error, thresholds):
            rival = Rival(effect=candidate, similarity=mimicry.similarity, loss_difference=-gain, standard_error=error)
            found[name].append(FittedRival(rival=rival, fitted=fitted))
    return {name: tuple(sorted(some, key=lambda one: one.rival.loss_difference)) for name, some in found.items()}


def similarity(selection: Selection, name: str) -> dict[EffectId, Mimicry]:
    """Compute how well each candidate mimics a chosen effect to first order."""
    present, found = selection.present, {}
    others, values = without(present, name)
    whole = _about(selection, present.effects, present.fit.values)
    root = whole.weight.sqrt()[:, None]
    for candidate, effect in selection.candidates.items():
        if candidate.name in present.effects:
            continue
        start = torch.cat((values, columns(*effect.vanished().values)))
        less = _about(selection, {**others, candidate.name: effect}, start)
        change = (root * (less.residual - whole.residual)).flatten()
        slope = (root[..., None] * -less.slope).flatten(0, 1)  # of the prediction
        _, before = _least_squares(slope[:, : len(values)], change)
        step, after = _least_squares(slope, change)
        share = 1 - (after / before).item() if before > 0 else 0.0
        found[candidate] = Mimicry(similarity=share, start=start + step)
    return found


def _yardstick(selection: Selection) -> tuple[Float[Tensor, "3 3"], ValidatedFit]:
    """The scatter of the chosen model's residual, and that model with its losses in this scatter."""
    present = selection.present
    scatter = robust_covariance(selection.impacts.v_post - present.fit.model.predict(selection.impacts).v_post)
    return scatter, selection.models.validated(present.effects, present.fit, scatter)


def _as_good(
    chosen: ValidatedFit, other: ValidatedFit, loss_difference: float, error: float, thresholds: RivalThresholds
) -> bool:
    """Whether another model is no worse by more than chance, and by too little to decide."""
    trials = int(chosen.loss.isfinite().sum())
    harm = other.mean_error / chosen.mean_error - 1
    little = max(thresholds.loss, math.log(thresholds.odds) / trials)
    return loss_difference <= thresholds.sigmas * error and (loss_difference < little or harm < thresholds.error)


def _replaced(
    selection: Selection, name: str, candidate: EffectId, start: Float[Tensor, " k"], scatter: Float[Tensor, "3 3"]
) -> ValidatedFit:
    """The chosen model with a candidate in the place of one effect, refitted and validated on the same folds."""
    others, _ = without(selection.present, name)
    effects = {**others, candidate.name: selection.candidates[candidate]}
    near, far = selection.models.fit(effects, start=start), selection.models.fit(effects)
    return selection.models.validated(effects, near if near.loss <= far.loss + 1e-6 else far, scatter)


def _about(selection: Selection, effects: Mapping[str, Effect], theta: Float[Tensor, " k"]) -> Linearisation:
    scatter = selection.present.fit.scatter
    return linearise(selection.law, effects, selection.impacts, theta, scatter, options=selection.options)


def _least_squares(slope: Float[Tensor, "m k"], change: Float[Tensor, " m"]) -> tuple[Tensor, Tensor]:
    """Least-squares step, and the residual sum of squares; a column of zeros gets no step."""
    scale = slope.norm(dim=0).clamp_min(1e-300)
    step = torch.linalg.lstsq(slope / scale, change[:, None]).solution[:, 0]
    return step / scale, (change - slope / scale @ step).square().sum()
