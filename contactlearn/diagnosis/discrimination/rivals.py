"""Rivals: effects that explain these data as well as a chosen one.

    change     the chosen effect's change of the predicted v_post of each trial, at its fitted values, in units of the
               scatter: the model without it minus the model with it
    screen     the share of the change that a candidate can reproduce to first order, R².  The part that the law's own
               parameters and the other chosen effects could do as well is taken out of both, since a refit would do it
    refit      the candidates that reproduce half of it or more are fitted in the effect's place
    compare    on the same folds, trial by trial against the chosen model, in the scatter of its residual

The effects that a plausible model of the selection has in the place of the chosen one are refitted as well.
A candidate is a rival if its held-out loss is no higher by more than chance, two standard errors of the paired
difference.  One that reproduces nearly all of the change may be somewhat worse, since another form of it, which the
catalogue has not, might not be.  So a rival is about these trials and not about physics:
where drops come from one height, most effects of the speed are rivals; `next_experiment` says which drops would
separate them.  Forms of one effect are not reported as rivals of each other.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.effects import Rival
from contactlearn.diagnosis.search.pool import ScoredFit
from contactlearn.diagnosis.search.selection import Selection, predict_held_out, validated
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.inference.identification.joint import Linearisation, linearise
from contactlearn.inference.validation import ValidatedFit, paired_gain, robust_covariance

_SIMILARITY = 0.5  # share R² of an effect's change that a rival reproduces to first order, to be refitted


@dataclass(frozen=True, kw_only=True)
class FittedRival:
    """A rival, and the model that has it in the place of the chosen effect."""

    rival: Rival
    fitted: ValidatedFit


@dataclass(frozen=True, kw_only=True)
class Collinearity:
    """The share R² of an effect's change that a candidate reproduces to first order, and the parameters that do so."""

    similarity: float
    start: Float[Tensor, " k"]


_Task = tuple[EffectId, dict[EffectId, Collinearity]]
"""A chosen effect, and the candidates that may be fitted in its place."""


def find_rivals(
    selection: Selection,
    thresholds: Thresholds = Thresholds(),
    progress: Callable[[Iterable[_Task]], Iterable[_Task]] = iter,
) -> dict[EffectId, tuple[FittedRival, ...]]:
    """Find the rivals of each effect of the chosen model that was not given, the best first.

    Args:
        selection: the chosen model and what it was chosen from.
        thresholds: limits within which two effects are indistinguishable.
        progress: wraps the effects.
    """
    pool, folds, missing = selection.pool, selection.folds, selection.missing
    residual = selection.impacts.residual(selection.present.fit.model.predict(selection.impacts).v_post)
    scatter = robust_covariance(residual)  # in which all models are compared
    chosen = validated(pool, folds, selection.chosen, scatter)
    similarities = [similarity(selection, effect) for effect in missing]
    rivals_of: dict[EffectId, tuple[FittedRival, ...]] = {}
    for effect, among in progress(list(zip(missing, similarities, strict=True))):
        exchanged, _ = selection.replacements(effect)
        among = {k: c for k, c in among.items() if c.similarity >= _SIMILARITY or exchanged.get(k.name) == k}
        models = _refitted(selection, effect, among)
        rivals = list[FittedRival]()
        for (candidate, collinearity), model in zip(among.items(), models, strict=True):
            fitted = validated(pool, folds, model, scatter)
            gain, error = paired_gain(chosen, fitted)
            similar = collinearity.similarity
            rival = Rival(effect=candidate, similarity=similar, loss_difference=-gain, standard_error=error)
            if _as_good(chosen, fitted, rival, thresholds):
                fitted = replace(fitted, fit=pool.polished(model.spec)[0].fit)  # with standard errors
                rivals.append(FittedRival(rival=rival, fitted=fitted))
        rivals_of[effect] = tuple(sorted(rivals, key=lambda fitted: fitted.rival.loss_difference))
    return rivals_of


def similarity(selection: Selection, effect: EffectId) -> dict[EffectId, Collinearity]:
    """Compute how much of a chosen effect each candidate of another family reproduces to first order."""
    present, pool = selection.present, selection.pool
    others = {key: value for key, value in present.effects.items() if key != effect.name}
    others_parameters = torch.tensor([not p.name.startswith(f"{effect.name}.") for p in present.fit.parameters])
    values = present.fit.values[others_parameters]
    among = {key: e for key, e in pool.candidates.items() if key.name not in present.effects}
    if not among:
        return {}
    whole = _about(selection, present.effects, present.fit.values)
    added = {f"{key}/": e.vanished() for key, e in among.items()}
    start = torch.cat((values, *(columns(*e.values) for e in added.values())))
    less = _about(selection, others, start, added)
    root = whole.weight.sqrt()[:, None]
    change = (root * (less.residual - whole.residual)).flatten()
    slope = (root[..., None] * -less.slope).flatten(0, 1).nan_to_num(0.0, 0.0, 0.0)  # of the prediction
    _, before = _least_squares(slope[:, : len(values)], change)
    collinearities, at = {}, len(values)
    for candidate, e in among.items():
        picked = [*range(len(values)), *range(at, at + len(e.parameters))]
        at += len(e.parameters)
        step, after = _least_squares(slope[:, picked], change)
        share = 1 - (after / before).item() if before > 0 else 0.0
        collinearities[candidate] = Collinearity(similarity=share, start=start[picked] + step)
    return collinearities


def _as_good(chosen: ValidatedFit, other: ValidatedFit, rival: Rival, thresholds: Thresholds) -> bool:
    """Return whether another model is worse by chance at most, or by what a wrong functional form may cost."""
    harm = other.mean_error / chosen.mean_error - 1
    if rival.similarity >= thresholds.fit.collinearity and harm < thresholds.form_error:
        return True
    return rival.loss_difference <= thresholds.chance_sigmas * rival.standard_error


def _refitted(selection: Selection, effect: EffectId, among: Mapping[EffectId, Collinearity]) -> list[ScoredFit]:
    """The chosen model with each candidate in the place of one effect, refitted also on the same folds."""
    pool, starts = selection.pool, {}
    for candidate, collinearity in among.items():
        spec = replace(selection.spec, effects=selection.spec.effects - {effect} | {candidate})
        start = collinearity.start[-len(pool.candidates[candidate].parameters) :]
        starts[spec] = pool.start(spec, selection.chosen, {candidate: start})
    models = pool.all_fitted(starts)
    predict_held_out(pool, selection.folds, models)
    return models


def _about(
    selection: Selection,
    effects: Mapping[str, Effect],
    theta: Float[Tensor, " k"],
    vanishing: Mapping[str, Effect] = MappingProxyType({}),
) -> Linearisation:
    scatter, options = selection.present.fit.scatter, selection.pool.options
    return linearise(selection.law, effects, selection.impacts, theta, scatter, vanishing=vanishing, options=options)


def _least_squares(slope: Float[Tensor, "m k"], change: Float[Tensor, " m"]) -> tuple[Tensor, Tensor]:
    """Least-squares step, and the residual sum of squares; a column of zeros gets no step."""
    scale = slope.norm(dim=0).clamp_min(1e-300)
    step = torch.linalg.lstsq(slope / scale, change[:, None]).solution[:, 0]
    return step / scale, (change - slope / scale @ step).square().sum()
