"""Conventions of units and axes: hypotheses about them, compared by the contradictions in the measurements under each.

A hypothesis is a few named corrections; `consistency.contradictions` makes the same tests under each.  The moment
balance alone knows the signs of its two terms only: turning θ looks like turning r.  The other tests distinguish
these, except for equivalent ones (a disc seen from behind).  Contradictions are bounded, so that no outlier
decides; their mean over the trials is compared pairwise, with its standard error.

All sensible combinations of up to five corrections are compared, shorter ones first.  Those of one correction are
compared on all trials, longer ones on a sample of them, from which the best few go on to all trials.  A hypothesis is
accepted only if the moments balance under it and contradictions are negligible; otherwise the data stay as given.

Each finding states the moment balance with its two coefficients and their 95 % intervals, whether it closes or not.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.consistency import Balance, Columns, balance, contradictions, torque
from contactlearn.data.audit.corrections import CORRECTIONS, units_and_axes
from contactlearn.data.audit.result import Evidence, Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.impacts import Impacts

AXES = (
    "swapped_pre_post",
    "mirrored_y",
    "swapped_axes",
    "mirrored_x",
    "mirrored_theta",
    "mirrored_omega",
    "contact_point_sign",
    "contact_point_mirrored",
)
DEGREES = ("degrees_omega", "degrees_theta", "degrees")
UNITS = (*DEGREES, "millimetres", "millimetres_velocity", "grams", "inertia_scaled")
BALANCED = set(UNITS) - {"degrees_theta"}
"""Units that the moment balance depends on."""
_SIGMAS = 5.0  # standard errors of the fall of contradictions: up to some thousand hypotheses are compared
_INDISTINCT = 0.02  # difference of the sum of contradictions below which two hypotheses are equivalent
_EXPLAINED = 0.5  # share of Δω that the balance explains under other units, which else only shrink a Δω that is noise
_INERTIA_ERROR = 0.1  # relative standard error of a term of the balance that estimates the inertia
_INERTIA_AGREEMENT = 0.2  # relative difference up to which the terms ask for the same factor
_INERTIA_R_SQUARED = 0.8  # share of Δω that the fitted balance explains for the same
_TESTED = 0.1  # half-width of the 95 % interval of the better known coefficient above which the balance is untested
_SMALL_MOMENTS = 0.05  # median of a term, of |Δv| / ρ, up to which it may be noise of some 5 % of the speeds
_SURE_MOMENTS = 4.0  # standard errors from 0 from which on the coefficient of such a term is judged
_REVERSED = 0.4  # share of trials with a pulling floor, or without approach, from which on no impact made the data
_STEPS = (*AXES[:3], "mirrored_y", *AXES[3:], *UNITS)
"""Corrections in the order in which they are applied.

A swap of the axes and a mirror of y are a turn by 90°, whose sense depends on which of them comes first.
"""
_TURN = 3  # step of the mirror of y that follows a swap
_DEPTH = 5  # corrections at once
_SAMPLE, _FINALISTS = 64, 8  # trials on which combinations are compared, and combinations that go on to all trials


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Corrections by name, in the order in which they are applied, and the impacts that they give."""

    names: tuple[str, ...]
    impacts: Impacts
    thresholds: AuditThresholds

    @cached_property
    def answers(self) -> dict[str, Float[Tensor, " n"]]:
        """Contradictions of each trial by question."""
        return contradictions(self.impacts)

    @cached_property
    def total(self) -> Float[Tensor, " n"]:
        """Sum of the contradictions of each trial."""
        first, *others = self.answers.values()
        return sum(others, first)

    @property
    def score(self) -> float:
        """Mean sum of the contradictions."""
        return self.total.mean().item()

    @cached_property
    def balance(self) -> Balance:
        """The moment balance, fitted."""
        return balance(self.impacts)

    @property
    def closed(self) -> bool:
        """Whether contradictions are negligible, those of the moments included."""
        return self.score < self.thresholds.consistent

    def means(self) -> dict[str, float]:
        """Mean contradiction by question."""
        return {question: answer.mean().item() for question, answer in self.answers.items()}

    def __str__(self) -> str:
        return hypothesis_text(self.names)


def hypothesis_text(names: tuple[str, ...]) -> str:
    """Write a hypothesis as its corrections, for display."""
    return " + ".join(names) or "as they are"


@dataclass(frozen=True, kw_only=True)
class ConventionComparison:
    """The data as given, the best hypothesis, others of its length as good as it, and the number compared."""

    given: Hypothesis
    best: Hypothesis
    equals: tuple[Hypothesis, ...]
    tried: int

    @property
    def gain(self) -> float:
        """Fall of the mean sum of contradictions under the best hypothesis."""
        return (self.given.total - self.best.total).mean().item()

    @property
    def sigmas(self) -> float:
        """The same in standard errors."""
        return _sigmas(self.given.total - self.best.total)


def _sigmas(gain: Float[Tensor, " n"]) -> float:
    error = gain.std() / math.sqrt(len(gain)) if len(gain) > 1 else torch.tensor(math.inf)
    return (gain.mean() / error.clamp_min(1e-3)).item()


def compare(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> ConventionComparison:
    """Find the best of the smallest hypotheses that are accepted, or the data as given where there is none."""
    given = Hypothesis(names=(), impacts=impacts.replace(validate=False), thresholds=thresholds)
    tried = 1
    for depth in range(1, _DEPTH + 1):
        if depth > 1 and given.closed:
            break
        screened = _screened(given.impacts, depth, thresholds)
        tried += len(screened.names)
        applied = (_applied(given, names) for names in screened.best())
        found = sorted((h for h in applied if h is not None), key=lambda h: h.score)
        new = next((h for h in found if _better(h, given)), None)
        if new is not None:
            equal = [h for h in found if h is new or new.score <= h.score < new.score + _INDISTINCT]
            best, *equals = sorted(equal, key=lambda h: [*map([*CORRECTIONS].index, h.names)])
            return ConventionComparison(given=given, best=best, equals=tuple(equals), tried=tried)
    return ConventionComparison(given=given, best=given, equals=(), tried=tried)


def _better(new: Hypothesis, given: Hypothesis) -> bool:
    """Whether a hypothesis is clearly better; other units must not merely shrink a Δω that is all noise."""
    gain, thresholds = given.total - new.total, new.thresholds
    if gain.mean().item() < thresholds.convention_gain * len(new.names) or _sigmas(gain) < _SIGMAS:
        return False
    explained = torque(new.impacts).explained.item() > _EXPLAINED
    return (explained or not BALANCED.intersection(new.names)) and new.closed


class _Screened(NamedTuple):
    """Hypotheses by name, and the mean sum of the contradictions under each; infinite for those that are excluded."""

    names: list[tuple[str, ...]]
    scores: Float[Tensor, " hypotheses"]

    def best(self) -> list[tuple[str, ...]]:
        """The few with the fewest contradictions."""
        ranked = self.scores.argsort(stable=True)[:_FINALISTS].tolist()
        return [self.names[k] for k in ranked if self.scores[k] < math.inf]


def _screened(impacts: Impacts, depth: int, thresholds: AuditThresholds) -> _Screened:
    """Compare all hypotheses of so many corrections, more than one of them on a sample of the trials."""
    if depth > 1 and len(impacts) > _SAMPLE:
        impacts = impacts[torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0))[:_SAMPLE]]
    names: list[tuple[str, ...]] = [()]
    columns = Columns.of(impacts)
    for step, name in enumerate(_STEPS):
        before = [k for k, have in enumerate(names) if len(have) < depth and _sensible(have, step)]
        changed, plausible = _changed(columns[torch.tensor(before, dtype=torch.long)], name, thresholds)
        names += [(*names[k], name) for k, good in zip(before, plausible.tolist(), strict=True) if good]
        columns = columns.and_also(changed[plausible])
    long = torch.tensor([len(have) == depth for have in names])
    names, columns = [have for have in names if len(have) == depth], columns[long]
    first, *others = contradictions(columns).values()
    shrunk = torch.tensor([bool(BALANCED.intersection(have)) for have in names])
    shrunk &= torque(columns).explained <= _EXPLAINED
    return _Screened(names, sum(others, first).mean(-1).masked_fill(shrunk, math.inf))


def _sensible(have: tuple[str, ...], step: int) -> bool:
    """Whether a step may follow others.

    An angle is converted from degrees once, and only one correction changes I relative to m.  Before and after are not
    swapped together with two other changes of the axes: a mirrored film run backwards explains any body that gains
    energy.
    """
    name, names = _STEPS[step], {*have, _STEPS[step]}
    if name in have or (step == _TURN and "swapped_axes" not in have):
        return False
    if len(names.intersection(DEGREES)) > 1 or names >= {"grams", "inertia_scaled"}:
        return False
    return "swapped_pre_post" not in names or len(names.intersection(AXES)) < 3


def _changed(columns: Columns, name: str, thresholds: AuditThresholds) -> tuple[Columns, Tensor]:
    """Columns [B] after a correction, and the hypotheses [B] for which it is plausible.

    Another inertia is not where the balance requires a negative one, or one that is only a little different.
    """
    if name != "inertia_scaled":
        return units_and_axes(columns, name), torch.ones(len(columns.mass), dtype=torch.bool)
    factor = torque(columns).inertia_factor
    plausible = (factor.log().abs() > math.log(thresholds.inertia_factor)) & factor.isfinite()
    return columns.replace(inertia=columns.inertia * factor[:, None]), plausible


def _applied(given: Hypothesis, names: tuple[str, ...]) -> Hypothesis | None:
    """Apply corrections to all trials; None where these require no other inertia, though the sample did."""
    impacts, thresholds = given.impacts, given.thresholds
    for name in names:
        if name == "inertia_scaled" and not wrong_inertia(torque(impacts).inertia_factor.item(), thresholds):
            return None
        impacts = CORRECTIONS[name].function(impacts, AuditThresholds())  # none of these drops a trial
    return Hypothesis(names=names, impacts=impacts, thresholds=thresholds)


def wrong_inertia(factor: float, thresholds: AuditThresholds) -> bool:
    """Whether a factor on I is a mistake in the data; a smaller one is the effect `inertia_error`."""
    return 0 < factor < math.inf and abs(math.log(factor)) > math.log(thresholds.inertia_factor)


_INERTIA_UNITS = {1e-3: "g m²", 1e-6: "kg mm²", 1e-9: "g mm²", 1e-4: "kg cm²", 1e-7: "g cm²"}
_SHOWN = 0.005  # change of a mean contradiction from which on it is part of the evidence
_MUST = "I Δω = a r_x P_n − b r_y P_t, which must give +1 and +1,"
_Quantity = tuple[str, float]


def convention_findings(comparison: ConventionComparison) -> list[Finding]:
    """A finding for each correction of the best hypothesis; the evidence is that of all of them together."""
    given, best = comparison.given, comparison.best
    if not best.names:
        return []
    evidence, numbers = _comparison_evidence(comparison)
    alternatives = tuple(equal.names for equal in comparison.equals)
    if alternatives:
        numbers += f"; these data cannot distinguish it from {'; '.join(map(hypothesis_text, alternatives))}"
    findings = []
    for name in best.names:
        others = ", ".join(other for other in best.names if other != name)
        factor = (best.impacts.inertia / given.impacts.inertia)[0].item() if name == "inertia_scaled" else None
        text = CORRECTIONS[name].description + ("" if factor is None else f", {_factor(factor)}")
        finding = Finding(
            name=name,
            sentence=f"{text}{others and f', together with {others}'}: {numbers}",
            evidence=evidence if factor is None else (*evidence, *evidence_of(("factor", factor))),
            correction=name,
            hypothesis=best.names,
            alternatives=alternatives,
        )
        findings.append(finding)
    return findings


def _comparison_evidence(comparison: ConventionComparison) -> tuple[tuple[Evidence, ...], str]:
    """Evidence for a hypothesis, and its numbers in words."""
    given, best = comparison.given, comparison.best
    before, after = given.balance, best.balance
    means = {question: (mean, best.means()[question]) for question, mean in given.means().items()}
    total = given.total.mean().item(), best.total.mean().item()
    better = (best.total < given.total).double().mean().item()
    turned = str(before) != str(after)
    changed = {question: pair for question, pair in means.items() if abs(pair[0] - pair[1]) > _SHOWN}
    evidence = evidence_of(
        *(_coefficients("before", before) if turned else ()),
        *_coefficients("after", after),
        *((f"{name}_{when}", pair[k]) for name, pair in changed.items() for k, when in enumerate(("before", "after"))),
        ("contradictions_before", total[0]),
        ("contradictions_after", total[1]),
        ("standard_errors", comparison.sigmas),
        ("better_in", better),
        ("hypotheses", float(comparison.tried)),
    )
    most = max(means, key=lambda question: means[question][0] - means[question][1])
    numbers = f"the moment balance {_MUST} gives {before} as read and {after} corrected; " if turned else ""
    numbers += (
        f"the contradictions per trial fall from {total[0]:.2f} to {total[1]:.2f} (mostly {most} {means[most][0]:.2f} "
        f"to {means[most][1]:.2f}; {comparison.sigmas:.0f} standard errors, better in {better:.0%} of "
        f"{len(given.total)} trials)"
    )
    return evidence, numbers


def _factor(factor: float) -> str:
    unit = next((u for scale, u in _INERTIA_UNITS.items() if abs(math.log(factor / scale)) < 0.3), None)
    return f"{factor:.3g}" + (f" (is it in {unit}?)" if unit else "")


def _coefficients(when: str, fit: Balance) -> list[_Quantity]:
    """Coefficients of the moment balance as evidence."""
    values = {"a": fit.a, "a_error": fit.a_error, "b": fit.b, "b_error": fit.b_error, "r_squared": fit.r_squared}
    return [(f"{name}_{when}", value) for name, value in values.items() if math.isfinite(value)]


def _judged(impacts: Impacts) -> Balance:
    """The moment balance, without coefficients that these measurements leave open."""
    return balance(impacts).judged(_SMALL_MOMENTS, _SURE_MOMENTS)


def balance_findings(
    impacts: Impacts, comparison: ConventionComparison, thresholds: AuditThresholds, *, explained: bool = False
) -> list[Finding]:
    """The moment balance of the corrected impacts where it does not close, or contradictions that nothing corrects.

    A small imbalance is a note, since effects may explain it: another inertia, a moment at the contact.  So is one that
    another inertia within the reach of an effect would close.  With `explained` other findings account for the
    contradictions, which are then not reported again.
    """
    fit, balanced, factor = _judged(impacts), impacts, torque(impacts).inertia_factor.item()
    if 0 < factor < math.inf and not wrong_inertia(factor, thresholds):  # within the reach of an effect
        balanced = impacts.replace(inertia=factor * impacts.inertia)
    answers = contradictions(balanced)
    means = {question: answer.mean().item() for question, answer in answers.items()}
    if not fit.terms:
        del means["moment"]
    total, worst = sum(means.values()), max(means, key=lambda question: means[question])
    opened = fit.imbalance > thresholds.open_balance
    contradictory = total > thresholds.consistent and not explained
    if not opened and not contradictory:
        return []
    doubted = contradictory or _judged(balanced).imbalance > thresholds.doubted_balance
    rule = "the moment balance does not close" if opened else "the trials contradict planar rigid impacts"
    sentence = (
        f"{rule}, and none of the known mistakes explains it ({comparison.tried} hypotheses compared): {_MUST} gives "
        f"{fit}"
    )
    if opened and not doubted:
        sentence += "; a wrong inertia, or an effect with a moment at the contact, would have this effect"
    if contradictory:
        sentence += f"; the contradictions per trial sum to {total:.2f}, mostly {worst} {means[worst]:.2f}"
    evidence = evidence_of(
        *_coefficients("measured", fit),
        ("imbalance", min(fit.imbalance, 1e3)),
        ("contradictions", total),
        ("hypotheses", float(comparison.tried)),
    )
    name = "moment_balance_open" if opened else "contradictions"
    return [Finding(name=name, sentence=sentence, evidence=evidence, mistake=doubted)]


def consistent_note(impacts: Impacts, thresholds: AuditThresholds) -> Finding:
    """Note that nothing contradicts planar rigid impacts, with the moment balance that was measured."""
    fit = _judged(impacts)
    limit = thresholds.open_balance
    if not fit.terms:
        closes = "cannot be judged: the moments in these data are negligible"
    elif fit.tested > _TESTED:
        closes = "is weakly tested by these data"
    elif any(low > 1 + limit or high < 1 - limit for _, low, high in fit.terms.values()):
        closes = (
            "is within the reach of noise and physics, but its coefficients are not 1 (possible causes: noise of the "
            "velocities, a wrong inertia, or something after contact)"
        )
    else:
        closes = "closes"
    sentence = (
        "the measurements are consistent with planar rigid impacts: columns, units, axes, order, energy and contact "
        f"points; the moment balance {closes}"
    )
    sentence += f": I Δω = a r_x P_n − b r_y P_t gives {fit}" if fit.terms else ""
    evidence = evidence_of(*_coefficients("measured", fit))
    return Finding(name="consistent", sentence=sentence, evidence=evidence, mistake=False)


def inertia_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """A wrong moment of inertia: both terms of the balance imply the same factor, too large for physics.

    The contradictions fall too little with it for `compare`.
    """
    factor, fit = torque(impacts).inertia_factor.item(), balance(impacts)
    terms = ((fit.a, fit.a_error), (fit.b, fit.b_error))
    precise = [x for x, error in terms if error < _INERTIA_ERROR * abs(x)]
    if not wrong_inertia(factor, thresholds) or not precise or fit.r_squared < _INERTIA_R_SQUARED:
        return []
    if any(abs(x * factor - 1) > _INERTIA_AGREEMENT for x in precise):
        return []
    description = CORRECTIONS["inertia_scaled"].description
    sentence = f"{description}, {_factor(factor)}: as read, the balance {_MUST} gives {fit}"
    evidence = evidence_of(("factor", factor), *_coefficients("before", fit))
    return [Finding(name="inertia_scaled", sentence=sentence, evidence=evidence, correction="inertia_scaled")]


def impossible_findings(comparison: ConventionComparison, thresholds: AuditThresholds) -> list[Finding]:
    """Data that no planar impact of a rigid body can have produced under any hypothesis; fatal."""
    best = comparison.best
    share, means, fit = max(0.0, torque(best.impacts).explained.item()), best.means(), best.balance
    moment = best.answers["moment"]
    at_least = moment.mean().item() - 2 * moment.std().item() / math.sqrt(len(moment))
    judged = bool(_judged(best.impacts).terms)
    unbalanced = judged and at_least > thresholds.impossible and share < thresholds.impossible
    reasons = {
        f"the residual of the moment balance is {means['moment']:.0%} of its terms, and the balance explains "
        f"{share:.0%} of Δω (it gives {fit})": unbalanced,
        f"the floor pulls in {means['push']:.0%} of trials": means["push"] > _REVERSED,
        f"{means['approach']:.0%} of trials do not approach the floor": means["approach"] > _REVERSED,
    }
    reasons = [reason for reason, holds in reasons.items() if holds]
    if not reasons:
        return []
    sentence = (
        f"no planar impact of a rigid body can have produced these data: under the best of {comparison.tried} "
        f"hypotheses about units and axes ({best}) {'; '.join(reasons)}. Do before and after belong to the same trials?"
    )
    evidence = evidence_of(
        ("hypotheses", float(comparison.tried)), ("explained", share), *_coefficients("best", fit), *means.items()
    )
    return [Finding(name="impossible", sentence=sentence, evidence=evidence, fatal=True, hypothesis=best.names)]
