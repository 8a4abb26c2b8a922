"""Errors of predictions by trial, and 95 % intervals of their means over trials.

    mass_error                   √(eᵀ M e) / √(vᵀ M v) over (v_x, v_y, ω) after contact   1
    euclidean_error              ‖e‖₂ over the same, the paper's measure                  m/s and rad/s
    normalised_euclidean_error   ‖e‖₂ / ‖v‖₂, the paper's Fig. 3.5                        1
    velocity_error               ‖e‖₂ over (v_x, v_y), of the mass centre alone           m/s

A bound is the least error of its class in the norm that it minimises, and in no other: see `bounded_metrics`.  Models
are compared by the `headline_metric` of that norm.  By default it is the mass norm, which does not add metres to
radians.  Nothing bounds `velocity_error`, in which a moment about the mass centre does not show.

`ErrorSums` holds means, variances and covariances of several models over blocks of trials, combined exactly (Chan,
Golub & LeVeque 1983).  Up to `BOOTSTRAPPED` trials intervals are those of the bootstrap, beyond of the Gaussian limit.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import Z_95
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import admissible, contact_velocity, effective_inertia, matvec, squared_mass_norm

Norm = Literal["mass", "euclidean"]
NORMS: tuple[Norm, ...] = get_args(Norm)
"""√(eᵀ M e), in √J, and ‖e‖₂ over (v_x, v_y, ω), which adds metres to radians as the paper does."""


def mass_error(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Compute √(eᵀ M e) / √(v_postᵀ M v_post) over (v_x, v_y, ω) [..., N]."""
    body = impacts.mass, impacts.world_inertia
    error = squared_mass_norm(*body, prediction.v_post - impacts.v_post)
    return (error / squared_mass_norm(*body, impacts.v_post)).sqrt()


def euclidean_error(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Compute ‖v̂_post − v_post‖₂ over (v_x, v_y, ω) [..., N]: it adds m/s to rad/s, as the paper's Section 3.2 does."""
    return (prediction.v_post - impacts.v_post).norm(dim=-1)


def normalised_euclidean_error(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Divide `euclidean_error` by ‖v_post‖₂ [..., N]; the paper normalises Fig. 3.5 and does not state by what."""
    return euclidean_error(impacts, prediction) / impacts.v_post.norm(dim=-1)


def velocity_error(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Compute ‖v̂_post − v_post‖₂ of the centre of mass [..., N] in m/s."""
    return (prediction.v_post - impacts.v_post)[..., : impacts.space.d].norm(dim=-1)


class Metric(NamedTuple):
    """An error of each trial: its `name` in tables, `label` on axes, unit, and the norm of its bounds if it has any."""

    error: Callable[[Impacts, Prediction], Tensor]
    name: str
    label: str
    unit: str
    norm: str | None

    @property
    def axis(self) -> str:
        """Label of an axis, with the unit."""
        return f"{self.label} ({self.unit})"


METRICS = {
    "mass_error": Metric(mass_error, "mass error", "Mass-weighted velocity error", "–", "mass"),
    "euclidean_error": Metric(
        euclidean_error, "Euclidean error", "Euclidean velocity error", "m/s and rad/s", "euclidean"
    ),
    "normalised_euclidean_error": Metric(
        normalised_euclidean_error, "normalised", "Normalised Euclidean velocity error", "–", "euclidean"
    ),
    "velocity_error": Metric(velocity_error, "velocity", "Velocity error of the mass centre", "m/s", None),
}
"""Each metric by name."""


def bounded_metrics(norm: str) -> tuple[str, ...]:
    """Return the metrics in which the bounds of a norm, see `bounds.distance`, are the least errors of their class."""
    return tuple(name for name, metric in METRICS.items() if metric.norm == norm)


def headline_metric(norm: str) -> str:
    """Return the metric by which models are compared where the bounds are those of a norm."""
    return bounded_metrics(norm)[0]


def outside_admissible(impacts: Impacts, impulse: Float[Tensor, "*batch n d"]) -> Bool[Tensor, "*batch n"]:
    """Find the impulses [..., N, d] that gain energy, pull or leave penetration: bool [..., N].

    For a point contact (τ = 0): see `mechanics.admissible`.
    """
    return ~admissible(impacts.W, impacts.v_c, impulse, tolerance=1e-7)


def back_spin(impacts: Impacts, v_post: Float[Tensor, "*batch n D"]) -> Bool[Tensor, "*batch n"]:
    """Find the outcomes v_post [..., N, D] whose impulse lies beyond the line of sticking: bool [..., N].

    Friction does more than end the slip v_t + W_tn P_n that the same normal impulse leaves without friction; it
    reverses it.  P is that of the contact point, M_c J Δv.  Source: Fazeli et al. (2017), Section 2.1.
    """
    after = contact_velocity(impacts.r, v_post)
    friction = matvec(effective_inertia(impacts.W), after - impacts.v_c)[..., :-1]
    slip = after[..., :-1]
    without = slip - matvec(impacts.W[:, :-1, :-1], friction)
    return (slip * without).sum(-1) < -1e-7 * impacts.v_c.norm(dim=-1) * without.norm(dim=-1)


def squared_distance(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Compute the squared Mahalanobis distance [..., N] of the measured v_post: χ² of D degrees if all is Gaussian."""
    return _whitened(impacts, prediction)[0].square().sum(-1)


def negative_log_density(impacts: Impacts, prediction: Prediction) -> Float[Tensor, "*batch n"]:
    """Compute −log of the predicted density of the measured v_post [..., N], in nats; v_post in (m/s, m/s, rad/s)."""
    white, root = _whitened(impacts, prediction)
    return 0.5 * white.square().sum(-1) + root.log().sum(-1) + white.shape[-1] / 2 * math.log(2 * math.pi)


def _whitened(impacts: Impacts, prediction: Prediction) -> tuple[Tensor, Tensor]:
    """Error in units of the predicted covariance's Cholesky factor, and that factor's diagonal, [..., N, 3]."""
    factor = torch.linalg.cholesky(_covariance(prediction))
    error = impacts.v_post - prediction.v_post
    white = torch.linalg.solve_triangular(factor, error[..., None], upper=False)[..., 0]
    return white, factor.diagonal(dim1=-2, dim2=-1)


def _covariance(prediction: Prediction) -> Tensor:
    if prediction.covariance is None:
        raise ContactLearnError(
            "the prediction has no covariance; a density needs a model with noise, such as a learned one"
        )
    return prediction.covariance


CHI_SQUARED_95 = {3: 7.8147279, 6: 12.5915872}
"""95 % quantile of χ² by its degrees of freedom, D: that of squared distances, if the predictions are right."""


def calibration(
    distance: Float[Tensor, "k"], freedom: int = 3
) -> tuple[Float[Tensor, "levels"], Float[Tensor, "levels"]]:
    """Return nominal levels [L], and the shares [L] of squared distances [K] inside the ellipsoids of those levels."""
    from scipy.special import chdtri  # SciPy takes long to load

    levels = torch.linspace(0.02, 0.98, 49, dtype=distance.dtype)
    radii = torch.from_numpy(chdtri(freedom, 1 - levels.numpy())).to(distance.device)
    inside = torch.searchsorted(distance.sort().values, radii, right=True)
    return levels.to(distance.device), inside.to(distance) / len(distance)


def covered(impacts: Impacts, prediction: Prediction) -> Bool[Tensor, "*batch n D"]:
    """Find which of (v_x, v_y, ω) after contact lie in their 95 % intervals: bool [..., N, 3]."""
    return (impacts.v_post - prediction.v_post).abs() <= Z_95 * predicted_spread(prediction)


def predicted_spread(prediction: Prediction) -> Float[Tensor, "*batch n D"]:
    """Compute the standard deviations [..., N, 3] of the measured v_post about the prediction, (m/s, m/s, rad/s)."""
    return _covariance(prediction).diagonal(dim1=-2, dim2=-1).sqrt()


# A file has null for an end that is not known, and `Interval` has nan.
if TYPE_CHECKING:
    End = float
else:
    End = float | None


@dataclass(frozen=True, order=True)
class Interval:
    """A mean over trials and its 95 % bootstrap interval; unpacks to (mean, low, high), and sorts by the mean.

    The ends are nan where there is no interval, since there is a single trial, or a single group of trials.
    """

    mean: float
    low: End
    high: End

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, math.nan)

    def __iter__(self) -> Iterator[float]:
        return iter((self.mean, self.low, self.high))


BOOTSTRAPPED = 20_000
"""Trials up to which intervals of means are bootstrapped; the Gaussian limit is then within a percent of its width."""

_DRAWN = 1 << 23  # resampled errors in memory at a time


def gaussian_interval(mean: float, variance: float, trials: int, level: float = 0.95) -> Interval:
    """Return a mean over many trials with the interval in which the central limit theorem expects it."""
    reach = NormalDist().inv_cdf((1 + level) / 2) * math.sqrt(variance / trials)
    return Interval(mean, mean - reach, mean + reach)


def bootstrap(
    errors: Float[Tensor, "n"] | Float[Tensor, "r n"],
    generator: torch.Generator,
    resamples: int = 2000,
    level: float = 0.95,
    groups: Int[Tensor, "n"] | None = None,
) -> Interval:
    """Average the errors of trials [N], or [R, N] of R training subsets, with a percentile bootstrap interval.

    Trials are resampled, or groups of them by their numbers, and so are subsets, independently of them.  For more than
    `BOOTSTRAPPED` trials [N] the interval is the Gaussian limit of the bootstrap, see `gaussian_interval`.  A single
    trial or group has no interval: its ends are nan.
    """
    if (errors.shape[-1] if groups is None else len(groups.unique())) < 2:
        return Interval(errors.mean().item(), math.nan, math.nan)
    if errors.ndim == 1 and groups is not None:
        errors = errors[None]
    if errors.ndim == 1 and len(errors) > BOOTSTRAPPED:
        return gaussian_interval(errors.mean().item(), errors.var().item(), len(errors), level)
    errors, size = errors.cpu(), errors.shape[-1]
    if errors.ndim == 1:
        blocks = torch.arange(resamples).split(max(1, _DRAWN // size))
        drawn = (torch.randint(size, (len(block), size), generator=generator) for block in blocks)
        means = torch.cat([errors[rows].mean(-1) for rows in drawn])
    else:
        size = size if groups is None else int(groups.max()) + 1
        rows = torch.randint(size, (resamples, size), generator=generator)
        subsets = torch.randint(len(errors), (resamples, len(errors)), generator=generator)
        by_subset, by_trial = (
            torch.zeros_like(drawn, dtype=errors.dtype).scatter_add_(
                1, drawn, torch.ones_like(drawn, dtype=errors.dtype)
            )
            / drawn.shape[1]
            for drawn in (subsets, rows)
        )
        if groups is not None:
            by_trial = by_trial[:, groups]
            by_trial = by_trial / by_trial.sum(1, keepdim=True)
        means = ((by_subset @ errors) * by_trial).sum(-1)
    low, high = means.quantile(torch.tensor(((1 - level) / 2, (1 + level) / 2), dtype=errors.dtype))
    return Interval(errors.mean().item(), low.item(), high.item())


class ErrorSums:
    """Errors by model and metric of the trials that were added, on the CPU; all models predict the same trials.

    Args:
        models: their names.
    """

    def __init__(self, models: Iterable[str]) -> None:
        self.models = tuple(models)
        self.trials = 0
        self._outside, self._back_spin = torch.zeros(2, len(self.models), dtype=torch.float64)
        self._measured_back_spin = 0.0
        self._moments = {name: _Moments(len(self.models)) for name in METRICS}
        self._groups: Tensor | None = None

    def add(self, impacts: Impacts, predictions: Mapping[str, Prediction]) -> None:
        """Add the trials of a block.

        Raises:
            DataError: an outcome at rest, to which no error is relative.
        """
        refuse_rest(impacts)
        chosen = [predictions[name] for name in self.models]
        self._groups = impacts.groups if not self.trials else None  # of impacts in memory, which are one block
        for name, metric in METRICS.items():
            self._moments[name].add(torch.stack([metric.error(impacts, one) for one in chosen]).cpu())
        outside = [outside_admissible(impacts, one.wrench[..., : impacts.space.d]).sum() for one in chosen]
        self._outside += torch.stack(outside).cpu()
        self._back_spin += torch.stack([back_spin(impacts, one.v_post).sum() for one in chosen]).cpu()
        self._measured_back_spin += back_spin(impacts, impacts.v_post).sum().item()
        self.trials += len(impacts)

    def mean(self, metric: str, model: str) -> float:
        """Return the mean error of a model."""
        return self._moments[metric].mean[self.models.index(model)].item()

    def interval(self, metric: str, model: str, generator: torch.Generator, resamples: int = 2000) -> Interval:
        """Return the mean error of a model with its interval."""
        weights = torch.zeros(len(self.models), dtype=torch.float64)
        weights[self.models.index(model)] = 1
        return self._moments[metric].interval(weights, generator, resamples, self._groups)

    def difference(self, metric: str, model: str, other: str, generator: torch.Generator) -> Interval:
        """Return the mean error of a model less that of another on the same trials, with its interval."""
        weights = torch.zeros(len(self.models), dtype=torch.float64)
        weights[self.models.index(model)], weights[self.models.index(other)] = 1, -1
        return self._moments[metric].interval(weights, generator, 2000, self._groups)

    def outside_admissible(self, model: str) -> float:
        """Return the share of impulses of a model that gain energy, pull or leave penetration."""
        return self._outside[self.models.index(model)].item() / self.trials

    def back_spin(self, model: str | None = None) -> float:
        """Return the share of outcomes of a model that reverse the slip; of the measured ones if None."""
        count = self._measured_back_spin if model is None else self._back_spin[self.models.index(model)].item()
        return count / self.trials


class _Moments:
    """Mean [K] and comoment [K, K] of K errors over trials, and the errors themselves while they are few."""

    def __init__(self, count: int) -> None:
        self.trials = 0
        self.mean = torch.zeros(count, dtype=torch.float64)
        self.comoment = torch.zeros(count, count, dtype=torch.float64)
        self.kept: list[Tensor] = []

    def add(self, errors: Float[Tensor, "k n"]) -> None:
        new, total = errors.shape[1], self.trials + errors.shape[1]
        mean = errors.mean(1)
        centred, step = errors - mean[:, None], mean - self.mean
        self.comoment += centred @ centred.T + torch.outer(step, step) * self.trials * new / total
        self.mean = self.mean + step * new / total
        self.trials = total
        self.kept = [*self.kept, errors] if total <= BOOTSTRAPPED else []

    def interval(
        self, weights: Float[Tensor, " k"], generator: torch.Generator, resamples: int, groups: Tensor | None
    ) -> Interval:
        """Mean of a weighted sum of the errors with its interval."""
        if self.kept:
            chosen = weights.nonzero()[:, 0]
            errors = (weights[chosen, None] * torch.cat(self.kept, 1)[chosen]).sum(0)
            return bootstrap(errors, generator, resamples, groups=groups)
        variance = (weights @ self.comoment @ weights).clamp_min(0) / (self.trials - 1)
        return gaussian_interval((weights @ self.mean).item(), variance.item(), self.trials)


def refuse_rest(impacts: Impacts) -> None:
    """Refuse an outcome at rest, to which no error is relative.

    Raises:
        DataError: naming its trial.
    """
    at_rest = (impacts.v_post == 0).all(1).nonzero()[:, 0].tolist()
    if at_rest:
        raise DataError(
            f"{impacts.source}: errors are relative to the outcome, which must not be at rest; trial "
            f"{impacts.trial[at_rest[0]]!r} has v_post = 0: leave it out"
        )
