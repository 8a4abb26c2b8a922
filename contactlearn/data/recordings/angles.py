"""Unit and sense of angles, stated or found: the reading that closes the moment balance of the impacts.

The balance I Δω = r_x P_n − r_y P_t holds in the right unit and sense alone, of bodies that spin.  A stated reading in
which it does not hold, though it holds in another one, contradicts the recordings.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.conventions import ANGLES, SENSES, Conventions, find_frame
from contactlearn.data.recordings.frame import Clue
from contactlearn.data.recordings.impacts import moment_imbalance
from contactlearn.data.recordings.result import Hit
from contactlearn.data.recordings.survey import TrackOptions, tracked
from contactlearn.data.recordings.track import Recording
from contactlearn.mechanics.shapes import Shape

_TELL = 3  # contacts that tell it, at least

_Reading = tuple[str | None, str]  # unit, None for quaternions, and sense


def find_angles(
    recordings: Sequence[Recording], options: TrackOptions, shape: Shape, gyration: float
) -> tuple[Conventions, Clue]:
    """Find the unit and sense of angles that are not stated, and check those that are.

    Args:
        recordings: a few.
        options: with the conventions that are stated.
        shape: of the body.
        gyration: squared radius of gyration in m².

    Raises:
        DataError: a stated reading contradicts the impacts, or one is neither stated nor found.
    """
    stated, limit, source = options.conventions, options.thresholds.frame.reading, recordings[0].source
    known = [*ANGLES] if recordings[0].quaternion is None else [stated.angle]
    units = [stated.angle] if stated.angle else known
    left = _left_over(recordings, options, units, [stated.sense] if stated.sense else [*SENSES], shape, gyration)
    best, *others = sorted(left, key=lambda reading: left[reading])
    if left[best] > limit and (len(units) < len(known) or stated.sense):
        every = _left_over(recordings, options, known, [*SENSES], shape, gyration)
        closing = min(every, key=lambda reading: every[reading])
        if every[closing] <= limit * min(left[best], 1.0):
            leaves = f"leaves {left[best]:.2g} with it" if left[best] < math.inf else "cannot be told with it"
            raise DataError(
                f"{source}: the impacts contradict {_settings(stated.angle, stated.sense)}: their moment balance "
                f"{leaves}, and {every[closing]:.2g} with {_settings(*closing)}"
            )
    if others and not left[best] <= limit * left[others[0]]:
        asked = _settings("…" if len(units) > 1 else None, None if stated.sense else "…")
        raise DataError(
            f"{source}: in which unit and sense angles are measured is not seen: the moment balance of impacts leaves "
            f"{left[best]:.2f} with one reading and {left[others[0]]:.2f} with another; state {asked}"
        )
    clue = Clue(
        convention="angles",
        value=", ".join(name for name in best if name),
        stated=not others,
        quantity="moment balance left over",
        number=left[best],
        unit="–",
    )
    return replace(stated, angle=best[0], sense=best[1]), clue


def _settings(angle: str | None, sense: str | None) -> str:
    """The settings of a reading, as they are stated."""
    named = (("angle", angle), ("sense", sense))
    return " and ".join(f"data.{name}={value}" for name, value in named if value)


def _left_over(
    recordings: Sequence[Recording],
    options: TrackOptions,
    units: Sequence[str | None],
    senses: Sequence[str],
    shape: Shape,
    gyration: float,
) -> dict[_Reading, float]:
    """Share of the moment balance that each reading leaves over; infinite where contacts are too few to tell."""
    left: dict[_Reading, float] = {}
    for unit in units:
        contacts = _contacts(recordings, replace(options.conventions, angle=unit, sense="as_read"), options)
        for sense in senses:
            enough = len(contacts) >= _TELL
            left[unit, sense] = moment_imbalance(contacts, shape, gyration, SENSES[sense]) if enough else math.inf
    return left


def _contacts(recordings: Sequence[Recording], conventions: Conventions, options: TrackOptions) -> list[Hit]:
    """Contacts of a few recordings under some conventions."""
    frame = find_frame(recordings, conventions, options.thresholds.frame)
    ready = options.in_air(frame)
    return [contact for recording in recordings for contact in tracked(recording, frame, ready).contacts]
