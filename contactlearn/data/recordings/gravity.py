"""Gravity and drag in recordings as read: the acceleration that all free flights share, in the file's units and axes.

Parabolas are fitted to all windows of a few recordings.  A body in flight, and nothing else that lasts, has the same
acceleration in every window; a body at rest has none.  The most common acceleration that is not zero is gravity.  What
of it is in proportion to the velocity is a linear drag, a = g − c v.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.detection import frame_noise
from contactlearn.data.recordings.flight import window_blocks, windows
from contactlearn.data.recordings.thresholds import FrameThresholds
from contactlearn.data.recordings.track import Array, Recording, mean_step

_DURATION = 0.06  # s of a window
_NARROWEST, _WIDEST = 7, 61  # frames
_SMOOTH = 2.0  # mean squared residual in units of the noise up to which a window holds one motion
_EDGE = 2  # windows before and after one that hold one motion as well: a contact begins at the edge of a window
_SURE = 8.0  # standard deviations of an acceleration that is not zero
_NEAR = 0.05  # relative distance of accelerations that are the same
_FEWEST = 6  # windows that agree
_TRIED = 300
_ROUNDS = 4
_BLOCK = 4  # widths of a window
_BLOCKS = 4  # blocks for each unknown, at least, that tell a drag


@dataclass(frozen=True, eq=False, kw_only=True)
class Gravity:
    """Gravity in a file's axes, and drag.

    Args:
        vector: in units of length per s², [2 or 3].
        covariance: of its errors.
        drag: linear drag c in 1/s: the stated one, or the measured one where it is seen, or 0.
        drag_error: standard error of the measured one; infinite where flights are too few to tell.
    """

    vector: Float[Array, " d"]
    covariance: Float[Array, "d d"]
    drag: float
    drag_error: float

    @property
    def size(self) -> float:
        """Its size in units of length per s²."""
        return float(np.linalg.norm(self.vector))

    @property
    def error(self) -> float:
        """Standard error of its size."""
        return self.error_along(self.vector / self.size)

    def error_along(self, direction: Float[Array, " d"]) -> float:
        """Standard error along a unit vector."""
        return float(direction @ self.covariance @ direction) ** 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class _Motions:
    """Accelerations [S, d] of windows that hold one motion, their standard errors [S], velocities, and blocks.

    Windows of one block overlap; those of different blocks are independent, but for a few at their ends.
    """

    acceleration: Float[Array, "s d"]
    error: Float[Array, " s"]
    velocity: Float[Array, "s d"]
    block: Float[Array, " s"]

    def __getitem__(self, rows: Array) -> "_Motions":
        return _Motions(**{name: value[rows] for name, value in vars(self).items()})


def find_gravity(
    recordings: Sequence[Recording], drag: float | None = None, drag_sigmas: float = FrameThresholds().drag_sigmas
) -> Gravity:
    """Find gravity and drag in recordings.

    Args:
        recordings: a few.
        drag: that is stated, in 1/s.
        drag_sigmas: standard errors of a drag that is allowed for.

    Raises:
        DataError: no acceleration is common.
    """
    motions = _together([_motions(recording, k) for k, recording in enumerate(recordings)])
    sizes = np.linalg.norm(motions.acceleration, axis=1)
    sure = np.flatnonzero(sizes > _SURE * motions.error)  # to choose from; windows that agree are not chosen by size
    if len(sure):
        tried = sure[np.unique(np.linspace(0, len(sure) - 1, min(_TRIED, len(sure))).astype(int))]
        apart = np.linalg.norm(motions.acceleration[tried, None] - motions.acceleration, axis=2)
        agree = apart <= _NEAR * sizes[tried, None] + 3 * motions.error
        best = agree[int(agree.sum(1).argmax())]
        if best.sum() >= _FEWEST:
            return _shared(motions, best, drag, drag_sigmas)
    raise DataError(
        f"{recordings[0].source}: no free flight is seen: no acceleration is common to the recordings; check "
        f"that frames are {mean_step(recordings[0].time):.4g} s apart (time stamps, data.rate), and that the body "
        f"flies for {_DURATION:g} s or longer"
    )


def _together(parts: Sequence[_Motions]) -> _Motions:
    return _Motions(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _shared(motions: _Motions, agree: Array, stated: float | None, sigmas: float) -> Gravity:
    """Gravity and drag of the windows that agree, and of those that then do."""
    known, covariance = _fitted(motions[agree])
    for _ in range(_ROUNDS):
        left = np.linalg.norm(motions.acceleration - known[:-1] + known[-1] * motions.velocity, axis=1)
        agree = left <= _NEAR * np.linalg.norm(known[:-1]) + 3 * motions.error
        known, covariance = _fitted(motions[agree])
    error = float(covariance[-1, -1] ** 0.5) if _told(motions[agree]) else np.inf
    seen = known[-1] > sigmas * error
    drag = stated if stated is not None else float(known[-1]) if seen else 0.0
    if stated is not None or not seen:
        known, covariance = _fitted(motions[agree], drag)
    d = motions.velocity.shape[1]
    return Gravity(vector=known[:d], covariance=covariance[:d, :d], drag=drag, drag_error=error)


def _told(motions: _Motions) -> bool:
    """Whether blocks are enough for their scatter to tell the error of a drag."""
    return len(np.unique(motions.block)) >= _BLOCKS * (motions.acceleration.shape[1] + 1)


def _fitted(motions: _Motions, drag: float | None = None) -> tuple[Array, Array]:
    """Gravity and drag [d + 1] by least squares, or gravity [d] under a given drag, and their covariance.

    The covariance is that of the scatter of the blocks, and no less than the noise of the windows makes.
    """
    count, d = motions.acceleration.shape
    design, y = np.broadcast_to(np.eye(d), (count, d, d)), motions.acceleration
    if drag is None:
        design = np.concatenate((design, -motions.velocity[..., None]), 2)
    else:
        y = y + drag * motions.velocity
    weight = 1 / motions.error**2
    normal = np.einsum("nik,n,nil->kl", design, weight, design)
    known = np.linalg.lstsq(normal, np.einsum("nik,n,ni->k", design, weight, y), rcond=None)[0]
    scores = np.einsum("nik,n,ni->nk", design, weight, y - design @ known)
    blocks, block = np.unique(motions.block, return_inverse=True)
    summed = np.zeros((len(blocks), len(known)))
    np.add.at(summed, block, scores)
    inverse = np.linalg.pinv(normal, hermitian=True)
    few = len(blocks) / max(len(blocks) - len(known), 1)
    scattered, noise = few * inverse @ summed.T @ summed @ inverse, inverse
    return known, np.where(scattered.diagonal().sum() >= noise.diagonal().sum(), scattered, noise)


def _motions(recording: Recording, number: int) -> _Motions:
    """Windows of a recording that hold one motion."""
    time, width = recording.time, recording.position.shape[1]
    frames = int(np.clip(round(_DURATION / np.median(np.diff(time))), _NARROWEST, _WIDEST))
    if len(time) < frames or not recording.seen.any():
        none = np.zeros((0, width))
        return _Motions(acceleration=none, error=none[:, 0], velocity=none, block=none[:, 0])
    pose = np.column_stack((recording.position, np.zeros((len(time), 3 - width))))
    sigma = np.maximum(frame_noise(time, pose, frames), 1e-9 * np.nanmax(np.abs(pose), initial=1e-9))
    parts: list[_Motions] = []
    for block in window_blocks(len(time), frames):
        part = _moving(time[block], pose[block], frames, sigma, width)
        number_of = number + (part.block + block.start) // (_BLOCK * frames) / len(time)
        parts.append(replace(part, block=number_of))
    return _together(parts)


def _moving(time: Array, pose: Array, frames: int, sigma: Array, width: int) -> _Motions:
    """Windows that hold one motion; their block is their first frame."""
    fits = windows(time, pose, frames, 2, None)
    share = ((fits.residual / sigma) ** 2).sum(1)[:, :width].sum(1) / (width * np.maximum(fits.count - 3, 1))
    good = (fits.count >= max(5, 0.7 * frames)) & (share <= _SMOOTH)
    good = sliding_window_view(np.pad(good, _EDGE, mode="edge"), 2 * _EDGE + 1).all(-1)
    errors = 2 * sigma / np.sqrt(np.maximum(fits.told, 1e-30))
    return _Motions(
        acceleration=2 * fits.leading[good, :width],
        error=np.linalg.norm(errors[good, :width], axis=1),
        velocity=_velocities(time, pose[:, :width], frames)[good],
        block=np.flatnonzero(good).astype(np.float64),
    )


def _velocities(time: Float[Array, " t"], position: Float[Array, "t d"], frames: int) -> Float[Array, "s d"]:
    """Mean velocity of each window, between the middles of its first and last thirds."""
    third = frames // 3
    when, where = sliding_window_view(time, frames), np.moveaxis(sliding_window_view(position, frames, axis=0), 1, -1)
    first, last = np.s_[:, :third], np.s_[:, -third:]
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(where[..., 0])
        sums = [(np.nansum(where[part], 1), seen[part].sum(1), (when * seen)[part].sum(1)) for part in (first, last)]
        (a, n, start), (b, m, end) = sums
        n, m = np.maximum(n, 1), np.maximum(m, 1)
        return (b / m[:, None] - a / n[:, None]) / np.maximum(end / m - start / n, 1e-12)[:, None]
