"""Findings about units and axes: a wrong convention, a wrong moment of inertia, or data of no rigid impact.

The moment balance is stated with its two coefficients and their 95 % intervals, whether it closes or not.
"""

import math
from collections.abc import Iterable

from contactlearn.data.audit.consistency import contradictions, torque
from contactlearn.data.audit.conventions import ConventionComparison, Hypothesis, hypothesis_text, wrong_inertia
from contactlearn.data.audit.corrections import CORRECTIONS
from contactlearn.data.audit.moments import Balance, balance
from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.data.audit.thresholds import AuditThresholds, ConventionThresholds
from contactlearn.mechanics.impacts import Impacts

_INERTIA_UNITS = {1e-3: "g m²", 1e-6: "kg mm²", 1e-9: "g mm²", 1e-4: "kg cm²", 1e-7: "g cm²"}
_SHOWN = 0.005  # change of a mean contradiction from which on it is part of the evidence
_MUST = "I Δω = a r_x P_n − b r_y P_t, which must give +1 and +1,"


def convention_findings(comparison: ConventionComparison) -> list[Finding]:
    """A finding for each correction of the best hypothesis; the evidence is that of all of them together."""
    given, best = comparison.given, comparison.best
    if not best.names:
        return []
    evidence, numbers = _shared(comparison)
    alternatives = tuple(equal.names for equal in comparison.equals)
    if alternatives:
        numbers += f"; this data cannot tell it from {'; '.join(map(hypothesis_text, alternatives))}"
    findings = []
    for name in best.names:
        others = [other for other in best.names if other != name]
        together = f", together with {', '.join(others)}" if others else ""
        own, text = evidence, ""
        if name == "inertia_scaled":
            factor = (best.impacts.inertia / given.impacts.inertia)[0].item()
            own, text = (*evidence, Evidence(quantity="factor", value=factor)), f", {_factor(factor)}"
        sentence = f"{CORRECTIONS[name].description}{text}{together}: {numbers}"
        findings.append(
            Finding(
                name=name,
                sentence=sentence,
                evidence=own,
                correction=name,
                hypothesis=best.names,
                alternatives=alternatives,
            )
        )
    return findings


def _shared(comparison: ConventionComparison) -> tuple[tuple[Evidence, ...], str]:
    """Evidence for a hypothesis, and its numbers in words."""
    given, best = comparison.given, comparison.best
    before, after = given.balance, best.balance
    totals = given.total.mean().item(), best.total.mean().item()
    better = (best.total < given.total).double().mean().item()
    turned = str(before) != str(after)
    evidence = (
        *(_balance("before", before) if turned else ()),
        *_balance("after", after),
        *_answers(given, best),
        Evidence(quantity="contradictions_before", value=totals[0]),
        Evidence(quantity="contradictions_after", value=totals[1]),
        Evidence(quantity="standard_errors", value=comparison.sigmas),
        Evidence(quantity="better_in", value=better),
        Evidence(quantity="hypotheses", value=float(comparison.tried)),
    )
    numbers = f"the moment balance {_MUST} gives {before} as read and {after} corrected; " if turned else ""
    numbers += (
        f"contradictions a trial fall from {totals[0]:.2f} to {totals[1]:.2f} (mostly {_most(given, best)}; "
        f"{comparison.sigmas:.0f} standard errors, better in {better:.0%} of {len(given.total)} trials)"
    )
    return evidence, numbers


def _factor(factor: float) -> str:
    unit = next((u for scale, u in _INERTIA_UNITS.items() if abs(math.log(factor / scale)) < 0.3), None)
    return f"{factor:.3g}" + (f" (is it in {unit}?)" if unit else "")


def _balance(when: str, fit: Balance) -> Iterable[Evidence]:
    values = {"a": fit.a, "a_error": fit.a_error, "b": fit.b, "b_error": fit.b_error, "r_squared": fit.r_squared}
    return [Evidence(quantity=f"{name}_{when}", value=value) for name, value in values.items() if math.isfinite(value)]


def _answers(given: Hypothesis, best: Hypothesis) -> Iterable[Evidence]:
    """Mean contradictions that differ between two hypotheses."""
    before, after = given.means(), best.means()
    changed = [question for question in before if abs(before[question] - after[question]) > _SHOWN]
    return [
        Evidence(quantity=f"{question}_{when}", value=means[question])
        for question in changed
        for when, means in (("before", before), ("after", after))
    ]


def _most(given: Hypothesis, best: Hypothesis) -> str:
    """The question whose contradictions fall most, with their means."""
    before, after = given.means(), best.means()
    question = max(before, key=lambda name: before[name] - after[name])
    return f"{question} {before[question]:.2f} to {after[question]:.2f}"


def _with_inertia(impacts: Impacts, thresholds: AuditThresholds) -> Impacts:
    """The impacts with the inertia that balances their moments, where this is within the reach of an effect."""
    factor = torque(impacts).inertia_factor.item()
    if not 0 < factor < math.inf or wrong_inertia(factor, thresholds.conventions):
        return impacts
    return impacts.replace(inertia=factor * impacts.inertia)


def _judged(impacts: Impacts, thresholds: AuditThresholds) -> Balance:
    """The moment balance, without coefficients that these measurements leave open."""
    return balance(impacts).judged(thresholds.small_moments, thresholds.sure_moments)


def balance_findings(
    impacts: Impacts, comparison: ConventionComparison, thresholds: AuditThresholds, *, explained: bool = False
) -> list[Finding]:
    """The moment balance of the corrected impacts where it does not close, or contradictions that nothing mends.

    A small imbalance is a note, since effects may explain it: another inertia, a moment at the contact.  So is one that
    another inertia within the reach of an effect would close.  With `explained` other findings account for the
    contradictions, which are then not reported again.
    """
    fit, balanced = _judged(impacts, thresholds), _with_inertia(impacts, thresholds)
    left = contradictions(balanced, thresholds.conventions)
    means = {question: answer.mean().item() for question, answer in left.items()}
    if not fit.terms:
        del means["moment"]
    total, worst = sum(means.values()), max(means, key=lambda question: means[question])
    opened = fit.imbalance > thresholds.open_balance
    contradictory = total > thresholds.conventions.consistent and not explained
    if not opened and not contradictory:
        return []
    doubted = contradictory or _judged(balanced, thresholds).imbalance > thresholds.doubted_balance
    none = f"none of the known mistakes explains it ({comparison.tried} hypotheses compared)"
    if opened:
        sentence = f"the moment balance does not close, and {none}: {_MUST} gives {fit}"
        sentence += "" if doubted else "; a wrong inertia, or an effect with a moment at the contact, would do this"
    else:
        sentence = f"the trials contradict planar rigid impacts, and {none}: {_MUST} gives {fit}"
    if contradictory:
        sentence += f"; contradictions a trial sum to {total:.2f}, mostly {worst} {means[worst]:.2f}"
    evidence = (
        *_balance("measured", fit),
        Evidence(quantity="imbalance", value=min(fit.imbalance, 1e3)),
        Evidence(quantity="contradictions", value=total),
        Evidence(quantity="hypotheses", value=float(comparison.tried)),
    )
    name = "moment_balance_open" if opened else "contradictions"
    return [Finding(name=name, sentence=sentence, evidence=evidence, mistake=doubted)]


def consistent_note(impacts: Impacts, thresholds: AuditThresholds) -> Finding:
    """Say that nothing contradicts planar rigid impacts, with the moment balance that was measured."""
    fit = _judged(impacts, thresholds)
    limit = thresholds.open_balance
    if not fit.terms:
        closes = "cannot be judged: there is next to no moment in these data"
    elif fit.tested > thresholds.tested_balance:
        closes = "is hardly tested by these data"
    elif any(low > 1 + limit or high < 1 - limit for _, low, high in fit.terms.values()):
        closes = (
            "is within what noise and physics can do, but its coefficients are not 1 (noise of the velocities, an "
            "inertia that is off, or something after contact would do this)"
        )
    else:
        closes = "closes"
    sentence = (
        "the measurements are consistent with planar rigid impacts: columns, units, axes, order, energy and contact "
        f"points; the moment balance {closes}"
    )
    sentence += f": I Δω = a r_x P_n − b r_y P_t gives {fit}" if fit.terms else ""
    return Finding(name="consistent", sentence=sentence, evidence=(*_balance("measured", fit),), mistake=False)


def inertia_findings(impacts: Impacts, thresholds: ConventionThresholds) -> list[Finding]:
    """A wrong moment of inertia: both terms of the balance ask for the same factor, too large for physics.

    The contradictions fall too little with it for `compare`.
    """
    factor, fit = torque(impacts).inertia_factor.item(), balance(impacts)
    terms = ((fit.a, fit.a_error), (fit.b, fit.b_error))
    asked = [x for x, error in terms if error < thresholds.inertia_error * abs(x)]
    if not wrong_inertia(factor, thresholds) or not asked or fit.r_squared < thresholds.inertia_r_squared:
        return []
    if any(abs(x * factor - 1) > thresholds.inertia_agreement for x in asked):
        return []
    sentence = (
        f"{CORRECTIONS['inertia_scaled'].description}, {_factor(factor)}: as read, I Δω = a r_x P_n − b r_y P_t, which "
        f"must give +1 and +1, gives {fit}"
    )
    evidence = (Evidence(quantity="factor", value=factor), *_balance("before", fit))
    return [Finding(name="inertia_scaled", sentence=sentence, evidence=evidence, correction="inertia_scaled")]


def impossible_findings(comparison: ConventionComparison, thresholds: AuditThresholds) -> list[Finding]:
    """Data that no planar impact of a rigid body can have produced under any hypothesis; fatal."""
    best = comparison.best
    share, means, fit = max(0.0, torque(best.impacts).explained.item()), best.means(), best.balance
    moment = best.answers["moment"]
    surely = moment.mean().item() - 2 * moment.std().item() / math.sqrt(len(moment))
    told = bool(_judged(best.impacts, thresholds).terms)
    unbalanced = told and surely > thresholds.imbalance and share < thresholds.unexplained
    reasons = {
        f"the moment balance leaves {means['moment']:.0%} of its terms over and explains {share:.0%} of Δω "
        f"(it gives {fit})": unbalanced,
        f"the floor pulls in {means['push']:.0%} of trials": means["push"] > thresholds.reversed_trials,
        f"{means['approach']:.0%} of trials do not approach the floor": means["approach"] > thresholds.reversed_trials,
    }
    said = [reason for reason, holds in reasons.items() if holds]
    if not said:
        return []
    sentence = (
        f"no planar impact of a rigid body can have produced this data: under the best of {comparison.tried} "
        f"hypotheses about units and axes ({best}) {'; '.join(said)}. Do before and after belong to the same trials?"
    )
    evidence = (
        Evidence(quantity="hypotheses", value=float(comparison.tried)),
        Evidence(quantity="explained", value=share),
        *_balance("best", fit),
        *(Evidence(quantity=question, value=mean) for question, mean in means.items()),
    )
    return [Finding(name="impossible", sentence=sentence, evidence=evidence, fatal=True, hypothesis=best.names)]
