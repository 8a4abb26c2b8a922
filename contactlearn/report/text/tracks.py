"""What was found in recordings: impacts and their errors, conventions with their evidence, refusals by reason."""

from collections import Counter
from collections.abc import Sequence
from math import degrees
from pathlib import Path

import numpy as np

from contactlearn.data.tracks import Tracked
from contactlearn.report.text.numbers import number
from contactlearn.tracks.result import Reason, Refusal

REASONS = {
    Reason.DOUBLE_HIT: "several hits",
    Reason.SLIDING: "sliding or rolling",
    Reason.REST: "at rest",
    Reason.TOO_FEW_FRAMES: "too few frames",
    Reason.LOST_FRAMES: "frames lost at the wrong moment",
    Reason.HAND_OR_WALL: "a hand or a wall",
    Reason.OUT_OF_PLANE: "out of the plane",
    Reason.NOT_READ: "could not be read",
}
"""Reasons of refusals as a person writes them."""
_STANDARD = 9.81  # m/s²


def tracks_summary(found: Tracked, out: Path, refused: Path) -> list[str]:
    """Say what was found and where it was written, line by line."""
    frame, floor, impacts = found.survey.frame, found.floor, found.impacts
    lines = [f"{len(impacts)} impacts from {found.survey.recordings} recordings, written to {out}"]
    for clue in frame.clues:
        origin = "stated" if clue.stated else "found"
        evidence = f"{clue.quantity} {number(clue.number, 3)} {clue.unit}".rstrip(" –")
        lines.append(f"  {clue.convention:<8} {clue.value}, {origin}: {evidence}")
    size, error = float(np.hypot(*frame.gravity)), frame.gravity_error
    off = number(100 * (size / _STANDARD - 1), 2)
    lines.append(f"  {'gravity':<8} {number(size)} ± {number(error, 1)} m/s², {off} % off {_STANDARD}")
    lines.append(
        f"  {'floor':<8} at {number(1e3 * floor.height, 4)} ± {number(1e3 * floor.height_error, 1)} mm, "
        f"inclined by {number(degrees(floor.slope), 2)}° ± {number(degrees(floor.slope_error), 1)}°"
    )
    if impacts.v_pre_cov is not None and impacts.v_post_cov is not None:
        for when, covariance in (("before", impacts.v_pre_cov), ("after", impacts.v_post_cov)):
            x, y, spin = covariance.diagonal(dim1=-2, dim2=-1).sqrt().median(0).values.tolist()
            lines.append(
                f"  {'errors':<8} {when} contact: {number(1e3 * x, 2)} and {number(1e3 * y, 2)} mm/s, "
                f"{number(spin, 2)} rad/s in the median"
            )
    missing = sum(contact.missing > 0 for contact in found.survey.contacts)
    if missing:
        lines.append(f"  {'missing':<8} frames at contact in {missing} impacts, though their time stamps show no gap")
    return [*lines, *refusal_lines(found.survey.refusals, refused)]


def refusal_lines(refusals: Sequence[Refusal], path: Path) -> list[str]:
    """Say how much was refused for which reason, and name the files that could not be read."""
    if not refusals:
        return ["Nothing was refused."]
    counts = Counter(refusal.reason for refusal in refusals)
    said = ", ".join(f"{REASONS[reason]} {count}" for reason, count in counts.most_common())
    lines = [f"{len(refusals)} parts of recordings were refused, see {path}: {said}"]
    return lines + [f"  left out {r.message}" for r in refusals if r.reason is Reason.NOT_READ]
