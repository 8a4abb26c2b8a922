"""Drift of the measurement: errors that wander with the sequence of trials, told from a parameter that does.

The residual of the chosen model, without effects that follow the order, is tested for dependence (`sequence`).  If
there is any, and it is added to the velocities alike whatever the impact, then the measurement drifts: effects over the
order would take its wandering for physics, and folds drawn at random would let each trial be told by its neighbours.
An effect over the order lasts beside it where the wandering is far faster: on blocks that were held out, longer than
the wandering, the effect then predicts more than nothing does, and more than velocities that change alike as slowly.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.diagnosis.search.candidates import follows_order
from contactlearn.diagnosis.search.pool import Pool, ScoredFit, Spec
from contactlearn.diagnosis.search.selection import Selection, validated
from contactlearn.diagnosis.sequence import Dependence, blocks, dependence, drift_kind
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.identification.joint import FitOptions, JointFit, linearise
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.inference.validation import Folds, robust_covariance
from contactlearn.mechanics.impacts import Impacts

_FOLDS = 5
_BLOCKS = 20  # at least, for effects over the order to be asked about beside a drift
_SLOW = 4  # cosines over the sequence by which velocities may change alike in place of an effect


@dataclass(frozen=True)
class Drift:
    """A measurement that drifts: what it leaves, and effects over the order that last beside it."""

    found: Dependence
    lasting: frozenset[EffectId] = frozenset()


def ordered_candidates(selection: Selection, drift: Drift) -> set[EffectId]:
    """Return the candidates that follow the order of the trials, without those that last beside a drift."""
    candidates, impacts = selection.pool.candidates, selection.impacts
    return {key for key, effect in candidates.items() if follows_order(effect, impacts)} - drift.lasting


def measurement_drift(selection: Selection, thresholds: Thresholds, generator: torch.Generator) -> Drift | None:
    """Find the dependence of the measurement along the sequence; None without any, or where a parameter drifts."""
    pool, without = selection.pool, _without_order(selection)
    found = drifts(without.fit, selection.impacts, pool.options, thresholds)
    lasting = selection.spec.effects - without.spec.effects
    if found is None or not lasting:
        return None if found is None else Drift(found)
    impacts, fit = selection.impacts, selection.present.fit
    rest = dependence(_left(impacts, fit), impacts.order, fit.inliers, thresholds.dependence_level)
    if rest is None or rest.block * _BLOCKS > len(impacts):
        return Drift(found)
    lasts = lasts_beside(rest, pool, selection.chosen, without, thresholds.gain_sigmas, generator)
    return Drift(rest, lasting) if lasts else Drift(found)


def lasts_beside(
    drift: Dependence, pool: Pool, whole: ScoredFit, without: ScoredFit, sigmas: float, generator: torch.Generator
) -> bool:
    """Whether effects over the order predict blocks that were held out, beside a measurement that drifts.

    Args:
        drift: of what the whole model leaves.
        pool: of the models.
        whole: the model with the effects.
        without: the same without them.
        sigmas: standard errors over the blocks by which the loss must fall.
        generator: of the blocks.
    """
    impacts, trials = pool.impacts, len(pool.impacts)
    place = impacts.order.argsort(stable=True).argsort()
    folds = Folds.of(blocks(impacts.order, drift.block, _FOLDS, generator), trials)
    scatter = robust_covariance(_left(impacts, whole.fit))
    with_them, nothing = (validated(pool, folds, one, scatter).loss for one in (whole, without))
    waves = (math.pi * ((place + 0.5) / trials).double()[:, None] * torch.arange(_SLOW + 1)).cos()
    left, each = _left(impacts, without.fit), torch.zeros(_FOLDS, trials, dtype=torch.float64)
    for k, rows in enumerate(folds.fitted):
        alike = left - waves @ torch.linalg.lstsq(waves[rows], left[rows]).solution
        each[k] = robust_distance(alike, scatter) + 0.5 * scatter.logdet()
    gain, over = nothing - with_them, folds.scores(each) - with_them
    held = gain.isfinite()
    sums = torch.zeros(int(place.max()) // drift.block + 1, dtype=torch.float64)
    sums = sums.index_add(0, place[held] // drift.block, gain[held])
    return bool(sums.sum() > sigmas * sums.square().sum().sqrt() and over[held].sum() > 0)


def drifts(fit: JointFit, impacts: Impacts, options: FitOptions, thresholds: Thresholds) -> Dependence | None:
    """Find the dependence of the measurement in the residual of a fitted model; None without any, or of a parameter."""
    model, residual = fit.model, _left(impacts, fit)
    found = dependence(residual, impacts.order, fit.inliers, thresholds.dependence_level)
    if found is None:
        return None
    unit = torch.eye(3, dtype=torch.float64)
    about = linearise(model.law, model.effects, impacts, fit.values, unit, options=options)
    kind = drift_kind(residual, -about.slope[..., :2].nan_to_num(), impacts.order)
    return found if kind == "measurement" else None


def blocked_folds(drift: Drift, selection: Selection, generator: torch.Generator) -> Folds:
    """Draw folds of blocks that are longer than the dependence, or as long as there are trials for."""
    order = selection.impacts.order
    length = min(drift.found.block, len(order) // (2 * _FOLDS))
    return Folds.of(blocks(order, length, _FOLDS, generator), len(order))


def drift_finding(drift: Drift) -> Finding:
    """Say the size and the time scale of the drift."""
    found, (v_x, v_y, omega) = drift.found, drift.found.size
    some = "Other effects" if drift.lasting else "Effects"
    sentence = (
        f"the measurement drifts: neighbouring residuals correlate by {found.correlation:.2f} "
        f"(95 %: {found.interval[0]:.2f} to {found.interval[1]:.2f}), over about {found.time_scale:.0f} trials; the "
        f"drifting part has standard deviations of {v_x:.2g} m/s, {v_y:.2g} m/s and {omega:.2g} rad/s, "
        f"{found.share:.0%} of the residual's variance. {some} over the order are left out, and blocks of trials are "
        "held out together"
    )
    evidence = (
        Evidence(quantity="correlation", value=found.correlation),
        Evidence(quantity="time_scale", value=found.time_scale, unit="trials"),
        Evidence(quantity="share", value=found.share),
        Evidence(quantity="v_x", value=v_x, unit="m/s"),
        Evidence(quantity="v_y", value=v_y, unit="m/s"),
        Evidence(quantity="omega", value=omega, unit="rad/s"),
    )
    return Finding(name="measurement_drift", sentence=sentence, evidence=evidence)


def _left(impacts: Impacts, fit: JointFit) -> Float[Tensor, "n 3"]:
    """The residual of a fitted model."""
    return impacts.v_post - fit.model.predict(impacts).v_post


def _without_order(selection: Selection) -> ScoredFit:
    """The chosen model without effects that follow the order."""
    pool, effects = selection.pool, selection.spec.effects
    kept = frozenset(key for key in effects if not follows_order(pool.candidates[key], selection.impacts))
    spec = Spec(selection.spec.law, kept)
    return pool.fitted(spec, pool.start(spec, selection.chosen, {}))
