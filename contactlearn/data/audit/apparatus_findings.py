"""Findings about the apparatus, from what recordings tell without any impact."""

from math import degrees

from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.apparatus import Apparatus, Measured
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY


def scale_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Gravity in free flight that is not 9.81 m/s²: the scale or the frame rate is wrong."""
    if impacts.apparatus is None:
        return []
    gravity = impacts.apparatus.gravity
    off, error = gravity.value / GRAVITY - 1, gravity.error / GRAVITY
    if abs(off) <= max(thresholds.scale_off, thresholds.apparatus_sigmas * error):
        return []
    wrong = "large" if off > 0 else "small"
    sentence = (
        f"gravity in free flight is {gravity.value:.3f} ± {gravity.error:.1g} m/s² and not {GRAVITY}: lengths "
        f"are too {wrong} by {abs(off):.1%}, or the frame rate is by {abs((1 + off) ** 0.5 - 1):.1%}"
    )
    evidence = (
        Evidence(quantity="gravity", value=gravity.value, unit="m/s²"),
        Evidence(quantity="standard_error", value=gravity.error, unit="m/s²"),
        Evidence(quantity="off", value=off),
    )
    return [Finding(name="scale_off", sentence=sentence, evidence=evidence)]


def apparatus_notes(impacts: Impacts) -> list[Finding]:
    """What is known of the apparatus without any impact, and what follows for the effects that say the same."""
    if impacts.apparatus is None:
        return []
    known = impacts.apparatus
    parts = [f"gravity {_said(known.gravity, 'm/s²')}"]
    parts += [] if known.drag is None else [f"drag {_said(known.drag, '1/s')}"]
    parts += [f"floor inclined by {_said(angle, '°')}" for angle in _angle(known.slope)]
    parts += [f"zero of θ off by {_said(angle, '°')}" for angle in _angle(known.orientation)]
    sentence = (
        f"measured without any impact: {', '.join(parts)}, contact at the instant at which flights meet; effects that "
        "say the same go no more than three standard errors beyond"
    )
    return [Finding(name="apparatus", sentence=sentence, evidence=_evidence(known), mistake=False)]


def _angle(angle: Measured | None) -> list[Measured]:
    """A known angle in degrees."""
    return [] if angle is None else [Measured(value=degrees(angle.value), error=degrees(angle.error))]


def _said(known: Measured, unit: str) -> str:
    return f"{known.value:.3g} ± {known.error:.1g} {unit}".replace(" °", "°")


def _evidence(known: Apparatus) -> tuple[Evidence, ...]:
    values = {
        ("gravity", "m/s²"): known.gravity,
        ("drag", "1/s"): known.drag,
        ("floor_slope", "rad"): known.slope,
        ("theta_zero", "rad"): known.orientation,
        ("delay", "s"): known.delay,
    }
    return tuple(
        Evidence(quantity=quantity, value=number, unit=unit)
        for (name, unit), one in values.items()
        if one is not None
        for quantity, number in ((name, one.value), (f"{name}_error", one.error))
    )
