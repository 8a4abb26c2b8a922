"""The audit: mistakes in the measurements themselves, found before any physics is fitted to them.

    …_shape                   the stated shape differs by a constant of units from |r|, from the height at contact, or
                              from what a body as light as this can have
    millimetres, inches, …    positions are in another unit than the shape, from which contact points are computed
    spin_not_measured         spins are 0, though impulses turn the body: a note
    units, columns, axes      one finding for each correction of the best hypothesis of `conventions`
    inertia_scaled            the moments balance up to one factor on I, of more than 2.5
    incomplete_trials         rows that were left out as the table was read: a note
    duplicated_trials         rows that repeat an earlier one bit for bit
    saturated_readings        velocities that stop at a limit in several trials
    two_kinds                 trials in which the moment balance closes, and others in which it does not
    saturated_gyroscope       spins in space that end at one number about the axes of the body
    uneven_covariances        variances of single trials that are far smaller than those of most
    out_of_order              times that contradict the order of the trials
    moving_floor              the floor moves along its normal: a constant in v_n⁺ beside its part ∝ v_n
    gross_outliers            trials that cannot be real measurements; fatal where many double their energy
    energy_gained             more trials than noise explains gain energy
    contact_point_off_shape   r is not where the body's shape touches the floor at θ
    scale_off                 gravity in free flight is not 9.81 m/s²
    traced_shape              data.shape is not stated, and the contact points trace it: a note
    rig, rig_applied          the rig card, measured without a law of contact, and what of it was applied: notes
    impossible_speeds         faster than anything in a laboratory
    products_of_inertia, scale_of_lengths, scale_of_axis, contact_points_moved, heading_turned, heading_drifts,
    gyroscope_turned, spins_exchanged, bodies_exchanged
                              the one wrong term that closes the moment balance in space (`one_term`)
    moment_balance_open       the coefficients of the moment balance are not 1, and no hypothesis explains it
    contradictions            the trials contradict themselves otherwise, and no hypothesis explains it
    consistent                none of these: a note with the coefficients of the moment balance
    too_few_trials            none of these, of too few trials to check units and axes: a note
    impossible                no hypothesis balances the moments, pushes and approaches: fatal
    mixed_units               a part of the trials has other units or axes than the rest: fatal
    exchanged_columns         two columns of velocities are mixed up, and no hypothesis explains it otherwise: fatal
    outcome_not_measured      a velocity after impact that is one number while that before it varies: fatal
    far_apart                 places that are farther apart than any laboratory: a note
    heavy_body                a mass that no material has in a body of this size: a note
    constant_columns          columns with one value, and what they cannot show: a note
    masses                    trials without names of bodies have a few masses: a note
    narrow_speed              an approach speed that hardly varies: a note
    rounded                   numbers that are rounded so coarsely that it is a part of their errors: a note
    sorted_trials             trials sorted by their state before impact, which hides what drifts: a note
    equal_states              trials of one state before impact differ in their outcomes by scatter: a note

In space gains of energy and contact points are not looked at, nor is a floor inclined by any angle.
Findings are mistakes that a correction, or a check of the set-up, removes.  Physical effects (a tilted floor, a wrong
centre of mass, a moment at the contact) cause none unless they are enormous.  Later findings are made on the data as
the earlier ones would correct it; nothing is corrected here.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import torch

from contactlearn.data.audit.balance import balance_finding, inertia_findings
from contactlearn.data.audit.constants import (
    constant_notes,
    heavy_body_notes,
    light_body_findings,
    narrow_notes,
    place_notes,
    rounded_notes,
    shape_findings_in_space,
    shape_unit_findings,
    spin_notes,
    unmeasured_findings,
)
from contactlearn.data.audit.conventions import (
    compare,
    convention_findings,
    exchanged_findings,
    impossible_findings,
)
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.moving_floor import moving_floor_findings
from contactlearn.data.audit.one_term import one_term_findings
from contactlearn.data.audit.outline import outline_notes
from contactlearn.data.audit.parts import mixed_findings
from contactlearn.data.audit.result import Audit, Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.trials import (
    copied,
    covariance_findings,
    duplicate_findings,
    gyroscope_findings,
    incomplete_findings,
    mass_notes,
    order_findings,
    rig_notes,
    saturation_findings,
    sorted_notes,
    speed_findings,
    state_notes,
    trial_findings,
    unchanged_findings,
)
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE

CLOSING = ("consistent", "too_few_trials", "moment_balance_open", "contradictions")
"""Findings that close an audit: what the whole of the data is, if it has no mistake."""
_MIN_TRIALS = 10  # trials below which nothing is said about units and axes: five standard errors need them
_QUICK = 500  # trials of a quick audit
_COMPARED = 20_000  # trials on which hypotheses about units and axes are compared, at most; the rest is of all trials


def audit(
    impacts: Impacts,
    thresholds: AuditThresholds = AuditThresholds(),
    every: Callable[[], Iterable[Impacts]] | None = None,
) -> Audit:
    """Find the mistakes in the measurements, most fundamental first, or note that they are consistent.

    The impacts need not be validated.  `data.correct=[…]` takes the corrections of all findings, in their order.

    Args:
        impacts: measurements.
        thresholds: limits of the findings.
        every: all trials in blocks, if the impacts are a sample of them; a part in other units ends among these.
    """
    findings = incomplete_findings(impacts) + duplicate_findings(impacts)
    sound = impacts.replace(validate=False)[~copied(impacts)]
    limited = saturation_findings(sound)
    sound = correct(sound, Audit(limited).corrections)
    findings += [*limited, *covariance_findings(impacts)]
    notes, plane = rig_notes(impacts), impacts.space is PLANE
    if unchanged := unchanged_findings(sound):
        return Audit((*unchanged, *findings, *notes))
    if len(sound) < _MIN_TRIALS:
        findings += trial_findings(sound, thresholds)
        few = [] if Audit(findings).mistakes else [_few_note(sound)]
        return Audit((*findings, *few, *notes))
    notes = [
        *mass_notes(sound),
        *narrow_notes(sound),
        *rounded_notes(sound),
        *sorted_notes(sound),
        *state_notes(sound),
        *notes,
    ]
    first = shape_unit_findings(sound) if plane else shape_findings_in_space(sound)
    first = first or light_body_findings(sound, thresholds)
    sound = correct(sound, Audit(first).corrections)
    notes = [*constant_notes(sound), *notes]
    if plane:
        notes, spins = [*place_notes(sound), *notes], spin_notes(sound)
        sound = correct(sound, Audit(spins).corrections)
        first += spins
        unmeasured = unmeasured_findings(sound)
        if unmeasured:
            return Audit((*unmeasured, *findings, *first, *notes))
    sample = _subsample(sound)
    comparison = compare(sample, thresholds)
    shaped = Audit(first).corrections
    blocks = (lambda: [sound]) if every is None else (lambda: (correct(one, shaped) for one in every()))
    fatal = mixed_findings(comparison, blocks) or (
        exchanged_findings(comparison) if plane else gyroscope_findings(sample)
    )
    fatal = fatal or impossible_findings(comparison, thresholds)
    if fatal:
        return Audit((*fatal, *findings, *first, *order_findings(sound), *notes))
    corrected = convention_findings(comparison)
    sound = comparison.best.impacts if len(sound) <= _COMPARED else correct(sound, comparison.best.names)
    scaled = inertia_findings(sound, thresholds)
    sound, corrected = correct(sound, Audit(scaled).corrections), [*corrected, *scaled]
    moving = moving_floor_findings(sound)
    if Audit(moving).corrections:
        sound, corrected = correct(sound, ["moving_floor"]), [*corrected, *moving]
    else:
        notes = [*moving, *notes]
    of_trials = trial_findings(sound, thresholds)
    of_trials += [] if plane or Audit(of_trials).mistakes else one_term_findings(_subsample(sound))
    closing = balance_finding(sound, comparison.tried, thresholds, explained=bool(of_trials))
    if closing.name == "moment_balance_open" and closing.mistake:
        corrected = [_not_recommended(finding) for finding in corrected]
    found = [*first, *corrected, closing, *findings, *of_trials]
    outlines, mistaken = outline_notes(sound) if plane else [], bool(Audit(found).mistakes)
    shown = (one for one in found if one.name != "consistent" or not mistaken)
    return Audit((*shown, *([] if mistaken else heavy_body_notes(sound)), *outlines, *notes))


def _few_note(impacts: Impacts) -> Finding:
    """Note that too few trials contradict nothing."""
    sentence = (
        f"nothing contradicts rigid impacts, but {len(impacts)} trials are too few to check units and axes: it takes "
        f"{_MIN_TRIALS}"
    )
    evidence = evidence_of(("trials", float(len(impacts)), "trials"))
    return Finding(name="too_few_trials", sentence=sentence, evidence=evidence, mistake=False)


def _not_recommended(finding: Finding) -> Finding:
    """Return a mistake without its correction, which does not close the moment balance."""
    sentence = f"{finding.sentence}; the moment balance does not close after it, so it is not recommended"
    return replace(finding, sentence=sentence, correction=None)


def quick_audit(impacts: Impacts, every: Callable[[], Iterable[Impacts]] | None = None) -> tuple[Finding, ...]:
    """Find the mistakes in a few hundred of the measurements, spread evenly; notes are left out.

    Repeated trials and their order are looked at in all of them, impossible speeds in all trials there are: `every`, in
    blocks, or the impacts.
    """
    blocks = (lambda: [impacts]) if every is None else every
    found = [*duplicate_findings(impacts), *order_findings(impacts)]
    sound = impacts.replace(validate=False, time=None)[~copied(impacts)]  # times of a subset do not show the order
    rows = torch.linspace(0, len(sound) - 1, min(len(sound), _QUICK)).round().long()
    seen = [one for one in audit(sound[rows], every=blocks) if one.name != "impossible_speeds"]
    if impacts.space is PLANE and not any(one.fatal or one.hypothesis for one in seen):  # another unit is no speed
        found += speed_findings(blocks())
    return Audit((*seen, *found)).mistakes


def _subsample(impacts: Impacts) -> Impacts:
    """Draw at most 20 000 trials, since every hypothesis holds its own copy of the data."""
    if len(impacts) <= _COMPARED:
        return impacts
    rows = torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0))[:_COMPARED]
    return impacts[rows.sort().values]
