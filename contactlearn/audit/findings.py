"""The audit: mistakes in the measurements themselves, found before any physics is fitted to them.

    units, columns, axes      one finding for each correction of the best hypothesis of `conventions`
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

import torch

from contactlearn.audit.consistency import gross_outliers, kinetic_energy, outliers, repeated
from contactlearn.audit.convention_findings import convention_findings, impossible_findings, inertia_findings
from contactlearn.audit.conventions import compare
from contactlearn.audit.corrections import correct
from contactlearn.audit.result import Evidence, Finding
from contactlearn.audit.thresholds import AuditThresholds
from contactlearn.impacts import Impacts
from contactlearn.shapes import contact_point


def audit(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> tuple[Finding, ...]:
    """Find the mistakes in the measurements, most fundamental first; empty where there are none.

    The impacts may be `suspect`.  The corrections of all findings, in their order, are what
    `data.correct=[…]` takes.
    """
    findings = _duplicates(impacts)
    sound = impacts.replace(suspect=True)[~repeated(impacts)]
    if len(sound) >= thresholds.fewest_trials:
        comparison = compare(sound, thresholds.conventions)
        fatal = impossible_findings(comparison, thresholds)
        if fatal:
            return (*fatal, *findings, *_order(sound, thresholds))
        sound = comparison.best.impacts
        scaled = inertia_findings(sound, thresholds.conventions)
        findings = convention_findings(comparison) + scaled + findings
        if scaled:
            sound = correct(sound, ["inertia_scaled"])
    findings += _outliers(sound, thresholds)
    good = ~outliers(sound, thresholds.outliers)
    if good.any():
        findings += _energy(sound[good], thresholds) + _shape(sound[good], thresholds)
    return tuple(findings + _order(sound, thresholds))


def _duplicates(impacts: Impacts) -> list[Finding]:
    twice = repeated(impacts)
    count = int(twice.sum())
    if not count:
        return []
    first = impacts.trial[int(twice.nonzero()[0, 0])]
    sentence = f"{count} of {len(impacts)} trials repeat an earlier one to the last digit, the first is {first!r}"
    evidence = (
        Evidence(quantity="trials", value=float(count), unit="trials"),
        Evidence(quantity="share", value=count / len(impacts)),
        Evidence(quantity="first", value=first),
    )
    return [Finding(name="duplicated_trials", sentence=sentence, evidence=evidence, correction="drop_duplicates")]


def _order(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Only a clock that all trials share can contradict their order, not a time within each recording."""
    if impacts.time is None or len(impacts) < 3:
        return []
    time = impacts.time[impacts.order.argsort(stable=True)]
    back = (time.diff() < 0).double().mean().item()
    rank = time.argsort().argsort().double()
    agreement = torch.corrcoef(torch.stack((rank, torch.arange(len(rank), dtype=rank.dtype))))[0, 1].item()
    long = (time.max() - time.min()).item() > thresholds.seconds_per_trial * len(time)
    if not back or not (long or abs(agreement) > thresholds.rank_correlation):
        return []
    sentence = (
        f"the order of the trials is not that of their times: time runs back in {back:.0%} of steps "
        f"(rank correlation {agreement:+.2f})"
    )
    evidence = (Evidence(quantity="back", value=back), Evidence(quantity="rank_correlation", value=agreement))
    return [Finding(name="out_of_order", sentence=sentence, evidence=evidence, correction="ordered_by_time")]


def _outliers(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    by_reason = gross_outliers(impacts, thresholds.outliers)
    reasons = {name: count for name, bad in by_reason.items() if (count := float(bad.sum()))}
    bad = torch.stack([*by_reason.values()]).any(0)
    count, share = int(bad.sum()), bad.double().mean().item()
    if not count:
        return []
    said = ", ".join(f"{name} {n:.0f}" for name, n in reasons.items())
    first = impacts.trial[int(bad.nonzero()[0, 0])]
    sentence = (
        f"{count} of {len(impacts)} trials ({share:.1%}) cannot be what was measured ({said}), the first is {first!r}"
    )
    few = share <= thresholds.dropped_share
    if not few:
        sentence += "; too many to be dropped"
    evidence = (
        Evidence(quantity="trials", value=float(count), unit="trials"),
        Evidence(quantity="share", value=share),
        Evidence(quantity="first", value=first),
        *(Evidence(quantity=reason, value=n, unit="trials") for reason, n in reasons.items()),
    )
    correction = "drop_outliers" if few else None
    return [Finding(name="gross_outliers", sentence=sentence, evidence=evidence, correction=correction)]


def _energy(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    before, after = kinetic_energy(impacts)
    share = (after > thresholds.energy_gain * before).double().mean().item()
    if share <= thresholds.energy_share:
        return []
    ratio = (after / before).median().item()
    sentence = (
        f"{share:.0%} of trials leave with at least a quarter more kinetic energy than they came with (median ratio "
        f"{ratio:.2f}): is the floor driven, or are speeds before contact taken too early?"
    )
    evidence = (Evidence(quantity="share", value=share), Evidence(quantity="median_ratio", value=ratio))
    return [Finding(name="energy_gained", sentence=sentence, evidence=evidence)]


def _shape(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    if impacts.shape is None:
        return []
    expected = contact_point(impacts.shape, impacts.q[:, 2])
    off, length = (impacts.r - expected).norm(dim=-1), impacts.r.norm(dim=-1)
    median = (off / length).median().item()
    if median <= thresholds.contact_point_off:
        return []
    ratio = (length / expected.norm(dim=-1)).median().item()
    sentence = (
        f"the contact points are not those of {impacts.shape} at θ: {median:.0%} of |r| off in the median "
        f"({1e3 * off.median():.3g} mm; |r| is {ratio:.3g} times the shape's); is the shape given in metres, and is θ "
        "measured from its axes?"
    )
    evidence = (Evidence(quantity="off", value=median), Evidence(quantity="length_ratio", value=ratio))
    return [Finding(name="contact_point_off_shape", sentence=sentence, evidence=evidence)]
