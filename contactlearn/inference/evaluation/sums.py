"""Errors of models over blocks of trials: sums that give means and intervals without the single errors.

Means, variances and covariances between models are exact, and combined block by block (Chan, Golub & LeVeque 1983,
"Algorithms for computing the sample variance").  Up to `metrics.BOOTSTRAPPED` trials the errors are kept, and the
intervals are those of the bootstrap; beyond, they are those of the Gaussian limit, as everywhere.
"""

from collections.abc import Iterable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import BOOTSTRAPPED, METRICS, Interval, bootstrap, gaussian_interval
from contactlearn.mechanics.impacts import Impacts, Prediction


class ErrorSums:
    """Errors by model and metric of the trials that were added, on the CPU; all models predict the same trials.

    Args:
        models: their names.
    """

    def __init__(self, models: Iterable[str]) -> None:
        self.models = tuple(models)
        self.trials = 0
        self._outside = torch.zeros(len(self.models), dtype=torch.float64)
        self._moments = {name: _Moments(len(self.models)) for name in METRICS}

    def add(self, impacts: Impacts, predictions: Mapping[str, Prediction]) -> None:
        """Add the trials of a block.

        Raises:
            DataError: an outcome at rest, to which no error is relative.
        """
        refuse_rest(impacts)
        chosen = [predictions[name] for name in self.models]
        for name, metric in METRICS.items():
            self._moments[name].add(torch.stack([metric.error(impacts, one) for one in chosen]).cpu())
        outside = [metrics.outside_admissible(impacts, one.wrench[..., :2]).sum() for one in chosen]
        self._outside += torch.stack(outside).cpu()
        self.trials += len(impacts)

    def mean(self, metric: str, model: str) -> float:
        """Return the mean error of a model."""
        return self._moments[metric].mean[self.models.index(model)].item()

    def interval(self, metric: str, model: str, generator: torch.Generator, resamples: int = 2000) -> Interval:
        """Return the mean error of a model with its interval."""
        weights = torch.zeros(len(self.models), dtype=torch.float64)
        weights[self.models.index(model)] = 1
        return self._moments[metric].interval(weights, generator, resamples)

    def difference(
        self, metric: str, model: str, other: str, generator: torch.Generator, resamples: int = 2000
    ) -> Interval:
        """Return the mean error of a model less that of another on the same trials, with its interval."""
        weights = torch.zeros(len(self.models), dtype=torch.float64)
        weights[self.models.index(model)], weights[self.models.index(other)] = 1, -1
        return self._moments[metric].interval(weights, generator, resamples)

    def outside_admissible(self, model: str) -> float:
        """Return the share of impulses of a model that gain energy, pull or leave penetration."""
        return self._outside[self.models.index(model)].item() / self.trials


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

    def interval(self, weights: Float[Tensor, " k"], generator: torch.Generator, resamples: int) -> Interval:
        """Mean of a weighted sum of the errors with its interval."""
        if self.kept:
            chosen = weights.nonzero()[:, 0]
            errors = (weights[chosen, None] * torch.cat(self.kept, 1)[chosen]).sum(0)
            return bootstrap(errors, generator, resamples)
        variance = (weights @ self.comoment @ weights).clamp_min(0) / (self.trials - 1)
        return gaussian_interval((weights @ self.mean).item(), variance.item(), self.trials)


def refuse_rest(impacts: Impacts) -> None:
    """Refuse an outcome at rest, to which no error is relative.

    Raises:
        DataError: naming its trial.
    """
    at_rest = (impacts.v_post[:, :2] == 0).all(1).nonzero()[:, 0].tolist()
    if at_rest:
        raise DataError(
            f"{impacts.source}: errors are relative to the outcome, which must not be at rest; trial "
            f"{impacts.trial[at_rest[0]]!r} has vx_post = vy_post = 0: leave it out"
        )
