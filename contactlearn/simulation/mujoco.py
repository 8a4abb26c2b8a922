"""Drops simulated by MuJoCo: an engine that shares no equation with this package's laws.

An ellipse or a box, held in the plane by two slides and a hinge, starts where it touches the floor
with a random velocity; MuJoCo resolves the contact in about a hundred small steps.  Spreads:

    θ ~ U(−π, π) rad    v_x ~ ±U(0.3, 0.9) m/s    v_y ~ U(−2.9, −2.2) m/s    ω ~ N(0, 6²) rad/s

v_pre is the velocity at first touch and v_post that at separation, with gravity acting in between.
Left out and drawn again: approaches that the measurement would not show as such, second contacts
until the sample, a box that changes corners or lands on a side, and contacts that do not end.

The contact is the spring and dashpot of `contactlearn.models.export.mujoco`.

**Hidden effects**, each off at 0, act in the simulation and are not reported: the impacts are those that a laboratory
would report, on a flat floor, of a uniform body, with the velocity of its geometric centre.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError, install_hint
from contactlearn.core.numerics import finite_number, random, whole
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY, contact_velocity, matvec, rotate, rotation
from contactlearn.mechanics.shapes import Ellipse, Polygon, contact_point
from contactlearn.mechanics.space import SPACE
from contactlearn.models.export.mujoco import STEPS, Scene, solref

KINDS = ("ellipse", "box")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """Effects that act in the simulation and are not reported, each off at 0; see `mujoco.load`."""

    tilt: float = 0.0
    com_offset: Sequence[float] = (0.0, 0.0)
    inertia_error: float = 0.0
    damping: float = 0.0
    delay: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Bench:
    """The simulated experiment: body, contact and hidden effects, as `mujoco.load` takes them.

    Raises:
        DataError: a value out of its range.
        UnknownNameError: no such kind of body.
    """

    kind: str
    semi_axes: Sequence[float]
    mass: float
    mu: float
    eps: float
    contact_time: float
    hidden: Hidden

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UnknownNameError("kind of body", self.kind, KINDS)
        a, b = _pair("semi_axes", self.semi_axes, (1e-3, 1e-3), (10, 10))
        hidden = Hidden(
            tilt=finite_number("tilt", self.hidden.tilt, -0.5, 0.5),
            com_offset=_pair("com_offset", self.hidden.com_offset, (-a, -b), (a, b)),
            inertia_error=finite_number("inertia_error", self.hidden.inertia_error, -1, 1),
            damping=finite_number("damping", self.hidden.damping, 0, 1e6),
            delay=finite_number("delay", self.hidden.delay, 0, 0.1),
        )
        checked = {
            "semi_axes": (a, b),
            "mass": finite_number("mass", self.mass, 1e-6, 1e3),
            "mu": finite_number("mu", self.mu, 0, 100),
            "eps": finite_number("eps", self.eps, 0.2, 1),
            "contact_time": finite_number("contact_time", self.contact_time, 1e-5, 2e-2),
            "hidden": hidden,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @cached_property
    def body(self) -> Ellipse | Polygon:
        """The body as drawn, of uniform density."""
        a, b = self.semi_axes
        return Ellipse((a, b)) if self.kind == "ellipse" else Polygon(((a, b), (-a, b), (-a, -b), (a, -b)))

    @cached_property
    def nominal_inertia(self) -> float:
        """Moment of inertia in kg m² of the body as drawn: the reported one."""
        return self.mass * self.body.gyration_squared()

    def touch(self, theta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 2"]:
        """Where the body meets the tilted floor, from its geometric centre, in world axes in m."""
        tilt = torch.tensor(self.hidden.tilt, dtype=torch.float64)
        return rotate(contact_point(self.body, theta - tilt), tilt)

    def approaches(self, theta: Float[Tensor, "*batch"], v: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether the touching point moves into the tilted floor."""
        velocity = contact_velocity(self.touch(theta), v)
        return velocity[..., 1] * math.cos(self.hidden.tilt) < velocity[..., 0] * math.sin(self.hidden.tilt)

    def spec(self) -> str:
        """The experiment in MuJoCo's own language."""
        hidden = self.hidden
        return Scene(
            shape=self.body,
            mass=self.mass,
            inertia=self.nominal_inertia * math.exp(hidden.inertia_error),
            mu=self.mu,
            eps=self.eps,
            contact_time=self.contact_time,
            tilt=(0.0, -hidden.tilt, 0.0),
            mass_centre=(hidden.com_offset[0], 0.0, hidden.com_offset[1]),
            damping=hidden.damping,
        ).xml()


def _pair(
    name: str, values: Sequence[float], low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    try:
        first, second = values
    except (TypeError, ValueError):
        raise DataError(f"{name} must be two numbers in m, got {values!r}") from None
    return finite_number(name, first, low[0], high[0]), finite_number(name, second, low[1], high[1])


WINDOW = 3  # contact times simulated; a contact that has not ended by then is left out
FLIGHT_STEP = 1e-4  # s, between separation and a late sample
BATCH = 500  # drops simulated at once, so that their histories take a few MB


def collect(
    size: int, bench: Bench, sigma: Float[Tensor, "3"], generator: torch.Generator
) -> tuple[Float[Tensor, "{size} 3"], ...]:
    """q, v_pre, q_post and v_post of `size` single contacts, with noise of standard deviation `sigma` on velocities.

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: too few drops are single contacts.
    """
    mujoco, rollout = engine()
    model = mujoco.MjModel.from_xml_string(bench.spec())
    data = mujoco.MjData(model)
    kept, found, drawn = [], 0, 0
    with rollout.Rollout(nthread=0) as runner:
        while found < size and drawn < 50 * size + BATCH:
            q, v, noise = _draw(min(BATCH, size), bench, sigma, generator)
            drawn += min(BATCH, size)
            q_post, v_post, clean = _drop(runner, model, data, bench, q, v)
            kept.append([part[clean] for part in (q, v + noise[:, 0], q_post, v_post + noise[:, 1])])
            found += int(clean.sum())
    if found < size:
        raise DataError(
            f"only {found} of {drawn} drops are single contacts, {size} are wanted: "
            "a shorter delay or contact_time, a rounder body or less noise leaves out fewer"
        )
    return tuple(torch.cat(parts)[:size] for parts in zip(*kept, strict=True))


@dataclass(frozen=True, kw_only=True)
class EngineLaboratory:
    """A laboratory in MuJoCo, in which drops are made as they are asked for, with noise `sigma` on velocities."""

    bench: Bench
    sigma: Float[Tensor, "3"]

    def measured(self, drops: Impacts, generator: torch.Generator) -> tuple[Impacts | None, Bool[Tensor, "n"]]:
        """Measure drops from true states before impact, in order; tell which were seen as single contacts.

        Raises:
            ContactLearnError: MuJoCo is not installed.
        """
        mujoco, rollout = engine()
        model = mujoco.MjModel.from_xml_string(self.bench.spec())
        noise = self.sigma * random(torch.randn, (len(drops), 2, 3), generator)
        x, theta = drops.q[:, 0], drops.q[:, 2]
        q, v = torch.stack((x, _on_floor(self.bench, x, theta), theta), -1), drops.v_pre
        seen = contact_velocity(contact_point(self.bench.body, theta), v + noise[:, 0])[:, 1] < 0
        good = self.bench.approaches(theta, v) & seen
        with rollout.Rollout(nthread=0) as runner:
            q_post, v_post, clean = _drop(runner, model, mujoco.MjData(model), self.bench, q[good], v[good])
        good[good.clone()] = clean
        if not good.any():
            return None, good
        parts = q[good], (v + noise[:, 0])[good], q_post[clean], v_post[clean] + noise[good][:, 1]
        return _reported(self.bench, *parts, source="MuJoCo drops").replace(order=drops.order[good]), good


def _on_floor(bench: Bench, x: Tensor, theta: Tensor) -> Tensor:
    """Height at which the body touches the tilted floor."""
    point = bench.touch(theta)
    return (x + point[:, 0]) * math.tan(bench.hidden.tilt) - point[:, 1]


def _draw(size: int, bench: Bench, sigma: Tensor, generator: torch.Generator) -> tuple[Tensor, ...]:
    """Pose and true velocity [n, 3] at touch and noise [n, 2, 3], n ≤ size; those that seem to approach."""
    low, high = torch.tensor(((0.08, -math.pi, 0.3, -2.9), (0.5, math.pi, 0.9, -2.2)), dtype=torch.float64)
    x, theta, v_x, v_y = (low + (high - low) * random(torch.rand, (size, 4), generator)).unbind(-1)
    v_x = torch.where(random(torch.rand, (size,), generator) < 0.5, -v_x, v_x)
    v = torch.stack((v_x, v_y, 6 * random(torch.randn, (size,), generator)), -1)
    noise = sigma * random(torch.randn, (size, 2, 3), generator)
    y = _on_floor(bench, x, theta)
    measured = contact_velocity(contact_point(bench.body, theta), v + noise[:, 0])
    chosen = bench.approaches(theta, v) & (measured[:, 1] < 0)
    return torch.stack((x, y, theta), -1)[chosen], v[chosen], noise[chosen]


def _drop(runner: Any, model: Any, data: Any, bench: Bench, q: Tensor, v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """q and v [n, 3] at the sample, and whether the drop was one contact at one point: bool [n]."""
    if len(q) == 0:
        return q, v, torch.ones(0, dtype=torch.bool)
    model.opt.timestep = bench.contact_time / STEPS
    # Half a step early: the engine's force then starts at touch (its error is of second order), and rounding,
    # 10⁻⁹ m in a box's corners, cannot decide whether it starts a step late.
    states, contacts = simulated(runner, model, data, q - v * model.opt.timestep / 2, v, WINDOW * STEPS)
    # contacts[:, k] counts those before step k, and states[:, k] is what follows it.
    touching, step = contacts > 0, torch.arange(contacts.shape[1])
    last = torch.where(touching, step, -1).amax(1)
    first = torch.where(touching, step, len(step)).amin(1)
    lasting = touching.sum(1) == last - first + 1
    state = states[torch.arange(len(q)), last]
    clean = (first <= 2) & lasting & (last < len(step) - 1) & (contacts.amax(1) == 1) & state.isfinite().all(-1)
    moved = rotate(bench.touch(state[:, 2]), -state[:, 2]) - rotate(bench.touch(q[:, 2]), -q[:, 2])
    clean &= (moved.norm(dim=-1) < 1e-9) | torch.tensor(isinstance(bench.body, Ellipse))  # the same corner
    if bench.hidden.delay > 0:
        steps = math.ceil(bench.hidden.delay / FLIGHT_STEP)
        model.opt.timestep = bench.hidden.delay / steps
        q, v = state.split(3, -1)
        states, contacts = simulated(runner, model, data, q, v, steps)
        state = states[:, -1]
        clean &= contacts.amax(1) == 0
    q, v = state.split(3, -1)
    return q, v, clean


def simulated(runner: Any, model: Any, data: Any, q: Tensor, v: Tensor, steps: int) -> tuple[Tensor, Tensor]:
    """(q, v) [n, steps, 6] after each step, and the number of contacts [n, steps] before it."""
    start = torch.cat((torch.zeros_like(q[:, :1]), q, v), -1)  # the time comes first
    states, contacts = runner.rollout(model, data, start.numpy(), nstep=steps)
    return torch.from_numpy(states)[..., 1:], torch.from_numpy(contacts)[..., 0]


def outcomes(
    scene: Scene, impacts: Impacts, coefficients: tuple[Tensor, Tensor] | None = None, *, xml: str | None = None
) -> Float[Tensor, "n D"]:
    """Return the velocities [N, D] after contacts of the body of a scene, nan where a contact does not end at once.

    Args:
        scene: of one body.
        impacts: poses and velocities before contact; the body is moved along z until it touches the floor.
        coefficients: μ and ε of each impact [N], those of the scene if None.
        xml: of a scene that was changed by hand.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    mujoco, rollout = engine()
    models = [mujoco.MjModel.from_xml_string(xml or scene.xml())]
    data, q, v = mujoco.MjData(models[0]), impacts.q.clone(), impacts.v_pre.clone()
    if coefficients is not None:
        models = [copy(models[0]) for _ in range(len(q))]
        for model, mu, eps in zip(models, *(x.expand(len(q)).tolist() for x in coefficients), strict=True):
            k, c = solref(eps, scene.contact_time)
            model.pair_friction[:, :2], model.pair_solref[:] = mu, (-k, -c)
    up = scene.space.d - 1
    floor, *parts = range(models[0].ngeom)
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(models[0], data)
        gap = min(mujoco.mj_geomDistance(models[0], data, floor, part, 1e3, None) for part in parts)
        row[up] -= gap / data.geom_xmat[floor, 8]
    q[:, : up + 1] -= v[:, : up + 1] * scene.step / 2  # see `_drop`
    if scene.space is SPACE:  # the engine's spin is in the axes of the body
        v[:, 3:] = matvec(rotation(q[:, 3:]).mT, v[:, 3:])
    with rollout.Rollout(nthread=0) as runner:
        states, contacts = simulated(runner, models, data, q, v, WINDOW * STEPS)
    last = torch.where(contacts > 0, torch.arange(contacts.shape[1]), -1).amax(1)
    q, v = states[torch.arange(len(q)), last].split((q.shape[1], v.shape[1]), -1)
    if scene.space is SPACE:
        v = torch.cat((v[:, :3], matvec(rotation(q[:, 3:]), v[:, 3:])), -1)
    return torch.where(((last >= 0) & (last < contacts.shape[1] - 1))[:, None], v, torch.nan)


def engine() -> tuple[Any, Any]:
    """Return MuJoCo and its module `rollout`.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    try:
        import mujoco
        from mujoco import rollout
    except ImportError as error:
        raise ContactLearnError(
            f"drops by MuJoCo need the engine ({error}); install it with: {install_hint('mujoco')}"
        ) from None
    return mujoco, rollout


__all__ = ["GRAVITY", "KINDS", "load"]


def load(
    size: int = 500,
    kind: str = "ellipse",
    semi_axes: Sequence[float] = (0.035, 0.025),
    mass: float = 0.0364,
    mu: float = 0.12,
    eps: float = 0.55,
    contact_time: float = 2e-4,
    tilt: float = 0.0,
    com_offset: Sequence[float] = (0.0, 0.0),
    inertia_error: float = 0.0,
    damping: float = 0.0,
    delay: float = 0.0,
    velocity_noise: float = 0.01,
    spin_noise: float = 0.5,
    seed: int = 0,
) -> Impacts:
    """Simulated drops; the same arguments and version of MuJoCo give the same drops.

    Args:
        size: number of drops, at least 1.
        kind: of body, ellipse or box.
        semi_axes: (a, b) in m along the body's x and y axes; half the sides of a box;
            in [0.001, 10].
        mass: in kg, in [10⁻⁶, 10³].
        mu: coefficient of friction, in [0, 100]; the engine's own least is 10⁻⁵.
        eps: restitution of the spring and dashpot, in [0.2, 1].
        contact_time: how long they would take to rebound undamped, half a period, in s; in [10⁻⁵, 0.02].
        tilt: hidden: the floor is turned counter-clockwise by it, rad, in [−0.5, 0.5].
        com_offset: hidden: centre of mass minus the geometric centre, body axes, m; inside the semi-axes.
        inertia_error: hidden: κ in [−1, 1]; the true inertia is e^κ times the reported one.
        damping: hidden: drag at this rate in 1/s, m·rate on the tracked centre and I·rate on the spin,
            from touch to sample; in [0, 10⁶].
        delay: hidden: v_post is sampled this long after separation, in s; at most 0.1.
        velocity_noise: standard deviation in m/s of the noise on v_x and v_y, before and after.
        spin_noise: standard deviation in rad/s of the noise on ω, before and after.
        seed: of the random states and noise, an integer in [0, 2⁶³).

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: a value out of its range, or settings under which too few drops are single contacts.
        UnknownNameError: no such kind of body.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    hidden = Hidden(tilt=tilt, com_offset=com_offset, inertia_error=inertia_error, damping=damping, delay=delay)
    bench = Bench(kind=kind, semi_axes=semi_axes, mass=mass, mu=mu, eps=eps, contact_time=contact_time, hidden=hidden)
    sigma_v, sigma_omega = (
        finite_number("velocity_noise", velocity_noise, 0),
        finite_number("spin_noise", spin_noise, 0),
    )
    sigma = torch.tensor((sigma_v, sigma_v, sigma_omega), dtype=torch.float64)
    return _reported(
        bench, *collect(size, bench, sigma, torch.Generator().manual_seed(seed)), source=f"MuJoCo drops (seed {seed})"
    )


def _reported(bench: Bench, q: Tensor, v_pre: Tensor, q_post: Tensor, v_post: Tensor, *, source: str) -> Impacts:
    masses = torch.full((len(q),), bench.mass, dtype=torch.float64)
    return Impacts(
        mass=masses,
        inertia=torch.full_like(masses, bench.nominal_inertia),
        r=contact_point(bench.body, q[:, 2]),
        q=q,
        v_pre=v_pre,
        v_post=v_post,
        q_post=q_post,
        object=(bench.kind,) * len(q),
        shape=bench.body,
        source=source,
    )
