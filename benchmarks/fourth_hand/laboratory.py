"""The laboratory: how bodies are thrown, the impact with what is changed in it, and the noise of the instruments.

P follows per trial from one of four laws: Routh's path with Poisson's restitution (Wang & Mason 1992) or with Stronge's
(Mirtich 1996; Stronge 1990), and complementarity with a decompression or with v_n⁺ = −ε v_n (Anitescu & Potra 1997).
In every table r is the lowest point of the nominal shape at the listed θ above a level floor: computed, not seen.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fourth_hand.bodies import Body
from third_hand.laws import impulse, inverse_mass

G = 9.81


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """What an effect changes in the impacts of a laboratory; arrays by trial, or numbers.

    `restitution` is added to ε, `friction` multiplies μ.  `before`, `after` [n, 3] are added to the velocities before
    and after impact, `arm` [n, 2] to r.  `floor` is the upward velocity of the floor, `tilt` its angle.  `tangential`
    is the restitution of sticking trials, `normal` is added to P_n, and `moment` of (P_n, r, v) to the angular impulse.
    """

    restitution: Any = 0.0
    friction: Any = 1.0
    before: Any = 0.0
    arm: Any = 0.0
    floor: Any = 0.0
    tilt: float = 0.0
    tangential: float = 0.0
    normal: Any = 0.0
    moment: Callable[[Any, Any, Any], Any] | None = None
    after: Any = 0.0


@dataclass(frozen=True)
class Hidden:
    """An effect: its words, what it changes of (laboratory, amplitude), its size over the noise, and a first amplitude.

    The size is the root mean square over trials and velocities, in units of the noise, of what the effect changes.
    """

    what: str
    change: Callable[["Laboratory", float], Change]
    size: float
    first: float


@dataclass(frozen=True)
class Noise:
    """Standard deviations in m/s and rad/s after impact, and the share of them before; Gaussian, or Student's t."""

    speed: float
    spin: float
    degrees: float | None = None
    before: float = 0.0

    @property
    def scales(self):
        """Of (v_x, v_y, ω)."""
        return np.array([self.speed, self.speed, self.spin])

    def errors(self, rng, n):
        """Draw errors before and after impact [n, 3]."""
        before = self.before * self.scales * rng.standard_normal((n, 3))
        if self.degrees is None:
            return before, self.scales * rng.standard_normal((n, 3))
        nu = self.degrees
        return before, self.scales * (rng.standard_t(nu, (n, 3)) / np.sqrt(nu / (nu - 2)))


@dataclass(frozen=True, kw_only=True)
class Throw:
    """Ranges of the velocities and places in m/s, rad/s and m; some of them are drawn near levels instead."""

    vy: tuple[float, float] = (-2.2, -0.9)
    vx: tuple[float, float] = (-1, 1)
    omega: tuple[float, float] = (-8, 8)
    x: tuple[float, float] = (-0.15, 0.15)
    heights: tuple[float, ...] = ()
    """From which bodies are dropped, in m."""
    spread: float = 0.0
    """Of a normal ω."""
    sideways: tuple[float, ...] = ()
    """Levels of v_x."""

    def draw(self, rng, n):
        """θ, x and (v_x, v_y, ω)."""
        if self.heights:
            vy = -np.sqrt(2 * G * rng.choice(self.heights, n)) * (1 + 0.01 * rng.standard_normal(n))
        else:
            vy = rng.uniform(*self.vy, n)
        omega = self.spread * rng.standard_normal(n) if self.spread else rng.uniform(*self.omega, n)
        theta = rng.uniform(-np.pi, np.pi, n)
        near = self.sideways
        vx = rng.choice(near, n) + 0.06 * rng.standard_normal(n) if near else rng.uniform(*self.vx, n)
        return theta, rng.uniform(*self.x, n), np.stack([vx, vy, omega], -1)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A table before it is drawn."""

    bodies: list[Body]
    n: int
    law: str
    mu: float
    eps: float
    throw: Throw
    noise: Noise
    known: Hidden | None = None
    """Of a kind that the package's catalogue has."""
    unknown: Hidden | None = None

    @property
    def effects(self):
        """What is hidden, the known before the unknown."""
        return [one for one in (self.known, self.unknown) if one]


def turned(a, angle):
    """Vectors [n, 2], turned."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * a[:, 0] - s * a[:, 1], s * a[:, 0] + c * a[:, 1]], -1)


class Laboratory:
    """Trials of a scene that approach and separate, with what its law makes of them.

    By trial: `index` of the body, `theta`, `x`, `v` = (v_x, v_y, ω) before, `mass`, `inertia`, the arm `r`, the
    velocity (`slip`, `vn`) of the contact point, and the impulse `P`, velocities `post` and energy `lost` of the law
    alone.
    """

    def __init__(self, scene, rng):
        self.scene = scene
        n = 4 * scene.n
        self.index = rng.integers(len(scene.bodies), size=n)
        self.theta, self.x, self.v = scene.throw.draw(rng, n)
        self._derive()
        vn_post = self.post[:, 1] + self.r[:, 0] * self.post[:, 2]
        with np.errstate(invalid="ignore"):
            good = (self.vn < -0.25) & (vn_post > 0) & (self.P[:, 1] > 0) & (self.lost >= 0)
        keep = np.flatnonzero(good & np.isfinite(self.post).all(1))[: scene.n]
        self.index, self.theta, self.x, self.v = self.index[keep], self.theta[keep], self.x[keep], self.v[keep]
        self._derive()

    def _derive(self):
        self.theta = (self.theta + np.pi) % (2 * np.pi) - np.pi
        self.mass = np.array([body.mass for body in self.scene.bodies])[self.index]
        self.inertia = np.array([body.inertia for body in self.scene.bodies])[self.index]
        self.r = self.lowest(self.theta)
        self.slip = self.v[:, 0] - self.r[:, 1] * self.v[:, 2]
        self.vn = self.v[:, 1] + self.r[:, 0] * self.v[:, 2]
        self.order = np.arange(len(self.x))
        self.P, self.post = self.impact([])
        self.lost = self.energy(self.v) - self.energy(self.post)

    def lowest(self, theta):
        """Lowest points of the bodies from their centres."""
        r = np.zeros((len(theta), 2))
        for mine, body in self.by_body():
            r[mine] = body.lowest(theta[mine])
        return r

    def by_body(self):
        """Trials of each body."""
        return [(np.flatnonzero(self.index == i), body) for i, body in enumerate(self.scene.bodies)]

    def energy(self, v):
        """Kinetic energy."""
        return 0.5 * (self.mass * (v[:, 0] ** 2 + v[:, 1] ** 2) + self.inertia * v[:, 2] ** 2)

    def impact(self, changes, v=None):
        """The impulse and the velocities after impact, with some changes, of these velocities or others."""
        v, r, mass, inertia = (self.v if v is None else v).copy(), self.r, self.mass, self.inertia
        mu, eps = self.scene.mu + np.zeros(len(v)), self.scene.eps + np.zeros(len(v))
        tilt = sum(one.tilt for one in changes)
        if tilt:
            r = self.lowest(self.theta - tilt)
            v[:, :2] = turned(v[:, :2], -tilt)
        for one in changes:
            mu, eps = mu * one.friction, eps + one.restitution
            v, r = v + one.before, r + one.arm
        mu, eps = np.maximum(mu, 0.005), np.clip(eps, 0.01, 0.99)
        W = inverse_mass(mass, inertia, *r.T)
        vt, vn = v[:, 0] - r[:, 1] * v[:, 2], v[:, 1] + r[:, 0] * v[:, 2] - sum(one.floor for one in changes)
        Pt, Pn = impulse(self.scene.law, W, vt, vn, mu, eps)
        for beta in (one.tangential for one in changes if one.tangential):
            sticks = np.abs(vt + W[0] * Pt + W[1] * Pn) < 1e-9
            Pt = np.where(sticks, np.clip(Pt - beta * vt / W[0], -mu * Pn, mu * Pn), Pt)
        Pn = Pn + sum(one.normal for one in changes)
        moment = sum(one.moment(Pn, r, v) for one in changes if one.moment)
        post = v + np.stack([Pt / mass, Pn / mass, (r[:, 0] * Pn - r[:, 1] * Pt + moment) / inertia], -1)
        if tilt:
            post[:, :2] = turned(post[:, :2], tilt)
        return np.stack([Pt, Pn], -1), post + sum(one.after for one in changes)

    def changes(self, noise):
        """The changes of the scene's effects, each of its size over a noise of this size."""
        changes = []
        for one in self.scene.effects:
            without = self.impact(changes)[1]
            a = one.first
            for _ in range(40):
                ratio = self.size(self.impact([*changes, one.change(self, a)])[1] - without) / noise / one.size
                if abs(ratio - 1) < 2e-3:
                    break
                a *= np.clip(1 / ratio, 0.2, 5) ** 0.9
            changes.append(one.change(self, a))
        return changes

    def size(self, errors):
        """Root mean square of errors of velocities, in units of the noise."""
        return float(np.sqrt(np.mean((errors / self.scene.noise.scales) ** 2)))
