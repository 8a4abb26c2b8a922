"""Trajectories: free flight in closed form, exact contact times, and an impact by the model, bounce after bounce.

    path = model.roll_out(state, shape, until=Until(bounces=5))
    path.times, path.at(torch.linspace(0, 0.5, 200))

The mass centre flies on v̇ = −c v − g ŷ, the spin stays.  Contact is where the lowest point of the body reaches the
floor y = 0, both as the model's effects say.  Contacts pile up where the next one comes within `SHORTEST`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import finite_number
from contactlearn.effects import State
from contactlearn.mechanics.bodies import body_code
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import GRAVITY, rotate
from contactlearn.mechanics.shapes import Shape, contact_point

SHORTEST = 1e-4
"""Time in s between two contacts below which contacts pile up."""

ENDS = ("bounces", "time", "piled up")
"""Reasons for which a trajectory ends."""

_NEAR = 1e-5  # s before contact at the latest from which Newton's method takes over
_STEEPEST = 0.2  # rad, of a floor that leans
_ROUNDING = 1e-12  # m
_INSIDE = 1e-9  # m by which rounding may put a body into the floor
RECORDING = ("sampling_delay", "gravity_impulse")
"""Effects of a recording, which a body in free flight does not have."""


Gap = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Height in m and velocity in m/s of the lowest point, of some bodies at poses and velocities."""


@dataclass(frozen=True, kw_only=True)
class Until:
    """Number of bounces and time in s, at the first of which a trajectory ends."""

    bounces: int = 10
    time: float = math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeFlights:
    """N free flights of the tracked point.

    Args:
        start: time [N] in s.
        pose: at the start [N, 3].
        velocity: at the start [N, 3].
        mass_centre: from the tracked point at the start [N, 2] in m, world axes.
        gravity: in m/s².
        drag: c in 1/s.
    """

    start: Float[Tensor, "n"]
    pose: Float[Tensor, "n 3"]
    velocity: Float[Tensor, "n 3"]
    mass_centre: Float[Tensor, "n 2"]
    gravity: float
    drag: float

    def of(self, which: Tensor) -> Self:
        """Return some of the flights."""
        return replace(self, **{name: x[which] for name, x in vars(self).items() if isinstance(x, Tensor)})

    def padded(self, rows: Tensor, count: int) -> Self:
        """Return `count` flights, these at `rows` and NaN elsewhere."""
        parts = {name: x for name, x in vars(self).items() if isinstance(x, Tensor)}
        every = {name: x.new_full((count, *x.shape[1:]), math.nan) for name, x in parts.items()}
        return replace(self, **{name: x.index_copy(0, rows, parts[name]) for name, x in every.items()})

    def after(self, t: Float[Tensor, "n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Return pose and velocity [N, 3] a time t [N] in s after the start."""
        spin, fall = self.velocity[:, 2], torch.tensor((0.0, -self.gravity), dtype=torch.float64)
        v = self.velocity[:, :2] + spin[:, None] * _perpendicular(self.mass_centre)
        t = t[:, None]
        if self.drag:
            lost = -torch.expm1(-self.drag * t) / self.drag  # ∫ exp(−c t)
            moved, v = v * lost + fall * (t - lost) / self.drag, v + (fall - self.drag * v) * lost
        else:
            moved, v = v * t + fall * t.square() / 2, v + fall * t
        turn = spin * t[:, 0]
        d = rotate(self.mass_centre, turn)
        pose = torch.cat((self.pose[:, :2] + moved + (self.mass_centre - d), (self.pose[:, 2] + turn)[:, None]), 1)
        return pose, torch.cat((v - spin[:, None] * _perpendicular(d), spin[:, None]), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class RollOut:
    """Trajectories with leading axes [...], of K contacts at most; NaN beyond the last contact of each.

    Args:
        times: of the contacts [..., K] in s.
        poses: at the contacts [..., K, 3].
        before: velocities before contact [..., K, 3].
        after: velocities after contact [..., K, 3].
        contacts: number of contacts [...].
        ended: place in `ENDS` of the reason for the end [...].
        end: time of it [...] in s, the last contact unless the time was up.
        flights: each flight of each trajectory, the first one before any contact.
        left_out: effects of the recordings, which a roll-out does not have.
    """

    times: Float[Tensor, "*batch k"]
    poses: Float[Tensor, "*batch k 3"]
    before: Float[Tensor, "*batch k 3"]
    after: Float[Tensor, "*batch k 3"]
    contacts: Int[Tensor, "*batch"]
    ended: Int[Tensor, "*batch"]
    end: Float[Tensor, "*batch"]
    flights: tuple[FreeFlights, ...]
    left_out: tuple[str, ...] = ()

    def reshaped(self, batch: torch.Size) -> Self:
        """Return the trajectories with their first axis split into others."""
        parts = {name: x for name, x in vars(self).items() if isinstance(x, Tensor)}
        return replace(self, **{name: x.reshape((*batch, *x.shape[1:])) for name, x in parts.items()})

    def at(self, times: Float[Tensor, "*#batch t"]) -> Float[Tensor, "*batch t 3"]:
        """Return poses [..., T, 3] at times in s, the same for all or those of each; NaN after the end."""
        found, end = [], self.end.reshape(-1)
        for time in times.double().expand(*self.contacts.shape, -1).reshape(len(end), -1).unbind(-1):
            pose = torch.full_like(self.flights[0].pose, math.nan)
            for flight in self.flights:  # the last one that has begun counts
                here = (time >= flight.start) & (time <= end)
                pose = torch.where(here[:, None], flight.after(time - flight.start)[0], pose)
            found.append(pose)
        return torch.stack(found, 1).reshape(*self.contacts.shape, -1, 3)


def follow(
    predict: Callable[[Impacts, Tensor], Prediction],
    actual: Callable[[State, Tensor], State],
    state: BodyState,
    shape: Shape | None,
    until: Until,
    gravity: float = GRAVITY,
    drag: float = 0.0,
) -> RollOut:
    """Follow bodies through their bounces.

    Args:
        predict: the outcome of impacts of the bodies at rows [n].
        actual: the state as it really is, of the bodies at rows [n].
        state: at the start, above the floor.
        shape: of the body; that of the state if None.
        until: when to stop.
        gravity: in m/s².
        drag: of the air on the mass centre, in 1/s.

    Raises:
        DataError: the shape is not known, a body starts inside the floor, or gravity is not positive.
    """
    shape = state.shape if shape is None else shape
    if shape is None:
        raise DataError("a roll-out needs the body's shape to find its contacts, such as shape=Disc(0.02); got None")
    finite_number("gravity", gravity, 0, above=True)
    pose, velocity = state.pose.reshape(-1, 3), state.velocity.reshape(-1, 3)
    fixed = {name: getattr(state, name).reshape(-1) for name in ("mass", "inertia", "order")}
    bodies = _Bodies(fixed, shape, state.object, actual, gravity, drag)
    bodies.refuse_inside(pose, velocity)
    return _bounced(bodies, predict, pose, velocity, until).reshaped(state.batch)


def _bounced(
    bodies: "_Bodies", predict: Callable[[Impacts, Tensor], Prediction], pose: Tensor, velocity: Tensor, until: Until
) -> RollOut:
    """Follow N bodies."""
    n, lever = len(pose), _lever(bodies.shape)
    rows = torch.arange(n)
    flight = bodies.fly(rows, torch.zeros(n, dtype=torch.float64), pose, velocity)
    flights = [flight]
    times = torch.full((n, until.bounces), math.nan, dtype=torch.float64)
    poses, before, after = (torch.full((n, until.bounces, 3), math.nan, dtype=torch.float64) for _ in range(3))
    ended = torch.zeros(n, dtype=torch.int64)
    for k in range(until.bounces):
        gap = partial(bodies.gap_of, rows)
        at, piled = _contact_times(flight, gap, lever, first=k == 0)
        late = flight.start + at > until.time
        ended[rows[piled]], ended[rows[late & ~piled]] = ENDS.index("piled up"), ENDS.index("time")
        hits = ~(piled | late)
        rows, at = rows[hits], at[hits]
        if not len(rows):
            break
        flight = flight.of(hits)
        q, v = flight.after(at)
        v_post = predict(bodies.impacts(rows, q, v), rows).v_post
        times[rows, k], poses[rows, k], before[rows, k], after[rows, k] = flight.start + at, q, v, v_post
        flight = bodies.fly(rows, flight.start + at, q, v_post)
        flights.append(flight.padded(rows, n))
    end = torch.where(ended == ENDS.index("time"), until.time, times.nan_to_num(0).amax(1))
    contacts = times.isfinite().sum(1)
    return RollOut(
        times=times, poses=poses, before=before, after=after, contacts=contacts, ended=ended, end=end,
        flights=tuple(flights),
    )  # fmt: skip


@dataclass(frozen=True)
class _Bodies:
    """Bodies by row, and how they really are."""

    fixed: dict[str, Tensor]  # mass, inertia, order
    shape: Shape
    name: str
    actual: Callable[[State, Tensor], State]
    gravity: float
    drag: float

    def impacts(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> Impacts:
        """Return the bodies in contact."""
        own = {name: value[rows] for name, value in self.fixed.items()}
        touching = BodyState(pose=pose, velocity=velocity, shape=self.shape, object=self.name, **own)
        return touching.as_impacts(validate=False)

    def real(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> State:
        """Return the state as it is, by the contact points of the shape."""
        mass, inertia, order = (self.fixed[name][rows] for name in ("mass", "inertia", "order"))
        r, body = contact_point(self.shape, pose[:, 2]), torch.full((len(rows),), body_code(self.name))
        return self.actual(State(mass, inertia, r, pose, velocity, order, self.shape, body=body), rows)

    def gap(self, rows: Tensor, pose: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor]:
        """Return height in m and velocity in m/s of the lowest point."""
        now = self.real(rows, pose, velocity)
        height = now.q[..., 1] + now.r[..., 1] + (0.0 if now.offset is None else now.offset[..., 1])
        return height, now.v_n

    def gap_of(self, rows: Tensor, some: Tensor, pose: Tensor, velocity: Tensor) -> tuple[Tensor, Tensor]:
        """Return `gap` of some of the rows."""
        return self.gap(rows[some], pose, velocity)

    def refuse_inside(self, pose: Tensor, velocity: Tensor) -> None:
        """Refuse a start inside the floor."""
        height, _ = self.gap(torch.arange(len(pose)), pose, velocity)
        if bool((height < -_INSIDE).any()):
            row = int((height < -_INSIDE).nonzero()[0, 0])
            depth = -height[row].item()
            raise DataError(f"a body must start above the floor y = 0; state {row + 1} is {depth:.3g} m inside it")

    def fly(self, rows: Tensor, start: Tensor, pose: Tensor, velocity: Tensor) -> FreeFlights:
        """Return the flights that begin here."""
        d = self.real(rows, pose, velocity).mass_centre
        d = torch.zeros_like(pose[:, :2]) if d is None else d.expand(len(rows), 2)
        about = {"gravity": self.gravity, "drag": self.drag}
        return FreeFlights(start=start, pose=pose, velocity=velocity, mass_centre=d, **about)


def _contact_times(flight: FreeFlights, gap: Gap, lever: float, *, first: bool) -> tuple[Tensor, Tensor]:
    """Time [N] from the start of each flight to contact, and whether contacts pile up.

    No point of a body comes down faster than its mass centre and its spin let it, so that steps which this allows
    miss no contact; Newton's method ends them.
    """
    every, t = torch.arange(len(flight.start)), torch.zeros_like(flight.start)
    if first:
        height, speed = gap(every, *flight.after(t))
        t = torch.where((height <= _INSIDE) & (speed >= 0), SHORTEST, t)  # at rest on the floor, or leaving it
    else:
        t = t + SHORTEST
    height, speed = gap(every, *flight.after(t))
    piled = (height <= 0) & (t > 0)
    left = every[~piled]
    while len(left):
        part = flight.of(left)
        now = _descended(part, t[left], lambda some, *at, left=left: gap(left[some], *at), lever)
        for _ in range(6):
            height, speed = gap(left, *part.after(now))
            step = torch.where(speed < 0, -height / torch.where(speed < 0, speed, -1.0), 0.0)
            now = now + step.clamp(-10 * _NEAR, 10 * _NEAR)
        on_floor = (height.abs() < _ROUNDING) & (speed < 0)
        t[left] = torch.where(on_floor, now, now + _NEAR)  # the others turned back just above the floor
        left = left[~on_floor]
    return t, piled


def _descended(flight: FreeFlights, t: Tensor, gap: Gap, lever: float) -> Tensor:
    """Times [N] just before the lowest point may reach the floor."""
    t, left = t.clone(), torch.arange(len(t))
    while len(left):
        part = flight.of(left)
        pose, v = part.after(t[left])
        height, speed = gap(left, pose, v)
        height = height.clamp_min(0)
        down = (
            (-v[:, 1]).clamp_min(0)
            + _STEEPEST * v[:, 0].abs()
            + (lever + 2 * part.mass_centre.norm(dim=-1)) * v[:, 2].abs()
        )
        g = part.gravity + part.drag * down
        step = 2 * height / (down + (down.square() + 2 * g * height).sqrt()).clamp_min(1e-12)
        t[left] = t[left] + torch.where(speed < 0, step, step.clamp_min(_NEAR))
        left = left[(step > _NEAR) | (speed >= 0)]
    return t


def _lever(shape: Shape) -> float:
    """Largest horizontal distance in m of the lowest point: its height changes by that per rad at most."""
    around = torch.linspace(0, 2 * math.pi, 721, dtype=torch.float64)
    return contact_point(shape, around)[:, 0].abs().max().item() * 1.3  # room for effects that stretch the body


def _perpendicular(vector: Tensor) -> Tensor:
    return torch.stack((-vector[..., 1], vector[..., 0]), -1)
