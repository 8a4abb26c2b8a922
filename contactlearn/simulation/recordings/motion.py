"""Motion of a body that is thrown onto a floor: flights, contacts by a law, and a rest in which it rocks.

Many bodies fly at once.  A contact is where the lowest point of the body reaches the floor; the law resolves it in an
instant.  A body whose next contact follows within `ZENO`, or whose contact the law leaves closed, stays on the floor,
rocks about its flat side and comes to rest there.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import random
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY, contact_velocity
from contactlearn.mechanics.shapes import Shape, contact_point
from contactlearn.models.contact_model import ContactModel

ZENO = 2e-3  # s
_MOST = 14  # contacts of a body
_GRID, _LONGEST, _HALVINGS = 800, 0.6, 40  # instants of a flight that are looked at, its length in s, then bisection
_ROCKING, _SETTLING, _SLOWING = 12.0, 0.15, 0.1  # rad/s, s, s


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A rigid body, the law of its contacts with the floor, and the drag of the air in 1/s."""

    shape: Shape
    mass: float
    inertia: float
    model: ContactModel
    drag: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Thrown:
    """Flights of N bodies, K each at most; where a body has fewer, its `start` is infinite.

    Args:
        body: all are the same.
        start: [N, K] in s, of a flight; that of the first is 0.
        q: pose [N, K, 3] at the start.
        v: velocity [N, K, 3] at the start.
        v_before: velocity [N, K, 3] before the contact that the flight starts with.
        rests: [N] in s, from when on a body stays on the floor; infinite where it still flies.
        q_rest: pose [N, 3] at that instant.
        v_rest: velocity [N, 3] before it.
    """

    body: Body
    start: Float[Tensor, "n k"]
    q: Float[Tensor, "n k 3"]
    v: Float[Tensor, "n k 3"]
    v_before: Float[Tensor, "n k 3"]
    rests: Float[Tensor, " n"]
    q_rest: Float[Tensor, "n 3"]
    v_rest: Float[Tensor, "n 3"]

    def poses(self, time: Float[Tensor, "n t"]) -> Float[Tensor, "n t 3"]:
        """Poses of the bodies at instants of their own."""
        flight = torch.searchsorted(self.start.contiguous(), time.contiguous(), right=True).clamp_min(1) - 1
        picked = [x.gather(1, flight[..., None].expand(-1, -1, 3)) for x in (self.q, self.v)]
        since = time - self.start.gather(1, flight)
        flying = _moved(picked[0], picked[1], since, self.body.drag)[0]
        resting = self._resting((time - self.rests[:, None]).clamp_min(0))
        return torch.where((time >= self.rests[:, None])[..., None], resting, flying)

    def _resting(self, since: Float[Tensor, "n t"]) -> Float[Tensor, "n t 3"]:
        """It rocks about the nearest flat side and slows down."""
        x, _, theta = (part[:, None] for part in self.q_rest.unbind(-1))
        flat = (theta / torch.pi).round() * torch.pi
        since = since.nan_to_num(0.0)
        angle = flat + (theta - flat) * (-since / _SETTLING).exp() * (_ROCKING * since).cos()
        along = x + self.v_rest[:, None, 0] * _SLOWING * (1 - (-since / _SLOWING).exp())
        return torch.stack((along, -contact_point(self.body.shape, angle)[..., 1], angle), -1)


def from_hand(count: int, generator: torch.Generator) -> tuple[Float[Tensor, "{count} 3"], Float[Tensor, "{count} 3"]]:
    """Pose and velocity of bodies that leave a hand, a hand's breadth above the floor.

    y₀ ~ U(0.22, 0.32) m, v_x ~ U(0.3, 0.9) m/s, v_y ~ U(−0.5, 0.3) m/s, θ ~ U(−π, π), ω ~ N(0, 6²) rad/s.
    """
    draws = random(torch.rand, (count, 4), generator)
    low, high = torch.tensor(((0.22, 0.3, -0.5, -torch.pi), (0.32, 0.9, 0.3, torch.pi)), dtype=torch.float64)
    y, v_x, v_y, theta = (low + (high - low) * draws).unbind(-1)
    q = torch.stack((torch.zeros_like(y), y, theta), -1)
    return q, torch.stack((v_x, v_y, 6 * random(torch.randn, (count,), generator)), -1)


def throw(body: Body, count: int, generator: torch.Generator) -> Thrown:
    """Throw bodies from a hand until they rest."""
    q, v = from_hand(count, generator)
    time, rests = torch.zeros(count, dtype=torch.float64), torch.full((count,), torch.inf, dtype=torch.float64)
    starts, flights, q_rest, v_rest = [time], [(q, v, v)], q.clone(), v.clone()
    for _ in range(_MOST):
        after = _next_contact(body, q, v)
        q_hit, v_hit = _moved(q, v, after, body.drag)
        time = time + after
        v_new = _resolved(body, q_hit, v_hit)
        soon = _next_contact(body, q_hit, v_new) < ZENO
        stops = soon & rests.isinf() & time.isfinite()
        rests = torch.where(stops, time, rests)
        q_rest, v_rest = (torch.where(stops[:, None], x, y) for x, y in ((q_hit, q_rest), (v_hit, v_rest)))
        time = torch.where(rests.isinf(), time, torch.inf)
        q, v = q_hit, v_new
        starts.append(time)
        flights.append((q_hit, v_new, v_hit))
        if time.isinf().all():
            break
    rests = torch.where(time.isfinite(), time, rests)  # after the last contact that is followed
    q_rest, v_rest = (torch.where(time.isfinite()[:, None], x, y) for x, y in ((q, q_rest), (v, v_rest)))
    parts = (torch.stack(part, 1) for part in zip(*flights, strict=True))
    there = torch.stack(starts, 1)
    q, v, v_before = (torch.where(there.isfinite()[..., None], part, 0.0) for part in parts)
    return Thrown(body=body, start=there, q=q, v=v, v_before=v_before, rests=rests, q_rest=q_rest, v_rest=v_rest)


def _moved(q: Tensor, v: Tensor, since: Tensor, drag: float) -> tuple[Tensor, Tensor]:
    """Pose and velocity [..., 3] after a flight of `since` [...] in s."""
    tau = torch.where(since.isfinite(), since, 0.0)
    s = -torch.expm1(-drag * tau) / drag if drag else tau
    b = (tau - s) / drag if drag else tau**2 / 2
    x, y = q[..., 0] + v[..., 0] * s, q[..., 1] + v[..., 1] * s - GRAVITY * b
    decay = torch.exp(-drag * tau)
    velocity = torch.stack((v[..., 0] * decay, v[..., 1] * decay - GRAVITY * s, v[..., 2].expand_as(tau)), -1)
    return torch.stack((x, y, q[..., 2] + v[..., 2] * tau), -1), velocity


def _next_contact(body: Body, q: Tensor, v: Tensor) -> Tensor:
    """Time [N] in s to the next contact of a flight that begins at or above the floor."""

    def height(tau: Tensor) -> Tensor:
        pose = _moved(q[:, None], v[:, None], tau, body.drag)[0]
        return pose[..., 1] + contact_point(body.shape, pose[..., 2])[..., 1]

    grid = torch.linspace(0, 1, _GRID, dtype=torch.float64)[1:] ** 2 * _LONGEST
    below = height(grid.expand(len(q), -1)) < 0
    first = torch.where(below.any(1), below.double().argmax(1), 0)
    low = torch.where(first > 0, grid[(first - 1).clamp_min(0)], 0.0)
    high = grid[first]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        under = height(middle[:, None])[:, 0] < 0
        low, high = torch.where(under, low, middle), torch.where(under, middle, high)
    return torch.where(below.any(1), low, torch.inf)


def _resolved(body: Body, q: Tensor, v: Tensor) -> Tensor:
    """Velocity after contact."""
    full = torch.full((len(q),), 1.0, dtype=torch.float64)
    r = contact_point(body.shape, q[:, 2])
    closing = contact_velocity(r, v)[:, 1] < 0
    safe = torch.where(closing[:, None], v, torch.tensor((0.0, -1.0, 0.0), dtype=torch.float64))
    drops = Impacts(
        mass=body.mass * full, inertia=body.inertia * full, r=r, q=q, v_pre=safe, v_post=safe, validate=False
    )
    return torch.where(closing[:, None], body.model.predict(drops).v_post, v)
