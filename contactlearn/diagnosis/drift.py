"""Drift of the measurement: errors that wander with the sequence of trials, told from a parameter that does.

The residual of the chosen model, without effects that follow the order, is tested for dependence (`sequence`).  If
there is any, and it is added to the velocities alike whatever the impact, then the measurement drifts: effects over the
order would take its wandering for physics, and folds drawn at random would let each trial be told by its neighbours.
"""

import torch

from contactlearn.audit.result import Evidence, Finding
from contactlearn.diagnosis.search.candidates import follows_order
from contactlearn.diagnosis.search.pool import ScoredFit, Spec
from contactlearn.diagnosis.search.selection import Selection
from contactlearn.diagnosis.sequence import Dependence, blocks, dependence, drift_kind
from contactlearn.diagnosis.thresholds import SequenceThresholds
from contactlearn.diagnosis.validation import Folds
from contactlearn.effects import EffectId
from contactlearn.identification.joint import FitOptions, JointFit, linearise
from contactlearn.impacts import Impacts

_FOLDS = 5


def ordered_candidates(selection: Selection) -> set[EffectId]:
    """Return the candidates that follow the order of the trials."""
    candidates, impacts = selection.pool.candidates, selection.impacts
    return {key for key, effect in candidates.items() if follows_order(effect, impacts)}


def measurement_drift(selection: Selection, thresholds: SequenceThresholds) -> Dependence | None:
    """Find the dependence of the measurement along the sequence; None without any, or where a parameter drifts."""
    return drifts(_without_order(selection).fit, selection.impacts, selection.pool.options, thresholds)


def drifts(fit: JointFit, impacts: Impacts, options: FitOptions, thresholds: SequenceThresholds) -> Dependence | None:
    """Find the dependence of the measurement in the residual of a fitted model; None without any, or of a parameter."""
    model = fit.model
    residual = impacts.v_post - model.predict(impacts).v_post
    found = dependence(residual, impacts.order, fit.inliers, thresholds.level / 2)
    if found is None:
        return None
    unit = torch.eye(3, dtype=torch.float64)
    about = linearise(model.law, model.effects, impacts, fit.values, unit, options=options)
    kind = drift_kind(residual, -about.slope[..., :2].nan_to_num(), impacts.order)
    return found if kind == "measurement" else None


def blocked_folds(found: Dependence, selection: Selection, generator: torch.Generator) -> Folds:
    """Draw folds of blocks that are longer than the dependence, or as long as there are trials for."""
    order = selection.impacts.order
    length = min(found.block, len(order) // (2 * _FOLDS))
    return Folds.of(blocks(order, length, _FOLDS, generator), len(order))


def drift_finding(found: Dependence) -> Finding:
    """Say the size and the time scale of the drift."""
    v_x, v_y, omega = found.size
    sentence = (
        f"the measurement drifts: neighbouring residuals correlate by {found.correlation:.2f} "
        f"(95 %: {found.interval[0]:.2f} to {found.interval[1]:.2f}), over about {found.time_scale:.0f} trials; the "
        f"drifting part has standard deviations of {v_x:.2g} m/s, {v_y:.2g} m/s and {omega:.2g} rad/s, "
        f"{found.share:.0%} of the residual's variance. Effects over the order are left out, and blocks of trials are "
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


def _without_order(selection: Selection) -> ScoredFit:
    """The chosen model without effects that follow the order."""
    pool, effects = selection.pool, selection.spec.effects
    kept = frozenset(key for key in effects if not follows_order(pool.candidates[key], selection.impacts))
    spec = Spec(selection.spec.law, kept)
    return pool.fitted(spec, pool.start(spec, selection.chosen, {}))
