"""The next experiment: the few drops that would best discriminate between models that agree on the measurements.

    d² = Δᵀ (Σ + J C Jᵀ)⁻¹ Δ,      Δ = v_post of the one minus v_post of the other

with Σ the covariance of the chosen model's residual, and J C Jᵀ the covariance of Δ that the uncertainty C of both
models' parameters makes: a difference that another value of ε within its error would remove decides nothing.  d is the
difference in standard deviations.  If one of the two is true, a drop is expected to bring d²/2 nats of evidence for it.
It also informs both models: after it, C is smaller and Δ is the residual difference of a refit (a Kalman filter), so
the next such drop may bring less, and the sum over drops is that of all of them together.

States are drawn evenly within the limits of the set-up (Sobol), in round numbers that can be set, and chosen one by
one: each for the rival that is separated least so far, and away from those chosen before, since a model can be wrong at
one place for a reason of its own.  The contact point is that of the body's shape; where no shape is known, and in
space, orientation and contact point are those of measured trials.  The two models are extrapolated: limits far beyond
the measurements ask more of them than they have shown.
Sources: Box & Hill 1967; Atkinson & Fedorov 1975.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.diagnosis.result.effects import Drop, Experiment, Separation
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.variables import symmetry
from contactlearn.inference.identification.joint import linearise
from contactlearn.inference.validation import robust_covariance
from contactlearn.laws import Law
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity, rotation
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models.contact_model import ContactModel

Key = TypeVar("Key", bound=Hashable)
STATES = {
    PLANE: ("x", "theta", "v_x", "v_y", "omega"),
    SPACE: ("x", "y", "v_x", "v_y", "v_z", "w_x", "w_y", "w_z"),
}
"""The numbers that a drop sets by space, in m, rad, m/s and rad/s: two of the pose, and the velocity."""
_POSE = {PLANE: [0, 2], SPACE: [0, 1]}  # columns of q
_ODDS = 20.0  # 3.0 nats over all drops: evidence that decides between two models
_DRAWN = 4096
_GRAZING = 0.1  # a drop's contact point approaches at more than this share of the body's speed
_BEYOND = 0.25  # of its own size, by which a limit of v or ω lies beyond the measured ones
_DISTINCT_DROPS = 0.4  # of the widths of the limits: drops that are closer count for less


# --- Model discrimination --------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ModelDiscrimination:
    """Two models at n states; leading axes are further pairs of models at the same states.

    Args:
        difference: of v_post in (m/s, m/s, rad/s).
        slope: its derivative in the parameters of both models.
        covariance: of these parameters.
        noise: covariance of the measured v_post at each state.
    """

    difference: Float[Tensor, "*p n D"]
    slope: Float[Tensor, "*p n D k"]
    covariance: Float[Tensor, "*p k k"]
    noise: Float[Tensor, "n D D"]

    def squared(self) -> Float[Tensor, "*p n"]:
        """Compute d² of the next drop at each state."""
        spread = self.noise + self.slope @ self.covariance[..., None, :, :] @ self.slope.mT
        spread = spread + 1e-9 * torch.diag_embed(spread.diagonal(dim1=-2, dim2=-1))  # noise may be next to nothing
        factor = torch.linalg.cholesky(spread)
        white = torch.linalg.solve_triangular(factor, self.difference[..., None], upper=False)
        return white.square().sum((-2, -1))

    def at(self, rows: Sequence[int]) -> Self:
        """Return the discrimination at some of the states."""
        difference, slope = self.difference[..., rows, :], self.slope[..., rows, :, :]
        return replace(self, difference=difference, slope=slope, noise=self.noise[rows])

    def after(self, k: int) -> Self:
        """Return the discrimination once both models are refitted to the expected outcome of a drop at state k."""
        J, C = self.slope[..., k, :, :], self.covariance
        gain = torch.linalg.solve(self.noise[k] + J @ C @ J.mT, J @ C).mT
        step = gain @ self.difference[..., k, :, None]
        difference = self.difference - (self.slope @ step[..., None, :, :])[..., 0]
        covariance = C - gain @ J @ C
        return replace(self, difference=difference, covariance=(covariance + covariance.mT) / 2)

    def needed(self) -> int | None:
        """Count the drops, at the states in turn, until the evidence decides; None beyond 1000.

        It is that of a single pair.
        """
        discrimination, nats = self, 0.0
        for made in range(1000):
            k = made % len(self.noise)
            nats += discrimination.squared()[k].item() / 2
            if nats >= math.log(_ODDS):
                return made + 1
            discrimination = discrimination.after(k)
        return None


def discriminations(
    impacts: Impacts, chosen: ContactModel, rivals: Mapping[Key, ContactModel], states: Impacts
) -> dict[Key, ModelDiscrimination]:
    """Set a chosen model against each rival at states; all are fitted to the impacts."""
    noise = robust_covariance(impacts.v_post - chosen.predict(impacts).v_post)
    mean, (slope, covariance), discriminated = chosen.predict(states).v_post, parameter_slopes(chosen, states), {}
    for key, rival in rivals.items():
        other, spread = parameter_slopes(rival, states)
        difference, both = mean - rival.predict(states).v_post, torch.cat((slope, -other), -1)
        good = difference.isfinite().all(-1) & both.isfinite().all(-1).all(-1)
        discriminated[key] = ModelDiscrimination(
            difference=torch.where(good[:, None], difference, 0.0),
            slope=torch.where(good[:, None, None], both, 0.0),
            covariance=torch.block_diag(covariance, spread),
            noise=noise.expand(len(states), -1, -1),
        )
    return discriminated


def parameter_slopes(model: ContactModel, states: Impacts) -> tuple[Float[Tensor, "n D k"], Float[Tensor, "k k"]]:
    """Compute the derivative of v_post in the fitted parameters, and their covariance; k = 0 if that is not known."""
    law = model.base
    if model.parameter_covariance is None or not isinstance(law, Law):
        none = torch.zeros(len(states), states.space.D, 0, dtype=torch.float64)
        return none, torch.zeros(0, 0, dtype=torch.float64)
    unit = torch.eye(states.space.D, dtype=torch.float64)
    about = linearise(law, model.effects, states, torch.stack(model.values), unit)
    return -about.slope, model.parameter_covariance


# --- The experiment --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Substitution:
    """The chosen model with a rival in the place of one of its effects."""

    effect: EffectId
    rival: EffectId


def next_experiment(
    impacts: Impacts,
    chosen: ContactModel,
    rivals: Mapping[Substitution, ContactModel],
    *,
    generator: torch.Generator,
    limits: Mapping[str, tuple[float, float]] | None = None,
    count: int = 6,
    drawn: int = _DRAWN,
) -> Experiment:
    """Choose the drops that best separate a chosen model from its rivals, all fitted to the impacts.

    Args:
        impacts: measurements.
        chosen: the model with its own effects.
        rivals: models by what they substitute.
        generator: of the states.
        limits: [low, high] of some of `STATES`; the others reach as far as was measured, velocities a quarter further.
        count: of drops.
        drawn: states to choose from.

    Raises:
        DataError: no rivals, limits that are not in order, or within which nothing approaches the floor.
        UnknownNameError: a limit of something that a drop does not set.
    """
    if not rivals:
        raise DataError("an experiment that separates models needs at least one rival, got none")
    within = state_limits(impacts, limits or {})
    states = _states(impacts, within, generator, drawn)
    discriminated = discriminations(impacts, chosen, rivals, states)
    picked = _picked([*discriminated.values()], _places(states, within), count)
    at_drops = {key: discrimination.at(picked) for key, discrimination in discriminated.items()}
    squared = torch.stack([discrimination.squared() for discrimination in at_drops.values()])
    names, drops = STATES[impacts.space], states[picked]
    floor = [names.index(name) for name in ("x", "y") if name in names]
    middle = drops.q.clone()
    middle[:, floor] = within[floor].mean(-1)
    moved = separations_of(impacts, chosen, rivals, drops.replace(q=middle))
    located = bool(((moved - squared).abs() > 1e-6 * squared + 1e-9).any())  # a separation depends on the place
    separations = tuple(
        Separation(effect=key.effect, rival=key.rival, drops_needed=discrimination.needed())
        for key, discrimination in at_drops.items()
    )
    if impacts.space is PLANE and "theta" not in (limits or {}):
        drops = drops.replace(q=torch.cat((drops.q[:, :2], within_a_turn(drops.q[:, 2:], impacts.q[:, 2])), 1))
    made = _drops(drops, squared, located=located, several=len({*impacts.object}) > 1)
    return Experiment(separations=separations, drops=made)


def within_a_turn(theta: Float[Tensor, "*n"], measured: Float[Tensor, " m"]) -> Float[Tensor, "*n"]:
    """Return angles as they are set: from 0 to 2π if all measured ones are there, else from −π to π."""
    start = 0.0 if bool(((measured >= 0) & (measured <= 2 * math.pi)).all()) else -math.pi
    out = (theta < start) | (theta > start + 2 * math.pi)
    return torch.where(out, start + (theta - start).remainder(2 * math.pi), theta)


def _drops(drops: Impacts, squared: Float[Tensor, "r n"], *, located: bool, several: bool) -> tuple[Drop, ...]:
    """Drops as they are to be made: where, if a separation depends on the place, and with which of several bodies."""
    names, in_space = STATES[drops.space], drops.space is SPACE
    states = torch.cat((drops.q[:, _POSE[drops.space]], drops.v_pre), 1)
    return tuple(
        Drop(
            **{name: value for name, value in zip(names, state, strict=True) if located or name not in ("x", "y")},
            orientation=tuple(drops.q[k, 3:].tolist()) if in_space else None,
            differences=tuple(squared[:, k].sqrt().tolist()),
            body=drops.object[k] if several else None,
        )
        for k, state in enumerate(states.tolist())
    )


def separations_of(
    impacts: Impacts, chosen: ContactModel, rivals: Mapping[Key, ContactModel], states: Impacts
) -> Float[Tensor, "r n"]:
    """Compute the squared difference d² between a chosen model and each rival at states; see `ModelDiscrimination`."""
    against = discriminations(impacts, chosen, rivals, states)
    return torch.stack([discrimination.squared() for discrimination in against.values()])


def state_limits(impacts: Impacts, limits: Mapping[str, tuple[float, float]]) -> Float[Tensor, "s 2"]:
    """Compute the limits of `STATES`: the given ones, else the measured ones, those of velocities a quarter beyond.

    Raises:
        DataError: limits that are not finite numbers in order.
        UnknownNameError: a limit of something that a drop does not set.
    """
    names = STATES[impacts.space]
    for name, (low, high) in limits.items():
        if name not in names:
            raise UnknownNameError("limit of an experiment", name, names)
        if not -math.inf < low <= high < math.inf:
            raise DataError(f"limits of {name} must be finite numbers [low, high] in order, got [{low}, {high}]")
    measured = torch.cat((impacts.q[:, _POSE[impacts.space]], impacts.v_pre), 1)
    low, high = measured.amin(0), measured.amax(0)
    beyond = torch.full_like(low, _BEYOND)
    beyond[:2] = 0.0
    within = torch.stack((low - beyond * low.abs(), high + beyond * high.abs()), -1)
    for name, (low, high) in limits.items():
        within[names.index(name)] = torch.tensor((low, high), dtype=torch.float64)
    return within


def _states(impacts: Impacts, within: Float[Tensor, "s 2"], generator: torch.Generator, drawn: int) -> Impacts:
    """States within the limits that approach the floor, after all measured ones; their v_post is not known yet."""
    seed = int(torch.randint(2**31, (), generator=generator))
    unit = torch.quasirandom.SobolEngine(len(within), scramble=True, seed=seed).draw(drawn, dtype=torch.float64)
    state = _rounded(within[:, 0] + unit * (within[:, 1] - within[:, 0]), within)
    rows = torch.randint(len(impacts), (drawn,), generator=generator)
    r, q, v = impacts.r[rows], impacts.q[rows], state[:, 2:]
    if impacts.space is SPACE:
        q = torch.cat((state[:, :2], q[:, 2:]), -1)
    elif impacts.shape is not None:
        r = contact_points(impacts.shape, impacts.body[rows], state[:, 1])
        q = torch.stack((state[:, 0], -r[:, 1], state[:, 1]), -1)
    state = torch.cat((q[:, _POSE[impacts.space]], v), 1)
    good = ((state >= within[:, 0]) & (state <= within[:, 1])).all(-1)
    good &= contact_velocity(r, v)[:, -1] < -_GRAZING * v[:, : impacts.space.d].norm(dim=-1).clamp_min(1e-9)
    if not good.any():
        ends = zip(STATES[impacts.space], within, strict=True)
        limits = ", ".join(f"{name} in [{low:.3g}, {high:.3g}]" for name, (low, high) in ends)
        down = "v_y" if impacts.space is PLANE else "v_z"
        raise DataError(f"no drop within the limits approaches the floor: {limits}; {down} < 0 is downwards")
    last, names = impacts.order.max() + 1, tuple(impacts.object[k] for k in rows[good].tolist())
    return Impacts(
        mass=impacts.mass[rows][good], inertia=impacts.inertia[rows][good], r=r[good], q=q[good], v_pre=v[good],
        v_post=v[good], order=last.expand(len(names)), object=names, shape=impacts.shape, source="drops to come",
    )  # fmt: skip


def _rounded(state: Float[Tensor, "n s"], within: Float[Tensor, "s 2"]) -> Float[Tensor, "n s"]:
    """States in steps of about a hundredth of the limits, θ in degrees: 1°, 0.01 m/s."""
    unit = torch.tensor([1.0, math.pi / 180, 1.0, 1.0, 1.0] if len(within) == len(STATES[PLANE]) else 1.0).to(within)
    width = (within[:, 1] - within[:, 0]) / unit
    step = unit * 10 ** (width.clamp_min(1e-9) / 100).log10().floor()
    return torch.where(width > 0, (state / step).round() * step, state)


def _places(states: Impacts, within: Float[Tensor, "s 2"]) -> Float[Tensor, "n s"]:
    """Positions of states within the limits: what lands, as a half of a direction, and velocities from 0 to 1.

    In the plane that direction is θ, once a symmetry; in space it is that of the normal in the body.
    """
    if states.space is SPACE:
        lands = rotation(states.q[:, 3:])[:, 2]
    else:
        theta = symmetry(states.shape) * states.q[:, 2:]
        lands = torch.cat((theta.cos(), theta.sin()), 1)
    width = (within[2:, 1] - within[2:, 0]).clamp_min(1e-9)
    return torch.cat((lands / 2, (states.v_pre - within[2:, 0]) / width), 1)


def _picked(rivals: Sequence[ModelDiscrimination], places: Float[Tensor, "n s"], count: int) -> list[int]:
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
        near = near.minimum((places - places[best]).norm(dim=-1) / _DISTINCT_DROPS)
        rivals = [rival.after(best) for rival in rivals]
    return picked
