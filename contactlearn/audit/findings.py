"""The audit: what is wrong with the measurements themselves, before any physics is fitted to them.

    units, columns, axes      one finding for each correction of the best hypothesis of `frame`
    inertia_scaled            the moments balance, but for one factor on I, by more than 40 %
    duplicated_trials         rows that repeat an earlier one bit for bit
    out_of_order              times that contradict the order of the trials
    gross_outliers            trials that cannot be what was measured
    energy_gained             more trials than noise explains leave with more energy than they came with
    contact_point_off_shape   r is not where the body's shape touches the floor at θ
    impossible                no hypothesis balances the moments, pushes and approaches: fatal

Findings are about mistakes that a correction, or a look at the set-up, mends.  Physical effects (a tilted
floor, a wrong centre of mass, a moment at the contact) leave them alone unless they are enormous.  Later
findings are made on the data as the earlier ones would correct it; nothing is corrected here.
"""

import math
from dataclasses import dataclass

import torch

from contactlearn.audit.conventions import Balance, Comparison, Hypothesis, balance, compare, explained, wrong_inertia
from contactlearn.audit.corrections import (
    CORRECTIONS,
    correct,
    gross_outliers,
    inertia_factor,
    kinetic_energy,
    repeated,
)
from contactlearn.impacts import Impacts
from contactlearn.shapes import contact_point

FEWEST = 10
"""Trials below which nothing is said about units and axes."""
_ENERGETIC = 0.05  # share of trials that may gain a quarter of their energy
_FEW = 0.2  # share of trials up to which outliers are dropped, rather than the data doubted
_OFF = 0.15  # of |r|: how far the contact point may be from the shape's, in the median
_SECONDS = 0.5  # a trial takes longer than this, so a column of times that spans less is no common clock

_INERTIA_UNITS = {1e-3: "g m²", 1e-6: "kg mm²", 1e-9: "g mm²", 1e-4: "kg cm²", 1e-7: "g cm²"}


@dataclass(frozen=True)
class Finding:
    """Something wrong with the data: in words, with the numbers behind it, and the correction that undoes it."""

    name: str
    sentence: str
    evidence: dict[str, float | str]
    correction: str | None = None
    fatal: bool = False
    mistake: bool = True  # else something that has to be known, but nobody's mistake


def audit(impacts: Impacts) -> tuple[Finding, ...]:
    """What is wrong with the measurements, most fundamental first; empty where nothing is.

    The impacts may be `suspect`.  The corrections of all findings, in their order, are what
    `data.correct=[…]` takes.
    """
    findings = _duplicates(impacts)
    sound = impacts.replace(suspect=True)[~repeated(impacts)]
    if len(sound) >= FEWEST:
        comparison = compare(sound)
        fatal = _impossible(comparison)
        if fatal:
            return (*fatal, *findings, *_order(sound))
        framed = _frame(comparison)
        sound = comparison.best.impacts
        scaled = _inertia(sound)
        framed += scaled
        findings = framed + findings
        if scaled:
            sound = correct(sound, ["inertia_scaled"])
    findings += _outliers(sound)
    good = ~torch.stack([*gross_outliers(sound).values()]).any(0)
    if good.any():
        findings += _energy(sound[good]) + _shape(sound[good])
    return tuple(findings + _order(sound))


# --- Units and axes ----------------------------------------------------------------------------


def _frame(comparison: Comparison) -> list[Finding]:
    """A finding for each correction of the best hypothesis; the evidence is that of all of them together."""
    given, best = comparison.given, comparison.best
    if not best.names:
        return []
    before, after = balance(given.impacts), balance(best.impacts)
    shared = {**_balance("before", before), **_balance("after", after), **_answers(given, best)}
    shared |= {
        "contradictions_before": given.total.mean().item(),
        "contradictions_after": best.total.mean().item(),
        "standard_errors": comparison.sigmas,
        "better_in": (best.total < given.total).double().mean().item(),
        "hypotheses": float(comparison.tried),
        "alternatives": "; ".join(map(str, comparison.equals)) or "none",
    }
    numbers = (
        f"the moment balance I Δω = a r_x P_n − b r_y P_t, which must give +1 and +1, gives {before} as read and "
        f"{after} corrected; contradictions a trial fall from {given.total.mean():.2f} to {best.total.mean():.2f} "
        f"({comparison.sigmas:.0f} standard errors, better in {shared['better_in']:.0%} of {len(given.total)} trials)"
    )
    if comparison.equals:
        numbers += f"; this data cannot tell it from {shared['alternatives']}"
    findings = []
    for name in best.names:
        others = [other for other in best.names if other != name]
        together = f", together with {', '.join(others)}" if others else ""
        evidence, factor = dict(shared), ""
        if name == "inertia_scaled":
            evidence["factor"] = (best.impacts.inertia / given.impacts.inertia)[0].item()
            factor = f", {_factor(evidence['factor'])}"
        findings.append(Finding(name, f"{CORRECTIONS[name].description}{factor}{together}: {numbers}", evidence, name))
    return findings


def _factor(factor: float) -> str:
    unit = next((u for scale, u in _INERTIA_UNITS.items() if abs(math.log(factor / scale)) < 0.3), None)
    return f"{factor:.3g}" + (f" (is it in {unit}?)" if unit else "")


def _balance(when: str, fit: Balance) -> dict[str, float]:
    values = {"a": fit.a, "a_error": fit.a_error, "b": fit.b, "b_error": fit.b_error, "r_squared": fit.r_squared}
    return {f"{name}_{when}": value for name, value in values.items() if math.isfinite(value)}


def _answers(given: Hypothesis, best: Hypothesis) -> dict[str, float]:
    """The questions whose answers differ."""
    before, after = given.means(), best.means()
    changed = [question for question in before if abs(before[question] - after[question]) > 0.005]
    return {f"{q}_{when}": means[q] for q in changed for when, means in (("before", before), ("after", after))}


def _inertia(impacts: Impacts) -> list[Finding]:
    """Both terms of the balance ask for the same factor: too small a gain for `compare`, but too large for physics."""
    factor, fit = inertia_factor(impacts), balance(impacts)
    asked = [x for x, error in ((fit.a, fit.a_error), (fit.b, fit.b_error)) if error < 0.1 * abs(x)]
    if not wrong_inertia(factor) or not asked or fit.r_squared < 0.8:
        return []
    if any(abs(x * factor - 1) > 0.2 for x in asked):
        return []
    sentence = (
        f"{CORRECTIONS['inertia_scaled'].description}, {_factor(factor)}: as read, I Δω = a r_x P_n − b r_y P_t, which "
        f"must give +1 and +1, gives {fit}"
    )
    evidence = {"factor": factor, **_balance("before", fit)}
    return [Finding("inertia_scaled", sentence, evidence, "inertia_scaled")]


def _impossible(comparison: Comparison) -> list[Finding]:
    best, share = comparison.best, max(0.0, explained(comparison.best.impacts))
    means, fit = best.means(), balance(best.impacts)
    moment = best.answers["moment"]
    surely = moment.mean().item() - 2 * moment.std().item() / math.sqrt(len(moment))
    reasons = {
        f"the moment balance leaves {means['moment']:.0%} of its terms over and explains {share:.0%} of Δω "
        f"(it gives {fit})": surely > 0.3 and share < 0.3,
        f"the floor pulls in {means['push']:.0%} of trials": means["push"] > 0.4,
        f"{means['approach']:.0%} of trials do not approach the floor": means["approach"] > 0.4,
    }
    said = [reason for reason, holds in reasons.items() if holds]
    if not said:
        return []
    sentence = (
        f"no planar impact of a rigid body can have produced this data: under the best of {comparison.tried} "
        f"hypotheses about units and axes ({best}) {'; '.join(said)}. Do before and after belong to the same trials?"
    )
    evidence = {
        "hypotheses": float(comparison.tried),
        "best": str(best),
        "explained": share,
        **_balance("best", fit),
        **means,
    }
    return [Finding("impossible", sentence, evidence, fatal=True)]


# --- Trials ------------------------------------------------------------------------------------


def _duplicates(impacts: Impacts) -> list[Finding]:
    twice = repeated(impacts)
    count = int(twice.sum())
    if not count:
        return []
    first = impacts.trial[int(twice.nonzero()[0, 0])]
    sentence = f"{count} of {len(impacts)} trials repeat an earlier one to the last digit, the first is {first!r}"
    evidence = {"trials": float(count), "share": count / len(impacts), "first": first}
    return [Finding("duplicated_trials", sentence, evidence, "drop_duplicates")]


def _order(impacts: Impacts) -> list[Finding]:
    """Only a clock that all trials share can contradict their order, not a time within each recording."""
    if impacts.time is None or len(impacts) < 3:
        return []
    time = impacts.time[impacts.order.argsort(stable=True)]
    back = (time.diff() < 0).double().mean().item()
    rank = time.argsort().argsort().double()
    agreement = torch.corrcoef(torch.stack((rank, torch.arange(len(rank), dtype=rank.dtype))))[0, 1].item()
    clock = (time.max() - time.min()).item() > _SECONDS * len(time) or abs(agreement) > 0.8
    if not back or not clock:
        return []
    sentence = (
        f"the order of the trials is not that of their times: time runs back in {back:.0%} of steps "
        f"(rank correlation {agreement:+.2f})"
    )
    return [Finding("out_of_order", sentence, {"back": back, "rank_correlation": agreement}, "ordered_by_time")]


def _outliers(impacts: Impacts) -> list[Finding]:
    reasons = {name: float(bad.sum()) for name, bad in gross_outliers(impacts).items()}
    bad = torch.stack([*gross_outliers(impacts).values()]).any(0)
    count, share = int(bad.sum()), bad.double().mean().item()
    if not count:
        return []
    said = ", ".join(f"{name} {n:.0f}" for name, n in reasons.items() if n)
    first = impacts.trial[int(bad.nonzero()[0, 0])]
    sentence = (
        f"{count} of {len(impacts)} trials ({share:.1%}) cannot be what was measured ({said}), the first is {first!r}"
    )
    if share > _FEW:
        sentence += "; too many to be dropped"
    evidence = {"trials": float(count), "share": share, "first": first, **{k: n for k, n in reasons.items() if n}}
    return [Finding("gross_outliers", sentence, evidence, "drop_outliers" if share <= _FEW else None)]


def _energy(impacts: Impacts) -> list[Finding]:
    before, after = kinetic_energy(impacts)
    share = (after > 1.25 * before).double().mean().item()
    if share <= _ENERGETIC:
        return []
    ratio = (after / before).median().item()
    sentence = (
        f"{share:.0%} of trials leave with at least a quarter more kinetic energy than they came with (median ratio "
        f"{ratio:.2f}): is the floor driven, or are speeds before contact taken too early?"
    )
    return [Finding("energy_gained", sentence, {"share": share, "median_ratio": ratio})]


def _shape(impacts: Impacts) -> list[Finding]:
    if impacts.shape is None:
        return []
    expected = contact_point(impacts.shape, impacts.q[:, 2])
    off, length = (impacts.r - expected).norm(dim=-1), impacts.r.norm(dim=-1)
    median = (off / length).median().item()
    if median <= _OFF:
        return []
    ratio = (length / expected.norm(dim=-1)).median().item()
    sentence = (
        f"the contact points are not those of {impacts.shape} at θ: {median:.0%} of |r| off in the median "
        f"({1e3 * off.median():.3g} mm; |r| is {ratio:.3g} times the shape's); is the shape given in metres, and is θ "
        "measured from its axes?"
    )
    return [Finding("contact_point_off_shape", sentence, {"off": median, "length_ratio": ratio})]
