"""What happens to a body that is dropped many times, and what a laboratory records of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from contactlearn.mechanics.impacts import Impacts
from second_nature import compliant, path
from second_nature.bodies import Body, turned
from second_nature.compliant import Compliance
from second_nature.effect import Circumstances, Effect, Geometry
from second_nature.noise import errors
from second_nature.path import Contacts

NOTHING = Geometry()
STEPS = 240  # of each phase along the path; a contact in time has five times as many


@dataclass(frozen=True)
class Drops:
    """True states at the moment of contact: θ, x [n], velocity of the centre of mass [n, 3]."""

    theta: np.ndarray
    x: np.ndarray
    v: np.ndarray


Design = Callable[[np.random.Generator, int, Body], Drops]


def free(rng: np.random.Generator, n: int, body: Body) -> Drops:
    """Thrown at all angles, speeds, spins and places."""
    v = np.stack((rng.normal(0, 1.2, n), -rng.uniform(0.6, 3, n), rng.normal(0, 0.6, n) / np.sqrt(body.rho2)), -1)
    return Drops(rng.uniform(-np.pi, np.pi, n), rng.uniform(-0.15, 0.15, n), v)


@dataclass(frozen=True)
class Scene:
    """A body, the constants of its law, the design of the drops and what is hidden.

    `seen`: the contact point in the table is where the body touched; else it is computed from the declared shape at
    the recorded angle, above a level floor.  `in_time` integrates a compliant contact even without an effect that
    asks for it.
    """

    body: Body
    mu: float
    eps: float
    restitution: str
    effects: tuple[Effect, ...] = ()
    seen: bool = True
    design: Design = free
    in_time: bool = False


@dataclass(frozen=True)
class Record:
    """A laboratory's table: arrays by trial; `valid` marks rows that approach the floor and did not jam."""

    mass: np.ndarray
    inertia: np.ndarray
    r: np.ndarray
    q: np.ndarray
    v: np.ndarray
    v_post: np.ndarray
    valid: np.ndarray

    def rows(self, index):
        """The trials at `index`."""
        return Record(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    def impacts(self, shape, objects: Sequence[str] = (), source: str = "measurements") -> Impacts:
        """The table that is analysed: nothing in it tells what was planted."""
        return Impacts(
            self.mass, self.inertia, self.r, self.q, self.v, self.v_post, object=objects, shape=shape, source=source
        )


def happen(scene: Scene, drops: Drops, scatter: np.ndarray) -> Record:
    """What a perfect instrument records of the drops; `scatter` [n, 2] is added to ε and, in shares, to μ."""
    geometry = _together(scene.effects)
    real = replace(
        scene.body,
        com=tuple(scene.body.a * np.array(geometry.com)),
        scale=geometry.scale,
        corner=scene.body.a * geometry.corner,
    )
    n, r = len(drops.x), real.contact(drops.theta, geometry.slope)
    declared = scene.body.mass * scene.body.rho2
    contacts = Contacts(
        mass=np.full(n, scene.body.mass),
        inertia=np.full(n, declared * np.exp(geometry.inertia)),
        r=turned(r, -geometry.slope),
        v=_turned(drops.v, -geometry.slope),
        mu=np.full(n, scene.mu),
        eps=np.full(n, scene.eps),
    )
    known = Circumstances(contacts, drops.theta, drops.x, np.arange(n) / n)
    eps = contacts.eps + scatter[:, 0] + sum(e.eps(known) for e in scene.effects if e.eps)
    mu = contacts.mu * (1 + scatter[:, 1]) * np.prod([np.ones(n), *(e.mu(known) for e in scene.effects if e.mu)], 0)
    contacts = replace(contacts, eps=np.clip(eps, 0.02, 0.98), mu=np.clip(mu, 0.002, 2))
    known = replace(known, contacts=contacts)
    with np.errstate(all="ignore"):  # of contacts that part or jam, which are left out
        v_post = _collide(scene, contacts, known)
    for effect in scene.effects:
        v_post = v_post if effect.after is None else effect.after(known, v_post)
    return _recorded(scene, geometry, drops, r, _turned(v_post, geometry.slope))


def _collide(scene: Scene, contacts: Contacts, known: Circumstances) -> np.ndarray:
    """Velocity after contact, [n, 3] in the contact's frame."""
    compliance = [e.compliance for e in scene.effects if e.compliance]
    if compliance or scene.in_time:
        return compliant.impact(contacts, (compliance or [Compliance()])[0], 5 * STEPS).v
    moments = [e.moment for e in scene.effects if e.moment]
    frictions = [e.friction for e in scene.effects if e.friction]
    extras = path.Extras(
        friction=(lambda slip: np.prod([f(slip) for f in frictions], 0)) if frictions else None,
        lever=(lambda v: sum(moment(known, v) for moment in moments)) if moments else None,
        rebound=sum(e.rebound for e in scene.effects),
    )
    return path.impact(contacts, scene.restitution, extras, STEPS).v


def _recorded(scene: Scene, geometry: Geometry, drops: Drops, r: np.ndarray, v_post: np.ndarray) -> Record:
    n = len(drops.x)
    theta = drops.theta + geometry.angle - drops.v[:, 2] * geometry.delay
    place = np.stack((drops.x, -r[:, 1]), -1) - drops.v[:, :2] * geometry.delay
    q = np.concatenate((turned(place, geometry.frame), theta[:, None] + geometry.frame), 1)
    r = turned(r, geometry.frame) if scene.seen else scene.body.contact(q[:, 2])
    v, v_post = _turned(drops.v, geometry.frame), _turned(v_post, geometry.frame)
    mass = np.full(n, scene.body.mass)
    after = v_post[:, 1] + r[:, 0] * v_post[:, 2]
    valid = (v[:, 1] + r[:, 0] * v[:, 2] < -0.35) & np.isfinite(after) & (scene.body.margin(drops.theta) > 0.12)
    return Record(mass, mass * scene.body.rho2, r, q, v, np.nan_to_num(v_post), valid)


def measured(record: Record, kind: str, level: float, rng: np.random.Generator) -> Record:
    """The record by a real instrument: errors of `noise` in both velocities."""
    rho = np.sqrt(record.inertia / record.mass)
    velocities = np.stack((record.v, record.v_post), 1)
    v, v_post = (velocities + errors(kind, level, velocities, rho, rng)).transpose(1, 0, 2)
    valid = record.valid & (v[:, 1] + record.r[:, 0] * v[:, 2] < -0.2)
    return replace(record, v=v, v_post=v_post, valid=valid)


def _turned(v: np.ndarray, angle: float) -> np.ndarray:
    """Velocities [n, 3] in axes turned by −angle."""
    return np.concatenate((turned(v[:, :2], angle), v[:, 2:]), 1)


def _together(effects: Sequence[Effect]) -> Geometry:
    """The set-up of all effects: each entry is changed by one of them at most."""
    changed = {}
    for effect in effects:
        for field in fields(Geometry):
            value = getattr(effect.geometry, field.name)
            if value != getattr(NOTHING, field.name):
                changed[field.name] = value
    return Geometry(**changed)
