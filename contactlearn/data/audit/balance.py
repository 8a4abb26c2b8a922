"""The moment balance after units and axes are corrected: a wrong inertia, or an imbalance without explanation."""

import math

import torch

from contactlearn.core.numerics import number
from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import CORRECTIONS
from contactlearn.data.audit.moments import (
    BALANCE,
    Balance,
    balance,
    drag_factor,
    inertia_text,
    median_gyration,
    needed_inertia,
    torque,
)
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.rig import simplest_rig
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.apparatus import PROPERTIES, Row
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc
from contactlearn.mechanics.space import PLANE

_INERTIA_ERROR = 0.1  # relative standard error of a term of the balance that estimates the inertia
_INERTIA_AGREEMENT = 0.2  # relative difference up to which the terms ask for the same factor
_INERTIA_R_SQUARED = 0.8  # share of Δω that the fitted balance explains for the same, and for any cause in physics
_UNTOLD_R_SQUARED = 0.5  # the same below which the note says how little it is
_DRAG = 2.0  # factor on the velocities after contact up to which a drag is the effect `side_drag`
_BALLS = {"a solid ball (2/5 m R²)": 2 / 5, "a hollow ball (2/3 m R²)": 2 / 3, "a hoop (m R²)": 1.0}  # I/m over R²
_EXACT = 1e-9  # largest imbalance of any trial that is one of roundings
_TESTED = 0.1  # half-width of the 95 % interval of the better known coefficient above which the balance is untested


def inertia_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Find a wrong moment of inertia: both terms of the balance imply the same factor, too large for physics.

    The contradictions fall too little with it for `compare`.
    """
    factor, fit = needed_inertia(impacts, thresholds).item(), balance(impacts)
    terms = ((fit.a, fit.a_error), (fit.b, fit.b_error))
    precise = [x for x, error in terms if error < _INERTIA_ERROR * abs(x)]
    if math.isnan(factor) or not precise or fit.r_squared < _INERTIA_R_SQUARED:
        return []
    if any(abs(x * factor - 1) > _INERTIA_AGREEMENT for x in precise):
        return []
    description = CORRECTIONS["inertia_scaled"].description
    evidence = evidence_of(("factor", factor), *fit.coefficients("before").items())
    return [
        Finding(
            name="inertia_scaled",
            sentence=f"{description}, {inertia_text(factor)}",
            grounds=f"as read, {_must(impacts)} gives {fit}",
            evidence=evidence,
            correction="inertia_scaled",
        )
    ]


def balance_finding(impacts: Impacts, tried: int, thresholds: AuditThresholds, *, explained: bool) -> Finding:
    """Report an open moment balance of the corrected impacts, or contradictions that nothing corrects.

    A small imbalance is a note, since effects may explain it: another inertia, a moment at the contact.  An imbalance
    that an inertia or a drag within the reach of an effect would close is a note as well.

    Args:
        impacts: as the other findings would correct them.
        tried: number of hypotheses about units and axes that were compared.
        thresholds: limits of the imbalance and of the contradictions.
        explained: whether other findings account for the contradictions, which are then not reported again.
    """
    fit = balance(impacts).judged
    balanced = min(_within_reach(impacts, thresholds), key=lambda some: balance(some).judged.imbalance)
    answers = contradictions(balanced)
    means = {question: answer.mean().item() for question, answer in answers.items()}
    if not fit.terms:
        del means["moment"]
    total, worst = sum(means.values()), max(means, key=lambda question: means[question])
    opened = fit.imbalance > thresholds.open_balance
    contradictory = total > thresholds.consistent and not explained
    if not opened and not contradictory:
        return _consistent_note(impacts, fit)
    blurred = fit.imbalance > thresholds.doubted_balance and fit.r_squared < _INERTIA_R_SQUARED
    doubted = contradictory or blurred or balance(balanced).judged.imbalance > thresholds.doubted_balance
    rule = "the moment balance does not close" if opened else f"the trials contradict {_rigid(impacts)}"
    sentence = f"{rule}, and no mistake of units or axes explains it ({tried} hypotheses compared): {_must(impacts)} "
    sentence += f"gives {fit}"
    if opened and not doubted:
        sentence += "; a wrong inertia, a drag after contact, or a moment at the contact would have this effect"
        sentence += _proposal(impacts, thresholds) if impacts.space is PLANE else ""
    if contradictory:
        sentence += f"; the contradictions per trial sum to {total:.2f}, mostly {worst} {means[worst]:.2f}"
    evidence = evidence_of(
        *fit.coefficients("measured").items(),
        ("imbalance", min(fit.imbalance, 1e3)),
        ("contradictions", total),
        ("hypotheses", float(tried)),
    )
    name = "moment_balance_open" if opened else "contradictions"
    return Finding(name=name, sentence=sentence, evidence=evidence, mistake=doubted)


def _must(impacts: Impacts) -> str:
    return f"{BALANCE[impacts.space.name]}, which should give a = b = 1,"


def _rigid(impacts: Impacts) -> str:
    return "planar rigid impacts" if impacts.space is PLANE else "rigid impacts"


def _proposal(impacts: Impacts, thresholds: AuditThresholds) -> str:
    """Say which rig would close the balance, how well physics would, and what only recordings can tell."""
    fit = simplest_rig(impacts, thresholds)
    if fit is None:
        return ""
    rows = [Row(name=name, estimate=one, **PROPERTIES[name]) for name, one in fit.estimates.items()]
    differing = [row for row in rows if row.differs]
    alone = [row.name for row in differing] == ["inertia"]
    if alone and isinstance(impacts.shape, Disc):
        ratio = math.exp(differing[0].estimate.value) * median_gyration(impacts).item() / impacts.shape.radius**2
        name, most = min(_BALLS.items(), key=lambda one: abs(math.log(ratio / one[1])))
        likely = f": is the body {name}?" if abs(math.log(ratio / most)) < _INERTIA_ERROR else ""
        return (
            f"; the data are consistent with an inertia of {number(2 * ratio)} times that of a uniform disc{likely} "
            "(data.correct=[inertia_scaled] takes it)"
        )
    change = " and ".join(map(str, differing))
    if alone:
        change = f"an inertia of {differing[0].measured} times the stated one (data.correct=[inertia_scaled])"
    removed, physical = (max(1 - left / fit.given, 0.0) for left in (fit.remaining, fit.physical))
    return (
        f"; {change} would remove {removed:.0%} of the residual, a single moment at the contact or a loss after it "
        f"{physical:.0%}: contactlearn diagnose weighs them, and recordings would decide"
    )


def _within_reach(impacts: Impacts, thresholds: AuditThresholds) -> list[Impacts]:
    """List the impacts as measured, and as they balance best with another inertia, and without drag after contact."""
    found, factor = [impacts], torque(impacts).inertia_factor.item()
    if abs(math.log(factor)) <= math.log(thresholds.inertia_factor):  # nan is not
        found.append(impacts.replace(inertia=factor * impacts.inertia))
    gain = drag_factor(impacts)
    if 1 < gain < _DRAG:
        d, D = impacts.space.d, impacts.space.D
        faster = torch.tensor([gain] * d + [1.0] * (D - d), dtype=torch.float64)
        found.append(impacts.replace(v_post=impacts.v_post * faster, validate=False))
    return found


def _consistent_note(impacts: Impacts, fit: Balance) -> Finding:
    """Note that nothing contradicts rigid impacts, with the moment balance that was measured.

    It closes only where the interval of each coefficient, to two decimals, has 1 in it.  Measured numbers never close
    it to the last digit: spins or contact points that were computed from it do, as those of a simulation.  Noise of
    the moments may shrink the coefficients to R², so of a small one nothing follows.
    """
    if not fit.terms:
        closes = "cannot be judged: the moments in these data are negligible, or in one proportion in all trials"
    elif fit.tested > _TESTED:
        closes = "is weakly tested by these data"
    elif any(round(low, 2) > 1 or round(high, 2) < 1 for _, low, high in fit.terms.values()):
        most = max(abs(x - 1) for x, _, _ in fit.terms.values())
        closes = (
            f"deviates by {most:.0%}, no more than noise of the velocities, a delay of the pose, a tilted floor, a "
            "wrong inertia or a force after contact can cause"
        )
    elif torque(impacts).imbalance.max() < _EXACT:
        closes = (
            "closes exactly, as only a simulation does, or spins or contact points that were computed from it: it is "
            "no evidence that they are right"
        )
    else:
        closes = "closes"
    agree = f"the measurements are consistent with {_rigid(impacts)}"
    sentence = f"{agree}: columns, units, axes, order, energy and contact points; the moment balance {closes}"
    if fit.terms and fit.r_squared < _UNTOLD_R_SQUARED:
        sentence = (
            f"{agree}, but the moments explain only {max(fit.r_squared, 0):.0%} of the change of the spin: the rest is "
            "noise of the spins, or they are not what their columns say"
        )
    sentence += f": {BALANCE[impacts.space.name]} gives {fit}" if fit.terms else ""
    evidence = evidence_of(*fit.coefficients("measured").items())
    return Finding(name="consistent", sentence=sentence, evidence=evidence, mistake=False)
