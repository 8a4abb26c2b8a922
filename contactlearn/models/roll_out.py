"""Trajectories: free flight, exact contact times, and an impact by the model, bounce after bounce.

    path = model.roll_out(state, shape, until=Until(bounces=5))
    path.times, path.at(torch.linspace(0, 0.5, 200))

The mass centre flies on v̇ = −c v − g n, in closed form, and the body turns freely (`mechanics.free_rotation`).  Contact
is where the lowest point of the body reaches the floor, y = 0 or in space z = 0, both as the model's effects say.

Contacts pile up where the next one comes within `SHORTEST`.  A trajectory ends there, unless a time is given until
which it lasts: it then goes on in steps of `STEP` with an impact at the lowest point at the end of each, so that a body
slides, rolls, topples and comes to rest by the same law.  The body has then sunk in by what it fell in the step, and is
moved back along the normal impulse at the contact, with the energy that the impact took and, where that is not enough,
a part of its motion: energy never rises.  An inelastic impact takes just what that needs.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad
from torch.nn.utils.rnn import pad_sequence

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import finite_number
from contactlearn.effects import State
from contactlearn.mechanics.bodies import body_code
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.free_rotation import most_spin, turned
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import (
    GRAVITY,
    displaced_pose,
    in_body,
    in_world,
    orientation_of,
    squared_mass_norm,
    swept,
)
from contactlearn.mechanics.shapes import Disc, Ellipse, Ellipsoid, Shape, Sphere, contact_point
from contactlearn.mechanics.space import PLANE, SPACE, Space

SHORTEST = 1e-4
"""Time in s between two contacts below which contacts pile up."""

STEP = 1e-3
"""Time in s between two contacts of a body whose contacts have piled up."""

FAINT = 4e-3
"""Time in s in which a body falls to the speed of the slowest bounce: in slower contacts it rests, slides or rolls."""

ENDS = ("bounces", "time", "piled up", "at rest")
"""Reasons for which a trajectory ends."""

_NEWTON_TIME = 1e-5  # s before contact at the latest from which Newton's method takes over
_STEEPEST = 0.2  # rad, of a floor that leans
_SAME_DIRECTION = 1e-6  # rad between directions of a grid, at its poles
_ROUNDING, _ROUNDING_TIME = 1e-12, 1e-13  # m; s
_MAX_ROUNDING_DEPTH = 1e-9  # m by which rounding may put a body into the floor
_SPEED_AT_REST = 2.0  # falls within a step: speed of a body that may be at rest
_REST_DEPTH, _HALVINGS = 1e-6, 10  # m by which a resting body sinks where another point comes down; of a step
_TIME_AT_REST = 0.2  # s for which a body at rest is that slow

Gap = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Height in m and velocity in m/s of the lowest point, of some bodies at poses and velocities."""
Predict = Callable[[Impacts, Tensor], Prediction]
"""The outcome of impacts of the bodies at rows [n]."""


@dataclass(frozen=True, kw_only=True)
class Until:
    """Number of bounces and time in s, at the first of which a trajectory ends.

    Without a time it also ends where contacts pile up, with one only where the body is at rest.
    """

    bounces: int = 10
    time: float = math.inf

    def __post_init__(self) -> None:
        """Refuse an end before the start."""
        if not (self.bounces >= 0 and self.bounces == int(self.bounces)):
            raise DataError(f"bounces must be a whole number of at least 0, got {self.bounces!r}")
        if not self.time >= 0:
            raise DataError(f"time must be at least 0 s, got {self.time!r}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeFlights:
    """N free flights of the tracked point.

    Args:
        body: number [N] of the body that flies.
        start: time [N] in s.
        pose: at the start [N, 3], in space [N, 7].
        velocity: at the start [N, D].
        inertia: in kg m² [N], in space principal moments [N, 3].
        mass_centre: from the tracked point [N, d] in m, along the body's axes; None where they are one point.
        acceleration: [N, d] beside gravity in m/s².
        gravity: in m/s².
        drag: c in 1/s.
    """

    body: Int[Tensor, "n"]
    start: Float[Tensor, "n"]
    pose: Float[Tensor, "n pose"]
    velocity: Float[Tensor, "n D"]
    inertia: Float[Tensor, "..."]
    mass_centre: Float[Tensor, "n d"] | None
    acceleration: Float[Tensor, "n d"]
    gravity: float
    drag: float

    def of(self, which: Tensor) -> Self:
        """Return some of the flights."""
        which = which.nonzero()[:, 0] if which.dtype is torch.bool else which  # once, not in each of them
        return replace(self, **{name: x[which] for name, x in vars(self).items() if isinstance(x, Tensor)})

    def later(self, t: Float[Tensor, "n"]) -> Self:
        """Return the flights from a time t [N] in s after their start on."""
        pose, velocity = self.after(t)
        return replace(self, start=self.start + t, pose=pose, velocity=velocity)

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return PLANE if self.pose.shape[-1] == 3 else SPACE

    @property
    def fastest(self) -> Float[Tensor, "n"]:
        """Spin [N] in rad/s that is never exceeded."""
        if self.space is PLANE:
            return self.velocity[:, 2].abs()
        return most_spin(self.inertia, self.velocity[:, 3:], self.pose[:, 3:])

    @property
    def asymmetry(self) -> Float[Tensor, "n"]:
        """Largest change [N] of the spin in rad/s², over its square."""
        if self.space is PLANE:
            return torch.zeros_like(self.start)
        return self.inertia.amax(-1) / self.inertia.amin(-1) - 1

    def after(self, t: Float[Tensor, "n"]) -> tuple[Float[Tensor, "n pose"], Float[Tensor, "n D"]]:
        """Return pose [N, 3 or 7] and velocity [N, D] a time t [N] in s after the start."""
        d, flat = self.space.d, self.space is PLANE
        v, spin, place, orientation = *self.velocity.tensor_split([d], 1), *self.pose.tensor_split([d], 1)
        if self.mass_centre is not None:
            arm = in_world(self.mass_centre, self.pose)
            v, place = v + swept(arm, spin), place + arm
        if flat:
            orientation = orientation + spin * t[:, None]
        else:
            orientation, spin = turned(orientation, spin, self.inertia, t)
        fall, t = self.acceleration + pad(v.new_tensor([-self.gravity]), (d - 1, 0)), t[:, None]
        if self.drag:
            lost = -torch.expm1(-self.drag * t) / self.drag  # ∫ exp(−c t)
            moved, v = v * lost + fall * (t - lost) / self.drag, v + (fall - self.drag * v) * lost
        else:
            moved, v = v * t + fall * t.square() / 2, v + fall * t
        pose = torch.cat((place + moved, orientation), 1)
        if self.mass_centre is not None:
            arm = in_world(self.mass_centre, pose)
            pose, v = torch.cat((pose[:, :d] - arm, orientation), 1), v - swept(arm, spin)
        return pose, torch.cat((v, spin), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class RollOut:
    """Trajectories with leading axes [...], of K bounces at most; NaN beyond the last bounce of each.

    Args:
        times: of the bounces [..., K] in s.
        poses: at the bounces [..., K, 3 or 7].
        before: velocities before contact [..., K, D].
        after: velocities after contact [..., K, D].
        contacts: number of bounces [...].
        ended: place in `ENDS` of the reason for the end [...].
        end: time of it [...] in s, the last contact unless the time was up.
        flights: of all trajectories, each one's in order, the first one before any contact.
        left_out: effects of the recordings, which a roll-out does not have.
    """

    times: Float[Tensor, "*batch k"]
    poses: Float[Tensor, "*batch k pose"]
    before: Float[Tensor, "*batch k D"]
    after: Float[Tensor, "*batch k D"]
    contacts: Int[Tensor, "*batch"]
    ended: Int[Tensor, "*batch"]
    end: Float[Tensor, "*batch"]
    flights: FreeFlights
    left_out: tuple[str, ...] = ()

    def reshaped(self, batch: torch.Size) -> Self:
        """Return the trajectories with their first axis split into others."""
        parts = {name: x for name, x in vars(self).items() if isinstance(x, Tensor)}
        return replace(self, **{name: x.reshape((*batch, *x.shape[1:])) for name, x in parts.items()})

    def at(self, times: Float[Tensor, "*#batch t"]) -> Float[Tensor, "*batch t pose"]:
        """Return poses [..., T, 3 or 7] at times in s, the same for all or those of each; NaN after the end."""
        times = times.double().expand(*self.contacts.shape, -1).reshape(self.contacts.numel(), -1).contiguous()
        counts = self.flights.body.bincount(minlength=len(times))
        starts = pad_sequence(list(self.flights.start.split(counts.tolist())), True, math.inf)
        k = torch.searchsorted(starts, times, right=True) - 1  # the last one that has begun counts
        which = ((counts.cumsum(0) - counts)[:, None] + k.clamp(min=0).minimum(counts[:, None] - 1)).flatten()
        poses, _ = self.flights.of(which).after(times.flatten() - self.flights.start[which])
        there = (times >= starts[:, :1]) & (times <= self.end.reshape(-1, 1))
        poses = torch.where(there.flatten()[:, None], poses, math.nan)
        return poses.reshape(*self.contacts.shape, -1, poses.shape[-1])


def follow(
    predict: Predict,
    steady: Predict | None,
    actual: Callable[[State, Tensor], State],
    state: BodyState,
    shape: Shape | None,
    until: Until,
    gravity: float = GRAVITY,
    drag: float = 0.0,
    acceleration: Float[Tensor, "*#batch d"] | None = None,
) -> RollOut:
    """Follow bodies through their bounces.

    Args:
        predict: the outcome of impacts of the bodies at rows [n].
        steady: that of contacts of bodies that rest on the floor, slide or roll; None where no law is known.
        actual: the state as it really is, of the bodies at rows [n].
        state: at the start, above the floor.
        shape: of the body; that of the state if None.
        until: when to stop.
        gravity: in m/s².
        drag: of the air on the mass centre, in 1/s.
        acceleration: of each body in flight beside gravity in m/s², such as air gives one that slows; 0 if None.

    Raises:
        DataError: the shape is not known or of the other space, a body starts inside the floor, or
            gravity is not positive.
    """
    shape = state.shape if shape is None else shape
    if shape is None:
        raise DataError("a roll-out needs the body's shape to find its contacts, such as shape=Disc(0.02); got None")
    state = replace(state, shape=shape)
    finite_number("gravity", gravity, 0, above=True)
    pose, velocity, mass, inertia, order = (
        state.flat(getattr(state, name)) for name in ("pose", "velocity", "mass", "inertia", "order")
    )
    fixed = {"mass": mass, "inertia": inertia, "order": order}
    acceleration = velocity.new_zeros(state.space.d) if acceleration is None else acceleration
    acceleration = acceleration.expand(*state.batch, -1).reshape(len(pose), -1)
    bodies = _Bodies(fixed, shape, state.object, state.space, predict, steady, actual, acceleration, gravity, drag)
    bodies.refuse_inside(pose, velocity)
    return _bounced(bodies, pose, velocity, until).reshaped(state.batch)


def _bounced(bodies: "_Bodies", pose: Tensor, velocity: Tensor, until: Until) -> RollOut:
    """Follow N bodies."""
    n, outline = len(pose), _Outline.of(bodies.shape, bodies.space)
    goes_on, rows = math.isfinite(until.time) and bodies.steady is not None, torch.arange(n)
    flight = bodies.fly(rows, torch.zeros(n, dtype=torch.float64), pose, velocity)
    flights = [flight]
    times = torch.full((n, until.bounces), math.nan, dtype=torch.float64)
    poses, before, after = (times.new_full((*times.shape, x.shape[-1]), math.nan) for x in (pose, velocity, velocity))
    end = torch.zeros(n, dtype=torch.float64)
    fast = torch.zeros_like(end)  # when the body was last faster than one at rest
    ended, contacts, resting = torch.zeros(n, dtype=torch.int64), torch.zeros(n, dtype=torch.int64), rows < 0
    while len(rows):
        gap = partial(bodies.gap_of, rows)
        duration, piled = _contact_times(flight, gap, outline, resting[rows], first=len(flights) == 1, goes_on=goes_on)
        now = flight.start + duration
        timed_out = now > until.time
        ended[rows[piled]], ended[rows[timed_out & ~piled]] = ENDS.index("piled up"), ENDS.index("time")
        hits = ~(piled | timed_out)
        if not bool(hits.any()):
            break
        rows, now, (q, v) = rows[hits], now[hits], flight.of(hits).after(duration[hits])
        if goes_on:
            q, v_post, bounced, resting[rows] = bodies.touch(rows, q, v)
            fast[rows] = torch.where(bodies.slow(rows, v_post), fast[rows], now)
            ended[rows[now - fast[rows] > _TIME_AT_REST]] = ENDS.index("at rest")
        else:
            v_post, bounced = bodies.predict(bodies.impacts(rows, q, v), rows).v_post, torch.ones_like(hits[hits])
        bounce = rows[bounced], contacts[rows[bounced]]
        times[bounce], poses[bounce], before[bounce], after[bounce] = (
            now[bounced],
            q[bounced],
            v[bounced],
            v_post[bounced],
        )
        contacts[bounce[0]] += 1
        end[rows] = now
        going = (contacts[rows] < until.bounces) & (ended[rows] == 0)
        rows = rows[going]
        flight = bodies.fly(rows, now[going], q[going], v_post[going])
        flights.append(flight)
    order = torch.cat([one.body for one in flights]).argsort(stable=True)
    return RollOut(
        times=times, poses=poses, before=before, after=after, contacts=contacts, ended=ended,
        end=torch.where(ended == ENDS.index("time"), until.time, end), flights=_joined(flights).of(order),
    )  # fmt: skip


@dataclass(frozen=True)
class _Bodies:
    """Bodies by row, and how they really are."""

    fixed: dict[str, Tensor]  # mass, inertia, order
    shape: Shape
    name: str
    space: Space
    predict: Predict
    steady: Predict | None
    actual: Callable[[State, Tensor], State]
    acceleration: Tensor
    gravity: float
    drag: float

    def impacts(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> Impacts:
        """Return the bodies in contact."""
        fixed = {name: value[rows] for name, value in self.fixed.items()}
        touching = BodyState(pose=pose, velocity=velocity, shape=self.shape, object=self.name, **fixed)
        return touching.as_impacts(validate=False)

    def touch(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return poses and velocities after contact, whether contacts are fast, bounces, and which bodies rest."""
        earlier, after = self.real(rows, pose, velocity), velocity.clone()
        bounced = earlier.v_n < -FAINT * self.gravity
        for which, predict in ((bounced, self.predict), (~bounced & (earlier.v_n < 0), self.steady)):
            if predict is not None and bool(which.any()):
                some = rows[which]
                after[which] = predict(self.impacts(some, pose[which], velocity[which]), some).v_post
        now = self.real(rows, pose, after)
        return *self.lifted(earlier, now, pose, after), bounced, now.v_n < self.gravity * STEP

    def lifted(self, earlier: State, now: State, pose: Tensor, after: Tensor) -> tuple[Tensor, Tensor]:
        """Return poses and velocities of bodies that are moved out of the floor after contact.

        A displacement M⁻¹Jᵀ (0, p) lifts the contact by W_nn p and needs the energy g p: that which the impact took, or
        more of the motion.
        """
        d, body, height = self.space.d, (now.mass, now.world_inertia), now.height
        before, moving = (squared_mass_norm(*body, one.v_pre) / 2 for one in (earlier, now))
        lost = (before - moving).clamp_min(0)
        p = (-height.clamp_max(0) / now.W[:, -1, -1]).minimum((lost + moving) / self.gravity)
        slower = (1 - (self.gravity * p - lost).clamp_min(0) / moving.clamp_min(1e-300)).clamp_min(0).sqrt()
        moved = now.as_measured(now.v_after(pad(p[:, None], (d - 1, 2 * d - 3)))) - after
        lifted, after = displaced_pose(pose, moved), slower[:, None] * after
        if self.space is PLANE:
            return lifted, after
        spin = in_world(in_body(after[:, d:], pose), lifted)  # turned as well: its energy stays
        return lifted, torch.cat((after[:, :d], spin), 1)

    def slow(self, rows: Tensor, velocity: Tensor) -> Tensor:
        """Return whether bodies are as slow as those at rest."""
        mass, inertia = self.fixed["mass"][rows], self.fixed["inertia"][rows].reshape(len(rows), -1).amax(-1)
        d = self.space.d
        square = velocity[:, :d].square().sum(-1) + inertia / mass * velocity[:, d:].square().sum(-1)
        return square < (_SPEED_AT_REST * self.gravity * STEP) ** 2

    def real(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> State:
        """Return the state as it is, by the contact points of the shape."""
        mass, inertia, order = (self.fixed[name][rows] for name in ("mass", "inertia", "order"))
        r = contact_point(self.shape, orientation_of(pose))
        body = torch.full((len(rows),), body_code(self.name))
        return self.actual(State(mass, inertia, r, pose, velocity, order, self.shape, body=body), rows)

    def gap(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor]:
        """Return height in m and velocity in m/s of the lowest point."""
        now = self.real(rows, pose, velocity)
        return now.height, now.v_n

    def gap_of(self, rows: Tensor, some: Tensor, pose: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor]:
        """Return `gap` of some of the rows."""
        return self.gap(rows[some], pose, velocity)

    def refuse_inside(self, pose: Tensor, velocity: Tensor) -> None:
        """Refuse a start inside the floor."""
        height, _ = self.gap(torch.arange(len(pose)), pose, velocity)
        if bool((height < -_MAX_ROUNDING_DEPTH).any()):
            row, up = int((height < -_MAX_ROUNDING_DEPTH).nonzero()[0, 0]), self.space.pose[self.space.d - 1]
            depth = -height[row].item()
            raise DataError(f"a body must start above the floor {up} = 0; state {row + 1} is {depth:.3g} m inside it")

    def fly(self, rows: Tensor, start: Tensor, pose: Tensor, velocity: Tensor) -> FreeFlights:
        """Return the flights that begin here."""
        now = self.real(rows, pose, velocity)
        d = None if now.mass_centre is None else in_body(now.mass_centre.expand(len(rows), -1), pose)
        inertia = now.inertia.expand(self.fixed["inertia"][rows].shape)
        about = {"gravity": self.gravity, "drag": self.drag}
        return FreeFlights(
            body=rows,
            start=start,
            pose=pose,
            velocity=velocity,
            inertia=inertia,
            mass_centre=d,
            acceleration=self.acceleration[rows],
            **about,
        )


def _contact_times(
    flight: FreeFlights, gap: Gap, outline: "_Outline", resting: Tensor, *, first: bool, goes_on: bool
) -> tuple[Tensor, Tensor]:
    """Time [N] from the start of each flight to contact, and whether contacts pile up and the trajectory ends.

    Steps that the speed of the mass centre, the spin and the outline allow miss no contact; Newton's method ends them.
    """
    t, flying = torch.zeros_like(flight.start), (~resting).nonzero()[:, 0]
    if first:
        height, speed = gap(flying, *flight.after(t))
        t = torch.where(
            (height <= _MAX_ROUNDING_DEPTH) & (speed >= 0), SHORTEST, t
        )  # at rest on the floor, or leaving it
    else:
        t = t + SHORTEST
    piled = torch.zeros_like(resting)
    if len(flying):
        height, _ = gap(flying, *flight.of(flying).after(t[flying]))
        low = (height <= 0) & (t[flying] > 0)
        piled[flying[low]] = True
        flying = flying[~low]
    if goes_on:
        flying, piled = _rest(flight, gap, t, resting | piled), torch.zeros_like(piled)
    while len(flying):
        part = flight.of(flying)
        with torch.no_grad():  # Newton's method gives the derivatives
            now = _descended(part, t[flying], lambda some, *at, flying=flying: gap(flying[some], *at), outline)
        part, moved, height, speed = part.later(now), *torch.zeros(3, len(now), dtype=torch.float64)
        for _ in range(6):
            height, speed = gap(flying, *part.after(moved))
            step = torch.where(speed < 0, -height / torch.where(speed < 0, speed, -1.0), 0.0)
            moved = moved + step.clamp(-10 * _NEWTON_TIME, 10 * _NEWTON_TIME)
            if bool((step.abs() < _ROUNDING_TIME).all()):
                break
        now = now + moved
        on_floor = (height.abs() < _ROUNDING) & (speed < 0)
        t[flying] = torch.where(on_floor, now, now + _NEWTON_TIME)  # the others turned back just above the floor
        flying = flying[~on_floor]
    return t, piled


def _rest(flight: FreeFlights, gap: Gap, t: Tensor, resting: Tensor) -> Tensor:
    """Let times of resting bodies end after a step; return the rows that fly on.

    A body may sink as fast as one at rest.  Where it would go deeper another point comes down, and the time ends when
    that is at the floor, by bisection.
    """
    lying, fall = resting.nonzero()[:, 0], FAINT * flight.gravity * STEP
    if not len(lying):
        return torch.arange(len(t))
    t[lying], part = STEP, flight.of(lying)
    start, _ = gap(lying, part.pose, part.velocity)
    height, _ = gap(lying, *part.after(t[lying]))
    resting[lying] = height <= fall
    deep = height < start.clamp_max(0) - fall
    lying, level = lying[deep], start[deep].clamp_max(0) - _REST_DEPTH
    part, early, late = flight.of(lying), torch.zeros_like(level), torch.full_like(level, STEP)
    for _ in range(_HALVINGS if len(lying) else 0):
        middle = (early + late) / 2
        above = gap(lying, *part.after(middle))[0] > level
        early, late = torch.where(above, middle, early), torch.where(above, late, middle)
    t[lying] = late
    return (~resting).nonzero()[:, 0]


def _descended(flight: FreeFlights, t: Tensor, gap: Gap, outline: "_Outline") -> Tensor:
    """Times [N] just before the lowest point may reach the floor.

    No point comes down faster than the mass centre and the spin let it.  On a rounded outline the lowest point also
    moves no more suddenly than its curvature allows: ḧ ≥ −g − ρ ω², with the spin's own change in space.
    """
    t, falling, up = t.clone(), torch.arange(len(t)), flight.space.d - 1
    beside = 0.0 if flight.mass_centre is None else 2 * flight.mass_centre.norm(dim=-1)
    sweep, here = (outline.lever + beside) * flight.fastest, flight.later(t)
    turning = (outline.radius + (1 + flight.asymmetry) * (outline.lever + beside)) * flight.fastest.square()
    while len(falling):
        height, speed = gap(falling, here.pose, here.velocity)
        height, v = height.clamp_min(0), here.velocity
        down = (-v[:, up]).clamp_min(0) + _STEEPEST * v[:, :up].norm(dim=-1) + sweep[falling]
        g = flight.gravity + (-flight.acceleration[falling, up]).clamp_min(0) + flight.drag * down
        step = _fall_time(height, down, g)
        if math.isfinite(outline.radius):
            step = step.maximum(_fall_time(height, -speed, g + turning[falling]))
        step = torch.where(speed < 0, step, step.clamp_min(_NEWTON_TIME))
        t[falling] += step
        high = (step > _NEWTON_TIME) | (speed >= 0)
        falling, here = falling[high], here.of(high).later(step[high])
    return t


def _fall_time(height: Tensor, down: Tensor, g: Tensor) -> Tensor:
    """Time in s in which a point that comes down with a speed, or rises where it is negative, falls from a height."""
    root = (down.square() + 2 * g * height).sqrt()
    return torch.where(down < 0, (root - down) / g, 2 * height / (down + root).clamp_min(1e-12))


def _joined(flights: list[FreeFlights]) -> FreeFlights:
    """All flights in one."""
    parts = {
        name: torch.cat([getattr(flight, name) for flight in flights])
        for name, x in vars(flights[0]).items()
        if isinstance(x, Tensor)
    }
    return replace(flights[0], **parts)


@dataclass(frozen=True, kw_only=True)
class _Outline:
    """How the lowest point moves as a body turns.

    Args:
        lever: largest horizontal distance in m of the lowest point: its height changes by that per rad at most.
        radius: largest radius of curvature in m; infinite of a shape that may have corners.
    """

    lever: float
    radius: float

    @classmethod
    def of(cls, shape: Shape, space: Space) -> "_Outline":
        """Return that of a shape, with room for effects that stretch the body."""
        angle = torch.linspace(0, 2 * math.pi, 721 if space is PLANE else 181, dtype=torch.float64)
        down = torch.stack((angle.cos(), angle.sin()), -1)
        if space is SPACE:  # longitudes and latitudes
            down = torch.cat((angle.cos()[:, None, None] * down, angle.sin()[:, None, None].expand(-1, 181, 1)), -1)
        lowest = shape.support(down)
        across = lowest - (lowest * down).sum(-1, keepdim=True) * down
        rounded = isinstance(shape, Ellipse | Disc | Ellipsoid | Sphere)
        return cls(
            lever=across.norm(dim=-1).max().item() * 1.3,
            radius=_largest_radius(lowest, down) * 3 if rounded else math.inf,
        )


def _largest_radius(lowest: Tensor, down: Tensor) -> float:
    """Largest change of the lowest point per rad between neighbouring directions of a grid."""
    square = torch.zeros(())
    for axis in range(down.ndim - 1):
        moved, turned = (x.diff(dim=axis).norm(dim=-1) for x in (lowest, down))
        square = square + torch.where(turned > _SAME_DIRECTION, moved / turned, 0.0).amax().square()
    return square.sqrt().item()
