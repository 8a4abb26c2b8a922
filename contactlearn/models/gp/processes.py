"""Common parts of exact and sparse Gaussian processes: modules, priors and hyperparameters of a batch of them.

The parts are GPyTorch's own: a squared exponential kernel with a length scale for each feature, mean zero and Gaussian
noise, unless `ProcessOptions` name others.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import gpytorch
import torch
from gpytorch.constraints import Interval, Positive
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import Kernel, RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.likelihoods.noise_models import HomoskedasticNoise
from gpytorch.means import ZeroMean
from gpytorch.priors import NormalPrior, Prior
from jaxtyping import Bool, Float, Int
from linear_operator.operators import DiagLinearOperator
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.models.gp.bfgs import Minimum
from contactlearn.models.gp.modules import build
from contactlearn.models.process_options import ProcessOptions

Inputs = Float[Tensor, "*batch n d"]
Outputs = Float[Tensor, "*batch o n"]
# Of standardised data: length scales, output scale and noise variance.
LENGTH, SCALE, NOISE = (0.05, 1e3), (1e-3, 1e3), (1e-6, 10.0)
_FIRST, _LAST = 0.5, 2.5  # log length scales of the starts, evenly between; each finds optima that the others miss
FIRST_NOISE = math.exp(-2)
TOLERANCE = 3e-5  # nats a point


class Fit(NamedTuple):
    """Result of the search for the hyperparameters."""

    loss: Float[Tensor, "*batch o"]  # −log marginal likelihood (and prior) per point in nats
    converged: Bool[Tensor, "*batch o"]
    evaluations: Int[Tensor, "*batch o"]  # over all starts
    history: Float[Tensor, "rounds *batch o"]  # the loss of the best start after each round
    gap: Float[Tensor, "*batch o"] | None = None  # loss that BFGS takes off where an optimiser of PyTorch ended


OnRound = Callable[[Fit], None]
"""Receives a fit after each of its rounds; the processes then have the hyperparameters of that round."""


class WeightedNoise(GaussianLikelihood):
    """Gaussian noise of variance σ²/w² on the training points [..., n], and σ² on any other number of points."""

    def __init__(
        self,
        batch_shape: torch.Size,
        weight: Float[Tensor, "*batch n"] | None,
        noise_prior: Prior | None = None,
        noise_constraint: Interval | None = None,
    ) -> None:
        super().__init__(noise_prior, noise_constraint or Positive(), batch_shape)
        self.register_buffer("weight", weight)

    def _shaped_noise_covar(self, base_shape: torch.Size, *inputs: Any, **kwargs: Any) -> DiagLinearOperator:
        weight = 1.0 if self.weight is None or base_shape[-1] != self.weight.shape[-1] else self.weight
        return DiagLinearOperator((self.noise / weight**2).expand(base_shape))


class GaussianProcesses(gpytorch.models.ExactGP):
    """Independent processes for each subset of trials (leading axes) and each of O outputs.

    Args:
        x: standardised inputs [..., n, D].
        y: standardised outputs [..., O, n].
        weight: w [..., O, n]; the noise variance of a point is σ²/w².  1 if left out.
        options: modules and training, see `ProcessOptions.on`.
        noise: noise variances [..., O, n] of standardised outputs, for a likelihood that has them fixed.

    Raises:
        DataError: a likelihood of fixed noise, and no noise.
    """

    def __init__(
        self,
        x: Inputs,
        y: Outputs,
        weight: Outputs | None = None,
        options: ProcessOptions = ProcessOptions(),
        noise: Outputs | None = None,
    ) -> None:
        parts = {"batch_shape": y.shape[:-1], **dict.fromkeys(("ard_num_dims", "num_dims", "input_size"), x.shape[-1])}
        super().__init__(for_each_output(x, y.shape[:-1]), y, _likelihood(options, parts, weight, noise))
        self.options, self.noise = options, noise
        self.mean_module = ZeroMean() if options.mean is None else build(options.mean, parts)
        self.covar_module = _kernel(options, parts)
        if options.prior:
            _register_priors(self)
        self.to(y)
        self._fix()

    def train(self, mode: bool = True) -> Self:
        """Make the hyperparameters variables while they are trained, and constants of the posterior.

        A prediction then carries derivatives in its inputs alone, and none where no input asks for them.
        """
        for name, parameter in self.named_parameters():
            parameter.requires_grad_(mode and name not in self._fixed)
        return super().train(mode)

    def _fix(self) -> None:
        """Remember which parameters the training leaves as they are."""
        self._fixed = {name for name, parameter in self.named_parameters() if not parameter.requires_grad}

    def forward(self, x: Tensor) -> MultivariateNormal:
        """Prior of the processes at x [..., O, N, D]."""
        return MultivariateNormal(self.mean_module(x), self.covar_module(x))

    @property
    def kernel(self) -> Kernel:
        """The kernel of the functions."""
        return self.covar_module

    @abstractmethod
    def fit(self, like: "GaussianProcesses | None" = None, *, on_round: OnRound | None = None) -> Fit:
        """Find the hyperparameters of all processes.

        Args:
            like: begin where this one ended instead, once.
            on_round: see `OnRound`.
        """

    @abstractmethod
    def predict(self, x: Float[Tensor, "*batch n d"]) -> tuple[Float[Tensor, "*more o n"], Float[Tensor, "*more o n"]]:
        """Mean and variance [..., O, N] of the noise-free functions at standardised x [..., N, D]."""

    @abstractmethod
    def leave_one_out(self) -> tuple[Float[Tensor, "*batch o n"], Float[Tensor, "*batch o n"]]:
        """Error y − ŷ of each training point if it were left out, and the variance of ŷ, [..., O, n] each.

        The hyperparameters are not found again.
        """

    def data(self, points: Tensor | slice = slice(None)) -> tuple[Any, ...]:
        """Arguments that make the same processes of some of the training points."""
        (x,), y, weight = self.train_inputs, self.train_targets, getattr(self.likelihood, "weight", None)
        y, weight, noise = (None if part is None else part[..., points] for part in (y, weight, self.noise))
        return x[..., 0, points, :], y, weight, self.options, noise

    def copies(self, starts: int) -> Self:
        """Return the same processes with an axis of so many starts before the others."""
        x, y, weight, options, noise = self.data()
        x, y = (part.expand(starts, *part.shape) for part in (x, y))
        weight, noise = (None if part is None else part.expand(starts, *part.shape) for part in (weight, noise))
        many = type(self)(x, y, weight, options, noise)
        # the kernel's buffers are its random features
        state, copied = ((*one.parameters(), *one.kernel.buffers()) for one in (self, many))
        for own, every in zip(state, copied, strict=True):
            every.data.copy_(own.data)
        return many

    def copy_to(self, other: "GaussianProcesses") -> None:
        """Give other processes the hyperparameters of these."""
        for own, theirs in zip(self.free_parameters(), other.free_parameters(), strict=True):
            theirs.data.copy_(own.data)

    def free_parameters(self) -> list[torch.nn.Parameter]:
        """Parameters that the training finds."""
        return [parameter for name, parameter in self.named_parameters() if name not in self._fixed]

    @torch.no_grad()
    def hyperparameters(self) -> Float[Tensor, "*batch o p"]:
        """(ℓ_1 … ℓ_D, s², σ²) of each process, [..., O, D + 2], of standardised data.

        ℓ of a feature is the least length scale of the kernels on it, infinite if none has one; s² and σ² are the
        variances of the process and of the noise, means over training points if they differ.
        """
        (x,) = self.train_inputs
        lengths = x.new_full((*x.shape[:-2], x.shape[-1]), torch.inf)
        _shorten(lengths, self.kernel, torch.arange(x.shape[-1], device=x.device))
        variances = self.kernel(x[..., :1000, :], diag=True), self.likelihood.noise
        return torch.cat((lengths, *(variance.mean(-1, keepdim=True) for variance in variances)), -1)

    def centred(self) -> Tensor:
        """Training outputs less the mean of the processes, [..., O, n]."""
        return self.train_targets - self.mean_module(*self.train_inputs)

    def noise_variance(self) -> Tensor:
        """Noise variance of the training points [..., O, n]."""
        return self.likelihood._shaped_noise_covar(self.train_targets.shape).diagonal(dim1=-2, dim2=-1)


def log_prior(D: int) -> Float[Tensor, "2 {D+2}"]:
    """Mean and standard deviation [2, D + 2] of the Gaussian prior of log (ℓ_1 … ℓ_D, s², σ²), of standardised data.

    Weak beside a hundred points, but ten points fit seven hyperparameters too well without it.  Typical
    distances, and so length scales, grow with √D (Hvarfner, Hellsten & Nardi 2024).
    """
    return torch.tensor([[1 + math.log(D) / 2] * D + [0.0, -3.0], [1.0] * D + [1.0, 2.0]], dtype=torch.float64)


def first_lengths(starts: int) -> Float[Tensor, "s"]:
    """Logarithm of the length scales with which each start begins."""
    return torch.linspace(_FIRST, _LAST, starts, dtype=torch.float64)


def best_starts(ends: Minimum, batch: torch.Size) -> tuple[Fit, Tensor]:
    """Return the fit of the best of the S starts of each of B processes, and its row [B] among the S B ends."""
    B = batch.numel()
    rows = ends.value.view(-1, B).nan_to_num(torch.inf).argmin(0) * B + torch.arange(B, device=ends.value.device)
    parts = ends.value[rows], ends.converged[rows], ends.evaluations.view(-1, B).sum(0)
    value, converged, evaluations = (part.unflatten(0, batch) for part in parts)
    return Fit(value, converged, evaluations, ends.history[:, rows].unflatten(1, batch)), rows


def _kernel(options: ProcessOptions, parts: dict[str, Any]) -> Kernel:
    """The kernel, with an output scale."""
    batch = parts["batch_shape"]
    if options.kernel is None:
        kernel = RBFKernel(ard_num_dims=parts["ard_num_dims"], batch_shape=batch)
    else:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)  # of kernels with random features
            kernel = build(options.kernel, parts)
    scaled = any(isinstance(part, ScaleKernel) for part in kernel.modules())
    return kernel if scaled else ScaleKernel(kernel, batch_shape=batch)


def _likelihood(
    options: ProcessOptions, parts: dict[str, Any], weight: Outputs | None, noise: Outputs | None
) -> gpytorch.likelihoods.Likelihood:
    description = dict(options.likelihood or {"_target_": GaussianLikelihood})
    if description["_target_"] is GaussianLikelihood:
        return build(description | {"_target_": WeightedNoise}, parts | {"weight": weight})
    fixed = issubclass(description["_target_"], gpytorch.likelihoods.FixedNoiseGaussianLikelihood)
    if fixed and noise is None:
        raise DataError(
            "the target has no stated noise for FixedNoiseGaussianLikelihood; leave the likelihood out, "
            "or learn a velocity, impulse or wrench from data with covariances"
        )
    return build(description, parts | ({"noise": noise.clamp_min(NOISE[0])} if fixed and noise is not None else {}))


def _register_priors(model: gpytorch.Module) -> None:
    """Give every length scale, output scale and noise variance without a prior its own of `log_prior`."""
    for module in list(model.modules()):
        if isinstance(module, Kernel) and module.has_lengthscale and "lengthscale_prior" not in module._priors:
            (mean, *_), (spread, *_) = log_prior(module.raw_lengthscale.shape[-1])
            module.register_prior("log_lengthscale_prior", NormalPrior(mean, spread), _log_lengthscale)
        if isinstance(module, ScaleKernel) and "outputscale_prior" not in module._priors:
            module.register_prior("log_outputscale_prior", NormalPrior(*log_prior(1)[:, -2]), _log_outputscale)
        if isinstance(module, HomoskedasticNoise) and "noise_prior" not in module._priors:
            module.register_prior("log_noise_prior", NormalPrior(*log_prior(1)[:, -1]), _log_noise)


# Named functions, which unlike lambdas can be sent to another process.


def _log_lengthscale(kernel: Kernel) -> Tensor:
    return kernel.lengthscale.log()


def _log_outputscale(kernel: ScaleKernel) -> Tensor:
    return kernel.outputscale.log()


def _log_noise(noise: HomoskedasticNoise) -> Tensor:
    return noise.noise.log()


def _shorten(lengths: Tensor, kernel: Kernel, columns: Tensor) -> None:
    """Lower lengths [..., D] to the length scales that a kernel on some columns, and those in it, have."""
    inner = getattr(kernel, "base_kernel", None)
    if kernel.active_dims is not None and (inner is None or inner.active_dims is None):  # a wrapper repeats them
        columns = columns[kernel.active_dims]
    if kernel.has_lengthscale:
        lengths[..., columns] = torch.minimum(lengths[..., columns], kernel.lengthscale[..., 0, :])
    for child in kernel.children() if not hasattr(kernel, "kernels") else kernel.kernels:
        if isinstance(child, Kernel):
            _shorten(lengths, child, columns)


def for_each_output(x: Tensor, batch: torch.Size) -> Tensor:
    """x [..., N, D] as [..., O, N, D]; leading axes may be missing."""
    return x.unsqueeze(-3).expand(*batch, *x.shape[-2:])
