"""Joint identification of a law's (μ, ε) and the parameters of the effects around it.

    minimise over θ, Σ:   Σ_k ½ (ν + 3) log(1 + d_k²/ν) + N/2 log |Σ|,      d_k² = e_kᵀ Σ⁻¹ e_k

where e_k is what the model leaves of the post velocity (or the wrench) of trial k: the likelihood of
Student's t distribution with ν = 5, for which gross outliers hardly count and whose scatter Σ weighs
the three components by what they cannot be predicted to.  Where the measurement noise is known, e_k is
weighed by its covariance V_k and Σ is a factor s² of it.

All subsets and starts move in lock step: Levenberg–Marquardt steps in θ within the bounds, with exact
derivatives (each trial gets parameters of its own, so three backward passes give all of them), and
expectation–maximisation steps in Σ.  Starts are the best two nodes of a grid over (μ, ε) with the
effects vanished, and points of a Sobol sequence over a part of the effects' ranges; the worse half
is dropped on the way.

Standard errors are those of an M-estimator, A⁻¹ B A⁻¹ from the curvature A and the spread B of the
trials' gradients, with the HC3 correction for leverage: they hold when trials are unequally noisy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.effects import Effect, Parameter, State
from contactlearn.errors import DataError, UnknownNameError
from contactlearn.fit import Box
from contactlearn.impacts import Impacts
from contactlearn.laws import Law
from contactlearn.model import ContactModel, derivative, resolve

TARGETS = ("velocity", "wrench")
_NU = 5.0  # degrees of freedom: 95 % as efficient as least squares on Gaussian noise
_ROUNDS, _HALVING = 60, 6
_TOLERANCE = 1e-7  # nats a trial
_OPEN = 0.125  # of its plausible range: a parameter with a larger standard error is not determined
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

    def undetermined(self) -> dict[str, str]:
        """What a single subset's data leave open: parameter → reason with the number that shows it."""
        found = {}
        for k, (p, error) in enumerate(zip(self.parameters, self.standard_errors.tolist(), strict=True)):
            others = self.correlation[k].abs().clone()
            others[k] = 0
            share = error / (p.high - p.low)
            if share > _OPEN:
                found[p.name] = f"its standard error is {share:.0%} of its plausible range"
            elif others.max() > _ALIKE:
                other = int(others.argmax())
                found[p.name] = (
                    f"its correlation with {self.parameters[other].name} is {self.correlation[k, other]:+.3f}"
                )
            elif not p.low < self.values[k] < p.high:
                found[p.name] = f"it ends at its bound {self.values[k]:g}"
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
    noise: Tensor | None = None,
    starts: int = 8,
) -> JointFit:
    """Fit a law with effects to trials.

    Args:
        law, variant: the analytical law.
        effects: by name; constants that they leave open are taken from the impacts.
        impacts, rows: subsets [..., n] of equal size as rows of the impacts; all of them if left out.
        box: limits of μ and ε.
        target: what is compared, the post velocity or the wrench.
        noise: covariance [3, 3] or [N, 3, 3] of the measured target, known up to a factor; else it is estimated.
        starts: of the search, for each subset.

    Raises:
        DataError: too few trials, or a shape that an effect needs is not known.
        UnknownNameError: no such law, variant or target.
    """
    laws.check(law, variant)
    if target not in TARGETS:
        raise UnknownNameError("target of a joint fit", target, TARGETS)
    effects = {name: effect.prepare(impacts) for name, effect in effects.items()}
    rows = torch.arange(len(impacts)) if rows is None else rows
    parameters = named_parameters(effects, box or Box())
    if 3 * rows.shape[-1] <= len(parameters):
        raise DataError(f"{len(parameters)} parameters need more than {rows.shape[-1]} trials of three numbers each")
    flat = rows.reshape(-1, rows.shape[-1])
    problem = _Problem.of(Law(law, 0.0, 0.0, variant), effects, impacts, flat, target, noise, parameters)
    theta, scatter, loss, agreement, converged = _search(problem, starts)
    covariance, weight = _uncertainty(problem, theta, scatter)
    back = (
        x.reshape(rows.shape[:-1] + x.shape[1:])
        for x in (theta, covariance, scatter, weight, loss, agreement, converged)
    )
    theta, covariance, *others = back
    return JointFit(assemble(law, variant, effects, theta, covariance), parameters, theta, covariance, *others)


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

    @classmethod
    def of(cls, law, effects, impacts, rows, target, noise, parameters) -> "_Problem":
        measured = impacts.v_post if target == "velocity" else impacts.wrench
        if noise is not None:
            eye = torch.eye(3, dtype=torch.float64)
            noise = torch.linalg.solve_triangular(torch.linalg.cholesky(noise), eye, upper=False)
            noise = noise.expand(len(impacts), 3, 3)[rows]
        limits = torch.tensor([(p.low, p.high, p.start) for p in parameters], dtype=torch.float64)
        return cls(law, effects, State.of(impacts, rows), measured[rows], noise, target, *limits.T)

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

    def scattered(self, left: Tensor, scatter: Tensor, steps: int) -> Tensor:
        """The scatter [..., B, 3, 3] after steps of expectation–maximisation from a first one."""
        for _ in range(steps):
            weighted = _weight(_distance(left, scatter))[..., None] * left
            scatter = (left.mT @ weighted) / left.shape[-2]
            if self.whitening is not None:
                scatter = scatter.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None] * torch.eye(3, dtype=left.dtype)
            # A component that is met exactly keeps a trace of scatter, so that nothing is divided by 0.
            scatter = scatter + 1e-12 * torch.diag_embed(left.square().mean(-2) + 1e-12)
        return scatter


def _distance(left: Tensor, scatter: Tensor) -> Tensor:
    """d² [..., n]."""
    white = torch.linalg.solve_triangular(torch.linalg.cholesky(scatter), left.mT, upper=False)
    return white.square().sum(-2)


def _weight(distance: Tensor) -> Tensor:
    return (_NU + 3) / (_NU + distance)


def _loss(left: Tensor, scatter: Tensor) -> Tensor:
    """Nats a trial [...]; infinite where something is not a number."""
    spread = torch.linalg.cholesky(scatter).diagonal(dim1=-2, dim2=-1).log().sum(-1)
    loss = (0.5 * (_NU + 3)) * torch.log1p(_distance(left, scatter) / _NU).mean(-1) + spread
    return torch.where(loss.isnan(), torch.inf, loss)


def _search(problem: _Problem, starts: int) -> tuple[Tensor, ...]:
    """Best (θ [B, K], Σ [B, 3, 3], loss, agreement, converged [B]) over the starts."""
    B = len(problem.measured)
    theta = _starts(problem, starts).reshape(-1, problem.low.shape[0])  # [S B, K]
    which = torch.arange(B).repeat(starts)
    scatter = torch.diag_embed(problem[which].left(theta[:, None]).square().median(-2).values + 1e-12)
    theta, scatter, loss, _ = _descend(problem[which], theta, scatter, _HALVING)
    if starts > 2:
        kept = loss.view(starts, B).argsort(0)[: starts // 2]  # [S/2, B]
        kept = (kept * B + torch.arange(B)).flatten()
        which, theta, scatter = which[kept], theta[kept], scatter[kept]
    theta, scatter, loss, converged = _descend(problem[which], theta, scatter, _ROUNDS)
    loss = loss.view(-1, B)
    least, best = loss.min(0)
    chosen = best * B + torch.arange(B)
    agreement = (loss <= least + 1e-4).double().mean(0)
    return theta[chosen], scatter[chosen], least, agreement, converged[chosen]


def _starts(problem: _Problem, starts: int) -> Tensor:
    """[S, B, K]: two nodes of (μ, ε), with the effects vanished, then with them anywhere in a third of their range."""
    few, low, high, start = problem.thinned(300), problem.low, problem.high, problem.start
    nodes = torch.linspace(0, 1, 15, dtype=torch.float64)[1:-1] ** torch.tensor([[2.0], [1.0]])  # μ is small more often
    grid = torch.cartesian_prod(*(low[:2, None] + nodes * (high - low)[:2, None]))
    theta = torch.cat((grid, start[2:].expand(len(grid), -1)), -1)
    left = few.left(theta[:, None, None, :])  # [G, B, n, 3]
    cost = (left / left.abs().median(0).values.median(-2, keepdim=True).values.clamp_min(1e-12)).norm(dim=-1).mean(-1)
    best = cost.argmin(0)
    far = (grid[:, None] - grid[best]).abs().amax(-1) > 0.2 * (high - low)[:2].amax()
    second = torch.where(far, cost, torch.inf).argmin(0)
    B, K = cost.shape[1], len(low)
    points = start.expand(starts, B, K).clone()
    points[..., :2] = grid[torch.stack((best, second))[torch.arange(starts) % 2]]
    if K > 2 and starts > 2:
        sobol = torch.quasirandom.SobolEngine(K - 2, scramble=True, seed=0).draw(starts - 2, dtype=torch.float64)
        reach = (high - low)[2:] / 3
        points[2:, :, 2:] = start[2:] + (sobol[:, None] - 0.5) * reach
    return points.clamp(low, high)


def _descend(problem: _Problem, theta: Tensor, scatter: Tensor, rounds: int) -> tuple[Tensor, ...]:
    """(θ, Σ, loss, converged) after rounds of damped steps; problems that have settled drop out."""
    result = [
        theta.clone(),
        scatter.clone(),
        theta.new_full(theta.shape[:1], torch.inf),
        torch.zeros(len(theta), dtype=bool),
    ]
    active, damping = torch.arange(len(theta)), theta.new_full(theta.shape[:1], 1e-2)
    calm = torch.zeros(len(theta), dtype=torch.long)
    for _ in range(rounds):
        left, slope = problem.linearised(theta)
        scatter = problem.scattered(left, scatter, 3)
        loss = _loss(left, scatter)
        step = _steps(left, slope, scatter, theta, problem, damping)  # [C, B, K]
        tried = (theta + step).clamp(problem.low, problem.high)
        losses = _loss(problem.left(tried[..., None, :]), scatter)
        new, pick = losses.min(0)
        better = new < loss
        theta = torch.where(better[:, None], _picked(tried, pick), theta)
        damping = damping * torch.where(better, torch.tensor((0.1, 1.0, 10.0), dtype=theta.dtype)[pick], 100.0)
        calm = torch.where(loss - new.minimum(loss) < _TOLERANCE, calm + 1, 0)
        done = (calm >= 3) | (damping > 1e10)
        for whole, part in zip(result, (theta, scatter, new.minimum(loss), done), strict=True):
            whole[active] = part
        if done.all():
            break
        if done.any():
            going = (~done).nonzero()[:, 0]
            problem, active = problem[going], active[going]
            theta, scatter, damping, calm = theta[going], scatter[going], damping[going], calm[going]
    left = problem.left(theta[:, None])
    result[1][active] = problem.scattered(left, scatter, 20)
    result[2][active] = _loss(left, result[1][active])
    return tuple(result)


def _steps(left: Tensor, slope: Tensor, scatter: Tensor, theta: Tensor, problem: _Problem, damping: Tensor) -> Tensor:
    """Steps [3, B, K] at a tenth of the damping, at it and at ten times it; who would leave its bound stays there."""
    gradient, curvature, _, _ = _normal(left, slope, scatter)
    width = problem.high - problem.low
    held = ((theta <= problem.low) & (gradient > 0)) | ((theta >= problem.high) & (gradient < 0))
    curvature = curvature.masked_fill(held[:, :, None] | held[:, None, :], 0.0)
    diagonal = curvature.diagonal(dim1=-2, dim2=-1)
    least = torch.where(held, 1.0, 1e-8 / width**2)
    dampings = damping * torch.tensor((0.1, 1.0, 10.0), dtype=theta.dtype)[:, None]
    damped = curvature + torch.diag_embed(dampings[..., None] * diagonal + least)
    return torch.linalg.solve(damped, -gradient.masked_fill(held, 0.0)[..., None])[..., 0]


def _normal(left: Tensor, slope: Tensor, scatter: Tensor) -> tuple[Tensor, ...]:
    """Gradient [B, K] and Gauss–Newton curvature [B, K, K] of the loss, the whitened slope and gradients by trial."""
    factor = torch.linalg.cholesky(scatter)
    left = torch.linalg.solve_triangular(factor[:, None], left[..., None], upper=False)
    slope = torch.linalg.solve_triangular(factor[:, None], slope, upper=False)
    weight = _weight(left.square().sum((-2, -1)))
    each = (slope * left).sum(-2)  # Jᵀ e
    gradient = (weight[..., None] * each).mean(-2)
    flat = (weight.sqrt()[..., None, None] * slope).flatten(1, 2)
    return gradient, flat.mT @ flat / left.shape[1], slope, each


def _picked(x: Tensor, which: Tensor) -> Tensor:
    """x[which[b], b] of x [C, B, K]."""
    return x.gather(0, which[None, :, None].expand(1, *x.shape[1:]))[0]


def _uncertainty(problem: _Problem, theta: Tensor, scatter: Tensor) -> tuple[Tensor, Tensor]:
    """Covariance [B, K, K] of the parameters and weights [B, n] of the trials."""
    left, slope = problem.linearised(theta)
    distance, n = _distance(left, scatter), left.shape[1]
    _, curvature, slope, each = _normal(left, slope, scatter)
    weight = _weight(distance)
    # A parameter that nothing depends on gets a standard error of a hundred times its range.
    floor = torch.diag_embed((1e-4 / n) / (problem.high - problem.low) ** 2)
    flat = each * (2 * weight.square() / (_NU + 3))[..., None]
    observed = curvature - each.mT @ flat / n
    definite = torch.linalg.eigvalsh(observed)[:, 0] > 1e-3 * torch.linalg.eigvalsh(curvature)[:, 0]
    A = torch.where(definite[:, None, None], observed, curvature) + floor
    inverse = torch.linalg.inv(A) / n
    leverage = torch.einsum("bnik,bkl,bnil->bn", slope, inverse, slope) * weight / 3
    scores = (weight / (1 - leverage.clamp(0, 0.9)))[..., None] * each
    covariance = inverse @ (scores.mT @ scores) @ inverse
    return covariance + inverse @ (n * floor) @ inverse, weight * (_NU / (_NU + 3))
