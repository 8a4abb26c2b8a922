"""Exact Gaussian processes with ARD squared-exponential kernels, many at once, on GPyTorch.

The module is a `gpytorch.models.ExactGP` with a batch of `ScaleKernel(RBFKernel)` and a Gaussian
likelihood: its state dict, its kernels and its predictions are GPyTorch's.  Only the hyperparameters
are found in our own way, by `fit`: all processes of the batch in lock step, with the closed-form
gradient of `evidence`, from two starts, since the likelihood has several optima.
"""

import math
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import gpytorch
import torch
from gpytorch.constraints import Positive
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from jaxtyping import Bool, Float, Int
from linear_operator.operators import DiagLinearOperator
from threadpoolctl import ThreadpoolController
from torch import Tensor

from contactlearn.models.gp.bfgs import Minimum, minimise
from contactlearn.models.gp.evidence import LogEvidence

Inputs = Float[Tensor, "*batch n d"]
Outputs = Float[Tensor, "*batch o n"]
# Of standardised data: length scales, output scale and noise variance.
LENGTH, SCALE, NOISE = (0.05, 1e3), (1e-3, 1e3), (1e-6, 10.0)
STARTS = (0.5, 2.5)  # log length scale; each finds optima that the other misses
_TOLERANCE = 3e-5  # nats a point


@cache
def _blas() -> ThreadpoolController:
    """Control of the threads of every BLAS, with SciPy's, which is loaded for it."""
    import_module("scipy.linalg")
    return ThreadpoolController()


class Fit(NamedTuple):
    """Result of the search for the hyperparameters."""

    loss: Float[Tensor, "*batch o"]  # −log marginal likelihood (and prior) per point in nats
    converged: Bool[Tensor, "*batch o"]
    evaluations: Int[Tensor, "*batch o"]  # over all starts
    history: Float[Tensor, "rounds *batch o"]  # the loss of the better start after each round


OnRound = Callable[[Fit], None]
"""Receives a fit after each of its rounds; the processes then have the hyperparameters of that round."""


class WeightedNoise(GaussianLikelihood):
    """Gaussian noise of variance σ²/w² on the training points [..., n], and σ² on any other number of points."""

    def __init__(self, batch: torch.Size, weight: Float[Tensor, "*batch n"] | None) -> None:
        super().__init__(batch_shape=batch, noise_constraint=Positive())
        self.register_buffer("weight", weight)

    def variance(self) -> Float[Tensor, "*batch points"]:
        """Noise variance of the training points, [..., n] or [..., 1]."""
        return self.noise if self.weight is None else self.noise / self.weight.square()

    def _shaped_noise_covar(self, base_shape: torch.Size, *inputs: Any, **kwargs: Any) -> DiagLinearOperator:
        training = self.weight is None or base_shape[-1:] == self.weight.shape[-1:]
        return DiagLinearOperator((self.variance() if training else self.noise).expand(base_shape))


class ExactGPs(gpytorch.models.ExactGP):
    """Independent processes for each subset of trials (leading axes) and each of O outputs.

    Args:
        x: standardised inputs [..., n, D].
        y: standardised outputs [..., O, n].
        weight: w [..., O, n]; the noise variance of a point is σ²/w².  1 if left out.
    """

    def __init__(self, x: Inputs, y: Outputs, weight: Outputs | None = None) -> None:
        batch = y.shape[:-1]
        super().__init__(_for_each_output(x, batch), y, WeightedNoise(batch, weight))
        self.covar_module = ScaleKernel(RBFKernel(ard_num_dims=x.shape[-1], batch_shape=batch), batch_shape=batch)
        self.to(y)

    def forward(self, x: Tensor) -> MultivariateNormal:
        """Prior of the processes at x [..., O, N, D]."""
        return MultivariateNormal(x.new_zeros(x.shape[:-1]), self.covar_module(x))

    def fit(self, like: "ExactGPs | None" = None, *, prior: bool = True, on_round: OnRound | None = None) -> Fit:
        """Find the hyperparameters of all processes: the better of two optima each.

        Args:
            like: begin where this one ended instead, once.
            prior: weigh the likelihood with `log_prior`.
            on_round: see `OnRound`.
        """
        (x,), y, weight = self.train_inputs, self.train_targets, self.likelihood.weight
        flat_x, flat_y = (part.reshape(-1, *part.shape[y.ndim - 1 :]) for part in (x, y))
        evidence = LogEvidence(flat_x, flat_y, None if weight is None else weight.reshape(flat_y.shape))
        B, D = y.shape[:-1].numel(), x.shape[-1]
        bounds = torch.tensor([LENGTH] * D + [SCALE, NOISE], dtype=y.dtype, device=y.device).log()
        if like is None:
            starts = torch.tensor([[start] * D + [0.0, -2.0] for start in STARTS]).to(y).repeat_interleave(B, 0)
        else:
            starts = like.hyperparameters().flatten(0, -2).log()
        mean, precision = log_prior(D).to(y) if prior else y.new_zeros(2, D + 2)
        precision = precision / x.shape[-2]  # per point, as the evidence is

        def objective(phi: Tensor, which: Tensor, curvature: bool) -> tuple[Tensor, Tensor, Tensor | None]:
            value, gradient, information = evidence(phi, which % B, curvature)
            away = precision * (phi - mean)
            value, gradient = value + 0.5 * (away * (phi - mean)).sum(-1), gradient + away
            return value, gradient, None if information is None else information + precision.diag()

        told = None if on_round is None else lambda now: on_round(self._take(now))
        with _blas().limit(limits=1):  # matrices this small gain nothing from threads, which spin against each other
            found = minimise(objective, starts, *bounds.T, tolerance=_TOLERANCE, starts=len(starts) // B, on_round=told)
        return self._take(found)

    def _take(self, found: Minimum) -> Fit:
        """Set the hyperparameters to those of each process's better start."""
        y = self.train_targets
        B, D = y.shape[:-1].numel(), self.train_inputs[0].shape[-1]
        value, x, converged, evaluations = (
            part.unflatten(0, (-1, B)) for part in (found.value, found.x, found.converged, found.evaluations)
        )
        best = value.nan_to_num(torch.inf).argmin(0)
        each = torch.arange(B, device=best.device)
        value, x, converged = (part[best, each] for part in (value, x, converged))
        theta = x.exp().unflatten(0, y.shape[:-1])
        self.covar_module.base_kernel.lengthscale = theta[..., None, :D]
        self.covar_module.outputscale = theta[..., D]
        self.likelihood.noise = theta[..., D + 1 :]
        self.eval()
        history = found.history.unflatten(1, (-1, B))[:, best, each].unflatten(1, y.shape[:-1])
        value, converged, evaluations = (
            part.unflatten(0, y.shape[:-1]) for part in (value, converged, evaluations.sum(0))
        )
        return Fit(value, converged, evaluations, history)

    @torch.no_grad()
    def hyperparameters(self) -> Float[Tensor, "*batch o p"]:
        """(ℓ_1 … ℓ_D, s², σ²) of each process, [..., O, D + 2], of standardised data."""
        lengths = self.covar_module.base_kernel.lengthscale[..., 0, :]
        return torch.cat((lengths, self.covar_module.outputscale[..., None], self.likelihood.noise), -1)

    @torch.no_grad()
    def predict(self, x: Float[Tensor, "*batch n d"]) -> tuple[Float[Tensor, "*more o n"], Float[Tensor, "*more o n"]]:
        """Mean and variance [..., O, N] of the noise-free functions at standardised x [..., N, D].

        What GPyTorch's own posterior gives in exact arithmetic, in a tenth of the time.
        """
        cross = self._cross(x)
        half = torch.linalg.solve_triangular(self._cholesky(), cross.mT, upper=False)
        rest = torch.linalg.solve_triangular(self._cholesky(), self.train_targets[..., None], upper=False)
        return (half.mT @ rest)[..., 0], (self.covar_module.outputscale[..., None] - half.square().sum(-2)).clamp_min(0)

    @torch.no_grad()
    def mean(self, x: Float[Tensor, "*batch n d"]) -> Float[Tensor, "*more o n"]:
        """Mean [..., O, N] alone, at standardised x [..., N, D], for a fraction of the time."""
        weights = torch.cholesky_solve(self.train_targets[..., None], self._cholesky())
        return (self._cross(x) @ weights)[..., 0]

    @torch.no_grad()
    def leave_one_out(self) -> tuple[Float[Tensor, "*batch o n"], Float[Tensor, "*batch o n"]]:
        """Error y − ŷ of each training point if it were left out, and the variance of ŷ, [..., O, n] each.

        Closed form, Rasmussen & Williams (2006), Eq. (5.12); the hyperparameters are not found again.
        """
        inverse = torch.cholesky_inverse(self._cholesky())
        variance = 1 / inverse.diagonal(dim1=-2, dim2=-1)
        error = (inverse @ self.train_targets[..., None])[..., 0] * variance
        return error, (variance - self.likelihood.variance()).clamp_min(0)

    def _cross(self, x: Tensor) -> Tensor:
        """Covariance [..., O, N, n] between standardised x [..., N, D] and the training inputs."""
        return self.covar_module(_for_each_output(x, self.train_targets.shape[:-1]), *self.train_inputs).to_dense()

    def _cholesky(self) -> Tensor:
        """Factor of the training covariance with noise, [..., O, n, n]."""
        K = self.covar_module(*self.train_inputs).to_dense()
        return torch.linalg.cholesky(K + torch.diag_embed(self.likelihood.variance().expand(K.shape[:-1])))


def log_prior(D: int) -> Float[Tensor, "2 {D+2}"]:
    """Mean and precision [2, D + 2] of the Gaussian prior of log (ℓ_1 … ℓ_D, s², σ²), of standardised data.

    Weak beside a hundred points, but ten points fit seven hyperparameters too well without it.  Typical
    distances, and so length scales, grow with √D (Hvarfner, Hellsten & Nardi 2024).
    """
    length = [1 + math.log(D) / 2] * D
    spread = torch.tensor([1.0] * D + [1.0, 2.0])
    return torch.stack((torch.tensor([*length, 0.0, -3.0]), spread**-2))


def _for_each_output(x: Tensor, batch: torch.Size) -> Tensor:
    """x [..., N, D] as [..., O, N, D]; leading axes may be missing."""
    return x.unsqueeze(-3).expand(*batch, *x.shape[-2:])
