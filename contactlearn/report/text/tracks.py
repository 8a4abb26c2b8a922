"""Findings in recordings: impacts and their errors, conventions with their evidence, refusals by reason."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contactlearn.core.numerics import number, readable
from contactlearn.data.recordings.frame import Clue
from contactlearn.data.recordings.result import REASONS, Reason, Refusal
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.tracks import Tracked
from contactlearn.mechanics.apparatus import Row
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.shapes import Cornered
from contactlearn.report.text.numbers import percent

_OF_THE_BODY = ("inertia", "corner", "oblong")  # rows beside which stands the user's shape or inertia
_SENSES = {"as_read": "turning as the axes do", "mirrored": "turning against the axes, such as clockwise"}
_STAR = (
    "  * differs from what is assumed or stated by more than three standard errors; corrected before any fit, unless "
    "data.correct=[]"
)
_LEAST_SHARE = 5e-4  # that is not 0.0 %
_MANY_CORNERS = 12  # of a polygon or polyhedron, from which on it may stand for a round one
_SLOW = 60.0  # frames a second, below which the rate limits velocities


def tracks_summary(tracked: Tracked, out: Path, refused: Path) -> list[str]:
    """Describe what was found and where it was written, line by line."""
    facts = [f"  {name:<8} {words}" for name, words in tracks_facts(tracked)]
    card = ["what the recordings say of the rig"]
    card += [f"  {row.quantity:<29} {rig_text(row)}" for row in tracked.rig.rows()]
    if any(row.differs for row in tracked.rig.rows()):
        card.append(_STAR)
    left_out = [*_refused(tracked.survey.refusals, refused), *_round_rim(tracked)]
    return [f"{tracks_headline(tracked)}, written to {out}", *facts, *card, *left_out]


def rig_text(row: Row) -> str:
    """Write a row of the rig card in a line; a star marks a difference of three errors."""
    word = "stated" if row.name in _OF_THE_BODY else "assumed"
    if row.name.startswith("centre_"):  # a centre in data.shape places the corners, not the tracked point
        word = "from the tracked point, assumed"
    return f"{row.measured}{row.said and f', {word} {row.said}'}{' *' if row.differs else ''}, from {row.known_from}"


def tracks_headline(tracked: Tracked) -> str:
    """Write the numbers of impacts and recordings, and the errors before contact beside the approach."""
    impacts, up = tracked.impacts, tracked.impacts.space.d - 1
    counts = f"{len(impacts)} impacts from {tracked.survey.recordings} recordings"
    if impacts.v_pre_cov is None:
        return counts
    error = impacts.v_pre_cov[:, up, up].sqrt().median().item()
    share = error / max(impacts.v_pre[:, up].abs().median().item(), 1e-12)
    of_them = f" ({percent(share, 1)} of them)" if share >= _LEAST_SHARE else ""
    return f"{counts}, normal velocities before contact ± {number(1e3 * error, 2)} mm/s{of_them}"


def tracks_facts(tracked: Tracked) -> list[tuple[str, str]]:
    """List conventions with their evidence, the floor, errors and missing frames, by name."""
    facts = [*map(_convention, tracked.survey.frame.clues), *_body(tracked), *_floor(tracked), *_errors(tracked)]
    facts = [*_rate(tracked), *facts]
    missing = sum(contact.missing > 0 for contact in tracked.survey.contacts)
    if missing:
        facts.append(("missing", f"frames at contact in {missing} impacts, though their time stamps show no gap"))
    return facts


def _rate(tracked: Tracked) -> list[tuple[str, str]]:
    """Warn of few frames a second, with the errors of velocities that follow."""
    steps = [one.track.step for one in tracked.searched.values()]
    if not steps or (rate := 1 / float(np.median(steps))) >= _SLOW or tracked.impacts.v_post_cov is None:
        return []
    up = tracked.impacts.space.d - 1
    error = tracked.impacts.v_post_cov[:, up, up].sqrt().median().item()
    share = error / max(tracked.impacts.v_post[:, up].abs().median().item(), 1e-12)
    words = (
        f"only {number(rate, 2)} a second: velocities after contact are uncertain by ± {number(1e3 * error, 2)} mm/s"
    )
    return [
        (
            "frames",
            f"{words} ({percent(share, 1)} of them), and contacts less than {number(16 / rate, 1)} s apart are lost",
        )
    ]


def refusals_by_reason(refusals: Sequence[Refusal]) -> list[tuple[Reason, int]]:
    """Count the refusals of each reason, the most frequent first."""
    return Counter(refusal.reason for refusal in refusals).most_common()


def refusal_number(refusal: Refusal) -> str:
    """Write the number that decided a refusal: frames in neither flight 3."""
    return _with_unit(refusal.quantity, refusal.value, refusal.unit)


_SOURCES = {True: "stated", False: "found", None: "assumed"}


def _convention(clue: Clue) -> tuple[str, str]:
    evidence = _with_unit(clue.quantity, clue.number, clue.unit)
    turning = ", ".join(f"{one} ({_SENSES[one]})" if one in _SENSES else one for one in clue.value.split(", "))
    return clue.convention, f"{turning}, {_SOURCES[clue.stated]}: {evidence}"


def _with_unit(quantity: str, value: float, unit: str) -> str:
    own = "" if unit == "–" or quantity.startswith(unit) else f" {unit}"
    return f"{quantity} {number(value, 3)}{own}" if math.isfinite(value) else quantity


def _body(tracked: Tracked) -> list[tuple[str, str]]:
    """State what is taken for the centre of mass, and contact points where the shape is the hull of the markers."""
    if tracked.hull is None and tracked.rig.centre_a is None:
        point = "the mean of the markers" if tracked.options.layout.markers else "the point that was tracked"
        return [("centre", f"of mass, assumed: {point}; flights do not show where it is")]
    if tracked.hull is None or tracked.r_cov is None:
        return []
    x, y = (1e3 * np.sqrt(np.median(tracked.r_cov.diagonal(axis1=1, axis2=2), 0))).tolist()
    centre = "uniform density is assumed" if tracked.centre is None else "the centre of mass is the stated one"
    return [
        ("shape", f"the convex hull of {len(tracked.hull.places)} markers, assumed to lie on the outline; {centre}"),
        ("points", f"of contact are the lowest markers, ± {number(x, 2)} and {number(y, 2)} mm in the median"),
    ]


def _floor(tracked: Tracked) -> list[tuple[str, str]]:
    floor, rests = tracked.floor, len(tracked.survey.rests)
    shown = len(tracked.survey.contacts) + floor.rests
    if shown < NEEDED.heights_of_error:
        said = f"at {number(1e3 * floor.height.value, 3)} mm, too few contacts ({shown}) for an error"
    else:
        height = f"at {readable(floor.height.value, floor.height.error, 'm')}"
        said = f"{height}, contacts scatter about it by {number(1e3 * floor.scatter, 2)} mm"
    facts = [("floor", said)]
    if rests:
        lie = f"{floor.rests} of {rests} bodies at rest lie flat on the floor, which is also fitted to them"
        facts.append(("rests", lie))
    return facts


def _errors(tracked: Tracked) -> list[tuple[str, str]]:
    impacts, facts = tracked.impacts, list[tuple[str, str]]()
    for when, covariance in (("before", impacts.v_pre_cov), ("after", impacts.v_post_cov)):
        if covariance is not None:
            errors = covariance.diagonal(dim1=-2, dim2=-1).sqrt().median(0).values.tolist()
            *across, up = (number(1e3 * error, 2) for error in errors[: impacts.space.d])
            spins = errors[impacts.space.d :]
            words = f"{', '.join(across)} and {up} mm/s, {number(sum(spins) / len(spins), 2)} rad/s in the median"
            facts.append(("errors", f"{when} contact: {words}"))
    return facts


def _refused(refusals: Sequence[Refusal], path: Path) -> list[str]:
    """Count the refusals by reason, and name the files that could not be read."""
    if not refusals:
        return ["Nothing was refused."]
    reasons = ", ".join(f"{REASONS[reason]} {count}" for reason, count in refusals_by_reason(refusals))
    lines = [f"{len(refusals)} parts of recordings were refused, see {path}: {reasons}"]
    return lines + [f"  left out {r.message}" for r in refusals if r.reason is Reason.NOT_READ]


def _round_rim(tracked: Tracked) -> list[str]:
    """Warn of a round rim that is stated as a polygon: beside its lowest corner the next ones may always hit, too."""
    second = Counter(one.reason for one in tracked.survey.refusals)[Reason.SECOND_CORNER]
    counts = [len(one.corners()) for one in shapes_among(tracked.impacts.shape).values() if isinstance(one, Cornered)]
    if second <= len(tracked.impacts) or max(counts, default=0) < _MANY_CORNERS:
        return []
    return [
        f"  the shape has {max(counts)} corners: of a round rim that is written as corners the next ones are near the "
        "floor, too; state the round shape, {kind: disc, radius: R} in a plane, {kind: cylinder, …} in space"
    ]
