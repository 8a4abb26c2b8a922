"""The audit: mistakes in the measurements themselves, found before any physics is fitted to them.

    units, columns, axes      one finding for each correction of the best hypothesis of `conventions`
    inertia_scaled            the moments balance up to one factor on I, of more than 2.5
    incomplete_trials         rows that were left out as the table was read: a note
    duplicated_trials         rows that repeat an earlier one bit for bit
    out_of_order              times that contradict the order of the trials
    gross_outliers            trials that cannot be real measurements
    energy_gained             more trials than noise explains gain energy
    contact_point_off_shape   r is not where the body's shape touches the floor at θ
    scale_off                 gravity in free flight is not 9.81 m/s²
    apparatus                 estimates from recordings without any impact: a note
    impossible_speeds         faster than anything in a laboratory
    moment_balance_open       the coefficients of the moment balance are not 1, and no hypothesis explains it
    contradictions            the trials contradict themselves otherwise, and no hypothesis explains it
    consistent                none of these: a note with the coefficients of the moment balance
    impossible                no hypothesis balances the moments, pushes and approaches: fatal

Findings are mistakes that a correction, or a check of the set-up, removes.  Physical effects (a tilted floor, a wrong
centre of mass, a moment at the contact) cause none unless they are enormous.  Later findings are made on the data as
the earlier ones would correct it; nothing is corrected here.
"""

import math
from dataclasses import replace

import torch

from contactlearn.data.audit.consistency import FASTEST, gross_outliers, kinetic_energy, outliers, repeated
from contactlearn.data.audit.conventions import (
    balance_findings,
    compare,
    consistent_note,
    convention_findings,
    impossible_findings,
    inertia_findings,
)
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.bodies import body_code, contact_points, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY

_APPARATUS_SIGMAS = 3.0  # standard errors by which the scale must be off, too
_SECONDS_A_TRIAL = 0.5  # that a trial takes at least: times that span less are no clock of the session
_RANK_CORRELATION = 0.8  # of time and order, from which on such times are a clock all the same
ENERGY_GAIN = 1.25
"""Ratio of kinetic energies after and before impact above which a trial gains energy; 1 to 1.25 decide the same."""
_GAINING = 0.05  # share of trials that gain energy above which this is reported; it guards against noise
_FEWEST = 10  # trials below which nothing is said about units and axes: five standard errors need them
_LISTED = 5  # values that a sentence names
_QUICK = 500  # trials of a quick audit
_COMPARED = 20_000  # trials on which hypotheses about units and axes are compared, at most; the rest is of all trials


def audit(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> tuple[Finding, ...]:
    """Find the mistakes in the measurements, most fundamental first, or note that they are consistent.

    The impacts need not be validated.  `data.correct=[…]` takes the corrections of all findings, in their order.
    """
    findings = incomplete_findings(impacts) + duplicate_findings(impacts)
    sound = impacts.replace(validate=False)[~repeated(impacts)]
    notes = apparatus_notes(impacts)
    if len(sound) < _FEWEST:
        return (*findings, *_trial_findings(sound, thresholds), *notes)
    comparison = compare(_subsample(sound), thresholds)
    fatal = impossible_findings(comparison, thresholds)
    if fatal:
        return (*fatal, *findings, *order_findings(sound), *notes)
    sound = comparison.best.impacts if len(sound) <= _COMPARED else correct(sound, comparison.best.names)
    scaled = inertia_findings(sound, thresholds)
    if scaled:
        sound = correct(sound, ["inertia_scaled"])
    of_trials = _trial_findings(sound, thresholds)
    unbalanced = balance_findings(sound, comparison, thresholds, explained=bool(of_trials))
    corrected = [*convention_findings(comparison), *scaled]
    if any(finding.name == "moment_balance_open" and finding.mistake for finding in unbalanced):
        corrected = [_not_recommended(finding) for finding in corrected]
    findings = [*corrected, *unbalanced, *findings, *of_trials]
    return (*(findings or [consistent_note(sound, thresholds)]), *notes)


def _not_recommended(finding: Finding) -> Finding:
    """Return a mistake without its correction, which does not close the moment balance."""
    sentence = f"{finding.sentence}; the moment balance does not close after it, so it is not recommended"
    return replace(finding, sentence=sentence, correction=None)


def quick_audit(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> tuple[Finding, ...]:
    """Find the mistakes in the measurements from a few hundred of them, spread evenly; notes are left out.

    Repeated trials and their order are looked at in all of them.
    """
    found = [*duplicate_findings(impacts), *order_findings(impacts)]
    sound = impacts.replace(validate=False, time=None)[~repeated(impacts)]  # times of a subset do not show the order
    rows = torch.linspace(0, len(sound) - 1, min(len(sound), _QUICK)).round().long()
    found = (*audit(sound[rows], thresholds), *found)
    return tuple(finding for finding in found if finding.mistake)


def _subsample(impacts: Impacts) -> Impacts:
    """Draw at most 20 000 trials, since every hypothesis holds its own copy of the data."""
    if len(impacts) <= _COMPARED:
        return impacts
    rows = torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0))[:_COMPARED]
    return impacts[rows.sort().values]


def _trial_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Find the mistakes that need no comparison of hypotheses."""
    findings = scale_findings(impacts, thresholds) + speed_findings(impacts)
    findings += outlier_findings(impacts, thresholds)
    good = ~outliers(impacts, thresholds)
    if good.any():
        findings += energy_findings(impacts[good]) + shape_findings(impacts[good], thresholds)
    return findings + order_findings(impacts)


def scale_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Gravity in free flight that is not 9.81 m/s²: the scale or the frame rate is wrong."""
    if impacts.apparatus is None:
        return []
    gravity = impacts.apparatus.gravity
    off, error = gravity.value / GRAVITY - 1, gravity.error / GRAVITY
    if abs(off) <= max(thresholds.scale_off, _APPARATUS_SIGMAS * error):
        return []
    wrong = "large" if off > 0 else "small"
    sentence = (
        f"gravity in free flight is {gravity.value:.3f} ± {gravity.error:.1g} m/s² instead of {GRAVITY} m/s²: lengths "
        f"are too {wrong} by {abs(off):.1%}, or the frame rate is by {abs((1 + off) ** 0.5 - 1):.1%}"
    )
    evidence = evidence_of(("gravity", gravity.value, "m/s²"), ("standard_error", gravity.error, "m/s²"), ("off", off))
    return [Finding(name="scale_off", sentence=sentence, evidence=evidence)]


def apparatus_notes(impacts: Impacts) -> list[Finding]:
    """Estimates of the apparatus without any impact, and how they limit the same effects."""
    known = impacts.apparatus
    if known is None:
        return []
    named = (
        ("gravity", known.gravity, "m/s²"),
        ("drag", known.drag, "1/s"),
        ("floor_slope", known.slope, "rad"),
        ("theta_zero", known.orientation, "rad"),
        ("delay", known.delay, "s"),
    )
    estimates = {name: (one, unit) for name, one, unit in named if one is not None}
    texts = {"gravity": "gravity", "drag": "drag", "floor_slope": "slope of the floor", "theta_zero": "offset of θ"}
    parts = [f"{text} {_estimate_text(*estimates[name])}" for name, text in texts.items() if name in estimates]
    sentence = (
        f"measured without any impact: {', '.join(parts)}, contact at the instant at which flights meet; the same "
        "effects are limited to three standard errors beyond these values"
    )
    evidence = evidence_of(
        *(
            (quantity, number, unit)
            for name, (one, unit) in estimates.items()
            for quantity, number in ((name, one.value), (f"{name}_error", one.error))
        )
    )
    return [Finding(name="apparatus", sentence=sentence, evidence=evidence, mistake=False)]


def _estimate_text(one: Estimate, unit: str) -> str:
    """An estimate in words, angles in degrees."""
    one, unit = (one.times(180 / math.pi), "°") if unit == "rad" else (one, f" {unit}")
    return f"{one.value:.3g} ± {one.error:.1g}{unit}"


def incomplete_findings(impacts: Impacts) -> list[Finding]:
    """Note the trials that were left out as the table was read, because a number is missing."""
    left_out = impacts.incomplete
    if not left_out:
        return []
    names = ", ".join(map(repr, left_out[:_LISTED])) + (", …" if len(left_out) > _LISTED else "")
    sentence = (
        f"{len(left_out)} of {len(impacts) + len(left_out)} trials of the table were left out because a number is "
        f"missing: {names}"
    )
    evidence = evidence_of(("trials", float(len(left_out)), "trials"), ("names", ", ".join(left_out)))
    return [Finding(name="incomplete_trials", sentence=sentence, evidence=evidence, mistake=False)]


def duplicate_findings(impacts: Impacts) -> list[Finding]:
    """Rows that repeat an earlier one bit for bit."""
    twice = repeated(impacts)
    count = int(twice.sum())
    if not count:
        return []
    first = impacts.trial[int(twice.nonzero()[0, 0])]
    sentence = f"{count} of {len(impacts)} trials repeat an earlier trial to the last digit, the first is {first!r}"
    evidence = evidence_of(("trials", float(count), "trials"), ("share", count / len(impacts)), ("first", first))
    return [Finding(name="duplicated_trials", sentence=sentence, evidence=evidence, correction="drop_duplicates")]


def order_findings(impacts: Impacts) -> list[Finding]:
    """Times that contradict the order of the trials; a time within each recording cannot, only a common clock."""
    if impacts.time is None or len(impacts) < 3:
        return []
    time = impacts.time[impacts.order.argsort(stable=True)]
    back = (time.diff() < 0).double().mean().item()
    rank = time.argsort().argsort().double()
    agreement = torch.corrcoef(torch.stack((rank, torch.arange(len(rank), dtype=rank.dtype))))[0, 1].item()
    long = (time.max() - time.min()).item() > _SECONDS_A_TRIAL * len(time)
    if not back or not (long or abs(agreement) > _RANK_CORRELATION):
        return []
    sentence = (
        f"the trials are not in the order of their times: time runs back in {back:.0%} of steps "
        f"(rank correlation {agreement:+.2f})"
    )
    evidence = evidence_of(("back", back), ("rank_correlation", agreement))
    return [Finding(name="out_of_order", sentence=sentence, evidence=evidence, correction="ordered_by_time")]


def outlier_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Trials that cannot be real measurements, by reason."""
    by_reason = gross_outliers(impacts, thresholds)
    reasons = {name: count for name, bad in by_reason.items() if (count := float(bad.sum()))}
    bad = torch.stack([*by_reason.values()]).any(0)
    count, share = int(bad.sum()), bad.double().mean().item()
    if not count:
        return []
    counts = ", ".join(f"{name} {n:.0f}" for name, n in reasons.items())
    first = impacts.trial[int(bad.nonzero()[0, 0])]
    sentence = (
        f"{count} of {len(impacts)} trials ({share:.1%}) cannot be real measurements ({counts}), the first is {first!r}"
    )
    few = share <= thresholds.dropped_share
    if not few:
        sentence += "; too many to drop"
    evidence = evidence_of(
        ("trials", float(count), "trials"),
        ("share", share),
        ("first", first),
        *((reason, n, "trials") for reason, n in reasons.items()),
    )
    correction = "drop_outliers" if few else None
    return [Finding(name="gross_outliers", sentence=sentence, evidence=evidence, correction=correction)]


def speed_findings(impacts: Impacts) -> list[Finding]:
    """Implausible speeds of the body, or of its contact point relative to the centre of mass."""
    limit = FASTEST
    lengths = impacts.r.norm(dim=-1, keepdim=True)
    speeds = {
        name: torch.stack((v[:, :2].norm(dim=-1), (v[:, 2:] * lengths)[:, 0].abs()), -1)
        for name, v in (("before", impacts.v_pre), ("after", impacts.v_post))
    }
    fast = torch.cat([*speeds.values()], -1) > limit
    if not fast.any():
        return []
    rows, columns = fast.nonzero().T
    velocities = torch.cat((impacts.v_pre, impacts.v_post), -1)
    seen = []
    for row, column in zip(rows[:_LISTED].tolist(), columns[:_LISTED].tolist(), strict=True):
        when, (v_x, v_y, omega) = ("before", "after")[column // 2], velocities[row].view(2, 3)[column // 2].tolist()
        value = f"ω = {omega:.3g} rad/s" if column % 2 else f"|v| = {math.hypot(v_x, v_y):.3g} m/s"
        seen.append(f"row {row + 1} (trial {impacts.trial[row]!r}) {value} {when} impact")
    more = f" and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
    sentence = (
        f"speeds above {limit:g} m/s, of the centre of mass or of the contact point relative to it, in "
        f"{int(fast.any(-1).sum())} of {len(impacts)} trials: {'; '.join(seen)}{more}; are the columns' units right?"
    )
    listed = sorted({*rows.tolist()})[:_LISTED]
    evidence = evidence_of(
        ("trials", float(fast.any(-1).sum()), "trials"),
        ("fastest", torch.cat([*speeds.values()], -1).max().item(), "m/s"),
        ("rows", ", ".join(str(row + 1) for row in listed)),
    )
    return [Finding(name="impossible_speeds", sentence=sentence, evidence=evidence)]


def energy_findings(impacts: Impacts) -> list[Finding]:
    """More trials than noise explains gain energy."""
    before, after = kinetic_energy(impacts)
    share = (after > ENERGY_GAIN * before).double().mean().item()
    if share <= _GAINING:
        return []
    ratio = (after / before).median().item()
    sentence = (
        f"{share:.0%} of trials gain at least a quarter of their kinetic energy (median ratio "
        f"{ratio:.2f}): is the floor driven, or are speeds before contact measured too early?"
    )
    evidence = evidence_of(("share", share), ("median_ratio", ratio))
    return [Finding(name="energy_gained", sentence=sentence, evidence=evidence)]


def shape_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Contact points that are not where the body's shape touches the floor at θ: of all, or of the worst body."""
    if impacts.shape is None:
        return []
    expected = contact_points(impacts.shape, impacts.body, impacts.q[:, 2])
    off, length = (impacts.r - expected).norm(dim=-1), impacts.r.norm(dim=-1)
    shapes = shapes_among(impacts.shape)
    trials = {name: impacts.body == body_code(name) if name else off >= 0 for name in shapes}
    medians = {name: (off / length)[rows].median().item() for name, rows in trials.items() if rows.any()}
    worst = max(medians, key=lambda name: medians[name])
    median, rows = medians[worst], trials[worst]
    if median <= thresholds.contact_point_off:
        return []
    ratio = (length / expected.norm(dim=-1))[rows].median().item()
    sentence = (
        f"the contact points{worst and f' of {worst!r}'} are not those of {shapes[worst]} at θ: they are {median:.0%} "
        f"of |r| off in the median ({1e3 * off[rows].median():.3g} mm; |r| is {ratio:.3g} times the shape's); is the "
        "shape in metres, and is θ measured from its axes?"
    )
    evidence = evidence_of(("off", median), ("length_ratio", ratio))
    return [Finding(name="contact_point_off_shape", sentence=sentence, evidence=evidence)]
