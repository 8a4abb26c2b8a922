"""Inertia and centre of mass of a body that rocks on one of its edges, without a law of contact.

    u · (κ I₀ ω̇ + ω × κ I₀ ω) = u · b × m (ÿ − g)        y = x + R c,  b = p − R c

Whatever friction does, forces along the edge u through p have no moment about it.  Pieces of a few frames are compared
with cubics.  The second derivative of a cubic's fit is a mean ⟨ ⟩ of that of the motion, and products have the mean
⟨b × ÿ⟩ = ⟨b⟩ × ⟨ÿ⟩ + ⟨t²⟩ ḃ × y⃛.  The frames are part of no flight and no impact, so κ and c are a second witness of
what the moment balance of impacts says.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.recordings.flights import Indices
from contactlearn.data.recordings.poses import Array, away, cross, orientation, rotated
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import ROCKING, Estimate
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Cornered, Solid

_LASTS = 0.8  # of a piece over √(|p|/g), the time in which a body rocks; 0.65 to 1 decide alike
_MIN_FRAMES = 5  # of a piece
_MIN_SCATTER = 1e-9  # m²/s², of any scatter of moments
_ROUNDS, _SLIGHT, _ROBUST = 10, 1e-6, 2.0  # of weights; of a difference quotient; scatters from which they fall
_VAGUE = 0.1  # of what is expected: an error beyond it is no estimate, as of c along edges that are all parallel
_OUTLINE = ("corner", "middle_a", "middle_b", "middle_c")
_LEVEL, _CLEAR = 0.02, 0.08  # of |p|: an edge that touches is as level and as still, and the next corner higher

Rocking = Float[Array, "w 4 18"]
"""Of each piece of a recording the mean and three derivatives of the position (3), of the body's axes (9) and of the
rotation vector (3); then in the body's axes the middle of the edge, the way from there to the axis of its rounding, of
radius 1, and the direction of the edge (3 each), with (⟨t²⟩, 0, 0)."""


@lru_cache(maxsize=1)
def _edges(solid: Cornered) -> tuple[Float[Array, "v 3"], Indices, Float[Array, "e 3 3"]]:
    """Corners, the two of each edge, and of each edge what `Rocking` has of it."""
    corners, cut, edges = solid.corners().numpy(), solid.arc_centres().numpy(), solid.edges().sort(-1).values.numpy()
    along = np.diff(corners[edges], axis=1)[:, 0]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return corners, edges, np.stack((corners[edges].mean(1), cut[edges].mean(1), along), 1)


def rocking(track: Track, solid: Solid | None) -> Rocking:
    """Return where a body with corners rocks on an edge, in pieces of equal length."""
    if not isinstance(solid, Solid) or not isinstance(solid, Cornered):
        return np.zeros((0, 4, 18))
    corners, edges, shown = _edges(solid)
    reach = float(np.linalg.norm(corners, axis=-1).max())
    size = max(round(_LASTS * math.sqrt(reach / GRAVITY) / track.step), _MIN_FRAMES)
    heights = rotated(track.pose[:, None, 3:], corners)[..., 2] + track.height[:, None]
    order = np.argsort(heights, -1)[:, :3]
    low = np.take_along_axis(heights, order, -1)
    touching = (low[:, 1] - low[:, 0] < _LEVEL * reach) & (low[:, 2] - low[:, 0] > _CLEAR * reach)
    same = (np.sort(order[:, None, :2], -1) == edges).all(-1) & touching[:, None]
    edge = np.where(same.any(1), same.argmax(1), -1)
    starts = np.flatnonzero(np.diff(edge, prepend=-2))
    found = list[Array]()
    for begin, end in zip(starts, [*starts[1:], len(edge)], strict=True):
        pieces = (end - begin - 2) // size  # what happens just before and after it is left out
        if edge[begin] < 0 or pieces < 1:
            continue
        frames = begin + (end - begin - pieces * size) // 2 + np.arange(pieces * size).reshape(pieces, size)
        found += [_piece(track, one, shown[edge[begin]]) for one in frames if np.ptp(low[one, 0]) < _LEVEL * reach]
    return np.array(found).reshape(-1, 4, 18)


def _piece(track: Track, frames: Indices, edge: Float[Array, "3 3"]) -> Float[Array, "4 18"]:
    """Cubics of the motion about the middle of the piece, by least squares."""
    pose, time = track.pose[frames], track.time[frames] - track.time[frames].mean()
    turned = away(pose, pose[len(frames) // 2])[:, 3:]
    axes = np.stack([rotated(orientation(pose), axis) for axis in np.eye(3)], -1).reshape(-1, 9)
    fit = np.linalg.pinv(np.vander(time, 4, increasing=True)) * np.array((1, 1, 2, 6))[:, None]
    fit[0, 1:] = fit[2].cumsum().cumsum()[:-1] * track.step**2  # weights of second differences in the second derivative
    fit[0, 0] = 0.0
    moved = fit @ np.concatenate((pose[:, :3], axes, turned), 1)
    return np.concatenate((moved, np.vstack((edge, (fit[0] @ time**2, 0, 0)))), 1)


def _turned(R: Float[Array, "n 3 3"], vector: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    return (R @ vector[..., None])[..., 0]


def rocked(
    found: Sequence[Rocking],
    gyration: Float[Array, "3"],
    gravity: Sequence[float],
    outline: Mapping[str, Estimate],
) -> dict[str, Estimate]:
    """Return ln κ and the centre of mass in m about the tracked point, by fields of `Apparatus`.

    None of too few recordings, and no coordinate of the centre that no edge shows.

    Args:
        found: of recordings in which it rocks.
        gyration: I₀/m in m² about the body's axes.
        gravity: in m/s².
        outline: radius of the corners and middle of the outline, as heights show them.
    """
    if len(found) < NEEDED.recordings_of_rocking:
        return {}
    every, first = np.concatenate(found), np.cumsum([0, *(len(one) for one in found[:-1])])
    corner, *shift = (outline[name].value if name in outline else 0.0 for name in _OUTLINE)
    middle, cut, edge, (square, *_) = *np.moveaxis(every[:, :3, 15:], 1, 0), every[:, 3, 15:].T
    centre = middle + corner * cut + shift  # of the rounding, about the tracked point
    R, (x, turned) = every[:, :, 3:12].reshape(-1, 4, 3, 3), (every[..., :3], every[..., 12:15])
    along = _turned(R[:, 0], edge)
    body = [_turned(R[:, 0].swapaxes(1, 2), turned[:, k]) for k in (1, 2)]
    spun = _turned(R[:, 0], gyration * body[1] + cross(body[0], gyration * body[0]))

    def moment(unknown: Float[Array, "4"]) -> Float[Array, " n"]:
        c = unknown[1:]
        b, moving = _turned(R[:, 0], centre - c) - (0.0, 0.0, corner), _turned(R[:, 1], centre - c)
        force, jerk = x[:, 2] + R[:, 2] @ c - gravity, x[:, 3] + R[:, 3] @ c
        return ((math.exp(unknown[0]) * spun - cross(b, force) - square[:, None] * cross(moving, jerk)) * along).sum(-1)

    at, scores, inverse, scatter = np.zeros(4), np.zeros((len(found), 4)), np.eye(4), 0.0
    expected = np.array((1.0, *np.full(3, np.linalg.norm(middle, axis=-1).max())))
    for _ in range(_ROUNDS):
        off = moment(at)
        slope = np.stack([(moment(at + _SLIGHT * one) - off) / _SLIGHT for one in np.eye(4)], -1)
        scatter = max(MAD_SCALE * float(np.median(np.abs(off))), _MIN_SCATTER)
        weight = 1 / np.hypot(1, off / (_ROBUST * scatter))
        inverse = np.linalg.inv(slope.T @ (weight[:, None] * slope) + np.diag((scatter / expected) ** 2))
        scores = np.add.reduceat((weight * off)[:, None] * slope, first)
        at = at - inverse @ scores.sum(0)
    error = np.sqrt((inverse @ scores.T @ scores @ inverse).diagonal() * len(found) / (len(found) - 4))
    shown = scatter * np.sqrt(inverse.diagonal()) < _VAGUE * expected
    each = zip(ROCKING, at.tolist(), error.tolist(), shown, strict=True)
    return {name: Estimate(value=value, error=own) for name, value, own, seen in each if seen}
