"""Designs of drops that cannot tell two effects apart, each with the effect that is planted and its rivals."""

from dataclasses import replace

import numpy as np

from second_nature.nature import free


def _changed(design):
    """A design from the free one with some of its columns replaced."""

    def changed(rng, n, body):
        drops = free(rng, n, body)
        return design(drops, rng, np.arange(n) / n, body)

    return changed


def _velocities(drops, *columns):
    return replace(drops, v=np.stack([np.broadcast_to(c, drops.x.shape) for c in columns], -1))


@_changed
def rising(drops, rng, u, body):
    """Every drop from higher up, hardly spinning."""
    n = len(u)
    return _velocities(drops, drops.v[:, 0], -0.6 - 2.4 * u, rng.normal(0, 0.02, n) / body.a)


@_changed
def marching(drops, rng, u, body):
    """Every drop further to the right."""
    return replace(drops, x=0.3 * u - 0.15)


@_changed
def one_pose(drops, rng, u, body):
    """Always nearly the same orientation."""
    return replace(drops, theta=rng.normal(0.6, 0.01, len(u)))


@_changed
def one_spin(drops, rng, u, body):
    """Always the same spin."""
    return _velocities(drops, drops.v[:, 0], drops.v[:, 1], 0.7 / np.sqrt(body.rho2))


@_changed
def one_incidence(drops, rng, u, body):
    """No spin, and always the same angle of incidence, from both sides."""
    side = rng.choice([-1.0, 1.0], len(u))
    return _velocities(drops, -1.6 * side * drops.v[:, 1], drops.v[:, 1], 0.0)


@_changed
def turning(drops, rng, u, body):
    """Turned a little further for every drop, once around."""
    return replace(drops, theta=2 * np.pi * u - np.pi)


@_changed
def plumb(drops, rng, u, body):
    """Without spin, a little sideways, from many heights."""
    return _velocities(drops, rng.normal(0, 0.2, len(u)), drops.v[:, 1], 0.0)


TWINS = (
    # design, body, planted, form, rivals
    (rising, "disc", "velocity_dependent_restitution", 0, ("parameter_drift",)),
    (marching, "square", "location_dependent_restitution", 0, ("parameter_drift",)),
    (one_pose, "ellipse", "com_offset", 0, ("orientation_offset", "shape_error")),
    (one_spin, "ellipse", "sampling_delay", 0, ("orientation_offset",)),
    (one_incidence, "disc", "velocity_dependent_restitution", 1, ("slip_dependent_restitution",)),
    (plumb, "disc", "gravity_impulse", 0, ("adhesion", "velocity_dependent_restitution")),
    (turning, "ellipse", "orientation_dependent_restitution", 0, ("parameter_drift",)),
    (one_incidence, "disc", "load_dependent_friction", 0, ("velocity_dependent_friction",)),
)
