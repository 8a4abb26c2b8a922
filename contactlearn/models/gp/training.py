"""Training of processes whose objective has no closed form here: GPyTorch's own, with its gradient.

    loss = −ExactMarginalLogLikelihood(likelihood, model)(model(x), y), per point and with the priors of the model

All starts of all processes are one model of a longer batch shape.  BFGS minimises its losses in lock step over
GPyTorch's raw parameters; an optimiser of PyTorch minimises their sum.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import torch
from gpytorch import settings
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import Kernel
from gpytorch.likelihoods.noise_models import HomoskedasticNoise
from gpytorch.mlls import ExactMarginalLogLikelihood
from linear_operator.utils.errors import NanError, NotPSDError
from linear_operator.utils.warnings import NumericalWarning
from torch import Tensor
from torch.nn.functional import softplus

from contactlearn.core.errors import ContactLearnError
from contactlearn.models.gp.bfgs import Minimum, minimise
from contactlearn.models.gp.processes import (
    FIRST_NOISE,
    TOLERANCE,
    Fit,
    GaussianProcesses,
    OnRound,
    best_starts,
    first_lengths,
)
from contactlearn.models.process_options import ITERATIONS, STARTS

_OnMinimum = Callable[[Minimum], None]
_CURVATURE = 0.01  # per point, of an objective about which nothing is known yet


def optimise(gps: GaussianProcesses, like: GaussianProcesses | None = None, on_round: OnRound | None = None) -> Fit:
    """Find the hyperparameters of all processes: the best of several starts each.

    Args:
        gps: the model, which is trained.
        like: begin where this one ended instead, once.
        on_round: see `OnRound`.

    Raises:
        ContactLearnError: a process has no finite likelihood, or prior, at any of its starts, or an optimiser of
            PyTorch arrives where a covariance has no Cholesky factor.
    """
    options, y = dict(gps.options.optimiser or {}), gps.train_targets
    starts, iterations = options.pop("starts", STARTS), options.pop("iterations", ITERATIONS)
    many = gps.copies(1 if like is not None else starts).train()
    if like is None:
        _spread_starts(many)
    else:
        like.copy_to(many)

    def take(ends: Minimum) -> Fit:
        fit, rows = best_starts(ends, y.shape[:-1])
        for own, every in zip(gps.free_parameters(), many.free_parameters(), strict=True):
            own.data.copy_(every.data.flatten(0, y.ndim - 1)[rows].view_as(own))
        gps.eval()
        return fit if gap is None else fit._replace(gap=gap[rows].unflatten(0, y.shape[:-1]))

    gap: Tensor | None = None
    report = None if on_round is None else lambda now: on_round(take(now))
    minimise_losses = _by_torch if "_target_" in options else _by_bfgs
    with warnings.catch_warnings(), settings.max_cholesky_size(10**6):
        warnings.simplefilter("ignore", NumericalWarning)  # of the little that is added to a singular covariance
        ends = minimise_losses(many, iterations, options, report)
        if "_target_" in options:
            gap = ends.value - _nearby(many)
            ends = ends._replace(converged=gap < TOLERANCE)
        fit = take(ends)
    if not fit.loss.isfinite().all():
        raise ContactLearnError(
            "no start has a finite likelihood: a prior has no density there, or the covariance is not positive "
            "definite; begin within the prior's support, take a wider prior, or leave it out"
        )
    return fit


def losses(gps: GaussianProcesses) -> Tensor:
    """−log marginal likelihood, and prior, per point in nats [..., O] of a model in training mode."""
    return -ExactMarginalLogLikelihood(gps.likelihood, gps)(gps(*gps.train_inputs), gps.train_targets)


def _spread_starts(many: GaussianProcesses) -> None:
    """Begin each start with length scales of its own, and with our noise, where constraints and priors let us."""
    lengths = first_lengths(len(many.train_targets)).exp().to(many.train_targets)
    for module in many.modules():
        if isinstance(module, Kernel) and module.has_lengthscale:
            name, value = "lengthscale", lengths.view(-1, *[1] * (module.raw_lengthscale.ndim - 1))
        elif isinstance(module, HomoskedasticNoise):
            name, value = "noise", torch.full_like(lengths[0], FIRST_NOISE)
        else:
            continue
        if f"{name}_prior" not in module._priors and module.constraint_for_parameter_name(f"raw_{name}").check(value):
            module.initialize(**{name: value})


class _Objective:
    """GPyTorch's losses and gradients of the B processes of a model: an `Objective` of `bfgs`.

    Its variables [B, P] are the raw parameters, or, of those that a softplus makes positive, their logarithms: the
    curvature in these depends little on the size of a parameter.
    """

    def __init__(self, model: GaussianProcesses):
        self.model, self.parameters = model, model.free_parameters()
        self.axes = model.train_targets.ndim - 1  # of the batch
        bounds = [bound for _, one, bound in model.named_parameters_and_constraints() if one.requires_grad]
        positive = [isinstance(bound, GreaterThan) for bound in bounds]
        self.positive = torch.cat(
            [torch.full((size,), sign) for size, sign in zip(self._sizes(), positive, strict=True)]
        ).to(model.train_targets.device)
        raw = self._flat(self.parameters).detach()
        self.at = torch.where(self.positive, softplus(raw).log(), raw)
        self.curvature = [_CURVATURE * torch.eye(raw.shape[1]).to(raw).expand(len(raw), -1, -1)]

    def __call__(self, x: Tensor, which: Tensor, _: bool) -> tuple[Tensor, Tensor, Tensor | None]:
        return *self._evaluate(x, which), self.curvature.pop() if self.curvature else None  # then updates know more

    def _evaluate(self, x: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
        """Values [b] and gradients [b, P]; nan for a process whose covariance has no Cholesky factor."""
        before = self.at
        self.move(before.index_copy(0, which, x))
        try:
            value = losses(self.model)
            gradient = self._flat(torch.autograd.grad(value.sum(), self.parameters))
        except (NanError, NotPSDError, ValueError):  # of one process at least; a value outside of a prior's support
            self.move(before)
            if len(which) == 1:
                return torch.full_like(x[:, 0], torch.nan), torch.full_like(x, torch.nan)
            halves = [self._evaluate(*half) for half in zip(x.tensor_split(2), which.tensor_split(2), strict=True)]
            value, gradient = map(torch.cat, zip(*halves, strict=True))
            return value, gradient
        own = self.at.exp()
        gradient = torch.where(self.positive, gradient * own / -(-own).expm1(), gradient)
        return value.detach().flatten()[which], gradient[which]

    def move(self, at: Tensor) -> None:
        """Give the model the variables [B, P]."""
        self.at, own = at, at.exp()
        raw = torch.where(self.positive, own + (-(-own).expm1()).log(), at)
        for parameter, part in zip(self.parameters, raw.split(self._sizes(), -1), strict=True):
            parameter.data.copy_(part.view_as(parameter))

    def _sizes(self) -> list[int]:
        """Number of values of each parameter for one process."""
        return [parameter.shape[self.axes :].numel() for parameter in self.parameters]

    def _flat(self, parts: Iterable[Tensor]) -> Tensor:
        """Parameters, or their gradients, as one tensor [B, P]."""
        return torch.cat([part.reshape(self.model.train_targets.shape[:-1].numel(), -1) for part in parts], -1)


def _by_bfgs(many: GaussianProcesses, iterations: int, _: Mapping[str, Any], on_round: _OnMinimum | None) -> Minimum:
    """Minimise the losses in lock step."""
    objective = _Objective(many)
    free = torch.full_like(objective.at[0], torch.inf)

    def report(now: Minimum) -> None:
        if on_round is not None:
            objective.move(now.x)
            on_round(now)

    starts = len(many.train_targets)
    ends = minimise(
        objective, objective.at, -free, free,
        tolerance=TOLERANCE, evaluations=iterations, starts=starts, on_round=report,
    )  # fmt: skip
    objective.move(ends.x)
    return ends


def _nearby(many: GaussianProcesses) -> Tensor:
    """Losses of the optima that BFGS finds from where a model is, which stays as it is."""
    before = [parameter.data.clone() for parameter in many.free_parameters()]
    value = _by_bfgs(many, ITERATIONS, {}, None).value
    for parameter, own in zip(many.free_parameters(), before, strict=True):
        parameter.data.copy_(own)
    return value


def _by_torch(
    many: GaussianProcesses, iterations: int, options: Mapping[str, Any], on_round: _OnMinimum | None
) -> Minimum:
    """Minimise the sum of the losses with an optimiser of PyTorch; every evaluation is a round."""
    arguments = {name: value for name, value in options.items() if name != "_target_"}
    optimiser, history = options["_target_"](many.free_parameters(), **arguments), list[Tensor]()

    def state() -> Minimum:
        end = history[-1]
        unknown = torch.zeros_like(end, dtype=torch.bool)
        return Minimum(end[:, None], end, unknown, torch.full_like(end, len(history)).long(), torch.stack(history))

    def closure() -> Tensor:
        optimiser.zero_grad()
        value = losses(many)
        value.sum().backward()
        history.append(value.detach().flatten())
        if on_round is not None:
            on_round(state())
        return value.sum()

    try:
        for _ in range(iterations):
            optimiser.step(closure)
        closure()
    except (NanError, NotPSDError, ValueError) as error:
        raise ContactLearnError(
            f"{type(optimiser).__name__} arrived where a covariance is not positive definite, or where a prior has "
            "no density; take a smaller lr, more noise, or leave optimiser._target_ out"
        ) from error
    return state()
