"""Bodies at rest: their mean pose, and the poses in which a shape comes to rest.

A body is still where the means of its pose over a tenth of a second stay within the noise of a frame.  It rests on a
side that the foot of the perpendicular from its centre of mass is on, or on the flat pole of an ellipse.  On a floor
of slope φ, where gravity leans by γ, the sum of θ and what its zero is off by is then

    polygon      α + φ
    ellipse      α + γ + g (φ − γ) − δ cos(α − β) / (a²/b − b)      g = a² / (a² − b²),  a > b

where the side or pole is below at α on level ground.  An ellipse turns further than the floor, until its centre of mass
is above the contact; one that is δ off along the major axis, at β or 0, turns it to opposite sides on both poles.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.result import Rest
from contactlearn.data.recordings.thresholds import RestThresholds
from contactlearn.data.recordings.track import Array, Track, turn
from contactlearn.mechanics.shapes import Ellipse, Polygon, Shape

_BLOCK = 0.1  # s
_LEAST = np.array((2e-5, 2e-5, 3e-4))  # m, m, rad: no frame of a body at rest is better
_ROUND = 1e-3  # relative difference of an ellipse's semi-axes up to which it is a disc


@dataclass(frozen=True, eq=False, kw_only=True)
class Lying:
    """Poses in which a body comes to rest.

    Args:
        angles: θ in rad on level ground, one for each stable side or pole; none of a disc.
        gain: turn of the body with the slope of the floor.
        arms: turn in rad per m by which the centre of mass is off along the major axis, at each of the angles.
    """

    angles: Float[Array, " k"]
    gain: float
    arms: Float[Array, " k"]

    @classmethod
    def of(cls, shape: Shape) -> "Lying":
        """Poses in which a shape comes to rest; none of one that is round or unknown."""
        match shape:
            case Polygon():
                angles = np.array(_sides(shape))
                return cls(angles=angles, gain=1.0, arms=np.zeros(len(angles)))
            case Ellipse(semi_axes=(first, second)) if abs(first / second - 1) > _ROUND:
                a, b = max(first, second), min(first, second)
                base, arm = 0.0 if first > second else math.pi / 2, b / (a**2 - b**2)
                angles = np.array((base, base + math.pi))
                return cls(angles=angles, gain=a**2 / (a**2 - b**2), arms=arm * np.array((-1.0, 1.0)))
            case _:
                return cls(angles=np.zeros(0), gain=1.0, arms=np.zeros(0))

    def nearest(self, theta: float) -> int:
        """Number of the side or pole on which a body with this θ lies."""
        return int(np.abs(turn(theta - self.angles)).argmin())

    def apart(self, theta: float) -> float:
        """Angle in rad from there."""
        return float(turn(theta - self.angles[self.nearest(theta)]))


def _sides(shape: Polygon) -> list[float]:
    """θ at which each stable side of a polygon is below."""
    corners, angles = np.array(shape.vertices), list[float]()
    for p, q in zip(corners, np.roll(corners, -1, 0), strict=True):
        along = q - p
        if 0 < -(p @ along) < along @ along:
            out = p - along * (p @ along) / (along @ along)
            angles.append(-math.pi / 2 - math.atan2(out[1], out[0]))
    return angles


def find_rests(
    track: Track,
    spans: Sequence[tuple[float, float]],
    sigma: Float[Array, "3"],
    limits: RestThresholds,
) -> tuple[Rest, ...]:
    """Find where a body is still.

    Args:
        track: of it.
        spans: times in s of first and last frames between which to look; of each the longest rest is found.
        sigma: standard deviations of a frame's (x, y, θ).
        limits: that decide.
    """
    size = max(round(_BLOCK / track.step), 2)
    fewest = max(round(limits.lasts / (size * track.step)), 2)
    found = list[Rest]()
    for begin, end in spans:
        frames = np.flatnonzero(track.seen & (track.time >= begin) & (track.time <= end))[::-1]
        blocks = frames[: len(frames) // size * size].reshape(-1, size)
        means = track.pose[blocks].mean(1)
        moves = np.abs(np.diff(means, axis=0)) > limits.moves * np.maximum(sigma, _LEAST)
        edges = np.concatenate(([0], np.flatnonzero(moves.any(1)) + 1, [len(blocks)]))
        longest = int(np.diff(edges).argmax())
        run = means[edges[longest] : edges[longest + 1]]
        if len(run) >= fewest:
            error, pose = run.std(0, ddof=1) / math.sqrt(len(run)), run.mean(0)
            pose[2] = turn(pose[2])
            found.append(Rest(recording=track.name, pose=pose, error=np.maximum(error, _LEAST / size)))
    return tuple(found)
