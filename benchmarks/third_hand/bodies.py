"""Bodies of a planar laboratory, and the point with which each touches the floor.

An ellipse, or the hull of some points with a rounded edge: boxes, discs, capsules, regular polygons, a half disc.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Body:
    """Mass in kg, moment of inertia about the centre in kg m²; lengths in m, in the body's axes.

    `shape` is what a user can tell the program about the outline: only of ellipses, discs and boxes with sharp corners.
    """

    name: str
    mass: float
    inertia: float
    semi_axes: tuple[float, float] | None = None
    hull: np.ndarray = field(default_factory=lambda: np.zeros((1, 2)))
    rounding: float = 0.0
    shape: dict | None = None


def ellipse(name, a, b, mass):
    """A flat elliptic plate."""
    shape = {"kind": "ellipse", "semi_axes": [a, b]}
    return Body(name, mass, mass * (a * a + b * b) / 4, semi_axes=(a, b), shape=shape)


def box(name, a, b, mass, rounding=0.0):
    """Half sides a, b."""
    c, d = a - rounding, b - rounding
    hull = [[c, d], [-c, d], [-c, -d], [c, -d]]
    shape = None if rounding else {"kind": "polygon", "vertices": hull}
    return Body(name, mass, mass * (a * a + b * b) / 3, hull=np.array(hull), rounding=rounding, shape=shape)


def disc(name, radius, mass, share=0.5):
    """Moment of inertia `share` m R²: 0.5 of a puck, 0.4 of a ball, more of a hollow one."""
    inertia = share * mass * radius * radius
    return Body(name, mass, inertia, rounding=radius, shape={"kind": "disc", "radius": radius})


def stadium(name, half_length, radius, mass):
    """A capsule: `half_length` is that of the straight part."""
    inertia = mass * (half_length * half_length / 3 + radius * radius / 2) * 1.05
    return Body(name, mass, inertia, hull=np.array([[half_length, 0.0], [-half_length, 0.0]]), rounding=radius)


def polygon(name, corners, radius, mass, rounding=0.0):
    """A regular polygon with its first corner at 0.3 rad."""
    angle = np.arange(corners) * 2 * np.pi / corners + 0.3
    inertia = mass * radius * radius / 6 * (2 + np.cos(2 * np.pi / corners))
    return Body(name, mass, inertia, hull=np.c_[np.cos(angle), np.sin(angle)] * radius, rounding=rounding)


def half_disc(name, radius, mass):
    """The flat side is below the centre."""
    angle = np.linspace(0, np.pi, 361)
    hull = np.c_[radius * np.cos(angle), radius * np.sin(angle) - 4 * radius / (3 * np.pi)]
    return Body(name, mass, mass * radius * radius * (0.5 - 16 / (9 * np.pi**2)), hull=hull, rounding=0.002)


def lowest_point(body, theta, slope=0.0, stretch=(1.0, 1.0)):
    """World vector from the centre to the point furthest against the normal (−sin slope, cos slope)."""
    c, s = np.cos(theta), np.sin(theta)
    dx, dy = np.sin(slope), -np.cos(slope)
    bx, by = c * dx + s * dy, -s * dx + c * dy  # the direction in the body's axes
    if body.semi_axes:
        a, b = body.semi_axes[0] * stretch[0], body.semi_axes[1] * stretch[1]
        h = np.sqrt((a * bx) ** 2 + (b * by) ** 2)
        px, py = a * a * bx / h, b * b * by / h
    else:
        hull = body.hull * np.array(stretch)
        i = np.argmax(np.outer(bx, hull[:, 0]) + np.outer(by, hull[:, 1]), axis=1)
        px, py = hull[i, 0] + body.rounding * bx, hull[i, 1] + body.rounding * by
    return c * px - s * py, s * px + c * py


def contact_points(bodies, index, theta, slope=0.0, stretch=(1.0, 1.0)):
    """`lowest_point` of trials with different bodies: `index` says which is whose."""
    rx, ry = np.zeros(len(theta)), np.zeros(len(theta))
    for i, body in enumerate(bodies):
        mine = index == i
        if mine.any():
            rx[mine], ry[mine] = lowest_point(body, theta[mine], slope, stretch)
    return rx, ry


OVAL = ellipse("oval", 0.035, 0.025, 0.045)
OVAL_B = ellipse("oval B", 0.05, 0.03, 0.12)
EGG = ellipse("egg", 0.06, 0.045, 0.3)
BLOCK = box("block", 0.04, 0.025, 0.15)
SQUARE = box("square", 0.03, 0.03, 0.08)
TILE = box("tile", 0.045, 0.02, 0.11, rounding=0.006)
CAPSULE = stadium("capsule", 0.03, 0.02, 0.1)
PUCK = disc("puck", 0.04, 0.12)
LARGE_PUCK = disc("puck L", 0.055, 0.2)
BALL = disc("ball", 0.03, 0.05, 0.4)
HOLLOW_BALL = disc("ball", 0.0335, 0.058, 0.55)
WHEEL = disc("wheel", 0.06, 0.2, 0.7)
NUT = polygon("nut", 6, 0.03, 0.09, rounding=0.002)
WEDGE = polygon("wedge", 3, 0.04, 0.06, rounding=0.003)
DOME = half_disc("dome", 0.045, 0.11)
