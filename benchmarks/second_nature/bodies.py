"""Convex bodies: the point that touches a floor of any slope, and the shape that is declared in a table."""

from dataclasses import dataclass

import numpy as np

from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon

KINDS = ("ellipse", "square", "rectangle", "disc", "triangle")


def turned(p, angle):
    """Vectors [n, 2] turned counter-clockwise by angle [n] or a number."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack((c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1]), -1)


@dataclass(frozen=True)
class Body:
    """A body as declared: kind, half-sizes (a, b) in m, mass in kg and ρ² = I/m in m².

    The real one may differ by `com` (centre of mass in body axes), `scale` of the sizes and `corner` radius.
    """

    kind: str
    a: float
    b: float
    mass: float
    rho2: float
    com: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)
    corner: float = 0.0

    @property
    def corners(self):
        """Vertices [k, 2] counter-clockwise, empty for round bodies."""
        a, b = self.a * self.scale[0], self.b * self.scale[1]
        if self.kind in ("square", "rectangle"):
            return np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
        if self.kind == "triangle":
            return np.array([[0, b], [-a, -b / 2], [a, -b / 2]])
        return np.empty((0, 2))

    @property
    def shape(self):
        """The declared shape, for the table."""
        if self.kind == "disc":
            return Disc(self.a)
        return Ellipse((self.a, self.b)) if self.kind == "ellipse" else Polygon(tuple(map(tuple, self.corners)))

    def contact(self, theta, slope=0.0):
        """Point r [n, 2] of the real body that touches a floor of this slope first, from its centre of mass."""
        down = np.stack((np.sin(slope) + 0 * theta, -np.cos(slope) + 0 * theta), -1)
        d = turned(down, -theta)
        if self.corners.size:
            centres = self.inset()
            point = centres[(d @ centres.T).argmax(1)] + self.corner * d
        else:
            axes = np.array([self.a * self.scale[0], self.b * self.scale[1]])
            point = axes**2 * d / np.linalg.norm(axes * d, axis=1, keepdims=True)
        return turned(point - np.array(self.com), theta)

    def margin(self, theta):
        """How much higher the second-lowest corner is than the lowest, in units of a; infinite for round bodies."""
        if not self.corners.size:
            return np.full(len(theta), np.inf)
        d = turned(np.stack((0 * theta, -1 + 0 * theta), -1), -theta)
        heights = np.sort(d @ self.corners.T, 1)
        return (heights[:, -1] - heights[:, -2]) / self.a

    def inset(self):
        """Centres of the round corners: each vertex moved along its bisector until the arc touches both sides."""
        p = self.corners
        to, back = np.roll(p, -1, 0) - p, np.roll(p, 1, 0) - p
        to, back = (e / np.linalg.norm(e, axis=1, keepdims=True) for e in (to, back))
        half = np.arccos(np.clip((to * back).sum(1), -1, 1)) / 2
        bisector = (to + back) / np.linalg.norm(to + back, axis=1, keepdims=True)
        return p + self.corner * bisector / np.sin(half)[:, None]


def draw(kind: str, rng: np.random.Generator) -> Body:
    """A body of a few centimetres, uniform in density."""
    a, mass = rng.uniform(0.025, 0.05), rng.uniform(0.02, 0.2)
    if kind == "disc":
        ball = rng.choice([2 / 5, 1 / 2, 2 / 3])  # a full ball, a disc, a hollow ball
        return Body(kind, a, a, mass, ball * a**2)
    b = a if kind == "square" else a * rng.uniform(0.55, 0.8)
    if kind == "ellipse":
        return Body(kind, a, b, mass, (a**2 + b**2) / 4)
    if kind == "triangle":
        b = 2 / np.sqrt(3) * a * rng.uniform(0.9, 1.3)
        return Body(kind, a, b, mass, (2 * a) ** 2 / 24 + (1.5 * b) ** 2 / 18)
    return Body(kind, a, b, mass, (a**2 + b**2) / 3)
