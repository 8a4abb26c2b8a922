"""A soft contact: springs in place of a law, in steps of time until the body is away.

Normal force: a spring that unloads 1/ε² times as stiff (Walton & Braun 1986), one with a dashpot that lets go at zero
force (Schwager & Pöschel 2007), or that of Hertz with viscous loss (Kuwabara & Kono 1987).  Tangential force: Coulomb's
with what arrests the slip of the step, regularised over a speed of creep, or a spring with slip.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Soft:
    """Springs of a contact of `duration` in s.

    `tangential` is k_t/k_n, infinite where there is no such spring.  Hooks: `friction` of (μ, slip, normal force),
    `moment` in N m of (v, normal force), `pull` in N of (depth, whether it unloads).
    """

    duration: float = 8e-4
    dashpot: bool = False
    creep: float | None = None
    hertz: float | None = None
    gamma: float = 0.0
    tangential: Any = np.inf
    friction: Callable[..., np.ndarray] | None = None
    moment: Callable[..., np.ndarray] | None = None
    pull: Callable[..., np.ndarray] | None = None


def stiffness(now: Any) -> float:
    """Of the normal spring in N/m, with which the middle trial has the contact's duration."""
    return (np.pi / now.soft.duration) ** 2 / float(np.median(now.W[2]))


class _Normal:
    """Normal forces by depth and speed."""

    def __init__(self, now, k):
        self.soft, self.k = now.soft, k
        self.eps2 = np.clip(now.eps, 0.02, 1.0) ** 2
        ratio = np.linspace(0.7, 0.0, 701)
        eps = np.exp(-ratio * (np.pi - 2 * np.arcsin(ratio)) / np.sqrt(1 - ratio**2))
        self.damping = 2 * np.interp(now.eps, eps, ratio) * np.sqrt(k / now.W[2])

    def force(self, depth, deepest, vn):
        if self.soft.hertz is not None:
            root = np.sqrt(np.maximum(depth, 0))
            return np.maximum(self.k * root * depth - self.soft.gamma * root * vn, 0.0)
        if self.soft.dashpot:
            return np.maximum(self.k * depth - self.damping * vn, 0.0)
        return latching(self.k, self.eps2, depth, deepest)


def latching(k, eps2, depth, deepest):
    """Force of a spring that unloads 1/ε² times as stiff as it loads."""
    return np.minimum(k * depth, np.maximum(k / eps2 * (depth - (1 - eps2) * deepest), 0.0))


class _Tangential:
    """Tangential forces in steps of time, with the stretch of the springs so far."""

    def __init__(self, now, k, dt):
        self.W, self.creep, self.dt = now.W, now.soft.creep, dt
        ratio = np.broadcast_to(np.asarray(now.soft.tangential, float), dt.shape)
        self.elastic, self.shift = np.isfinite(ratio), np.zeros(len(dt))
        self.k = np.where(self.elastic, ratio, 0.0) * k

    def force(self, vt, load, mu):
        tt, tn, _ = self.W
        if self.creep is not None:
            shear = -mu * load * np.tanh(vt / self.creep)
        else:
            shear = np.clip(-(vt / self.dt + tn * load) / tt, -mu * load, mu * load)
        if not self.elastic.any():
            return shear
        spring = np.clip(-self.k * (self.shift + vt * self.dt), -mu * load, mu * load)
        self.shift = -spring / np.where(self.elastic, self.k, 1.0)
        return np.where(self.elastic, spring, shear)


def soft_contact(now: Any, steps: int = 160) -> tuple[np.ndarray, np.ndarray]:
    """Velocities after the contact of an `impact.Impact` [n, 3], and the impulse (P_t, P_n) [n, 2]."""
    soft, J, inverse = now.soft, now.J, now.inverse
    k = stiffness(now) if soft.hertz is None else soft.hertz
    dt = np.pi / np.sqrt(k * now.W[2]) / steps
    if soft.hertz is not None:
        dt = 3.0 / (k**0.4 * now.W[2] ** 0.4 * now.approach**0.2) / steps
    normal, tangential = _Normal(now, k), _Tangential(now, k, dt)
    v, vc = now.v, now.contact_velocity
    P, live, deepest = np.zeros(vc.shape), np.ones(len(v), bool), np.zeros(len(v))
    depth = np.maximum(-vc[:, 1] * dt * 0.5, 0)
    for step in range(steps * 8):
        deepest = np.maximum(deepest, depth)
        load = normal.force(depth, deepest, vc[:, 1])
        mu = now.mu if soft.friction is None else soft.friction(now.mu, vc[:, 0], load)
        shear = tangential.force(vc[:, 0], load, mu)
        up = load if soft.pull is None or not step else load - soft.pull(depth, depth < deepest)
        wrench = np.einsum("nij,ni->nj", J, np.stack([shear, up], 1))
        if soft.moment is not None:
            wrench[:, 2] += soft.moment(v, load)
        v = np.where(live[:, None], v + dt[:, None] * np.einsum("nij,nj->ni", inverse, wrench), v)
        P += np.where(live[:, None], dt[:, None] * np.stack([shear, up], 1), 0.0)
        vc = np.einsum("nij,nj->ni", J, v) - now.floor
        depth = np.where(live, depth - vc[:, 1] * dt, depth)
        live &= ~((load <= 0) & (vc[:, 1] > 0) & (step > 5)) & (depth > 0)
        if not live.any():
            break
    return v, P


def two_corners(now: Any, seconds: float, steps: int = 120) -> np.ndarray:
    """Velocities of a polygon [n, 3] whose two lowest corners are on springs for so long after the first touch."""
    corners, k, dt = now.bodies[0].size, stiffness(now), now.soft.duration / steps
    v, theta = now.v.copy(), now.theta.copy()
    heights = now.bodies[0].corners(theta)[..., 1]
    low = np.argsort(heights, axis=1)[:, :2]
    rise = -np.take_along_axis(heights, low, 1)[:, 0]
    deepest = np.zeros((len(v), 2))
    inverse = np.stack([1 / now.mass, 1 / now.mass, 1 / now.inertia], 1)
    for _ in range(int(seconds / dt)):
        push = np.zeros(v.shape)
        for j in range(2):
            x, y = corners[low[:, j]].T
            rx, ry = np.cos(theta) * x - np.sin(theta) * y, np.sin(theta) * x + np.cos(theta) * y
            depth = np.maximum(-(rise + ry), 0)
            deepest[:, j] = np.where(depth <= 0, 0.0, np.maximum(deepest[:, j], depth))
            load = latching(k, now.eps**2, depth, deepest[:, j])
            tt, tn = inverse[:, 0] + ry**2 * inverse[:, 2], -rx * ry * inverse[:, 2]
            arrest = -((v[:, 0] - ry * v[:, 2]) / dt + tn * load) / tt
            shear = np.clip(arrest, -now.mu * load, now.mu * load)
            push += np.stack([shear, load, rx * load - ry * shear], 1)
        v += dt * push * inverse
        theta += dt * v[:, 2]
        rise += dt * v[:, 1]
    return v
