"""Gravity in recordings as read: the acceleration that all free flights share, in the file's units and axes.

Parabolas are fitted to all windows of a few recordings.  A body in flight, and nothing else that lasts, has the same
acceleration in every window; a body at rest has none.  The most common acceleration that is not zero is gravity.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from contactlearn.errors import DataError
from contactlearn.tracks.detection import frame_noise
from contactlearn.tracks.flight import windows
from contactlearn.tracks.track import Array, Recording

_DURATION = 0.06  # s of a window
_NARROWEST, _WIDEST = 7, 61  # frames
_SMOOTH = 2.0  # mean squared residual in units of the noise up to which a window holds one motion
_SURE = 8.0  # standard deviations of an acceleration that is not zero
_NEAR = 0.05  # relative distance of accelerations that are the same
_FEWEST = 6  # windows that agree
_TRIED = 300


@dataclass(frozen=True, eq=False, kw_only=True)
class Gravity:
    """Gravity in a file's axes.

    Args:
        vector: in units of length per s², [2 or 3].
        error: standard error of its size.
        windows: that agree on it.
    """

    vector: Float[Array, " d"]
    error: float
    windows: int

    @property
    def size(self) -> float:
        """Its size in units of length per s²."""
        return float(np.linalg.norm(self.vector))


def find_gravity(recordings: Sequence[Recording]) -> Gravity:
    """Find gravity in recordings.

    Raises:
        DataError: no acceleration is common.
    """
    parts = [_accelerations(recording) for recording in recordings]
    accelerations, errors = (np.concatenate(part) for part in zip(*parts, strict=True))
    sizes, spread = np.linalg.norm(accelerations, axis=1), np.linalg.norm(errors, axis=1)
    moving = sizes > _SURE * spread
    accelerations, spread, sizes = accelerations[moving], spread[moving], sizes[moving]
    if len(sizes) >= _FEWEST:
        tried = np.unique(np.linspace(0, len(sizes) - 1, min(_TRIED, len(sizes))).astype(int))
        apart = np.linalg.norm(accelerations[tried, None] - accelerations, axis=2)
        agree = apart <= _NEAR * sizes[tried, None] + 3 * spread
        best = agree[int(agree.sum(1).argmax())]
        if best.sum() >= _FEWEST:
            mean = np.average(accelerations[best], axis=0, weights=1 / spread[best] ** 2)
            best = np.linalg.norm(mean - accelerations, axis=1) <= _NEAR * np.linalg.norm(mean) + 3 * spread
            weight = 1 / spread[best] ** 2
            mean = np.average(accelerations[best], axis=0, weights=weight)
            along = (accelerations[best] - mean) @ mean / np.linalg.norm(mean)
            freedom = max(best.sum() / _NARROWEST, 1.0)  # windows overlap
            error = np.sqrt(np.average(along**2, weights=weight) / freedom)
            return Gravity(vector=mean, error=float(error), windows=int(best.sum()))
    raise DataError(
        f"{recordings[0].source}: no free flight is seen: no acceleration is common to the recordings; state units, up "
        "and frame rate (data.unit, data.up, data.rate), and check that the body flies for "
        f"{_DURATION:g} s or longer"
    )


def _accelerations(recording: Recording) -> tuple[Array, Array]:
    """Accelerations [S, d] of windows that hold one motion, and their standard errors."""
    time, width = recording.time, recording.position.shape[1]
    frames = int(np.clip(round(_DURATION / np.median(np.diff(time))), _NARROWEST, _WIDEST))
    if len(time) < frames or not recording.seen.any():
        return np.zeros((0, width)), np.zeros((0, width))
    pose = np.column_stack((recording.position, np.zeros((len(time), 3 - width))))
    sigma = np.maximum(frame_noise(time, pose, frames), 1e-9 * np.nanmax(np.abs(pose), initial=1e-9))
    fits = windows(time, pose, frames, 2, None)
    share = ((fits.residual / sigma) ** 2).sum(1)[:, :width].sum(1) / (width * np.maximum(fits.count - 3, 1))
    good = (fits.count >= max(5, 0.7 * frames)) & (share <= _SMOOTH)
    errors = 2 * sigma / np.sqrt(np.maximum(fits.told, 1e-30))
    return 2 * fits.leading[good, :width], errors[good, :width]
