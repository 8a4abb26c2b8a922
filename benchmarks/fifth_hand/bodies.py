"""Bodies as the author's tables have them, and the point or corner with which each touches the floor."""

from dataclasses import replace

import numpy as np

from fourth_hand.bodies import Body


def weighed(body, factor=1.0):
    """Corners to 10 µm, and the moment of inertia, `factor` times that of the uniform body, to five digits."""
    size = np.round(body.size, 5) if body.kind == "polygon" else body.size
    return replace(body, inertia=float(f"{body.inertia * factor:.5g}"), size=size)


def heavier(body):
    """The same outline with 1.8 times the mass and the inertia."""
    return replace(body, mass=round(1.8 * body.mass, 3), inertia=float(f"{1.8 * body.inertia:.5g}"))


def reach(body):
    """Greatest distance of the outline from the centre in m."""
    return np.hypot(*body.size.T).max() if body.kind == "polygon" else body.size.max()


def stretched(body, along, across):
    """Semi-axes, corners or radius longer by these shares of them."""
    return replace(body, size=body.size * (1 + np.array([along, across])[: body.size.shape[-1]]))


def contact(body: Body, theta):
    """Lowest point in world axes from the mass centre [n, 2], and the number of the corner, 0 where there is none."""
    corner = body.corners(theta)[..., 1].argmin(1) if body.kind == "polygon" else np.zeros(len(theta), int)
    return body.lowest(theta), corner
