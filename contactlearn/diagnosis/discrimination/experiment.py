"""The next experiment: the few drops that would best separate models that are alike on what was measured.

For many states before impact, within the limits of the set-up, both models say what they expect; `contest` says by how
many standard deviations that differs, and what evidence a drop brings after those before it.

States are drawn evenly within the limits (Sobol), in round numbers that can be set and said, and chosen one by one:
each for the rival that is separated least so far, and away from those chosen before, since a model can be wrong at one
place for a reason of its own.  The contact point is that of the body's shape; where no shape is known, pose and
contact point are those of measured trials.  The two models are extrapolated as they are: limits far beyond the
measurements ask more of them than they have shown.
Source: Atkinson & Fedorov 1975.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from contactlearn.diagnosis.discrimination.contest import Contest, contests
from contactlearn.diagnosis.failure.variables import symmetry
from contactlearn.errors import DataError, UnknownNameError
from contactlearn.impacts import Impacts
from contactlearn.mechanics import contact_velocity
from contactlearn.model import ContactModel
from contactlearn.shapes import contact_point

STATES = ("x", "theta", "v_x", "v_y", "omega")
"""What a drop sets, in m, rad, m/s, m/s and rad/s."""
_DRAWN = 4096
_GRAZING = 0.1  # a drop's contact point approaches at more than this share of the body's speed
_BEYOND = 0.25  # of its own size, by which a limit of v or ω lies beyond the measured ones
_APART = 0.4  # of the widths of the limits: drops that are closer count for less


@dataclass(frozen=True)
class Drop:
    """A state before impact in SI units, and by how many standard deviations the chosen model differs there.

    `x` is None where no model asks for it; `differences` are by the name of the rival.
    """

    theta: float
    v_x: float
    v_y: float
    omega: float
    differences: Mapping[str, float]
    x: float | None = None

    def __str__(self) -> str:
        place = "" if self.x is None else f"x = {self.x:.3g} m, "
        state = f"{place}θ = {math.degrees(self.theta):.3g}°, v = ({self.v_x:.3g}, {self.v_y:.3g}) m/s"
        state = f"drop at {state}, ω = {self.omega:.3g} rad/s".replace("-", "−")
        if len(self.differences) == 1:
            return f"{state}: the two differ by {next(iter(self.differences.values())):.1f} standard deviations"
        by = ", ".join(f"{difference:.1f} from {name}" for name, difference in self.differences.items())
        return f"{state}: the chosen model differs by {by} standard deviations"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        state = {name: getattr(self, name) for name in STATES}
        return state | {"differences": dict(self.differences), "sentence": str(self)}


@dataclass(frozen=True)
class Experiment:
    """Drops, the best first, and how many in all, repeating them in turn, it takes to rule out each rival.

    `needed` is where the evidence is expected to reach `ODDS`; half of such experiments take more.  It is None for a
    rival that no such number of drops up to a thousand rules out.
    """

    drops: tuple[Drop, ...]
    needed: Mapping[str, int | None]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"drops": [drop.to_dict() for drop in self.drops], "needed": dict(self.needed)}


def next_experiment(
    impacts: Impacts,
    chosen: ContactModel,
    rivals: Mapping[str, ContactModel],
    *,
    generator: torch.Generator,
    limits: Mapping[str, tuple[float, float]] | None = None,
    count: int = 6,
    drawn: int = _DRAWN,
) -> Experiment:
    """The drops that best separate a chosen model from its rivals, all fitted to the impacts.

    Args:
        limits: [low, high] of some of `STATES`; the others reach as far as was measured, velocities a quarter further.
        count: of drops.
        drawn: states to choose from.

    Raises:
        DataError: no rivals, limits that are not in order, or within which nothing approaches the floor.
        UnknownNameError: a limit of something that a drop does not set.
    """
    if not rivals:
        raise DataError("an experiment that separates models needs at least one rival, got none")
    within = reachable(impacts, limits or {})
    states = _states(impacts, within, generator, drawn)
    squared = separation(impacts, chosen, rivals, states)
    picked = _picked(contests(impacts, chosen, rivals, states), _places(states, within), count)
    middle = states.q.clone()
    middle[:, 0] = within[0].mean()
    moved = separation(impacts, chosen, rivals, states.replace(q=middle))
    located = bool(((moved - squared).abs() > 1e-6 * squared + 1e-9).any())
    drops = []
    for k in picked:
        x, _, theta = states.q[k].tolist()
        differences = dict(zip(rivals, squared[:, k].sqrt().tolist(), strict=True))
        drops.append(Drop(theta, *states.v_pre[k].tolist(), differences, x if located else None))
    needed = (contest.needed() for contest in contests(impacts, chosen, rivals, states[picked]))
    return Experiment(tuple(drops), dict(zip(rivals, needed, strict=True)))


def separation(impacts: Impacts, chosen: ContactModel, rivals: Mapping[str, ContactModel], states: Impacts) -> Tensor:
    """Squared difference d² [R, n] between a chosen model and each rival at states, in units of what is not known."""
    return torch.stack([contest.squared() for contest in contests(impacts, chosen, rivals, states)])


def reachable(impacts: Impacts, limits: Mapping[str, tuple[float, float]]) -> Tensor:
    """Limits [5, 2] of `STATES`: those that are given, else the measured ones, those of velocities a quarter beyond."""
    for name, (low, high) in limits.items():
        if name not in STATES:
            raise UnknownNameError("limit of an experiment", name, STATES)
        if not -math.inf < low <= high < math.inf:
            raise DataError(f"limits of {name} must be finite numbers [low, high] in order, got [{low}, {high}]")
    measured = torch.cat((impacts.q[:, [0, 2]], impacts.v_pre), 1)
    low, high = measured.amin(0), measured.amax(0)
    beyond = torch.tensor((0.0, 0.0, _BEYOND, _BEYOND, _BEYOND), dtype=torch.float64)
    within = torch.stack((low - beyond * low.abs(), high + beyond * high.abs()), -1)
    for name, (low, high) in limits.items():
        within[STATES.index(name)] = torch.tensor((low, high), dtype=torch.float64)
    return within


def _states(impacts: Impacts, within: Tensor, generator: torch.Generator, drawn: int) -> Impacts:
    """States within the limits that approach the floor, after all measured ones; their v_post is not known yet."""
    seed = int(torch.randint(2**31, (), generator=generator))
    unit = torch.quasirandom.SobolEngine(5, scramble=True, seed=seed).draw(drawn, dtype=torch.float64)
    state = _rounded(within[:, 0] + unit * (within[:, 1] - within[:, 0]), within)
    rows = torch.randint(len(impacts), (drawn,), generator=generator)
    r, q, v = impacts.r[rows], impacts.q[rows], state[:, 2:]
    if impacts.shape is not None:
        r = contact_point(impacts.shape, state[:, 1])
        q = torch.stack((state[:, 0], -r[:, 1], state[:, 1]), -1)
    state = torch.cat((q[:, [0, 2]], v), 1)
    good = ((state >= within[:, 0]) & (state <= within[:, 1])).all(-1)
    good &= contact_velocity(r, v)[:, 1] < -_GRAZING * v[:, :2].norm(dim=-1).clamp_min(1e-9)
    if not good.any():
        said = ", ".join(f"{name} in [{low:.3g}, {high:.3g}]" for name, (low, high) in zip(STATES, within, strict=True))
        raise DataError(f"no drop within the limits approaches the floor: {said}; v_y < 0 is downwards")
    last = impacts.order.max() + 1
    return Impacts(
        mass=impacts.mass[rows][good], inertia=impacts.inertia[rows][good], r=r[good], q=q[good], v_pre=v[good],
        v_post=v[good], order=last.expand(int(good.sum())), shape=impacts.shape, source="drops to come",
    )  # fmt: skip


def _rounded(state: Tensor, within: Tensor) -> Tensor:
    """States [n, 5] in steps of about a hundredth of the limits, θ in degrees: 1°, 0.01 m/s."""
    unit = torch.tensor((1.0, math.pi / 180, 1.0, 1.0, 1.0), dtype=torch.float64)
    width = (within[:, 1] - within[:, 0]) / unit
    step = unit * 10 ** (width.clamp_min(1e-9) / 100).log10().floor()
    return torch.where(width > 0, (state / step).round() * step, state)


def _places(states: Impacts, within: Tensor) -> Tensor:
    """Where states [n, 5] are within the limits: θ around a circle, once a symmetry; velocities from 0 to 1."""
    theta, width = symmetry(states.shape) * states.q[:, 2:], within[2:, 1] - within[2:, 0]
    return torch.cat((theta.cos() / 2, theta.sin() / 2, (states.v_pre - within[2:, 0]) / width.clamp_min(1e-9)), 1)


def _picked(rivals: Sequence[Contest], places: Tensor, count: int) -> list[int]:
    """States one by one, each the best for the rival that is separated least so far, less where it is close."""
    picked, total = [], torch.zeros(len(rivals))
    near = places.new_ones(len(places))
    for _ in range(min(count, len(places))):
        squared = torch.stack([rival.squared() for rival in rivals])
        worth = squared[total.argmin()] * near
        worth[picked] = -1.0
        best = int(worth.argmax())
        picked.append(best)
        total = total + squared[:, best]
        near = near.minimum((places - places[best]).norm(dim=-1) / _APART)
        for rival in rivals:
            rival.make(best)
    return picked
