"""Robust regression of D components a trial with Student's t distribution, many problems at once.

    minimise over θ, Σ:   Σ_k ½ (ν + D) log(1 + d_k²/ν) + N/2 log |Σ|,      d_k² = e_k(θ)ᵀ Σ⁻¹ e_k(θ)

With ν = 5 gross outliers have little weight.  The scatter Σ weights the components by the covariance of their
residuals; where the noise is known, e_k is whitened by it and Σ is s² times the identity.

Levenberg–Marquardt steps in θ within the bounds alternate with expectation–maximisation steps in Σ.  Near the minimum
they are Newton's: Gauss–Newton steps leave out that the weights change, and only approach it by a constant factor each.

Two starts are the best nodes of a grid over (μ, ε), with the other parameters at their initial values.  The further
starts draw the other parameters from a Sobol sequence over a third of each range, or over the whole range of a
parameter of which no value makes its effect vanish.  The worse half of the starts is dropped on the way.

Standard errors are those of an M-estimator, A⁻¹ B A⁻¹ from the curvature A and the covariance B of the trials'
gradients, with the HC3 correction for leverage, or those of the curvature alone where these are larger.
Source: Lange, Little & Taylor 1989; MacKinnon & White 1985.
"""

from typing import Protocol

import torch
from torch import Tensor

from contactlearn.core.numerics import mahalanobis

_NU = 5.0  # degrees of freedom: 95 % as efficient as least squares on Gaussian noise
_ROUNDS, _HALVING = 60, 6
_DAMPING = torch.tensor((0.1, 0.1, 10.0), dtype=torch.float64)  # of each step, by that of the last
TOLERANCE = 1e-7
"""Decrease of the loss in nats a trial below which a step is no improvement."""


class Problem(Protocol):
    """B problems in K parameters, of which μ and ε are the first."""

    @property
    def low(self) -> Tensor:
        """Lower bounds [K]."""
        ...

    @property
    def high(self) -> Tensor:
        """Upper bounds [K]."""
        ...

    @property
    def start(self) -> Tensor:
        """Initial parameters [K]."""
        ...

    @property
    def reach(self) -> Tensor:
        """Widths [K] of the intervals about the initial parameters in which other starts lie."""
        ...

    @property
    def scaled(self) -> bool:
        """Whether the residual is whitened by its known noise."""
        ...

    def __len__(self) -> int: ...

    def __getitem__(self, which: Tensor) -> "Problem": ...

    def thinned(self, most: int) -> "Problem":
        """Return the problems with at most so many trials each."""
        ...

    def residual(self, theta: Tensor) -> Tensor:
        """Residual [..., B, n, D] at parameters [..., B, n or 1, K]."""
        ...

    def linearised(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        """Residual [B, n, D], and its derivative [B, n, D, K], at parameters [B, K]."""
        ...


def _weight(distance: Tensor, components: int) -> Tensor:
    return (_NU + components) / (_NU + distance)


def _loss(residual: Tensor, scatter: Tensor) -> Tensor:
    """Loss [...] in nats a trial; infinite where it is not a number."""
    spread = torch.linalg.cholesky(scatter).diagonal(dim1=-2, dim2=-1).log().sum(-1)
    loss = robust_distance(residual, scatter).mean(-1) + spread
    return torch.where(loss.isnan(), torch.inf, loss)


def search(
    problem: Problem, starts: int, start: Tensor | None = None, tolerance: float = TOLERANCE
) -> tuple[Tensor, ...]:
    """Minimise the loss from several starts, or from the one that is given.

    Returns:
        θ [B, K], Σ [B, D, D], residual [B, n, D] and loss [B] of the best start, the share [B] of the starts followed
        to the end that reached this loss, and whether the best one converged [B].
    """
    B = len(problem)
    if start is None:
        theta = _starts(problem, starts).reshape(-1, problem.low.shape[0])  # [S B, K]
    else:
        theta, starts = start.expand(B, -1).clamp(problem.low, problem.high), 1
    every = torch.arange(B, device=theta.device)
    which, scatter = every.repeat(starts), None
    if starts > 2:
        theta, scatter, _, loss, _ = _descend(problem[which], theta, scatter, _HALVING, tolerance)
        kept = loss.view(starts, B).argsort(0)[: starts // 2]  # [S/2, B]
        kept = (kept * B + every).flatten()
        which, theta, scatter = which[kept], theta[kept], scatter[kept]
    theta, scatter, residual, loss, converged = _descend(problem[which], theta, scatter, _ROUNDS, tolerance)
    loss = loss.view(-1, B)
    least, best = loss.min(0)
    chosen = best * B + every
    agreement = (loss <= least + 1e-4).double().mean(0)
    return theta[chosen], scatter[chosen], residual[chosen], least, agreement, converged[chosen]


def _starts(problem: Problem, starts: int) -> Tensor:
    """Starts [S, B, K]: two nodes of (μ, ε) with the initial parameters of the effects, then with others in reach."""
    few, low, high, start = problem.thinned(300), problem.low, problem.high, problem.start
    nodes = torch.linspace(0, 1, 15, dtype=torch.float64)[1:-1] ** torch.tensor([[2.0], [1.0]])  # denser at small μ
    nodes = nodes.to(low)
    grid = torch.cartesian_prod(*(low[:2, None] + nodes * (high - low)[:2, None]))
    theta = torch.cat((grid, start[2:].expand(len(grid), -1)), -1)
    residual = few.residual(theta[:, None, None, :])  # [G, B, n, D]
    cost = (
        (residual / residual.abs().median(0).values.median(-2, keepdim=True).values.clamp_min(1e-12))
        .norm(dim=-1)
        .mean(-1)
    )
    best = cost.argmin(0)
    far = (grid[:, None] - grid[best]).abs().amax(-1) > 0.2 * (high - low)[:2].amax()
    second = torch.where(far, cost, torch.inf).argmin(0)
    B, K = cost.shape[1], len(low)
    points = start.expand(starts, B, K).clone()
    points[..., :2] = grid[torch.stack((best, second))[torch.arange(starts, device=grid.device) % 2]]
    if K > 2 and starts > 2:
        sobol = torch.quasirandom.SobolEngine(K - 2, scramble=True, seed=0).draw(starts - 2, dtype=torch.float64)
        points[2:, :, 2:] = start[2:] + (sobol.to(start)[:, None] - 0.5) * problem.reach[2:]
    return points.clamp(low, high)


def _descend(
    problem: Problem, theta: Tensor, scatter: Tensor | None, rounds: int, tolerance: float
) -> tuple[Tensor, ...]:
    """Take rounds of damped steps, and return (θ, Σ, residual, loss, converged); converged problems drop out.

    A step that brings less than the tolerance ends a problem if it promised no more; otherwise two such steps do.
    """
    residual, slope = problem.linearised(theta)
    if scatter is None:
        size = residual.square().median(-2).values
        scatter = torch.diag_embed(torch.where(size.isfinite(), size, 1.0) + 1e-12)
    active, damping = torch.arange(len(theta), device=theta.device), theta.new_full(theta.shape[:1], 1e-3)
    dampings, calm, converged = _DAMPING.to(theta), torch.zeros_like(active), torch.zeros_like(active).bool()
    result = [x.clone() for x in (theta, scatter, residual, torch.full_like(damping, torch.inf), converged)]
    for _ in range(rounds):
        scatter = _scattered(problem, residual, scatter, 3)
        loss = _loss(residual, scatter)
        step, promised = _steps(residual, slope, scatter, theta, problem, damping)  # [C, B, K], [B]
        tried = (theta + step).clamp(problem.low, problem.high)
        residuals = problem.residual(tried[..., None, :])
        new, pick = _loss(residuals, scatter).min(0)
        better = new < loss
        theta = torch.where(better[:, None], _picked(tried, pick), theta)
        best = residuals[pick, torch.arange(len(pick), device=pick.device)]
        residual = torch.where(better[:, None, None], best, residual)
        damping = damping * torch.where(better, dampings[pick], 100.0)
        calm = torch.where(loss - new.minimum(loss) < tolerance, calm + 1 + (promised < tolerance), 0)
        done = (calm >= 2) | (damping > 1e10)
        for whole, part in zip(result, (theta, scatter, residual, new.minimum(loss), done), strict=True):
            whole[active] = part
        if done.all():
            break
        if done.any():
            going = (~done).nonzero()[:, 0]
            problem, active, better, slope = problem[going], active[going], better[going], slope[going]
            theta, scatter, residual, damping, calm = (x[going] for x in (theta, scatter, residual, damping, calm))
        if better.any():
            residual, slope = problem.linearised(theta)
    result[1][active] = _scattered(problem, residual, scatter, 20)
    result[3][active] = _loss(residual, result[1][active])
    return tuple(result)


def _steps(
    residual: Tensor, slope: Tensor, scatter: Tensor, theta: Tensor, problem: Problem, damping: Tensor
) -> tuple[Tensor, Tensor]:
    """Steps [3, B, K], and the decrease [B] of the loss that the first promises.

    That is Newton's with a tenth of the damping; the others are Gauss–Newton steps, which are shorter, with a tenth and
    ten times the damping.  A parameter that would cross its bound is held there.
    """
    width = problem.high - problem.low
    gradient, curvature, _, each = _normal(residual, slope * width, scatter)
    components = residual.shape[-1]
    newton = _observed(curvature, each, _weight(mahalanobis(residual, scatter), components), components)
    held = ((theta <= problem.low) & (gradient > 0)) | ((theta >= problem.high) & (gradient < 0))
    curvature = torch.stack((newton, curvature, curvature)).masked_fill(held[:, :, None] | held[:, None, :], 0.0)
    dampings = (_DAMPING.to(damping)[:, None] * damping)[..., None] * curvature.diagonal(dim1=-2, dim2=-1)
    damped = curvature + torch.diag_embed(dampings + torch.where(held, 1.0, 1e-8))
    gradient = gradient.masked_fill(held, 0.0)
    step = -torch.linalg.solve(damped, gradient[..., None])[..., 0]
    return width * step, -0.5 * (gradient * step[0]).sum(-1)


def _observed(curvature: Tensor, each: Tensor, weight: Tensor, components: int) -> Tensor:
    """Curvature [B, K, K] with what the weights change, or the Gauss–Newton one where that is not positive definite."""
    flat = each * (2 * weight.square() / (_NU + components))[..., None]
    observed = curvature - each.mT @ flat / each.shape[1]
    factor, failed = torch.linalg.cholesky_ex(observed - 1e-3 * curvature)
    definite = (failed == 0) & factor.isfinite().all(-1).all(-1)
    return torch.where(definite[:, None, None], observed, curvature)


def whitened(residual: Tensor, slope: Tensor, scatter: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Whiten residual [B, n, D] and slope [B, n, D, K] by the scatter [B, D, D]; return the weights [B, n] as well."""
    factor = torch.linalg.cholesky(scatter)[:, None]
    residual = torch.linalg.solve_triangular(factor, residual[..., None], upper=False)[..., 0]
    slope = torch.linalg.solve_triangular(factor, slope, upper=False)
    return residual, slope, _weight(residual.square().sum(-1), residual.shape[-1])


def robust_distance(residual: Tensor, scatter: Tensor) -> Tensor:
    """Compute a trial's term of the loss for a given scatter, ½ (ν + D) log(1 + d²/ν) [..., n] in nats."""
    return (0.5 * (_NU + residual.shape[-1])) * torch.log1p(mahalanobis(residual, scatter) / _NU)


def _normal(residual: Tensor, slope: Tensor, scatter: Tensor) -> tuple[Tensor, ...]:
    """Gradient [B, K] and Gauss–Newton curvature [B, K, K] of the loss, the whitened slope and gradients by trial."""
    residual, slope, weight = whitened(residual, slope, scatter)
    each = (slope * residual[..., None]).sum(-2)  # Jᵀ e
    gradient = (weight[..., None] * each).mean(-2)
    flat = (weight.sqrt()[..., None, None] * slope).flatten(1, 2)
    return gradient, flat.mT @ flat / residual.shape[1], slope, each


def _picked(x: Tensor, which: Tensor) -> Tensor:
    """x[which[b], b] of x [C, B, K]."""
    return x.gather(0, which[None, :, None].expand(1, *x.shape[1:]))[0]


def trial_weights(residual: Tensor, scatter: Tensor) -> Tensor:
    """Compute the weights [B, n] of the trials, near 0 for gross outliers and 1 for those that are fitted exactly."""
    return _NU / (_NU + mahalanobis(residual.nan_to_num(0.0, 0.0, 0.0), scatter))


def uncertainty(problem: Problem, theta: Tensor, scatter: Tensor) -> tuple[Tensor, Tensor]:
    """Estimate the covariance of the parameters.

    The variance in each direction is the larger of two estimates.  The sandwich allows for trials of unequal noise; the
    curvature, with the weighted variance of the residual, is not reduced by a trial that a kink of the model happens to
    fit exactly.

    Returns:
        Covariance [B, K, K], and the effective number of trials [B, K] that inform each parameter.
    """
    residual, slope = problem.linearised(theta)
    width = problem.high - problem.low
    slope = slope * width  # parameters in units of their ranges from here on
    residual, slope = (x.nan_to_num(0.0, 0.0, 0.0) for x in (residual, slope))  # then the loss is infinite
    distance, (n, D), K = mahalanobis(residual, scatter), residual.shape[1:], theta.shape[-1]
    _, curvature, slope, each = _normal(residual, slope, scatter)
    weight = _weight(distance, D)
    observed = _observed(curvature, each, weight, D)
    (values, vectors), (stretch, turn) = (torch.linalg.eigh(A) for A in (observed, curvature))
    # A parameter that nothing depends on gets a standard error of a hundred times its range.
    information, plain = (n * x.clamp_min(0) + 1e-4 for x in (values, stretch))
    inverse = (vectors / information[:, None]) @ vectors.mT
    leverage = torch.einsum("bnik,bkl,bnil->bn", slope, inverse, slope) * weight / D
    scores = (weight / (1 - leverage.clamp(0, 0.9)))[..., None] * each
    sandwich = inverse @ (scores.mT @ scores) @ inverse
    spread = (weight.square() * distance).sum(-1) / D / weight.sum(-1)  # weighted variance of the whitened residual
    spread = spread.clamp_min(1e-30)  # exact data have none
    free = D * n - K - D * (D + 1) // 2  # degrees of freedom: residuals less the parameters and the scatter
    small = D * n / max(free, 1)
    # The larger variance in every direction.
    scale = (spread[:, None] / plain).sqrt()  # standard errors by the curvature, along its axes
    along = turn.mT @ sandwich @ turn / (scale[:, :, None] * scale[:, None, :])
    values, vectors = torch.linalg.eigh(along)
    root = width[:, None] * (turn * scale[:, None] @ vectors) * values.clamp_min(1).sqrt()[:, None]
    covariance = small * root @ root.mT
    # Information of each trial on each parameter, the others being free.
    information = weight[..., None] * (slope @ inverse[:, None]).square().sum(-2)
    trials = information.sum(1).square() / information.square().sum(1).clamp_min(1e-300)
    return covariance, trials


def _scattered(problem: Problem, residual: Tensor, scatter: Tensor, steps: int) -> Tensor:
    """Update the scatter [..., B, D, D] by steps of expectation–maximisation."""
    for _ in range(steps):
        weighted = _weight(mahalanobis(residual, scatter), residual.shape[-1])[..., None] * residual
        scatter = (residual.mT @ weighted) / residual.shape[-2]
        if problem.scaled:
            scatter = scatter.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None] * torch.eye(residual.shape[-1]).to(
                residual
            )
        # A component that is fitted exactly keeps a little scatter, so that nothing is divided by 0.
        scatter = scatter + 1e-12 * torch.diag_embed(residual.square().mean(-2) + 1e-12)
    return scatter
