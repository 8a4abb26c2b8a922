"""Bodies by mass and outline, and the point with which each touches a level floor."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Body:
    """Mass in kg, moment of inertia about the centre in kg m², and the outline in m, in the body's axes.

    `size` holds the semi-axes of an ellipse, the radius of a disc or the corners of a polygon about its centroid.
    """

    kind: str
    mass: float
    inertia: float
    size: np.ndarray

    @property
    def shape(self):
        """The outline, as a user tells it to the program."""
        if self.kind == "ellipse":
            return {"kind": "ellipse", "semi_axes": self.size.tolist()}
        if self.kind == "disc":
            return {"kind": "disc", "radius": self.size.item()}
        return {"kind": "polygon", "vertices": [[float(f"{q:.6g}") for q in corner] for corner in self.size]}

    def corners(self, theta):
        """Corners in world axes from the mass centre [n, corners, 2]."""
        c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
        x, y = self.size.T
        return np.stack([c * x - s * y, s * x + c * y], -1)

    def lowest(self, theta):
        """Lowest point in world axes from the mass centre [n, 2]."""
        if self.kind == "disc":
            return np.stack([0 * theta, 0 * theta - self.size], -1)
        if self.kind == "polygon":
            corners = self.corners(theta)
            return corners[np.arange(len(theta)), corners[..., 1].argmin(1)]
        c, s = np.cos(theta), np.sin(theta)
        a, b = self.size.tolist()
        down = np.stack([-s, -c], -1)  # in the body's axes
        h = np.sqrt((a * down[:, 0]) ** 2 + (b * down[:, 1]) ** 2)
        x, y = a * a * down[:, 0] / h, b * b * down[:, 1] / h
        return np.stack([c * x - s * y, s * x + c * y], -1)


def ellipse(mass, a, b):
    """Semi-axes a, b."""
    return Body("ellipse", mass, mass * (a * a + b * b) / 4, np.array([a, b]))


def disc(mass, radius, factor=1.0):
    """Moment of inertia `factor` times that of a uniform disc."""
    return Body("disc", mass, mass * radius**2 / 2 * factor, np.array([radius]))


def polygon(mass, corners):
    """Uniform, with these corners against the clock."""
    V = np.array(corners, float)
    cross, x, y, x2, y2 = _sides(V)
    area = cross.sum() / 2
    V = V - np.array([((x + x2) * cross).sum(), ((y + y2) * cross).sum()]) / (6 * area)
    cross, x, y, x2, y2 = _sides(V)
    inertia = mass * (cross * (x * x + x * x2 + x2 * x2 + y * y + y * y2 + y2 * y2)).sum() / 12 / area
    return Body("polygon", mass, inertia, V)


def _sides(V):
    x, y = V.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    return x * y2 - x2 * y, x, y, x2, y2


def box(mass, width, height):
    """A rectangle."""
    w, h = width / 2, height / 2
    return polygon(mass, [(-w, -h), (w, -h), (w, h), (-w, h)])


def regular(mass, corners, radius, angle):
    """A regular polygon with its first corner at the angle."""
    angles = [2 * np.pi * k / corners + angle for k in range(corners)]
    return polygon(mass, [(radius * np.cos(q), radius * np.sin(q)) for q in angles])


def triangle(mass):
    """A triangle without a symmetry."""
    return polygon(mass, [(-0.045, -0.025), (0.05, -0.03), (-0.01, 0.05)])
