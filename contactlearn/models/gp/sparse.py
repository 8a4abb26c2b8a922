"""Sparse Gaussian processes, for more trials than exact ones can afford: M inducing points z carry the function.

    y = f(x) + e,   Q = K_xz K_zz⁻¹ K_zx,   Λ = diag of the noise variances
    log p(y) ≥ log N(y; 0, Q + Λ) − ½ tr(Λ⁻¹ (K_xx − Q))

The module is a `gpytorch.models.ExactGP` with an `InducingPointKernel` (SGPR), whose marginal likelihood in GPyTorch is
this collapsed bound of Titsias (2009).  The best q(u) is in it already, so only the hyperparameters are left, and
`training` finds them in about ten evaluations of O(n M²).  A stochastic variational process (`ApproximateGP`) must find
q(u) too, by many small noisy steps: on 4000 synthetic drops it was still 0.2 nats a point worse after thirty times as
long.

The inducing points are training points, chosen once: the next is where f is least certain given the last,
with the hyperparameters of an exact process on a few trials (Burt, Rasmussen & van der Wilk 2020).  Moving
them by gradient gained at most 0.002 nats a point for five times the work.  Data almost without noise need
more of them: there the bound explains as noise what 200 cannot follow.

Of more than 10 000 points a random sample gives inducing points and hyperparameters.  The posterior is that of all
points: they enter it by two sums alone, A Λ⁻¹ Aᵀ and A Λ⁻¹ y with Q = Aᵀ A, which are taken over blocks of points, so
that no matrix of M rows and n columns is ever in memory.
"""

from collections.abc import Callable, Iterator
from typing import Any

import torch
from gpytorch.kernels import InducingPointKernel, Kernel
from jaxtyping import Float
from linear_operator.utils.cholesky import psd_safe_cholesky
from torch import Tensor
from torch.linalg import cholesky_ex, solve_triangular

from contactlearn.models.gp.exact import ExactGPs
from contactlearn.models.gp.processes import Fit, GaussianProcesses, OnRound, for_each_output
from contactlearn.models.gp.training import optimise

INDUCING = 200
"""Inducing points M of a process; all training points where these are fewer."""

_EXACT_POINTS = 500  # random training points, on which exact processes find where the search begins
_SAMPLE = 10_000  # random training points, of which the inducing points and the hyperparameters are
_BLOCK = 1 << 14  # points whose features are in memory at a time
_JITTER = 1e-10  # relative, on the diagonal of K_zz: long length scales leave it singular to rounding


class SparseGPs(GaussianProcesses):
    """Processes that see their training points through M inducing points; see `GaussianProcesses`."""

    def __init__(self, *data: Any) -> None:
        super().__init__(*data)
        (x,) = self.train_inputs
        self.covar_module = InducingPointKernel(self.covar_module, x[..., :INDUCING, :].clone(), self.likelihood)
        self.covar_module.inducing_points.requires_grad_(False)
        self._fix()
        self._known: tuple[Tensor, Tensor, Tensor] | None = None

    @property
    def kernel(self) -> Kernel:
        """The kernel of the functions."""
        return self.covar_module.base_kernel

    def fit(self, like: GaussianProcesses | None = None, *, on_round: OnRound | None = None) -> Fit:
        """Choose the inducing points and maximise the bound; the loss is −bound per point, and prior.

        Args:
            like: begin with its hyperparameters, not with those of a few trials.
            on_round: see `OnRound`.
        """
        n = self.train_targets.shape[-1]
        order = torch.randperm(n, generator=torch.Generator().manual_seed(0)).to(self.train_targets.device)
        if like is None:
            like = ExactGPs(*self.data(order[:_EXACT_POINTS]))
            like.fit()
        sample = self if n <= _SAMPLE else SparseGPs(*self.data(order[:_SAMPLE]))
        like.copy_to(sample)
        with torch.no_grad():
            z = _spread(sample.eval())
        self.covar_module.inducing_points.data = sample.covar_module.inducing_points.data = z

        def take(fit: Fit) -> None:
            sample.copy_to(self)
            if on_round is not None:
                on_round(fit)

        fit = optimise(sample, like, take if on_round is not None else None)
        sample.copy_to(self.eval())
        return fit

    def predict(self, x: Float[Tensor, "*batch n d"]) -> tuple[Float[Tensor, "*more o n"], Float[Tensor, "*more o n"]]:
        """Mean and variance [..., O, N] of the noise-free functions at standardised x [..., N, D].

        Titsias (2009), Eq. (6).  GPyTorch's own posterior is FITC's unless `sgpr_diagonal_correction` is off.
        """
        mean, inside, outside = self._posterior(for_each_output(x, self.train_targets.shape[:-1]))
        return mean, inside + outside

    def leave_one_out(self) -> tuple[Float[Tensor, "*batch o n"], Float[Tensor, "*batch o n"]]:
        """Error y − ŷ of each training point if it were left out, and the variance of ŷ, [..., O, n] each.

        Rasmussen & Williams (2006), Eq. (5.12), of the covariance Q + Λ: 1 / [(Q + Λ)⁻¹]_ii is λ_i / (1 − h_i)
        with the leverage h_i.  Neither the hyperparameters nor the inducing points are found again.
        """
        (x,) = self.train_inputs
        mean, inside, outside = self._posterior(x)
        rest = 1 - inside / self.noise_variance()
        return (self.train_targets - mean) / rest, inside / rest + outside

    def _posterior(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Mean of f at x [..., N, D], and its variance inside and outside the span of the inducing points."""
        (root, target), project = self._conditioned(), self._projection()
        blocks = []
        for part in x.split(_BLOCK, -2):
            features = project(part)
            half = solve_triangular(root, features, upper=False)
            outside = (self.kernel(part, diag=True) - features.square().sum(-2)).clamp_min(0)
            mean = self.mean_module(part) + (half.mT @ target[..., None])[..., 0]
            blocks.append((mean, half.square().sum(-2), outside))
        mean, inside, outside = (torch.cat(parts, -1) for parts in zip(*blocks, strict=True))
        return mean, inside, outside

    def _projection(self) -> Callable[[Tensor], Tensor]:
        """x ↦ A = L⁻¹ K_zx [..., M, n] with K_zz = L Lᵀ, so that Q = Aᵀ A."""
        z = self.covar_module.inducing_points.detach()  # in a copy by `deepcopy` GPyTorch lets them vary again
        K = self.kernel(z, z).to_dense()
        L = psd_safe_cholesky(K * (1 + _JITTER * torch.eye(K.shape[-1]).to(K)))
        return lambda x: solve_triangular(L, self.kernel(z, x).to_dense(), upper=False)

    def _conditioned(self) -> tuple[Tensor, Tensor]:
        """R [..., M, M] with R Rᵀ = 1 + A Λ⁻¹ Aᵀ, and R⁻¹ A Λ⁻¹ y [..., M]; kept until a parameter changes."""
        at = torch.cat([part.detach().flatten() for part in self.parameters()])
        known = self._known
        if known is None or known[0].device != at.device or not known[0].equal(at):
            (x,), project = self.train_inputs, self._projection()
            z = self.covar_module.inducing_points
            outer, product = torch.eye(z.shape[-2]).to(z), z.new_zeros(())
            for points, values, variance in _blocks(x, self.centred(), self.noise_variance()):
                A, values = project(points) / variance.sqrt()[..., None, :], values / variance.sqrt()
                outer, product = outer + A @ A.mT, product + A @ values[..., None]
            root = cholesky_ex(outer).L
            known = self._known = at, root, solve_triangular(root, product, upper=False)[..., 0]
        return known[1:]


def _spread(gps: SparseGPs) -> Tensor:
    """Inducing points [..., M, D] out of training points: pivots of a Cholesky factorisation of w_i w_j K_ij."""
    (x,), precision = gps.train_inputs, 1 / gps.noise_variance()
    n = x.shape[-2]
    scale = gps.kernel(x, diag=True)
    left, factor, rows = scale.clone(), x.new_zeros(*x.shape[:-2], min(INDUCING, n), n), []
    for m in range(factor.shape[-2]):
        rows.append(row := (precision * left).argmax(-1, keepdim=True))  # [..., 1]
        point = x.take_along_dim(row[..., None], -2)
        known = factor[..., :m, :]
        column = gps.kernel(point, x).to_dense() - known.take_along_dim(row[..., None], -1).mT @ known
        pivot = left.take_along_dim(row, -1).maximum(_JITTER * scale.take_along_dim(row, -1))
        factor[..., m, :] = column[..., 0, :] / pivot.sqrt()
        left = (left - factor[..., m, :].square()).clamp_min(0)
        left.scatter_(-1, torch.cat(rows, -1), -1)  # none twice, even where nothing is left
    return x.take_along_dim(torch.cat(rows, -1)[..., None], -2)


def _blocks(x: Tensor, *values: Tensor) -> Iterator[tuple[Tensor, ...]]:
    """Blocks of points x [..., n, D] with their values [..., n]."""
    return zip(x.split(_BLOCK, -2), *(part.split(_BLOCK, -1) for part in values), strict=True)
