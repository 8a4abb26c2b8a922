"""Exact Gaussian processes, many at once.

`fit` finds the hyperparameters of all processes of the batch in lock step, from two starts, since the objective has
several optima.  The objective of the default modules, and its gradient, have a closed form, see `evidence`; those of
any others are GPyTorch's, see `training`.  Either is what GPyTorch's `ExactMarginalLogLikelihood` gives for the model.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from typing import Any

import torch
from gpytorch.constraints import Positive
from gpytorch.kernels import RBFKernel, ScaleKernel
from gpytorch.means import ZeroMean
from jaxtyping import Float
from linear_operator.utils.cholesky import psd_safe_cholesky
from linear_operator.utils.errors import NanError, NotPSDError
from threadpoolctl import ThreadpoolController
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.models.gp.bfgs import Minimum, minimise
from contactlearn.models.gp.evidence import CHUNK, LogEvidence
from contactlearn.models.gp.modules import resolved, resolved_optimiser
from contactlearn.models.gp.processes import (
    FIRST_NOISE,
    LENGTH,
    NOISE,
    SCALE,
    TOLERANCE,
    Fit,
    GaussianProcesses,
    OnRound,
    WeightedNoise,
    best_starts,
    first_lengths,
    for_each_output,
    log_prior,
)
from contactlearn.models.gp.training import losses, optimise
from contactlearn.models.process_options import ITERATIONS, STARTS, ProcessOptions

_PARTS = 4  # of the processes, that cores share
_SHORT, _LONG = 0.2, 20.0  # lengths of a function of one input, of standardised inputs
_SEARCHED = 200  # points of a fold on which the hyperparameters of all are searched for
_ROUNDING = 1e-8  # of an eigenvalue
_OF_FOLDS = 3e-4  # nats a point, tolerance of the folds: their held-out errors are within 0.6 %, for 70 % of the time


@cache
def _blas() -> ThreadpoolController:
    """Control of the threads of every BLAS, with SciPy's, which is loaded for it."""
    import_module("scipy.linalg")
    return ThreadpoolController()


class ExactGPs(GaussianProcesses):
    """Processes that condition on every training point; see `GaussianProcesses`."""

    @property
    def has_closed_form(self) -> bool:
        """Whether `evidence` has the objective: of the default modules, constraints and priors."""
        scale, (x,) = self.covar_module, self.train_inputs
        rbf = scale.base_kernel if type(scale) is ScaleKernel else None
        return (
            rbf is not None
            and type(rbf) is RBFKernel
            and (rbf.ard_num_dims, rbf.active_dims) == (x.shape[-1], None)
            and scale.active_dims is None
            and type(self.mean_module) is ZeroMean
            and type(self.likelihood) is WeightedNoise
            and all(type(constraint) is Positive for constraint in self.constraints())
            and all(name.rpartition(".")[2].startswith("log_") for name, *_ in self.named_priors())
            and "_target_" not in (self.options.optimiser or {})
        )

    def fit(
        self,
        like: GaussianProcesses | None = None,
        *,
        along_one: bool = False,
        tolerance: float = TOLERANCE,
        on_round: OnRound | None = None,
    ) -> Fit:
        """Find the hyperparameters of all processes: the best of several optima each.

        Args:
            like: begin where this one ended instead, once.
            along_one: begin also with the likeliest function of one input that varies fast, which starts of equal
                lengths miss among many inputs; of the default modules alone.
            tolerance: nats a point that a step must promise; of the default modules alone.
            on_round: see `OnRound`.
        """
        if not self.has_closed_form:
            return optimise(self, like, on_round)
        (x,), y, weight = self.train_inputs, self.train_targets, self.likelihood.weight
        flat_x, flat_y = (part.reshape(-1, *part.shape[y.ndim - 1 :]) for part in (x, y))
        flat_weight = None if weight is None else weight.reshape(flat_y.shape)
        B, D, optimiser = y.shape[:-1].numel(), x.shape[-1], self.options.optimiser or {}
        bounds = torch.tensor([LENGTH] * D + [SCALE, NOISE], dtype=y.dtype, device=y.device).log()
        if like is None:
            lengths = first_lengths(optimiser.get("starts", STARTS))
            starts = torch.stack([torch.tensor([start] * D + [0.0, math.log(FIRST_NOISE)]) for start in lengths])
            starts = starts.to(y).repeat_interleave(B, 0)
        else:
            starts = like.hyperparameters().expand(*y.shape[:-1], -1).flatten(0, -2).log()
        prior = log_prior(D).to(y) if self.options.prior else None
        report = None if on_round is None else lambda now: on_round(self._take(now))
        most = optimiser.get("iterations", ITERATIONS)
        settings = {"most": most, "along_one": along_one, "tolerance": tolerance, "report": report}
        search = partial(_ends, bounds=bounds, prior=prior, **settings)
        size = B if report else max(-(-B // _PARTS), CHUNK // x.shape[-2] ** 2)
        ends = [
            search(flat_x[some], flat_y[some], None if flat_weight is None else flat_weight[some], begin)
            for some, begin in zip(torch.arange(B).split(size), starts.view(-1, B, D + 2).split(size, 1), strict=True)
        ]
        return self._take(_joined(ends))

    def fit_folds(self) -> None:
        """Find the hyperparameters for folds of the same data, in random order, which are as good as alike.

        Those of the first fold are searched for on a part of it, and all folds begin where that ends.
        """
        x, y, weight, *_ = self.data(slice(_SEARCHED))
        first = ExactGPs(x[:1], y[:1], None if weight is None else weight[:1], self.options)
        first.fit(along_one=True)
        self.fit(first, tolerance=_OF_FOLDS)

    def _take(self, ends: Minimum) -> Fit:
        """Set the hyperparameters to those of each process's best start."""
        D, batch = self.train_inputs[0].shape[-1], self.train_targets.shape[:-1]
        fit, best = best_starts(ends, batch)
        theta = ends.x[best].exp().unflatten(0, batch)
        self.covar_module.base_kernel.lengthscale = theta[..., None, :D]
        self.covar_module.outputscale = theta[..., D]
        self.likelihood.noise = theta[..., D + 1 :]
        self.eval()
        return fit

    def predict(self, x: Float[Tensor, "*batch n d"]) -> tuple[Float[Tensor, "*more o n"], Float[Tensor, "*more o n"]]:
        """Mean and variance [..., O, N] of the noise-free functions at standardised x [..., N, D].

        What GPyTorch's own posterior gives in exact arithmetic, in a tenth of the time.
        """
        x, root = for_each_output(x, self.train_targets.shape[:-1]), self._cholesky()
        half = torch.linalg.solve_triangular(root, self._cross(x).mT, upper=False)
        rest = torch.linalg.solve_triangular(root, self.centred()[..., None], upper=False)
        variance = self.covar_module(x, diag=True) - half.square().sum(-2)
        return self.mean_module(x) + (half.mT @ rest)[..., 0], variance.clamp_min(0)

    def mean(self) -> Callable[[Float[Tensor, "*batch n d"]], Float[Tensor, "*more o n"]]:
        """Return the mean [..., O, N] as a function of standardised x [..., N, D], for a fraction of the time."""
        return partial(self._mean, torch.cholesky_solve(self.centred()[..., None], self._cholesky()))

    def _mean(self, weights: Float[Tensor, "*batch o n 1"], x: Float[Tensor, "*batch n d"]) -> Tensor:
        x = for_each_output(x, self.train_targets.shape[:-1])
        return self.mean_module(x) + (self._cross(x) @ weights)[..., 0]

    def leave_one_out(self) -> tuple[Float[Tensor, "*batch o n"], Float[Tensor, "*batch o n"]]:
        """Error y − ŷ of each training point if it were left out, and the variance of ŷ, [..., O, n] each.

        Closed form, Rasmussen & Williams (2006), Eq. (5.12); the hyperparameters are not found again.
        """
        inverse = torch.cholesky_inverse(self._cholesky())
        variance = 1 / inverse.diagonal(dim1=-2, dim2=-1)
        error = (inverse @ self.centred()[..., None])[..., 0] * variance
        return error, (variance - self.noise_variance()).clamp_min(0)

    def _cross(self, x: Tensor) -> Tensor:
        """Covariance [..., O, N, n] between x [..., O, N, D] and the training inputs."""
        return self.covar_module(x, *self.train_inputs).to_dense()

    def _cholesky(self) -> Tensor:
        """Factor of the training covariance with noise, [..., O, n, n]."""
        K = self.covar_module(*self.train_inputs).to_dense() + torch.diag_embed(self.noise_variance())
        try:
            return psd_safe_cholesky(K)
        except (NanError, NotPSDError) as error:
            raise ContactLearnError(
                f"the covariance of the training trials{self.options} is not positive definite where the search ended; "
                "take another kernel, or more noise"
            ) from error


def _ends(
    x: Float[Tensor, "b n d"],
    y: Float[Tensor, "b n"],
    weight: Float[Tensor, "b n"] | None,
    starts: Float[Tensor, "s b p"],
    *,
    bounds: Float[Tensor, "p 2"],
    prior: Float[Tensor, "2 p"] | None,
    most: int,
    along_one: bool,
    tolerance: float,
    report: Callable[[Minimum], None] | None,
) -> Minimum:
    """Ends of the search from each start, as axes [s, b]; histories are [rounds, s, b]."""
    evidence, b = LogEvidence(x, y, weight), len(y)

    def objective(phi: Tensor, which: Tensor, curvature: bool) -> tuple[Tensor, Tensor, Tensor | None]:
        likelihood = evidence(phi, which % b, curvature)
        return likelihood if prior is None else _with_prior(likelihood, phi, prior, x.shape[-2])

    with _blas().limit(limits=1):  # matrices this small gain nothing from threads, which spin against each other
        if along_one:
            D = x.shape[-1]
            begin = torch.tensor([_LONG] * D + [1.0, FIRST_NOISE]).to(starts).log().repeat(D, b, 1)
            begin[range(D), :, range(D)] = math.log(_SHORT)
            value, *_ = objective(begin.flatten(0, 1), torch.arange(D * b), False)
            best = value.view(D, b).nan_to_num(torch.inf).argmin(0)
            starts = torch.cat((starts, begin[best, range(b)][None]))
        ends = minimise(
            objective, starts.flatten(0, 1), *bounds.T, tolerance=tolerance, evaluations=most, starts=len(starts),
            on_round=report,
        )  # fmt: skip
    *end, history = ends
    axes = starts.shape[:2]
    return Minimum._make((*(part.unflatten(0, axes) for part in end), history.unflatten(1, axes)))


def _joined(parts: Sequence[Minimum]) -> Minimum:
    """Join the ends of some processes each; those that end first stay where they are."""
    rounds = max(len(part.history) for part in parts)
    histories = [part.history[torch.arange(rounds).clamp_max(len(part.history) - 1)] for part in parts]
    ends = (torch.cat(pieces, 1).flatten(0, 1) for pieces in zip(*(part[:-1] for part in parts), strict=True))
    return Minimum._make((*ends, torch.cat(histories, 2).flatten(1)))


def _with_prior(
    likelihood: tuple[Tensor, Tensor, Tensor | None], phi: Tensor, prior: Tensor, n: int
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Values, gradients and curvatures at phi [b, P], per point, less those of the logarithm of a prior."""
    (value, gradient, curvature), (mean, spread) = likelihood, prior
    away = (phi - mean) / spread
    value = value + (0.5 * away.square() + spread.log() + 0.5 * math.log(2 * math.pi)).sum(-1) / n
    gradient = gradient + away / spread / n
    return value, gradient, None if curvature is None else curvature + (spread**-2 / n).diag()


def checked_options(options: ProcessOptions, columns: Sequence[str]) -> ProcessOptions:
    """Return options with classes for names, and numbers for features, after a trial on a few points.

    Args:
        options: see `ProcessOptions`.
        columns: names of the features.

    Raises:
        ContactLearnError: naming the part that does not fit, and what is wrong with it.
    """
    checked: dict[str, Any] = {}
    x = torch.randn(5, len(columns), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    y = x.sum(-1).expand(2, -1)
    for part in ("kernel", "mean", "likelihood", "optimiser"):
        if (description := getattr(options, part)) is None:
            continue
        try:
            of_torch = part == "optimiser"
            checked[part] = resolved_optimiser(description) if of_torch else resolved(description, columns, f"{part}s")
            gps = ExactGPs(x, y, None, ProcessOptions(**checked), torch.full_like(y, 0.1))
            losses(gps.train()).sum().backward()
            if part == "kernel":
                _refuse_indefinite(gps.eval())
        except ContactLearnError as error:
            raise ContactLearnError(f"{part}: {error}") from error
        except Exception as error:  # whatever a module may raise
            seen = " ".join(str(error).partition(", but found")[0].split())  # values and their graph tell nothing
            raise ContactLearnError(f"{part}: does not fit {len(columns)} features: {seen}") from error
        if shared := [name for name, one in gps.named_parameters() if one.shape[:1] != y.shape[:1]]:
            raise ContactLearnError(f"{part}: its class must take batch_shape and make use of it; {shared[0]} has none")
    return replace(options, **checked)


def _refuse_indefinite(gps: ExactGPs) -> None:
    """Refuse a kernel that is no covariance, such as a cosine of distances among several features."""
    D = gps.train_inputs[0].shape[-1]
    x = torch.randn(4, 60, D, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    x = x * torch.tensor([0.1, 0.3, 1.0, 3.0], dtype=torch.float64)[:, None, None]
    more = torch.cat((x, x[:, :1]), 1)  # of a matrix that is not square GPyTorch takes no roots, which would hide it
    K = torch.stack([gps.covar_module(*pair).to_dense()[0, :, :-1] for pair in zip(x, more, strict=True)])
    values = torch.linalg.eigvalsh(K)
    if (share := (values[:, 0] / values[:, -1]).min().item()) < -_ROUNDING:
        raise ContactLearnError(
            f"is no covariance of {D} features: of 60 points its matrix has an eigenvalue {share:.2g} times the "
            "greatest; give it a single feature, such as active_dims: [0], or take another kernel"
        )
