"""Recordings as trackers write them, and tracks: the same in the plane of motion or in space, in SI and world axes.

    Recording   time [T] in s, position [T, 2 or 3] in the file's units and axes, an angle [T] or a quaternion [T, 4]
    Track       time [T] in s, pose (x, y, θ) [T, 3] in m and rad with y up, distance [T] from the plane in m; in space
                pose [T, 7], a position with z up and a quaternion

A frame that the tracker lost is not a number in all of its coordinates.  Time stamps grow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.poses import Array, arms, orientation, turn
from contactlearn.data.recordings.sufficiency import NEEDED

Mask = np.ndarray
_DIGITS = (1e-2, 1e-3, 1e-4)  # s, to which time stamps are rounded
_ROUNDED = 20  # steps that show it
_EXACT = 1e-3  # of a digit, by which a rounded stamp may differ from a multiple of it
_OF_ROUNDING = 0.75  # of a digit, up to which stamps are off an even grid by rounding: half of one, and its fit
_NO_TURN = 0.02  # of an entry of Rᵀ R − 1, above which a matrix is no rotation
_PAUSE = 0.4  # s without a frame: bodies are thrown again, and what they hit meanwhile is lost anyhow
_PAUSE_STEPS = 5  # between frames, which a pause lasts as well
_SENSELESS = 1e50  # of a coordinate in any unit: products of a few such numbers still are finite


def rotations(matrix: Float[Array, "t 9"]) -> Bool[Mask, " t"]:
    """Whether matrices, row by row, are rotations; those of lost frames are zero."""
    R = np.where(np.abs(matrix) < 2, matrix, 0.0).reshape(-1, 3, 3)
    off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max((1, 2))
    return (off < _NO_TURN) & (np.linalg.det(R) > 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """Poses of one body over time, as read.

    Args:
        name: of the recording, one of its own.
        source: the file that it came from.
        time: of the frames in s.
        position: of the tracked point in the file's unit of length and axes.
        angle: in the plane, for positions in a plane, in the file's unit.
        quaternion: in the file's order of components, for positions in space; or the orientation as turns [T, 3] in rad
            about x, y and z, or as a matrix [T, 9] row by row (`frame.ORDERS`).
        unit: of length, where the format says so.
        order: of the quaternion's components, where the format or the names of its columns say so.
        markers: mean places [m, d] in the body about the tracked point, where the pose is found from markers.
        turned: whether the file's arrays have a column a frame.

    Raises:
        DataError: fewer than two frames, columns of unequal length, or time stamps that do not grow.
    """

    name: str
    source: str
    time: Float[Array, " t"]
    position: Float[Array, "t d"]
    angle: Float[Array, " t"] | None = None
    quaternion: Float[Array, "t c"] | None = None
    unit: str | None = None
    order: str | None = None
    markers: Float[Array, "m d"] | None = None
    turned: bool = False

    def __repr__(self) -> str:
        seconds = self.time[-1] - self.time[0]
        return f"Recording({self.name!r}, {len(self.time)} frames in {seconds:.3g} s, source={self.source!r})"

    def __post_init__(self) -> None:
        frames = len(self.time)
        if frames < NEEDED.frames_of_recording:
            raise DataError(
                f"{self.source}: {self.name}: has {frames} frames; at least {NEEDED.frames_of_recording} are needed"
            )
        parts = 4 if self.quaternion is None or len(self.quaternion[0]) not in (3, 9) else len(self.quaternion[0])
        wanted = {"position": (frames, len(self.position[0])), "angle": (frames,), "quaternion": (frames, parts)}
        for name, shape in wanted.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise DataError(f"{self.source}: {self.name}: {name} must have shape {shape}, got {np.shape(value)}")
        if (self.angle is None) == (self.quaternion is None) or len(self.position[0]) != (
            2 if self.quaternion is None else 3
        ):
            raise DataError(f"{self.source}: {self.name}: needs x, y and an angle, or x, y, z and a quaternion")
        if self.quaternion is not None and parts == 9:
            there = np.isfinite(self.quaternion).all(1) & self.quaternion.any(1)
            if there.any() and not rotations(self.quaternion[there]).any():
                raise DataError(
                    f"{self.source}: {self.name}: an orientation of nine numbers must be a matrix of a right-handed "
                    "turn, row by row; check their order"
                )
        step = np.diff(self.time)
        if not np.isfinite(self.time).all() or (step <= 0).any():
            k = int(np.argmax(~(step > 0))) + 1
            kind = "repeats" if step[k - 1] == 0 else "runs back" if step[k - 1] < 0 else "is not a number"
            raise DataError(f"{self.source}: {self.name}: time must grow; it {kind} at frame {k + 1}")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rotation(self) -> Float[Array, "t c"]:
        """The angle or the quaternion, as columns."""
        if self.quaternion is not None:
            return self.quaternion
        assert self.angle is not None
        return self.angle[:, None]

    @property
    def seen(self) -> Bool[Mask, " t"]:
        """Frames in which every coordinate is a number and not senselessly large, and the orientation is one."""
        values = np.column_stack((self.position, self.rotation))
        seen = np.logical_and.reduce(np.abs(values) < _SENSELESS, axis=-1)  # false where it is not a number
        if self.quaternion is None or self.quaternion.shape[1] == 3:
            return seen
        if self.quaternion.shape[1] == 9:
            return seen & rotations(np.where(seen[:, None], self.quaternion, 0.0))
        return seen & (np.abs(self.quaternion).max(axis=-1) > 1 / _SENSELESS)


def parted(recording: Recording) -> list[Recording]:
    """The recordings before and after each pause of 0.4 s and more in which no frame was seen."""
    seen = np.flatnonzero(recording.seen)
    ends = np.flatnonzero(
        np.diff(recording.time[seen]) > max(_PAUSE, _PAUSE_STEPS * np.median(np.diff(recording.time)))
    )
    if not len(ends):
        return [recording]
    spans = zip(np.append(0, ends + 1), np.append(ends, len(seen) - 1), strict=True)
    frames = [slice(seen[first], seen[last] + 1) for first, last in spans if last - first >= NEEDED.frames_of_recording]
    return [
        replace(
            recording,
            name=f"{recording.name} {number}",
            time=recording.time[part],
            position=recording.position[part],
            angle=None if recording.angle is None else recording.angle[part],
            quaternion=None if recording.quaternion is None else recording.quaternion[part],
        )
        for number, part in enumerate(frames, 1)
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class Track:
    """Motion of one body in a plane or in space.

    Args:
        name: of the recording.
        time: of the frames in s.
        pose: (x, y, θ) in m, m and rad, θ continuous but for whole turns; in space (x, y, z) and a unit quaternion.
        out_of_plane: distance of the tracked point from the plane of motion in m; None where no other was recorded.
        tilted: angle in rad between the body's axis of rotation and the normal of the plane, or None.
        low: height in m of the lowest point of a body in space, where its shape is known.
    """

    name: str
    time: Float[Array, " t"]
    pose: Float[Array, "t m"]
    out_of_plane: Float[Array, " t"] | None = None
    tilted: Float[Array, " t"] | None = None
    low: Float[Array, " t"] | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def d(self) -> int:
        """Components of a position."""
        return 2 if self.pose.shape[1] == 3 else 3

    @property
    def k(self) -> int:
        """Components of a velocity."""
        return 3 * self.d - 3

    @property
    def height(self) -> Float[Array, " t"]:
        """Upward coordinate in m."""
        return self.pose[:, self.d - 1]

    @cached_property
    def seen(self) -> Bool[Mask, " t"]:
        """Frames that the tracker did not lose."""
        return finite(self.pose)

    @cached_property
    def step(self) -> float:
        """Median time between two frames in s."""
        return float(np.median(np.diff(self.time)))


def about_centre(track: Track, centre: Sequence[float]) -> Track:
    """The track of a point of the body, given from the tracked point in m along the body's axes."""
    if not any(centre):
        return track
    pose = track.pose.copy()
    pose[:, : track.d] += arms(centre, orientation(pose))
    return replace(track, pose=pose)


def finite(values: Float[Array, "*batch d"]) -> Bool[Mask, "*batch"]:
    """Where every number along the last axis is finite."""
    return np.logical_and.reduce(np.isfinite(values), axis=-1)


def continuous(angle: Float[Array, " t"], time: Float[Array, " t"], folds: int = 1) -> Float[Array, " t"]:
    """The angle in rad without jumps of a turn over `folds`; over lost frames it goes on at the last rate."""
    seen = np.isfinite(angle)
    there, when = folds * angle[seen], time[seen]
    out = np.full_like(angle, np.nan)
    if len(there) == 0:
        return out
    step, gap = turn(np.diff(there)), np.diff(when)
    if len(step) > 1:
        rate = np.concatenate((step[:1] / gap[:1], step[:-1] / gap[:-1]))
        expected = np.where(gap > 1.5 * np.median(gap), rate * gap, 0.0)
        step = expected + turn(step - expected)
    out[seen] = (there[0] + np.concatenate(([0.0], np.cumsum(step)))) / folds
    return out


def mean_step(time: Float[Array, " t"]) -> float:
    """Mean time between two frames, as time stamps are: rounded ones do no harm, nor do frames that are skipped."""
    step = np.diff(time)
    return float(np.mean(step[step <= 1.5 * np.median(step)]))


def on_grid(time: Float[Array, " t"]) -> Float[Array, " t"]:
    """Even times of frames whose stamps are rounded, such as 4 and 5 ms apart at 240 Hz; others are as they are."""
    step = np.diff(time)
    if len(step) < _ROUNDED or not np.isfinite(time).all() or (step <= 0).any():
        return time
    for digit in _DIGITS:
        if np.abs(time / digit - np.round(time / digit)).max() < _EXACT:
            break
    else:
        return time
    number = np.concatenate(([0.0], np.cumsum(np.round(step / mean_step(time)))))
    even = np.polyval(np.polyfit(number, time, 1), number)
    uneven = np.ptp(step[np.diff(number) == 1]) > digit / 2 if (np.diff(number) == 1).any() else False
    return even if uneven and np.abs(even - time).max() <= digit * _OF_ROUNDING else time
