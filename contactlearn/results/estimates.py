"""Estimates of a run as numbers: fitted laws, laws with effects, Gaussian processes, and errors of models."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.result.effects import FittedParameter
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import HEADLINE, Interval
from contactlearn.mechanics.apparatus import KnownParameter

_HIGHEST = 1e9  # of an error that a page can draw

Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class LawEstimate:
    """Shared (μ, ε) of a law, identified from random subsets of the training pool.

    Args:
        law: its name.
        variant: of the law.
        options: of the law, beside μ and ε.
        trials: in each subset.
        repetitions: number of subsets.
        mu: mean over the subsets.
        mu_std: standard deviation over the subsets; None for a single one.
        eps: as `mu`.
        eps_std: as `mu_std`.
        cost: mean ‖P − P̂‖ over a subset in N s, averaged over the subsets.
        mu_range: mean ends of the interval in which the cost stays near its least.
        eps_range: as `mu_range`.
        mu_undetermined: share of the subsets with a cost that is flat in μ.
    """

    law: str
    variant: str
    options: Mapping[str, Any]
    trials: int
    repetitions: int
    mu: float
    mu_std: float | None
    eps: float
    eps_std: float | None
    cost: float
    mu_range: Pair
    eps_range: Pair
    mu_undetermined: float


@dataclass(frozen=True, kw_only=True)
class JointEstimate:
    """A law with effects, fitted jointly.

    Args:
        law: its name.
        effects: around it; none for the law that was fitted in the same way.
        equation: the model with parameters and standard errors, as text.
        parameters: μ and ε, then those of the effects.
        correlation: of the estimates, square.
        undetermined: why the data do not determine a parameter, by its name.
        at_bounds: which bound a parameter stopped at, by its name.
        loss: per trial, in nats.
        starts_at_best: share of the starts that reached the best loss.
        converged: whether the search settled.
        trials: fitted to.
        outliers: trials with next to no weight.
        known: parameters whose range is what flight allows.
    """

    law: str
    effects: tuple[EffectId, ...]
    equation: str
    parameters: tuple[FittedParameter, ...]
    correlation: tuple[tuple[float, ...], ...]
    undetermined: Mapping[str, str]
    at_bounds: Mapping[str, str]
    loss: float
    starts_at_best: float
    converged: bool
    trials: int
    outliers: int
    known: tuple[KnownParameter, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ProcessEstimate:
    """Hyperparameters of the Gaussian process of one output.

    Args:
        output: its letter, such as ω.
        unit: of the output.
        length_scales: by feature, in standard deviations of the feature over the training trials.
        spread: standard deviation of the process, in the output's unit.
        noise: standard deviation of the noise, in the output's unit.
        loss: negative log marginal likelihood a trial, in nats.
        converged: whether the training settled.
        evaluations: of the loss and its gradient.
    """

    output: str
    unit: str
    length_scales: Mapping[str, float]
    spread: float
    noise: float
    loss: float
    converged: bool
    evaluations: int


@dataclass(frozen=True, kw_only=True)
class ModelErrors:
    """Errors of a model on the held-out trials, see `evaluation.metrics`.

    `outside_admissible` is the share of impulses that gain energy, pull or leave penetration.

    Raises:
        ContactLearnError: a mean error that is negative or not of this world.
    """

    mass_error: Interval
    normalised_velocity_error: Interval
    velocity_error: Interval
    outside_admissible: float

    def __post_init__(self) -> None:
        for name in ("mass_error", "normalised_velocity_error", "velocity_error"):
            if not all(0 <= x < _HIGHEST for x in self.of(name)):
                raise ContactLearnError(f"{name} must be a number, 0 or more, and less than {_HIGHEST:g}")

    def of(self, metric: str) -> Interval:
        """The mean and interval of a metric by its name in `METRICS`."""
        return getattr(self, metric)

    @property
    def headline(self) -> Interval:
        """The error by which models are compared."""
        return self.of(HEADLINE)


def known_model(model: str, errors: Mapping[str, ModelErrors]) -> None:
    """Refuse the name of a model without errors.

    Raises:
        ContactLearnError: naming it.
    """
    if model not in errors:
        raise ContactLearnError(f"a model must be one of those in errors ({', '.join(errors) or 'none'}), got {model}")
