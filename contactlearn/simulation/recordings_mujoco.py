"""Simulated recordings of bodies whose flights, contacts and rest are MuJoCo's, with the truth about every contact.

The engine's contacts are soft: they last about `contact_time`, and the body moves while they do.  A tracker's frames
seldom see them.  The flights before and after meet within that time, in each coordinate at another instant: the instant
of a contact is known to no better than a quarter of it, and v_y, which gravity changes, accordingly; the search for
contacts has this time as an option.  `start` is the instant at which the heights of both flights meet, extended into
the contact under gravity; so are the velocities.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from contactlearn.core.numerics import whole
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import Tracked, find_impacts, track_options
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation.camera import Camera, Motion, TrueContacts, record
from contactlearn.simulation.mujoco import GRAVITY, STEPS, Bench, Hidden, engine, simulated
from contactlearn.simulation.recordings import QUATERNION, random_throws, write_recordings

_STRIDE = 10  # steps from one pose that is kept to the next: ten in a contact time


def bounce(bench: Bench, count: int, seconds: float, generator: torch.Generator) -> Motion:
    """Throw bodies from a hand and simulate them for so many seconds.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    mujoco, rollout = engine()
    model = mujoco.MjModel.from_xml_string(bench.spec())
    data = mujoco.MjData(model)
    step, steps = bench.contact_time / STEPS, math.ceil(seconds / bench.contact_time) * STEPS
    q, v = random_throws(count, generator)
    with rollout.Rollout(nthread=0) as runner:
        thrown = [_thrown(runner, model, data, q[k : k + 1], v[k : k + 1], step, steps) for k in range(count)]
    starts, *flights, rests, path = map(list, zip(*thrown, strict=True))
    start = pad_sequence(starts, batch_first=True, padding_value=torch.inf)
    q, v, v_before = (pad_sequence(part, batch_first=True) for part in flights)
    paths, kept_step = torch.stack(path), step * _STRIDE

    def poses(time: Tensor) -> Tensor:  # between two kept ones on a line
        place = time / kept_step
        k = place.floor().long().clamp(0, paths.shape[1] - 2)
        first, second = (paths.gather(1, (k + j)[..., None].expand(-1, -1, 3)) for j in (0, 1))
        return first + (place - k)[..., None] * (second - first)

    rests = torch.tensor(rests, dtype=torch.float64)
    return Motion(start=start, q=q, v=v, v_before=v_before, rests=rests, poses=poses)


def _thrown(
    runner: Any, model: Any, data: Any, q: Tensor, v: Tensor, step: float, steps: int
) -> tuple[Tensor, Tensor, Tensor, Tensor, float, Tensor]:
    """Start, q, v and v_before [K, ...] of the flights of one body, when it rests, and the poses that are kept."""
    states, contacts = simulated(runner, model, data, q, v, steps)
    states = torch.cat((torch.cat((q, v), -1)[:, None], states), 1)[0]  # states[k] is that before step k
    touching = torch.cat((contacts[0] > 0, torch.zeros(1, dtype=torch.bool))).to(torch.int8)
    edges = torch.diff(touching, prepend=touching.new_zeros(1)).nonzero()[:, 0]
    runs = edges.reshape(-1, 2)
    rests = math.inf
    if len(runs) and int(runs[-1, 1]) == steps:  # it still touches in the end
        rests, runs = float(runs[-1, 0]) * step, runs[:-1]
    first = (torch.zeros(1, dtype=torch.float64), q, v, v)
    met = [first, *_meetings(states, runs, step)]
    start, q, v, v_before = (torch.cat(parts) for parts in zip(*met, strict=True))
    return start, q, v, v_before, rests, states[::_STRIDE, :3]


def _meetings(states: Tensor, runs: Tensor, step: float) -> Iterator[tuple[Tensor, Tensor, Tensor, Tensor]]:
    """Instant at which the flights before and after each contact meet in height, mean pose and velocities there."""
    fall = torch.tensor((0.0, -GRAVITY, 0.0), dtype=torch.float64)
    for touch, leave in runs.tolist():
        (p, u), (q, v) = states[touch].split(3), states[leave].split(3)
        u, v = u + fall * step / 2, v + fall * step / 2  # the slopes of the path; the engine's are half a step older
        lasted = (leave - touch) * step
        rise = (q[1] - p[1]) - v[1] * lasted - GRAVITY * lasted**2 / 2
        since = float(rise / (u[1] - v[1] - GRAVITY * lasted))
        before, after = (x + w * tau + fall * tau**2 / 2 for x, w, tau in ((p, u, since), (q, v, since - lasted)))
        velocities = (v + fall * (since - lasted), u + fall * since)
        parts = (torch.tensor(touch * step + since, dtype=torch.float64), (before + after) / 2, *velocities)
        yield tuple(part[None] for part in parts)  # pyright: ignore[reportReturnType]  (four of them)


def load(**settings: Any) -> Impacts:
    """Impacts from recordings that MuJoCo simulates; the settings are those of `find`."""
    return find(**settings).impacts


def find(
    size: int = 50,
    folder: str | None = None,
    kind: str = "ellipse",
    semi_axes: Sequence[float] = (0.035, 0.025),
    mass: float = 0.0364,
    mu: float = 0.12,
    eps: float = 0.55,
    contact_time: float = 1e-3,
    tilt: float = 0.0,
    inertia_error: float = 0.0,
    seed: int = 0,
    **camera: Any,
) -> Tracked:
    """Impacts from recordings that MuJoCo simulates, and everything found on the way to them.

    Args:
        size: number of recordings, each of one second.
        folder: where they are written; None is outputs/tracks/mujoco_SEED.
        kind: of body, ellipse or box.
        semi_axes: (a, b) in m along the body's x and y axes; half the sides of a box.
        mass: in kg.
        mu: coefficient of friction.
        eps: restitution of the contact's spring and dashpot, in [0.2, 1].
        contact_time: how long they would take to rebound undamped, in s; in [10⁻⁵, 0.02].
        tilt: hidden: the floor is turned counter-clockwise by it, rad.
        inertia_error: hidden: κ; the true inertia is e^κ times the reported one.
        seed: of motions and faults.
        camera: fields of `Camera`.

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: a value out of its range, or see `contactlearn.data.tracks.find_impacts`.
        UnknownNameError: no such kind of body, or axes.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    hidden = Hidden(tilt=tilt, inertia_error=inertia_error)
    bench = Bench(kind=kind, semi_axes=semi_axes, mass=mass, mu=mu, eps=eps, contact_time=contact_time, hidden=hidden)
    tracker = Camera(**camera)
    tracker = replace(tracker, frames=round(tracker.rate))  # of one second
    recordings, _ = record_bounces(size, bench, tracker, seed=seed)
    place = Path("outputs") / "tracks" / f"mujoco_{seed}" if folder is None else Path(folder)
    write_recordings(recordings, place)
    options = track_options(contact_time=bench.contact_time, columns={"quaternion": QUATERNION})
    return find_impacts(place, mass=bench.mass, shape=bench.body, options=options)


def record_bounces(size: int, bench: Bench, camera: Camera, *, seed: int = 0) -> tuple[list[Recording], TrueContacts]:
    """Simulate recordings of bodies that are thrown onto a floor, and return them with the truth.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    seconds = (camera.frames + 3) / camera.rate
    return record(bounce(bench, size, seconds, torch.Generator().manual_seed(seed)), camera, seed)
