"""Simulated recordings of bodies that are thrown onto a floor, with the truth about every contact.

    throw              flights, contacts by a law, rest: poses at any instant
    simulate           recordings of such motions by a tracker (`camera`)
    find, load         impacts from such recordings, in the same way as from real ones
    write_recordings   the recordings as CSV files

Many bodies fly at once.  A contact is where the lowest point of the body reaches the floor; the law resolves it in an
instant.  A body whose next contact follows within `ZENO`, or whose contact the law leaves closed, stays on the floor,
rocks about its flat side and comes to rest there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn import laws
from contactlearn.core.numerics import finite_number, random, whole
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import Tracked, find_impacts, track_options
from contactlearn.effects import Effect
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY, contact_velocity
from contactlearn.mechanics.shapes import Ellipse, Shape, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation.camera import AXES, Camera, Motion, TrueContacts, record

QUATERNION = ("q1", "q2", "q3", "q4")
"""Columns of a quaternion, whose names do not show the order of its components."""
_SECONDS = 2.0  # of a recording
ZENO = 2e-3  # s
_MAX_CONTACTS = 14  # contacts of a body
_GRID, _LONGEST, _HALVINGS = 800, 0.6, 40  # instants of a flight that are looked at, its length in s, then bisection
_ROCKING, _SETTLING, _SLOWING = 12.0, 0.15, 0.1  # rad/s, s, s


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A rigid body, the law of its contacts with the floor, and what acts on it in the air.

    Args:
        drag: linear drag in 1/s.
        plates: standard deviation in m/s² of an acceleration that each flight has of its own; of its spin, 30 rad/m
            times as much.
    """

    shape: Shape
    mass: float
    inertia: float
    model: ContactModel
    drag: float = 0.0
    plates: float = 0.0

    def draw_acceleration(self, count: int, generator: torch.Generator) -> Float[Tensor, "n 3"]:
        """Accelerations of flights."""
        return self.plates * torch.tensor((1.0, 1.0, 30.0)) * random(torch.randn, (count, 3), generator)


def random_throws(count: int, generator: torch.Generator) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """Pose and velocity of bodies that leave a hand above the floor.

    y₀ ~ U(0.22, 0.32) m, v_x ~ U(0.3, 0.9) m/s, v_y ~ U(−0.5, 0.3) m/s, θ ~ U(−π, π), ω ~ N(0, 6²) rad/s.
    """
    draws = random(torch.rand, (count, 4), generator)
    low, high = torch.tensor(((0.22, 0.3, -0.5, -torch.pi), (0.32, 0.9, 0.3, torch.pi)), dtype=torch.float64)
    y, v_x, v_y, theta = (low + (high - low) * draws).unbind(-1)
    q = torch.stack((torch.zeros_like(y), y, theta), -1)
    return q, torch.stack((v_x, v_y, 6 * random(torch.randn, (count,), generator)), -1)


def throw(body: Body, count: int, generator: torch.Generator) -> Motion:
    """Throw bodies from a hand until they rest."""
    q, v = random_throws(count, generator)
    time, rests = torch.zeros(count, dtype=torch.float64), torch.full((count,), torch.inf, dtype=torch.float64)
    acceleration = body.draw_acceleration(count, generator)
    starts, flights, q_rest, v_rest = [time], [(q, v, v, acceleration)], q.clone(), v.clone()
    for _ in range(_MAX_CONTACTS):
        after = _next_contact(body, q, v, acceleration)
        q_hit, v_hit = _moved(q, v, acceleration, after, body.drag)
        time = time + after
        v_new, acceleration = _resolved(body, q_hit, v_hit), body.draw_acceleration(count, generator)
        soon = _next_contact(body, q_hit, v_new, acceleration) < ZENO
        stops = soon & rests.isinf() & time.isfinite()
        rests = torch.where(stops, time, rests)
        q_rest, v_rest = (torch.where(stops[:, None], x, y) for x, y in ((q_hit, q_rest), (v_hit, v_rest)))
        time = torch.where(rests.isinf(), time, torch.inf)
        q, v = q_hit, v_new
        starts.append(time)
        flights.append((q_hit, v_new, v_hit, acceleration))
        if time.isinf().all():
            break
    rests = torch.where(time.isfinite(), time, rests)  # after the last contact that is followed
    q_rest, v_rest = (torch.where(time.isfinite()[:, None], x, y) for x, y in ((q, q_rest), (v, v_rest)))
    parts = (torch.stack(part, 1) for part in zip(*flights, strict=True))
    there = torch.stack(starts, 1)
    q, v, v_before, acceleration = (torch.where(there.isfinite()[..., None], part, 0.0) for part in parts)

    def poses(time: Tensor) -> Tensor:
        flight = torch.searchsorted(there.contiguous(), time.contiguous(), right=True).clamp_min(1) - 1
        q_0, v_0, a_0 = (x.gather(1, flight[..., None].expand(-1, -1, 3)) for x in (q, v, acceleration))
        flying = _moved(q_0, v_0, a_0, time - there.gather(1, flight), body.drag)[0]
        resting = _rocking(body, q_rest, v_rest, (time - rests[:, None]).clamp_min(0))
        return torch.where((time >= rests[:, None])[..., None], resting, flying)

    return Motion(start=there, q=q, v=v, v_before=v_before, rests=rests, poses=poses)


def _rocking(body: Body, q: Tensor, v: Tensor, since: Tensor) -> Tensor:
    """Poses [N, T, 3] of bodies that rock about the nearest flat side and slow down, from q and v [N, 3] on."""
    x, _, theta = (part[:, None] for part in q.unbind(-1))
    flat = (theta / torch.pi).round() * torch.pi
    since = since.nan_to_num(0.0)
    angle = flat + (theta - flat) * (-since / _SETTLING).exp() * (_ROCKING * since).cos()
    along = x + v[:, None, 0] * _SLOWING * (1 - (-since / _SLOWING).exp())
    return torch.stack((along, -contact_point(body.shape, angle)[..., 1], angle), -1)


def _moved(q: Tensor, v: Tensor, acceleration: Tensor, since: Tensor, drag: float) -> tuple[Tensor, Tensor]:
    """Pose and velocity [..., 3] after a flight of `since` [...] in s with an acceleration of its own."""
    tau = torch.where(since.isfinite(), since, 0.0)
    s = -torch.expm1(-drag * tau) / drag if drag else tau
    b = (tau - s) / drag if drag else tau**2 / 2
    pulled = acceleration + torch.tensor((0.0, -GRAVITY, 0.0))
    s, b, decay = (
        torch.stack((air, air, free), -1)
        for air, free in ((s, tau), (b, tau**2 / 2), (torch.exp(-drag * tau), 1 + 0 * tau))
    )
    return q + v * s + pulled * b, v * decay + pulled * s


def _next_contact(body: Body, q: Tensor, v: Tensor, acceleration: Tensor) -> Tensor:
    """Time [N] in s to the next contact of a flight that begins at or above the floor."""

    def height(tau: Tensor) -> Tensor:
        pose = _moved(q[:, None], v[:, None], acceleration[:, None], tau, body.drag)[0]
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
    """Velocity after contact, that before it where the contact does not close."""
    r, after = contact_point(body.shape, q[:, 2]), v.clone()
    hits = contact_velocity(r, v)[:, 1] < 0
    if hits.any():
        touching = BodyState(pose=q[hits], velocity=v[hits], mass=body.mass, inertia=body.inertia, r=r[hits])
        after[hits] = body.model.predict(touching.as_impacts(validate=False)).v_post
    return after


__all__ = ["AXES", "MASS", "SEMI_AXES", "find", "load", "simulate", "write_recordings"]

SEMI_AXES, MASS = (0.035, 0.025), 0.0364  # m, kg: the published ellipse
"""Of the simulated body, an ellipse of uniform density."""


def load(**settings: Any) -> Impacts:
    """Impacts from simulated recordings of an ellipse; the settings are those of `find`."""
    return find(**settings).impacts


def find(
    size: int = 200,
    folder: str | None = None,
    law: str = "wang_mason",
    mu: float = 0.12,
    eps: float = 0.55,
    drag: float = 0.0,
    seed: int = 0,
    **camera: Any,
) -> Tracked:
    """Impacts from simulated recordings of an ellipse, and everything found on the way to them.

    Args:
        size: number of recordings, each of two seconds.
        folder: where they are written; None is outputs/tracks/seed_SEED.
        law: that is true, with its coefficients of friction `mu` and restitution `eps`, and `drag` of the air in 1/s.
        seed: of motions and faults.
        camera: fields of `Camera`.

    Raises:
        DataError: a value out of its range, or see `contactlearn.data.tracks.find_impacts`.
        UnknownNameError: no such law or axes.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    tracker = Camera(**camera)
    tracker = replace(tracker, frames=round(_SECONDS * tracker.rate))
    recordings, _ = simulate(size, tracker, law=law, mu=mu, eps=eps, drag=drag, seed=seed)
    place = Path("outputs") / "tracks" / f"seed_{seed}" if folder is None else Path(folder)
    write_recordings(recordings, place)
    options = track_options(columns={"quaternion": QUATERNION})
    return find_impacts(place, mass=MASS, shape=Ellipse(SEMI_AXES), options=options)


def simulate(
    size: int,
    camera: Camera = Camera(),
    *,
    law: str = "wang_mason",
    mu: float = 0.12,
    eps: float = 0.55,
    effects: Mapping[str, Effect] = MappingProxyType({}),
    drag: float = 0.0,
    plates: float = 0.0,
    seed: int = 0,
) -> tuple[list[Recording], TrueContacts]:
    """Simulate recordings of ellipses that are thrown onto a floor, and return them with the truth."""
    shape = Ellipse(SEMI_AXES)
    model = ContactModel(laws.find(law).at(mu, eps), effects=dict(effects))
    body = Body(
        shape=shape,
        mass=MASS,
        inertia=MASS * shape.gyration_squared(),
        model=model,
        drag=finite_number("drag", drag, 0),
        plates=plates,
    )
    motion = throw(body, size, torch.Generator().manual_seed(seed))
    return record(motion, camera, seed)


def write_recordings(recordings: Sequence[Recording], folder: Path) -> None:
    """Write recordings as CSV files of a folder, a file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for recording in recordings:
        names = ("x", "y", "z")[: recording.position.shape[1]]
        columns = {"time": recording.time, **dict(zip(names, recording.position.T, strict=True))}
        rotations = ("theta",) if recording.quaternion is None else QUATERNION
        columns |= dict(zip(rotations, recording.rotation.T, strict=True))
        pd.DataFrame(columns).to_csv(folder / f"{recording.name}.csv", index=False, float_format="%.9g")
