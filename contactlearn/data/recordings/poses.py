"""Poses of bodies in the plane and in space, small differences between them, and free turning.

    plane   pose (x, y, θ) [..., 3]                       difference (x, y, θ) [..., 3], θ within half a turn
    space   pose (x, y, z, unit quaternion) [..., 7]      difference (x, y, z, rotation vector) [..., 6]

Quaternions turn the body's axes into the world's, the scalar first; rotation vectors are in world axes.  A pose in
space moves by `displaced(pose, d)`: the position by the first half of d, and the body is turned by exp of the second.

A body that nothing touches turns as Euler's equations say.  If its moments are equal, its spin is constant and its
quaternion runs along a great circle of the unit sphere: small differences across that circle are a cos(ωt/2) +
b sin(ωt/2) in axes that turn half as fast as the body, which are nearly lines over a flight.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

Array = np.ndarray
_TINY = 1e-150  # by which one can still divide
_NEXT, _LAST = np.array((1, 2, 0)), np.array((2, 0, 1))
_SIGNS = np.array(((1.0, -1.0, -1.0, -1.0), (1.0, 1.0, 1.0, -1.0), (1.0, -1.0, 1.0, 1.0), (1.0, 1.0, -1.0, 1.0)))
_PLACES = np.arange(4)[:, None] ^ np.arange(4)  # (p q)_i = Σ_j ± p_j q_k, k = i xor j
_SPUN = _PLACES[:, 1:]  # (p (0, ω)/2)_i = Σ_k ± p_j ω_k/2, j = i xor k
_SPUN_SIGNS = np.take_along_axis(_SIGNS, _PLACES, 1)[:, 1:] / 2
_STEP = 0.2  # rad that a body turns in a step of an integration: errors of 1e-6 a step
_STEP_QUANTILE = 0.95  # share of the times whose way sets the steps: some windows are no flights
_MOMENT_TOLERANCE = 1e-3  # relative difference of moments up to which a body turns as if they were equal


def turn(angle: Any) -> Any:
    """The angle in rad, in [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def orientation(pose: Float[Array, "*batch m"]) -> Array:
    """Return θ [...] of poses in the plane, or quaternions [..., 4] of those in space."""
    return pose[..., 2] if pose.shape[-1] == 3 else pose[..., 3:]


def away(pose: Float[Array, "*#batch m"], other: Float[Array, "*#batch m"]) -> Float[Array, "*batch k"]:
    """Difference from another pose to a pose."""
    if pose.shape[-1] == 3:
        d = pose - other
        d[..., 2] = turn(d[..., 2])
        return d
    turned = rotation_vector(product(pose[..., 3:], conjugate(other[..., 3:])))
    return np.concatenate((pose[..., :3] - other[..., :3], turned), -1)


def displaced(pose: Float[Array, "*#batch m"], d: Float[Array, "*#batch k"]) -> Float[Array, "*batch m"]:
    """The pose that differs by d."""
    if pose.shape[-1] == 3:
        there = pose + d
        there[..., 2] = turn(there[..., 2])
        return there
    return np.concatenate((pose[..., :3] + d[..., :3], product(quaternion(d[..., 3:]), pose[..., 3:])), -1)


def arms(centre: Sequence[float] | Array, turned: Array) -> Float[Array, "*batch d"]:
    """A vector that is fixed to the body, in world axes, at orientations θ [...] in rad, or quaternions [..., 4]."""
    if len(centre) == 2:
        (a, b), c, s = centre, np.cos(turned), np.sin(turned)
        return np.stack((a * c - b * s, a * s + b * c), -1)
    return rotated(turned, np.asarray(centre))


def levers(arm: Float[Array, " d"]) -> Float[Array, "d s"]:
    """Matrix L of an arm c from a point to another one, L ω = −ω × c; in the plane (c_y, −c_x)."""
    if len(arm) == 2:
        return np.array(((arm[1],), (-arm[0],)))
    x, y, z = arm
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def product(p: Float[Array, "*#batch 4"], q: Float[Array, "*#batch 4"]) -> Float[Array, "*batch 4"]:
    """Product of quaternions: the turn q, then p."""
    return np.einsum("...ij,...j->...i", q.take(_PLACES, -1) * _SIGNS, p)


def cross(u: Float[Array, "*#batch 3"], v: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """u × v; NumPy's own takes ten times as long for a few vectors."""
    return u.take(_NEXT, -1) * v.take(_LAST, -1) - u.take(_LAST, -1) * v.take(_NEXT, -1)


def conjugate(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """The turn back."""
    return q * np.array((1.0, -1.0, -1.0, -1.0))


def _length(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    """Lengths of vectors, none below `_TINY`; NumPy's norm takes twice as long for a few."""
    return np.maximum(np.sqrt(np.einsum("...i,...i->...", vector, vector)), _TINY)


def quaternion(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Quaternion of a rotation vector in rad."""
    length, q = _length(vector), np.empty((*vector.shape[:-1], 4))
    q[..., 0] = np.cos(length / 2)
    q[..., 1:] = (np.sin(length / 2) / length)[..., None] * vector
    return q


def rotation_vector(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """Rotation vector in rad, of at most half a turn."""
    sine = _length(q[..., 1:])
    factor = 2 * np.arctan2(sine, np.abs(q[..., 0])) / sine
    return np.where(q[..., 0] < 0, -factor, factor)[..., None] * q[..., 1:]


def rotated(q: Float[Array, "*#batch 4"], vector: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """Vectors of the body in world axes."""
    across = 2 * cross(q[..., 1:], vector)
    return vector + q[..., :1] * across + cross(q[..., 1:], across)


def free_turn(
    q: Float[Array, "*#batch 4"],
    spin: Float[Array, "*#batch 3"],
    tau: Float[Array, "*#batch"],
    moments: Sequence[float] | None = None,
) -> tuple[Float[Array, "*batch 4"], Float[Array, "*batch 3"]]:
    """Quaternion and spin in rad/s, in world axes, of a body that has turned freely for times in s.

    Args:
        q: at first.
        spin: at first.
        tau: times, also negative ones.
        moments: principal moments of inertia along the body's axes in any unit; None if they are equal.
    """
    vector = spin * tau[..., None]
    if moments is None or max(moments) / min(moments) < 1 + _MOMENT_TOLERANCE:
        return product(quaternion(vector), q), np.broadcast_to(spin, vector.shape)
    I = np.asarray(moments)  # noqa: E741
    coupling = (I[_NEXT] - I[_LAST]) / I
    way = np.sort(np.linalg.norm(vector, axis=-1), axis=None)
    steps = max(math.ceil(way[int(_STEP_QUANTILE * len(way))] / _STEP), 1) if way.size else 1
    h = tau[..., None] / steps
    state = np.concatenate((q, rotated(conjugate(q), spin)), -1)
    state = np.broadcast_to(state, (*vector.shape[:-1], 7))

    def rates(state: Array) -> Array:  # of quaternion and spin, in the body's axes
        found, w = np.empty(state.shape), state[..., 4:]
        np.einsum("...ij,...j->...i", state.take(_SPUN, -1) * _SPUN_SIGNS, w, out=found[..., :4])
        np.multiply(w.take(_NEXT, -1) * w.take(_LAST, -1), coupling, out=found[..., 4:])
        return found

    for _ in range(steps):  # Runge and Kutta
        a = rates(state)
        b = rates(state + h / 2 * a)
        c = rates(state + h / 2 * b)
        d = rates(state + h * c)
        state = state + h / 6 * (a + 2 * (b + c) + d)
    q, w = state[..., :4] / np.linalg.norm(state[..., :4], axis=-1, keepdims=True), state[..., 4:]
    return q, rotated(q, w)
