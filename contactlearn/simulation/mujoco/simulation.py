"""Drops of a `Bench` in the engine: single contacts at one point, from touch to sample."""

import math
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, installing
from contactlearn.core.numerics import random
from contactlearn.mechanics.rigid_body import contact_velocity, rotate
from contactlearn.mechanics.shapes import Ellipse, contact_point
from contactlearn.simulation.mujoco.bench import STEPS, Bench

WINDOW = 3  # contact times simulated; a contact that has not ended by then is left out
FLIGHT_STEP = 1e-4  # s, between separation and a late sample
BATCH = 500  # drops simulated at once, so that their histories take a few MB


def collect(
    size: int, bench: Bench, sigma: Float[Tensor, "3"], generator: torch.Generator
) -> tuple[Float[Tensor, "{size} 3"], ...]:
    """q, v_pre, q_post and v_post of `size` single contacts, with noise of standard deviation `sigma` on velocities.

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: hardly any drop is a single contact.
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


def _draw(size: int, bench: Bench, sigma: Tensor, generator: torch.Generator) -> tuple[Tensor, ...]:
    """Pose and true velocity [n, 3] at touch and noise [n, 2, 3], n ≤ size; those that seem to approach."""
    low, high = torch.tensor(((0.08, -math.pi, 0.3, -2.9), (0.5, math.pi, 0.9, -2.2)), dtype=torch.float64)
    x, theta, v_x, v_y = (low + (high - low) * random(torch.rand, (size, 4), generator)).unbind(-1)
    v_x = torch.where(random(torch.rand, (size,), generator) < 0.5, -v_x, v_x)
    v = torch.stack((v_x, v_y, 6 * random(torch.randn, (size,), generator)), -1)
    noise = sigma * random(torch.randn, (size, 2, 3), generator)
    point = bench.touch(theta)
    y = (x + point[:, 0]) * math.tan(bench.hidden.tilt) - point[:, 1]  # the point is on the floor
    measured = contact_velocity(contact_point(bench.body, theta), v + noise[:, 0])
    chosen = bench.approaches(theta, v) & (measured[:, 1] < 0)
    return torch.stack((x, y, theta), -1)[chosen], v[chosen], noise[chosen]


def _drop(runner: Any, model: Any, data: Any, bench: Bench, q: Tensor, v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """q and v [n, 3] at the sample, and whether the drop was one contact at one point: bool [n]."""
    if len(q) == 0:
        return q, v, torch.ones(0, dtype=torch.bool)
    model.opt.timestep = bench.contact_time / STEPS
    # Half a step early: the engine's force then starts at touch (its error is of second order), and rounding,
    # 10⁻⁹ m in a box's corners, cannot tell whether it starts a step late.
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
            f"drops by MuJoCo need the engine ({error}); install it with: {installing('mujoco')}"
        ) from None
    return mujoco, rollout
