"""Friction of bodies that slide on a side until they stop, from their deceleration: no law of contact is needed.

A body that lies on a side and does not roll has v̇ = −μ g − c v along its way, whatever its shape and mass are.  The way
to its end is a parabola of the time; gravity in the same units of length and time cancels errors of both.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.poses import Array, away
from contactlearn.data.recordings.result import SlideToRest
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import Estimate

_FRAMES = 10  # of a slide, at least
_SETTLES = 2  # frames in which the last corner comes down
_STILL = 5.0  # standard deviations of a frame within which a height or a place is the same
_TURNED = 0.05  # rad about a horizontal axis, of a body that does not roll


def find_slides(
    track: Track, spans: Sequence[tuple[float, float]], sigma: Float[Array, "k"]
) -> tuple[SlideToRest, ...]:
    """Find how a body slides until it stops.

    Args:
        track: of it.
        spans: times in s of first and last frames between which to look; each has one slide at most, at its end.
        sigma: standard deviations of a frame's pose.
    """
    found, up = list[SlideToRest](), track.d - 1
    for begin, end in spans:
        frames = np.flatnonzero(track.seen & (track.time >= begin) & (track.time <= end))
        pose, time = track.pose[frames], track.time[frames]
        moved = away(pose, pose[-1:])
        rolls = np.abs(moved[:, track.d : track.d + up]).max(1) > _TURNED
        lies = (np.abs(moved[:, up]) <= _STILL * sigma[up]) & ~rolls
        first = len(lies) - int(lies[::-1].cumprod().sum()) + _SETTLES
        way = moved[first:, :up]
        moving = np.flatnonzero(np.linalg.norm(way, axis=1) > _STILL * sigma[:up].max())
        if len(moving) < _FRAMES:
            continue
        way, t = way[: moving[-1] + 1], time[first:][: moving[-1] + 1] - time[first]
        along = way @ way[0] / np.linalg.norm(way[0])
        slows, speed = 2 * float(np.polyfit(t, along, 2)[0]), float(along[0] - along[-1]) / float(t[-1])
        found.append(SlideToRest(recording=track.name, deceleration=slows, speed=speed))
    return tuple(found)


def friction_of(slides: Sequence[SlideToRest], gravity: float, drag: float) -> Estimate | None:
    """Estimate μ, beside the drag of the air in 1/s: the median over slides, None of too few.

    Its error is that of a median, by their quartiles.
    """
    if len(slides) < NEEDED.slides_of_friction:
        return None
    low, mu, high = np.quantile(
        [(slide.deceleration - drag * slide.speed) / gravity for slide in slides], (0.25, 0.5, 0.75)
    ).tolist()
    deviation = (high - low) / 1.349  # of a normal distribution; its median has √(π/2) times the error of its mean
    return Estimate(value=mu, error=math.sqrt(math.pi / 2 / len(slides)) * deviation)
