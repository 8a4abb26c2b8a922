"""The residual of a law with effects over many subsets of trials, as a problem for `robust`.

    e_k(θ) = v_post,k − f(v_pre,k, θ), whitened by the covariance of trial k where that is known

Derivatives are exact: each trial has its own copy of the parameters, so that D backward passes, one a component, give
the derivatives of all trials.

`suited` scales plausible ranges.  Effects declare them for bodies of some centimetres and grams at a few m/s; those of
lengths, speeds, impulses and energies go with a body that is larger, heavier or faster, or smaller, lighter or slower.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from contactlearn.effects import Effect, Parameter, State
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import linearised, resolve


def effects_at(effects: Mapping[str, Effect], theta: Tensor) -> dict[str, Effect]:
    """Return the effects at parameters [..., K] of a fit, of which μ and ε are the first."""
    counts = [len(effect.parameters) for effect in effects.values()]
    parts = theta[..., 2:].split(counts, -1) if counts else ()
    return {name: effect.at(part) for (name, effect), part in zip(effects.items(), parts, strict=True)}


@dataclass(frozen=True)
class JointProblem:
    """B problems of n trials: the measured target [B, n, D], and the inverse square root of its covariance where known.

    The model predicts the target from the `state` before impact.  The covariance is that of stated noise, or that of
    instrument and scatter of the contact, `Impacts.outcome_cov`.  Where noise is stated the residual is `scaled`: the
    covariance is known up to one factor.
    """

    law: Law
    effects: Mapping[str, Effect]
    state: State
    measured: Tensor
    whitening: Tensor | None
    scaled: bool
    target: str
    low: Tensor
    high: Tensor
    start: Tensor
    reach: Tensor

    @classmethod
    def of(
        cls,
        law: Law,
        effects: Mapping[str, Effect],
        impacts: Impacts,
        rows: Tensor,
        parameters: Sequence[Parameter],
        target: str,
        noise: Tensor | None,
    ) -> "JointProblem":
        """Return the problem of rows [B, n] of the impacts.

        Args:
            law: analytical; its own μ and ε are ignored.
            effects: by name, prepared.
            impacts: measurements.
            rows: of the impacts.
            parameters: of the fit.
            target: `velocity` or `wrench`; where the covariance is known the velocity is compared in either case.
            noise: standard deviations [D] of the measured v_post.
        """
        whitening = None if impacts.whitening is None else impacts.whitening[rows]
        if whitening is None and noise is not None:
            whitening = torch.diag(1 / noise).expand(*rows.shape, *[len(noise)] * 2)
        target = target if whitening is None else "velocity"
        device = impacts.mass.device
        measured = (impacts.centred if target == "velocity" else impacts.wrench)[rows]
        limits = torch.tensor([(p.low, p.high, p.start) for p in parameters], dtype=torch.float64, device=device)
        low, high, start = limits.T
        nuisance = torch.tensor([p.vanishing is None for p in parameters], device=device)
        reach = torch.where(nuisance, high - low, (high - low) / 3)
        state, scaled = State.of(impacts, rows), noise is not None
        return cls(law, effects, state, measured, whitening, scaled, target, low, high, start, reach)

    def __len__(self) -> int:
        return len(self.measured)

    def __getitem__(self, which: Tensor | slice | tuple[slice, slice]) -> "JointProblem":
        whitening = None if self.whitening is None else self.whitening[which]
        return replace(self, state=self.state[which], measured=self.measured[which], whitening=whitening)

    def thinned(self, most: int) -> "JointProblem":
        """Return the problems with every k-th trial alone, at most `most` each."""
        step = -(-self.measured.shape[1] // most)
        return self[:, ::step]

    def residual(self, theta: Tensor) -> Tensor:
        """Residual, whitened by the known noise, [..., B, n, D] at parameters [..., B, n or 1, K]."""
        residual = self.measured - self._outcome(self.state, theta)
        return residual if self.whitening is None else (self.whitening @ residual[..., None])[..., 0]

    def linearised(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        """Residual [B, n, D], and its derivative [B, n, D, K], at parameters [B, K]."""
        own = theta[:, None, :].expand(*self.measured.shape[:2], -1)
        with torch.no_grad():  # the slope itself needs no derivative
            return linearised(lambda *parts: self.residual(torch.stack(parts, -1)), own.unbind(-1))

    def outcome(self, v_pre: Tensor, theta: Tensor) -> Tensor:
        """Outcome [..., B, n, D] as the target, from v_pre [..., B, n, D] at parameters [..., B, n or 1, K]."""
        return self._outcome(self.state.replace(v_pre=v_pre), theta)

    def _outcome(self, state: State, theta: Tensor) -> Tensor:
        """Outcome from a state, whose inertia is computed once for all calls."""
        prediction = resolve(self.law, effects_at(self.effects, theta), state, theta[..., 0], theta[..., 1])
        return prediction.v_post if self.target == "velocity" else prediction.wrench


_SIZE = 0.003, 0.03  # m, radii of gyration for which the declared ranges hold as they are
_MASS = 0.001, 0.1  # kg
_SPEED = 0.3, 10.0  # m/s, of the contact point before contact


def suited(parameters: Iterable[Parameter], impacts: Impacts) -> tuple[Parameter, ...]:
    """Return parameters with ranges, and first values, in proportion to measurements."""
    size, mass, speed = (_beyond(x, *usual) for x, usual in zip(impacts.scales, (_SIZE, _MASS, _SPEED), strict=True))
    factors = {"m": size, "m/s": speed, "s/m": 1 / speed, "N s": mass * speed, "J": mass * speed**2}
    return tuple(_times(p, factors.get(p.unit, 1.0)) for p in parameters)


def _beyond(value: float, least: float, most: float) -> float:
    """By which factor a value is outside of a range; 1 within."""
    return value / min(max(value, least), most)


def _times(p: Parameter, factor: float) -> Parameter:
    vanishing = None if p.vanishing is None else p.vanishing * factor
    return replace(p, low=p.low * factor, high=p.high * factor, start=p.start * factor, vanishing=vanishing)
