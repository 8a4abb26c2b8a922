"""The laboratory: which trials are thrown, the impact with what is hidden in it, and what instruments make of it.

The laws are five of `third_hand.laws`.  In every table r is the lowest point of the nominal shape at the listed θ above
a level floor: computed, not seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fifth_hand.bodies import contact, reach, stretched
from fifth_hand.instruments import SCATTER, Noise
from fifth_hand.throws import Throw
from fourth_hand.bodies import Body
from fourth_hand.laboratory import turned
from third_hand.laws import impulse, inverse_mass
from third_hand.nature import Table

COLUMNS = ("mass", "inertia", "rx", "ry", "x", "y", "theta")
BEFORE = ("vx_pre", "vy_pre", "omega_pre")
AFTER = ("vx_post", "vy_post", "omega_post")


@dataclass(frozen=True)
class Hidden:
    """An effect: its name, the place where it acts, what it does there, and its amplitude.

    `act` of (impact, amplitude, impact with nothing hidden) changes the first of them in place.
    """

    what: str
    place: str
    act: Callable[["Impact", float, "Impact"], None]
    amplitude: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials:
    """Trials before impact, as they are: θ, x and v = (v_x, v_y, ω), the number of the body, and 1, 2, … in `order`."""

    bodies: Sequence[Body]
    index: np.ndarray
    theta: np.ndarray
    x: np.ndarray
    v: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    order: np.ndarray

    @classmethod
    def of(cls, bodies, index, theta, x, v):
        """Trials of these bodies, by their numbers."""
        mass, inertia = (np.array([getattr(body, name) for body in bodies])[index] for name in ("mass", "inertia"))
        order = np.arange(1.0, len(x) + 1)
        return cls(bodies=bodies, index=index, theta=theta, x=x, v=v, mass=mass, inertia=inertia, order=order)

    def taken(self, rows):
        """These rows in their order, numbered anew."""
        return Trials.of(self.bodies, self.index[rows], self.theta[rows], self.x[rows], self.v[rows])

    def energy(self, v):
        """Kinetic energy in J with these velocities."""
        return 0.5 * self.mass * (v[:, 0] ** 2 + v[:, 1] ** 2) + 0.5 * self.inertia * v[:, 2] ** 2

    def touching(self, theta, stretch=(0.0, 0.0)):
        """The contact points from the centres [n, 2], and the number of the corner."""
        r, corner = np.zeros((len(theta), 2)), np.zeros(len(theta), int)
        for i, body in enumerate(self.bodies):
            mine = self.index == i
            r[mine], corner[mine] = contact(stretched(body, *stretch), theta[mine])
        return r, corner


@dataclass(frozen=True, eq=False)
class Scene:
    """A table before it is drawn: the law with μ and ε; `arrange` puts trials elsewhere, or in another order."""

    bodies: Sequence[Body]
    n: int
    law: tuple[str, float, float]
    throw: Throw
    noise: Noise
    hidden: Sequence[Hidden] = ()
    arrange: Callable[[Trials, Any], Trials] | None = None


class Impact:
    """The impact of all trials, under way; effects change it at places, in this order.

    state      `theta`, `v`, `inertia`, `tilt` of the floor, `offset` of r in the body's axes, `stretch` of the outline
    approach   `v` and `theta` relative to the floor, arm `r` and `corner`
    law        `slip`, `vn`, `W`, lever `rho` = √(I/m), `place` of contact along the floor, `mu`, `eps`
    wrench     `Pt`, `Pn`, `moment` about the contact point
    rebound    `post`, velocities after impact relative to the floor
    flight     the same in the world's axes
    """

    def __init__(self, scene, trials, hidden=()):
        self.law, mu, eps = scene.law
        self.trials, self.mass, n = trials, trials.mass, len(trials.x)
        plain = Impact(scene, trials) if hidden else self

        def act(place):
            for one in hidden:
                if one.place == place:
                    one.act(self, one.amplitude, plain)

        self.theta, self.v, self.inertia = trials.theta, trials.v, trials.inertia
        self.tilt, self.offset, self.stretch = np.zeros(n), (0.0, 0.0), (0.0, 0.0)
        act("state")
        self.theta = self.theta - self.tilt
        self.r, self.corner = trials.touching(self.theta, self.stretch)
        self.r = self.r + turned(np.array([self.offset]), self.theta)
        self.v = np.column_stack([turned(self.v[:, :2], -self.tilt), self.v[:, 2]])
        act("approach")
        self.slip, self.vn = (self.v[:, 0] - self.v[:, 2] * self.r[:, 1], self.v[:, 1] + self.v[:, 2] * self.r[:, 0])
        self.W, self.rho = inverse_mass(self.mass, self.inertia, *self.r.T), np.sqrt(self.inertia / self.mass)
        self.place = trials.x + self.r[:, 0]
        self.mu, self.eps = np.full(n, mu), np.full(n, eps)
        act("law")
        self.mu, self.eps = np.maximum(self.mu, 0.003), np.clip(self.eps, 0.02, 1.0)
        self.Pt, self.Pn = impulse(self.law, self.W, self.slip, self.vn, self.mu, self.eps)
        self.moment = np.zeros(n)
        act("wrench")
        self.post = self.v + self.change(self.r, self.Pt, self.Pn, self.moment)
        self.vn_post = self.post[:, 1] + self.post[:, 2] * self.r[:, 0]
        act("rebound")
        self.post = np.column_stack([turned(self.post[:, :2], self.tilt), self.post[:, 2]])
        act("flight")

    def change(self, r, Pt, Pn, moment=0.0):
        """Velocities that a wrench at r brings."""
        spin = (r[:, 0] * Pn - r[:, 1] * Pt + moment) / self.inertia
        return np.stack([Pt / self.mass, Pn / self.mass, spin], -1)

    @property
    def lever(self):
        """|r_x|/ρ."""
        return np.abs(self.r[:, 0]) / self.rho


def thrown(scene, rng):
    """Trials that approach faster than 0.25 m/s, separate by the law alone, and stand on no face to 0.03 rad."""
    bodies, kept, count = scene.bodies, [], 0
    while count < scene.n:
        index = rng.integers(0, len(bodies), 4 * scene.n)
        theta, x, v = scene.throw.draw(rng, 4 * scene.n, np.array([reach(body) for body in bodies])[index])
        trials = Trials.of(bodies, index, theta, x, v)
        now = Impact(scene, trials)
        good = (now.vn < -0.25) & (now.post[:, 1] > 0.05) & (now.vn_post > 0.02)
        good &= trials.energy(now.post) <= trials.energy(v) * (1 - 1e-6)
        good &= trials.touching(theta - 0.03)[1] == trials.touching(theta + 0.03)[1]
        kept.append((index[good], theta[good], x[good], v[good]))
        count += int(good.sum())
    trials = Trials.of(bodies, *(np.concatenate(some)[: scene.n] for some in zip(*kept, strict=True)))
    return trials if scene.arrange is None else scene.arrange(trials, rng)


def _scatter(scene, trials, rng):
    """Velocities after impact that coefficients bring which vary at random from impact to impact."""
    of_eps, of_mu = (rng.normal(0, size, len(trials.x)) for size in SCATTER)

    def act(now, a, plain):
        now.eps, now.mu = now.eps + of_eps, now.mu * np.exp(of_mu)

    return Impact(scene, trials, [Hidden("scatter", "law", act, 1.0)]).post - Impact(scene, trials).post


def table(scene, rng, rng_of_height):
    """What the laboratory writes down of a scene, without the trials that hidden effects let rest or gain energy."""
    trials = thrown(scene, rng)
    after, before, pose = scene.noise.errors(rng, trials.v)
    if scene.noise.scatter:
        after = after + _scatter(scene, trials, rng)
    now = Impact(scene, trials, scene.hidden)
    sane = (now.vn_post > 0.005) & (now.post[:, 1] > -0.02)
    sane &= trials.energy(now.post) / trials.energy(trials.v) < 1
    post = scene.noise.read((now.post + after)[sane])
    measured, x = scene.noise.read((trials.v + before)[sane]), (trials.x + pose[:, 0])[sane]
    trials = replace(trials.taken(sane), theta=(trials.theta + pose[:, 2])[sane])
    r, _ = trials.touching(trials.theta)
    y = -r[:, 1] + rng_of_height.normal(size=len(x)) * scene.noise.place * 0.7
    values = [trials.mass, trials.inertia, *r.T, x, y, trials.theta, *measured.T, *post.T]
    columns = dict(zip((*COLUMNS, *BEFORE, *AFTER), values, strict=True))
    return Table(columns, ["AB"[i] for i in trials.index])
