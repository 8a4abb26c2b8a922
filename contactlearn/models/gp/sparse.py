"""Sparse Gaussian processes, for more trials than exact ones can afford: M inducing points z carry the function.

    y = f(x) + e,   Q = K_xz K_zz⁻¹ K_zx,   Λ = diag(σ² / w_i²)
    log p(y) ≥ log N(y; 0, Q + Λ) − ½ tr(Λ⁻¹ (K_xx − Q))

The module is a `gpytorch.models.ExactGP` with an `InducingPointKernel`, whose marginal likelihood is this
collapsed bound of Titsias (2009).  The best q(u) is in it already, so only D + 2 hyperparameters are left,
and the minimiser of the exact processes finds them in about ten evaluations of O(n M²).  A stochastic
variational process (`ApproximateGP`) must find q(u) too, by many small noisy steps: on 4000 synthetic drops
it was still 0.2 nats a point worse after thirty times as long.

The inducing points are training points, chosen once: the next is where f is least certain given the last,
with the hyperparameters of an exact process on a few trials (Burt, Rasmussen & van der Wilk 2020).  Moving
them by gradient gained at most 0.002 nats a point for five times the work.  Data almost without noise need
more of them: there the bound explains as noise what 200 cannot follow.

The points enter the bound by two sums alone, A Λ⁻¹ Aᵀ and A Λ⁻¹ y with Q = Aᵀ A, which are taken over blocks of
points, so that no matrix of M rows and n columns is ever in memory.  Of more than 20 000 points a random sample
gives the inducing points, and where the search over all of them begins.
"""

import math
from collections.abc import Callable, Iterator

import gpytorch
import torch
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import InducingPointKernel, RBFKernel, ScaleKernel
from jaxtyping import Float
from torch import Tensor
from torch.linalg import cholesky_ex, solve_triangular

from contactlearn.models.gp.bfgs import Minimum, minimise
from contactlearn.models.gp.evidence import LogEvidence
from contactlearn.models.gp.exact import LENGTH, NOISE, SCALE, ExactGPs, Fit, Inputs, OnRound, Outputs, WeightedNoise

INDUCING = 200
"""Inducing points M of a process; all training points where these are fewer."""

_FEW = 500  # random training points, on which exact processes find where the search begins
_SAMPLE = 20_000  # random training points, of which the inducing points are, and on which the search begins
_BLOCK = 1 << 14  # points whose features are in memory at a time
_JITTER = 1e-10  # relative, on the diagonal of K_zz: long length scales leave it singular to rounding
_TOLERANCE = 3e-5  # nats a point


class SparseGPs(gpytorch.models.ExactGP):
    """`ExactGPs` of many points, approximated by M inducing points; the arguments are the same."""

    def __init__(self, x: Inputs, y: Outputs, weight: Outputs | None = None) -> None:
        batch, x = y.shape[:-1], x.unsqueeze(-3).expand(*y.shape, x.shape[-1])
        super().__init__(x, y, WeightedNoise(batch, weight))
        kernel = ScaleKernel(RBFKernel(ard_num_dims=x.shape[-1], batch_shape=batch), batch_shape=batch)
        self.covar_module = InducingPointKernel(kernel, x[..., :INDUCING, :].clone(), self.likelihood)
        self.covar_module.inducing_points.requires_grad_(False)
        self._known: tuple[Tensor, Tensor, Tensor, Tensor] | None = None
        self.to(y)

    def forward(self, x: Tensor) -> MultivariateNormal:
        """Prior of the processes at x [..., O, N, D], with covariance Q."""
        return MultivariateNormal(x.new_zeros(x.shape[:-1]), self.covar_module(x))

    def fit(self, like: "ExactGPs | SparseGPs | None" = None, *, on_round: OnRound | None = None) -> Fit:
        """Choose the inducing points and maximise the bound; the loss is −bound per point.

        Args:
            like: begin with its hyperparameters, not with those of a few trials.
            on_round: see `OnRound`; of the rounds over all trials.
        """
        (x,), y, weight = self.train_inputs, self.train_targets, self.likelihood.weight
        batch, weight = y.shape[:-1], torch.ones_like(y) if weight is None else weight
        x, y, weight = x.reshape(-1, *x.shape[-2:]), y.flatten(0, -2), weight.flatten(0, -2)
        few = torch.randperm(y.shape[-1], generator=torch.Generator().manual_seed(0))[:_FEW].to(y.device)
        if like is None:
            first = ExactGPs(x[:, few], y[:, None, few], weight[:, None, few])
            first.fit(prior=False)
            like = first
        start = like.hyperparameters().reshape(len(y), -1)
        some = _sample(y)
        z = torch.stack([_spread(*process) for process in zip(x[:, some], weight[:, some], start, strict=True)])
        if len(some) < y.shape[-1]:
            first = torch.arange(_FEW).to(some)
            start = _maximise(start.log(), first, z, x[:, some], y[:, some], weight[:, some]).x.exp()
        self.covar_module.inducing_points.data = z.unflatten(0, batch)
        told = None if on_round is None else lambda now: on_round(self._take(now))
        return self._take(_maximise(start.log(), few, z, x, y, weight, on_round=told))

    def _take(self, found: Minimum) -> Fit:
        """Set the hyperparameters."""
        batch = self.train_targets.shape[:-1]
        kernel, theta = self.covar_module.base_kernel, found.x.exp().unflatten(0, batch)
        kernel.base_kernel.lengthscale, kernel.outputscale = theta[..., None, :-2], theta[..., -2]
        self.likelihood.noise = theta[..., -1:]
        self.eval()
        value, converged, evaluations = (
            part.unflatten(0, batch) for part in (found.value, found.converged, found.evaluations)
        )
        return Fit(value, converged, evaluations, found.history.unflatten(1, batch))

    @torch.no_grad()
    def hyperparameters(self) -> Float[Tensor, "*batch o p"]:
        """(ℓ_1 … ℓ_D, s², σ²) of each process, [..., O, D + 2], of standardised data."""
        kernel, noise = self.covar_module.base_kernel, self.likelihood.noise
        return torch.cat((kernel.base_kernel.lengthscale[..., 0, :], kernel.outputscale[..., None], noise), -1)

    @torch.no_grad()
    def predict(self, x: Float[Tensor, "*batch n d"]) -> tuple[Float[Tensor, "*more o n"], Float[Tensor, "*more o n"]]:
        """Mean and variance [..., O, N] of the noise-free functions at standardised x [..., N, D].

        Titsias (2009), Eq. (6).  GPyTorch's own posterior is FITC's unless `sgpr_diagonal_correction` is off.
        """
        mean, inside, outside = self._posterior(x.unsqueeze(-3))
        return mean, inside + outside

    @torch.no_grad()
    def leave_one_out(self) -> tuple[Float[Tensor, "*batch o n"], Float[Tensor, "*batch o n"]]:
        """Error y − ŷ of each training point if it were left out, and the variance of ŷ, [..., O, n] each.

        Rasmussen & Williams (2006), Eq. (5.12), of the covariance Q + Λ: 1 / [(Q + Λ)⁻¹]_ii is λ_i / (1 − h_i)
        with the leverage h_i.  Neither the hyperparameters nor the inducing points are found again.
        """
        (x,) = self.train_inputs
        mean, inside, outside = self._posterior(x)
        rest = 1 - inside / self.likelihood.variance()
        return (self.train_targets - mean) / rest, inside / rest + outside

    def _posterior(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Mean of f at x [..., N, D], and its variance inside and outside the span of the inducing points."""
        root, target = self._conditioned()
        theta, z = self.hyperparameters(), self.covar_module.inducing_points
        factor = _factor(z, theta)
        blocks = []
        for part in x.split(_BLOCK, -2):
            features = solve_triangular(factor, _kernel(z, part, theta), upper=False)
            half = solve_triangular(root, features, upper=False)
            outside = (theta[..., -2, None] - features.square().sum(-2)).clamp_min(0)
            blocks.append(((half.mT @ target[..., None])[..., 0], half.square().sum(-2), outside))
        mean, inside, outside = (torch.cat(parts, -1) for parts in zip(*blocks, strict=True))
        return mean, inside, outside

    def _conditioned(self) -> tuple[Tensor, Tensor]:
        """R and R⁻¹ Σ aᵢyᵢ/λᵢ of `_condition`, kept until the hyperparameters or the inducing points change."""
        theta, z = self.hyperparameters(), self.covar_module.inducing_points.detach()
        known = self._known
        if known is None or known[0].device != theta.device or not (known[0].equal(theta) and known[1].equal(z)):
            (x,), y = self.train_inputs, self.train_targets
            variance = self.likelihood.variance().expand(y.shape)
            known = self._known = theta, z.clone(), *_condition(*_sums(x, y, variance, z, theta))
        return known[2:]


def _spread(x: Tensor, weight: Tensor, theta: Tensor) -> Tensor:
    """Inducing points [M, D] out of x [n, D]: pivots of a Cholesky factorisation of w_i w_j K_ij."""
    left, rows = theta[-2].repeat(len(x)), []
    factor = x.new_zeros(min(INDUCING, len(x)), len(x))
    for m in range(len(factor)):
        rows.append(row := int((weight.square() * left).argmax()))
        column = _kernel(x[row, None], x, theta)[0] - factor[:m, row] @ factor[:m]
        factor[m] = column / left[row].clamp_min(_JITTER * theta[-2]).sqrt()
        left = (left - factor[m].square()).clamp_min(0)
        left[rows] = -1  # none twice, even where nothing is left
    return x[rows]


def _kernel(a: Tensor, b: Tensor, theta: Tensor) -> Tensor:
    """Covariance [..., A, B] of f at a [..., A, D] and b [..., B, D]."""
    a, b = (x / theta[..., None, :-2] for x in (a, b))
    half = 0.5 * (a.square().sum(-1)[..., None] + b.square().sum(-1)[..., None, :])
    return theta[..., -2, None, None] * (a @ b.mT - half).exp()


def _factor(z: Tensor, theta: Tensor) -> Tensor:
    """L [..., M, M] with K_zz = L Lᵀ; nan where there is none."""
    L, info = cholesky_ex(_kernel(z, z, theta) * (1 + _JITTER * torch.eye(z.shape[-2]).to(z)))
    return L.masked_fill(info[..., None, None] > 0, torch.nan)


def _project(x: Tensor, z: Tensor, theta: Tensor) -> Tensor:
    """A = L⁻¹ K_zx [..., M, n], so that Q = Aᵀ A."""
    return solve_triangular(_factor(z, theta), _kernel(z, x, theta), upper=False)


def _sums(x: Tensor, y: Tensor, noise: Tensor, z: Tensor, theta: Tensor) -> tuple[Tensor, Tensor]:
    """A Λ⁻¹ Aᵀ [..., M, M] and A Λ⁻¹ y [..., M], summed over blocks of points; `noise` [..., n] is that of Λ."""
    outer, product = 0.0, 0.0
    for points, values, variance in _blocks(x, y, noise):
        A, values = _project(points, z, theta) / variance.sqrt()[..., None, :], values / variance.sqrt()
        outer, product = outer + A @ A.mT, product + (A @ values[..., None])[..., 0]
    return torch.as_tensor(outer), torch.as_tensor(product)


def _blocks(x: Tensor, *values: Tensor) -> Iterator[tuple[Tensor, ...]]:
    """Blocks of points x [..., n, D] with their values [..., n]."""
    return zip(x.split(_BLOCK, -2), *(part.split(_BLOCK, -1) for part in values), strict=True)


def _condition(outer: Tensor, product: Tensor) -> tuple[Tensor, Tensor]:
    """R [..., M, M] with R Rᵀ = 1 + A Λ⁻¹ Aᵀ, and R⁻¹ A Λ⁻¹ y [..., M]."""
    root = cholesky_ex(torch.eye(outer.shape[-1]).to(outer) + outer).L
    return root, solve_triangular(root, product[..., None], upper=False)[..., 0]


def _negative_bound(
    phi: Tensor, at: Tensor, z: Tensor, outer: Tensor, product: Tensor, y: Tensor, weight: Tensor
) -> Tensor:
    """−bound of one process per point in nats, from the sums of `_sums` at hyperparameters `at`.

    phi [D + 2] is the logarithm of its hyperparameters.  The value is right at phi = at; the derivative there is that
    through K_zz, s² and σ², where they stand alone and in the sums, but not through the length scales in K_zx.
    """
    scale, noise = (phi - at)[-2:].exp()
    turned = solve_triangular(_factor(z, phi.exp()), _factor(z, at.exp()), upper=False)  # 1, but for its derivative
    outer = scale.square() / noise * turned @ outer @ turned.mT
    product = scale / noise * turned @ product
    root, target = _condition(outer, product)
    squares, weights = (weight * y).square().sum(), weight.square().sum()
    own = (squares + phi[-2].exp() * weights) / phi[-1].exp() - outer.trace()
    own = own + len(y) * (math.log(2 * math.pi) + phi[-1]) - 2 * weight.log().sum()
    return (0.5 * (own - target.square().sum()) + root.diagonal().log().sum()) / len(y)


def _loss_and_gradient(phi: Tensor, z: Tensor, x: Tensor, y: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """−bound of one process per point in nats, and its derivative in phi [D + 2], its hyperparameters' logarithm.

    There are two passes over the points: one for the sums, one for the length scales.
    """
    theta, noise = phi.exp(), phi[-1].exp() / weight.square()
    free = [part.detach().requires_grad_() for part in (phi, *_sums(x, y, noise, z, theta))]
    with torch.enable_grad():
        loss = _negative_bound(free[0], phi, z, free[1], free[2], y, weight)
        gradient, by_outer, by_product = torch.autograd.grad(loss, free)
    L = _factor(z, theta)
    left = solve_triangular(L.mT, by_outer + by_outer.mT, upper=True)
    H = solve_triangular(L, left, upper=False, left=False)  # by K_zx Λ⁻¹ K_xz
    h = solve_triangular(L.mT, by_product[:, None], upper=True)
    for points, values, variance in _blocks(x, y, noise):
        K = _kernel(z, points, theta)
        W = (H @ K).addmm_(h, values[None]).mul_(K).div_(variance)
        squared = W.sum(1) @ z.square() - 2 * (z * (W @ points)).sum(0) + W.sum(0) @ points.square()
        gradient[:-2] += squared / theta[:-2].square()
    return loss.detach(), gradient


def _sample(y: Tensor) -> Tensor:
    """Points that stand for all: all of them, in order, or a random sample."""
    n = y.shape[-1]
    every = torch.arange(n) if n <= _SAMPLE else torch.randperm(n, generator=torch.Generator().manual_seed(0))
    return every[:_SAMPLE].to(y.device)


def _maximise(start: Tensor, few: Tensor, *data: Tensor, on_round: Callable[[Minimum], None] | None = None) -> Minimum:
    """log hyperparameters [B, D + 2] that minimise −bound of data (z, x, y, w) of B processes.

    The evidence of the points `few` gives the first curvature.
    """
    evidence = LogEvidence(*(part[:, few] for part in data[1:]))
    curvature = [evidence(start, torch.arange(len(start), device=start.device), True)[2]]

    def objective(phi: Tensor, which: Tensor, _: bool) -> tuple[Tensor, Tensor, Tensor | None]:
        found = [_loss_and_gradient(p, *(part[i] for part in data)) for p, i in zip(phi, which, strict=True)]
        value, gradient = map(torch.stack, zip(*found, strict=True))
        return value, gradient, curvature.pop() if curvature else None  # the updates know more after one round

    bounds = torch.tensor([LENGTH] * (start.shape[1] - 2) + [SCALE, NOISE]).to(start).log()
    return minimise(objective, start, *bounds.T, tolerance=_TOLERANCE, on_round=on_round)
