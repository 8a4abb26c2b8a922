"""Joint identification of a law's (μ, ε) and the parameters of the effects around it.

The model leaves e_k of the post velocity (or the wrench) of trial k; `student` finds the parameters under
which these are most likely, robustly, many subsets and starts at once.  Derivatives are exact: each
trial gets parameters of its own, so three backward passes give all of them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.effects import Effect, Parameter, State
from contactlearn.errors import DataError, UnknownNameError
from contactlearn.identification import robust as student
from contactlearn.identification.shared import Box
from contactlearn.impacts import Impacts
from contactlearn.laws import Law
from contactlearn.mechanics import velocity_per_wrench
from contactlearn.model import ContactModel, derivative, resolve

TARGETS = ("velocity", "wrench")
_SCATTER = 6  # numbers of a scatter matrix; as many again keep it from being singular
_OPEN = 0.125  # of its plausible range: a parameter with a larger standard error is not determined
_HARDLY = 0.07  # weight of a trial at five standard deviations in each of three components
_FEW = 5.0  # trials
_ALIKE = 0.95  # correlation from which on two parameters are said to do the same


@dataclass(frozen=True)
class JointFit:
    """What was found, for each subset (leading axes).

    `values` [..., K] and `covariance` [..., K, K] follow `parameters`, named `mu`, `eps` and `effect.parameter`.
    """

    model: ContactModel
    parameters: tuple[Parameter, ...]
    values: Tensor
    covariance: Tensor
    scatter: Tensor  # robust covariance [..., 3, 3] of what is left, in squares of the target's units
    weight: Tensor  # [..., n] of the trials, near 0 for gross outliers and 1 for ordinary ones
    telling: Tensor  # [..., K] how many trials tell of each parameter, in effect
    loss: Tensor  # [...] what was minimised, nats a trial
    agreement: Tensor  # [...] share of the starts followed to the end that came to the best one
    converged: Tensor  # [...]

    @property
    def standard_errors(self) -> Tensor:
        """[..., K]."""
        return self.covariance.diagonal(dim1=-2, dim2=-1).sqrt()

    @cached_property
    def correlation(self) -> Tensor:
        """[..., K, K]."""
        error = self.standard_errors
        return self.covariance / (error[..., :, None] * error[..., None, :])

    @property
    def usual(self) -> Tensor:
        """Trials [..., n] that count; of the others over five times as much is left as is usual."""
        return self.weight >= _HARDLY

    @property
    def outliers(self) -> int:
        """Trials of all subsets that hardly count."""
        return int((~self.usual).sum())

    def undetermined(self) -> dict[str, str]:
        """What a single subset's data leave open: parameter → reasons with the numbers that show them."""
        found = {}
        errors, told = self.standard_errors.tolist(), self.telling.tolist()
        for k, (p, error) in enumerate(zip(self.parameters, errors, strict=True)):
            others = self.correlation[k].abs().clone()
            others[k] = 0
            other, share, reasons = int(others.argmax()), error / (p.high - p.low), []
            if share > _OPEN:
                reasons.append(f"its standard error is {share:.0%} of its plausible range" if share < 1 else "nothing")
            if others.max() > _ALIKE:
                reasons.append(
                    f"its correlation with {self.parameters[other].name} is {self.correlation[k, other]:+.3f}"
                )
            if told[k] < _FEW and share <= 1:
                reasons.append(f"about {max(1, round(told[k]))} trials tell of it")
            if reasons:
                found[p.name] = " and ".join(reasons).replace("nothing", "hardly anything depends on it")
        return found

    def at_bounds(self) -> dict[str, str]:
        """Parameters of a single subset that end at a bound: parameter → what that means."""
        found = {}
        for p, value, error in zip(self.parameters, self.values.tolist(), self.standard_errors.tolist(), strict=True):
            if p.low < value < p.high:
                continue
            if value == p.vanishing:
                found[p.name] = f"is not seen: |{p.symbol}| < {1.645 * error:.2g} {p.unit} with 95 %".replace(" –", "")
            else:
                found[p.name] = f"ends at its bound {value:g}; the other parameters may be biased"
        return found


def identify_jointly(
    law: str,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    rows: Tensor | None = None,
    *,
    variant: str = "textbook",
    box: Box | None = None,
    target: str = "velocity",
    noise: Sequence[float] | None = None,
    starts: int = 8,
    start: Tensor | None = None,
) -> JointFit:
    """Fit a law with effects to trials.

    Args:
        law, variant: the analytical law.
        effects: by name; constants that they leave open are taken from the impacts.
        impacts, rows: subsets [..., n] of equal size as rows of the impacts; all of them if left out.
        box: limits of μ and ε.
        target: what is compared, the post velocity or the wrench.
        noise: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), known up to a common factor; else
            what is left is weighed by its own scatter.
        starts: of the search, for each subset.
        start: values [..., K] to begin at instead of a search.

    Raises:
        DataError: too few trials, or a shape that an effect needs is not known.
        UnknownNameError: no such law, variant or target.
    """
    laws.check(law, variant)
    if noise is not None and (len(noise) != 3 or not all(0 < sigma < math.inf for sigma in noise)):
        raise DataError(f"noise must be three positive standard deviations, of v_x, v_y and ω; got {noise}")
    if target not in TARGETS:
        raise UnknownNameError("target of a joint fit", target, TARGETS)
    effects = {name: effect.prepare(impacts) for name, effect in effects.items()}
    rows = torch.arange(len(impacts)) if rows is None else rows
    parameters = named_parameters(effects, box or Box())
    least = (len(parameters) + 2 * _SCATTER) // 3 + 1
    if rows.shape[-1] < least:
        raise DataError(f"{len(parameters)} parameters need at least {least} trials, got {rows.shape[-1]}")
    flat = rows.reshape(-1, rows.shape[-1])
    problem = _Problem.of(Law(law, 0.0, 0.0, variant), effects, impacts, flat, target, noise, parameters)
    theta, scatter, loss, agreement, converged = student.search(problem, starts, start)
    covariance, weight, telling = student.uncertainty(problem, theta, scatter)
    back = (
        x.reshape(rows.shape[:-1] + x.shape[1:])
        for x in (theta, covariance, scatter, weight, telling, loss, agreement, converged)
    )
    theta, covariance, *others = back
    return JointFit(assemble(law, variant, effects, theta, covariance), parameters, theta, covariance, *others)


class Linearisation(NamedTuple):
    """A fit about given parameters: what is left [n, 3], its derivative [n, 3, K], both whitened, and weights [n]."""

    left: Tensor
    slope: Tensor
    weight: Tensor


def linearise(
    law: str,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    theta: Tensor,
    scatter: Tensor,
    *,
    variant: str = "textbook",
    target: str = "velocity",
    noise: Sequence[float] | None = None,
) -> Linearisation:
    """What a law with effects leaves at parameters [K], and how that changes with them; options as of a fit."""
    rows = torch.arange(len(impacts))[None]
    parameters = named_parameters(effects, Box())
    problem = _Problem.of(Law(law, 0.0, 0.0, variant), effects, impacts, rows, target, noise, parameters)
    left, slope = problem.linearised(theta[None])
    return Linearisation(*(part[0] for part in student.whitened(left, slope, scatter[None])))


def named_parameters(effects: Mapping[str, Effect], box: Box) -> tuple[Parameter, ...]:
    """μ, ε and the parameters of the effects, `effect.parameter` each."""
    shared = (
        Parameter("mu", "μ", "–", *box.mu, vanishing=None),
        Parameter("eps", "ε", "–", *box.eps, vanishing=None),
    )
    own = (replace(p, name=f"{name}.{p.name}") for name, effect in effects.items() for p in effect.parameters)
    return (*shared, *own)


def assemble(
    law: str, variant: str, effects: Mapping[str, Effect], theta: Tensor, covariance: Tensor | None = None
) -> ContactModel:
    """The model at parameters [..., K]; with leading axes they broadcast against [..., N]."""
    shaped = theta[..., None, :] if theta.ndim > 1 else theta
    return ContactModel(
        Law(law, shaped[..., 0], shaped[..., 1], variant), effects=_at(effects, shaped), parameter_covariance=covariance
    )


def _at(effects: Mapping[str, Effect], theta: Tensor) -> dict[str, Effect]:
    counts = [len(effect.parameters) for effect in effects.values()]
    parts = theta[..., 2:].split(counts, -1) if counts else ()
    return {name: effect.at(part) for (name, effect), part in zip(effects.items(), parts, strict=True)}


@dataclass(frozen=True)
class _Problem:
    """B problems of n trials: the measured target [B, n, 3] and what whitens it by its known noise."""

    law: Law
    effects: Mapping[str, Effect]
    state: State
    measured: Tensor
    whitening: Tensor | None
    target: str
    low: Tensor
    high: Tensor
    start: Tensor
    reach: Tensor

    @classmethod
    def of(cls, law, effects, impacts, rows, target, noise, parameters) -> "_Problem":
        measured = (impacts.v_post if target == "velocity" else impacts.wrench)[rows]
        state, whitening = State.of(impacts, rows), None
        if noise is not None:
            whitening = torch.diag(1 / torch.tensor(noise, dtype=torch.float64)).expand(*rows.shape, 3, 3)
            if target == "wrench":  # the velocity that goes with it
                whitening = whitening @ velocity_per_wrench(state.mass, state.inertia, state.r)
        limits = torch.tensor([(p.low, p.high, p.start) for p in parameters], dtype=torch.float64)
        low, high, start = limits.T
        nuisance = torch.tensor([p.vanishing is None for p in parameters])
        reach = torch.where(nuisance, high - low, (high - low) / 3)
        return cls(law, effects, state, measured, whitening, target, low, high, start, reach)

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def scaled(self) -> bool:
        return self.whitening is not None

    def __getitem__(self, which: Tensor | slice) -> "_Problem":
        state = self.state.replace(
            **{name: getattr(self.state, name)[which] for name in ("mass", "inertia", "r", "q", "v_pre", "order")}
        )
        whitening = None if self.whitening is None else self.whitening[which]
        return replace(self, state=state, measured=self.measured[which], whitening=whitening)

    def thinned(self, most: int) -> "_Problem":
        """With every so many-th trial left out, so that no more than `most` are left."""
        step = -(-self.measured.shape[1] // most)
        return self[:, ::step]

    def left(self, theta: Tensor) -> Tensor:
        """What the model leaves, whitened by the known noise, [..., B, n, 3] at parameters [..., B, n or 1, K]."""
        prediction = resolve(self.law, _at(self.effects, theta), self.state, theta[..., 0], theta[..., 1])
        left = self.measured - (prediction.v_post if self.target == "velocity" else prediction.wrench)
        return left if self.whitening is None else (self.whitening @ left[..., None])[..., 0]

    def linearised(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        """What is left [B, n, 3], and its derivative [B, n, 3, K], at parameters [B, K]."""
        own = theta[:, None, :].expand(*self.measured.shape[:2], -1)
        own = [part.clone().requires_grad_() for part in own.unbind(-1)]
        with torch.enable_grad():
            left = self.left(torch.stack(own, -1))
            slope = derivative(left, own)
        return left.detach(), slope
