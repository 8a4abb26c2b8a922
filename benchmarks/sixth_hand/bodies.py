"""Bodies by their mass, and the point with which each touches the floor."""

from dataclasses import replace
from functools import partial

import numpy as np

from fourth_hand.bodies import Body, box, ellipse, polygon, regular
from fourth_hand.laboratory import turned


def _ball(mass: float, radius: float, share: float) -> Body:
    """A disc or a ball, told as an ellipse, whose moment of inertia is `share` m R²."""
    return replace(ellipse(mass, radius, radius), inertia=share * mass * radius**2)


def _regular(mass: float, corners: int, radius: float) -> Body:
    """A regular polygon about 0 to the last bit, with which a step of a soft contact may end or not."""
    angles = 2 * np.pi * np.arange(corners) / corners
    about = radius * np.stack([np.cos(angles), np.sin(angles)], -1)
    return replace(regular(mass, corners, radius, 0.0), size=about)


OVAL, EGG = partial(ellipse, a=0.040, b=0.026), partial(ellipse, a=0.031, b=0.023)
PUCK, COIN = partial(_ball, radius=0.038, share=1 / 2), partial(_ball, radius=0.0121, share=1 / 2)
MARBLE, GOLF = partial(_ball, radius=0.0125, share=2 / 5), partial(_ball, radius=0.02135, share=2 / 5)
SUPERBALL, CRICKET = partial(_ball, radius=0.0245, share=2 / 5), partial(_ball, radius=0.036, share=2 / 5)
PINGPONG, TENNIS = partial(_ball, radius=0.020, share=2 / 3), partial(_ball, radius=0.033, share=0.55)
SQUARE, DIE = partial(box, width=0.050, height=0.050), partial(box, width=0.016, height=0.016)
BOX, ROD = partial(box, width=0.080, height=0.046), partial(box, width=0.180, height=0.008)
HEXAGON, PENTAGON = partial(_regular, corners=6, radius=0.035), partial(_regular, corners=5, radius=0.032)
TRIANGLE = partial(_regular, corners=3, radius=0.040)
STONE = partial(
    polygon,
    corners=[(-0.038, -0.020), (-0.004, -0.033), (0.034, -0.022), (0.041, 0.008), (0.012, 0.031), (-0.029, 0.022)],
)


def touching(body: Body, theta: np.ndarray, tilt: float = 0.0, radius: float = 0.0) -> np.ndarray:
    """Point nearest to a floor inclined by `tilt`, from the centre [n, 2]; corners are round with this radius in m."""
    if radius:
        body = replace(body, size=_centres(body.size, radius))
    return turned(body.lowest(theta - tilt), tilt) + radius * np.array([np.sin(tilt), -np.cos(tilt)])


def _centres(corners: np.ndarray, radius: float) -> np.ndarray:
    """Centres of the circles that round the corners."""
    sides = [np.roll(corners, shift, axis=0) - corners for shift in (-1, 1)]
    ahead, back = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in sides)
    inward = ahead + back
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    half = 0.5 * np.arccos(np.clip(np.sum(ahead * back, axis=1), -1, 1))
    return corners + inward * (radius / np.sin(half))[:, None]


def gap(body: Body, theta: np.ndarray) -> np.ndarray:
    """Height of the second lowest corner above the lowest [n], infinite for what is round."""
    if body.kind != "polygon":
        return np.full(len(theta), np.inf)
    heights = np.sort(body.corners(theta)[..., 1], axis=1)
    return heights[:, 1] - heights[:, 0]
