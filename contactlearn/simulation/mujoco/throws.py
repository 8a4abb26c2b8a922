"""Bodies that MuJoCo lets fly, bounce and come to rest: poses at any instant, and what a flight is before and after.

A contact of the engine lasts.  A tracker's frames seldom see it, and two flights meet somewhere within it: `start` is
the instant at which the heights of both meet, extended into the contact under gravity; so are the velocities.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.simulation.mujoco.bench import GRAVITY, STEPS, Bench
from contactlearn.simulation.mujoco.simulation import engine, simulated
from contactlearn.simulation.recordings.motion import from_hand

_KEPT = 10  # steps from one pose that is kept to the next: ten in a contact time


@dataclass(frozen=True, eq=False, kw_only=True)
class Bounces:
    """Motion of N bodies as the engine simulates it; the fields are those of `recordings.camera.Motion`.

    Args:
        start: [N, K] in s.
        q: mean pose [N, K, 3] of the two flights at the start.
        v: velocity [N, K, 3] at the start.
        v_before: velocity [N, K, 3] before the contact that the flight starts with.
        rests: [N] in s.
        step: s from one kept pose to the next.
        path: poses [N, S, 3] that are kept.
    """

    start: Float[Tensor, "n k"]
    q: Float[Tensor, "n k 3"]
    v: Float[Tensor, "n k 3"]
    v_before: Float[Tensor, "n k 3"]
    rests: Float[Tensor, " n"]
    step: float
    path: Float[Tensor, "n s 3"]

    def poses(self, time: Float[Tensor, "n t"]) -> Float[Tensor, "n t 3"]:
        """Poses of the bodies at instants of their own, between two kept ones on a line."""
        place = time / self.step
        k = place.floor().long().clamp(0, self.path.shape[1] - 2)
        first, second = (self.path.gather(1, (k + j)[..., None].expand(-1, -1, 3)) for j in (0, 1))
        return first + (place - k)[..., None] * (second - first)


def bounce(bench: Bench, count: int, seconds: float, generator: torch.Generator) -> Bounces:
    """Throw bodies from a hand and simulate them for so many seconds.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    mujoco, rollout = engine()
    model = mujoco.MjModel.from_xml_string(bench.spec())
    data = mujoco.MjData(model)
    step, steps = bench.contact_time / STEPS, math.ceil(seconds / bench.contact_time) * STEPS
    q, v = from_hand(count, generator)
    with rollout.Rollout(nthread=0) as runner:
        thrown = [_thrown(runner, model, data, q[k : k + 1], v[k : k + 1], step, steps) for k in range(count)]
    most = max(len(start) for start, *_ in thrown)
    padded = [torch.stack([_filled(x, most) for x in field]) for field in list(zip(*thrown, strict=True))[:4]]
    rests, path = zip(*(one[4:] for one in thrown), strict=True)
    start, q, v, v_before = padded
    start = torch.where(torch.arange(most) < torch.tensor([[len(one[0])] for one in thrown]), start, torch.inf)
    return Bounces(
        start=start,
        q=q,
        v=v,
        v_before=v_before,
        rests=torch.tensor(rests, dtype=torch.float64),
        step=step * _KEPT,
        path=torch.stack(path),
    )


def _filled(values: Tensor, length: int) -> Tensor:
    return torch.cat((values, values.new_zeros(length - len(values), *values.shape[1:])))


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
    return start, q, v, v_before, rests, states[::_KEPT, :3]


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
