"""The laboratory: which trials are thrown, and the table that its instruments make of their impacts."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from fourth_hand.bodies import Body
from fourth_hand.laboratory import turned
from sixth_hand.bodies import gap
from sixth_hand.impact import Hidden, Impact, struck
from sixth_hand.instruments import Noise
from sixth_hand.soft import Soft
from sixth_hand.throws import Throw
from third_hand.nature import Table

COLUMNS = ("x", "y", "theta", "vx_pre", "vy_pre", "omega_pre", "vx_post", "vy_post", "omega_post")
GIVEN = ("mass", "inertia", "rx", "ry")


@dataclass(frozen=True, eq=False)
class Scene:
    """A table before it is drawn: bodies by their names, the law with μ and ε or a `soft` contact, and what is hidden.

    `size` is that of what is hidden, after the best refit of μ and ε: root mean square over trials and velocities, each
    over the root mean square of what the errors bring.  The contact point is `seen` and stands in the table, or is
    left to the reader.  x is within ±`span` in m, θ within `theta`; poses with two corners nearer than `gap` in m to
    the floor are left out.  The floor slopes by `slope` where that is seen, the camera's axes are turned by `camera`
    in rad, and poses are recorded `early` by so many s.
    """

    bodies: Mapping[str, Body]
    n: int
    law: tuple[str, float, float]
    throw: Throw
    noise: Noise
    hidden: Sequence[Hidden] = ()
    size: float = 0.0
    seen: bool = True
    soft: Soft = field(default_factory=Soft)
    span: float = 0.15
    theta: tuple[float, float] = (-np.pi, np.pi)
    gap: float = 0.0012
    slope: float = 0.0
    camera: float = 0.0
    early: float = 0.0

    def computed(self, trials: Impact) -> np.ndarray:
        """Contact points that the outlines give, in the camera's axes [n, 2]."""
        return turned(trials.touching(trials.theta + self.camera, self.slope), -self.camera)


def thrown(scene: Scene, rng: np.random.Generator) -> Impact:
    """Trials that approach faster than 0.3 m/s, as a laboratory without errors reports them."""
    bodies, kept, count, n = list(scene.bodies.values()), [], 0, 4 * scene.n
    while count < scene.n:
        v, theta = scene.throw(rng, n), rng.uniform(*scene.theta, n)
        x = rng.uniform(-scene.span, scene.span, n)
        trials = Impact(bodies, rng.integers(0, len(bodies), n), x, theta, v, scene.soft)
        trials.r = scene.computed(trials)
        clear = np.choose(trials.index, [gap(body, theta + scene.camera) for body in bodies])
        good = (trials.approach > 0.3) & (clear > scene.gap)
        kept.append([one[good] for one in (trials.index, x, theta, v)])
        count += int(good.sum())
    drawn = (np.concatenate(some)[: scene.n] for some in zip(*kept, strict=True))
    trials = Impact(bodies, *drawn, scene.soft)
    trials.r = scene.computed(trials)
    return trials


def table(scene: Scene, rng: np.random.Generator, of_errors: np.random.Generator) -> Table:
    """What the laboratory writes down of a scene."""
    trials, noise, (law, mu, eps) = thrown(scene, rng), scene.noise, scene.law
    n = len(trials.x)
    now = struck(trials, law, *noise.coefficients(of_errors, n, mu, eps), scene.hidden)
    post = noise.read(now.post + noise.errors(of_errors, now.post))
    before = noise.read(trials.v + noise.before * noise.errors(of_errors, trials.v))
    seen, turn = copy(trials), noise.angle * of_errors.standard_normal(n)
    seen.theta = trials.theta + turn
    seen.r = turned(trials.r, turn) + noise.point * of_errors.standard_normal((n, 2))
    point = turned(now.r, -scene.camera)
    floor = (trials.x + point[:, 0]) * np.tan(scene.slope - scene.camera)
    height = floor - point[:, 1] - trials.v[:, 1] * scene.early
    x, y = (one + noise.place * of_errors.standard_normal(n) for one in (trials.x, height))
    values = [x, y, seen.theta, *before.T, *post.T, trials.mass, trials.inertia, *seen.r.T]
    columns = dict(zip((*COLUMNS, *GIVEN), values, strict=True))
    if not scene.seen:
        del columns["rx"], columns["ry"]
    return Table(columns, [list(scene.bodies)[k] for k in trials.index])
