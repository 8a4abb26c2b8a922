"""Events of training: rounds, held-out errors, and points of learning curves."""

from collections.abc import Callable
from typing import TypeAlias

from contactlearn.core.events import EventBase, TaskProgress
from contactlearn.inference.evaluation.metrics import Interval


class TrainingRound(EventBase, frozen=True, kw_only=True):
    """A model after a round of its training: loss in nats a trial and hyperparameters, by output.

    Of models on several subsets these are means.

    Args:
        trained_on: number of training trials.
        round: counted from 1.
        loss: of each output.
        noise: standard deviation, in the output's unit.
        length_scales: by feature, in standard deviations of the feature.
    """

    trained_on: int
    round: int
    loss: dict[str, float]
    noise: dict[str, float]
    length_scales: dict[str, dict[str, float]]


class RoundScored(EventBase, frozen=True, kw_only=True):
    """Held-out trials by a model after a round of its training: mean errors by metric, mean −log density in nats."""

    trained_on: int
    round: int
    errors: dict[str, float]
    negative_log_density: float


class CurvePoint(EventBase, frozen=True, kw_only=True):
    """The next point of a learning curve: a model on held-out trials, trained on subsets of one size.

    Args:
        model: its name.
        trained_on: number of training trials.
        errors: by metric.
        loss: of each output in nats a trial, mean over the subsets; empty without training.
        noise: standard deviation, in the output's unit, likewise.
        length_scales: of each output by feature, in standard deviations of the feature, likewise.
        negative_log_density: mean over trials and subsets in nats; None without a predicted covariance.
        coverage: share of the trials inside the predicted 95 % ellipsoid; None likewise.
    """

    model: str
    trained_on: int
    errors: dict[str, Interval]
    loss: dict[str, float]
    noise: dict[str, float]
    length_scales: dict[str, dict[str, float]]
    negative_log_density: float | None
    coverage: float | None


class LearningProgress(EventBase, frozen=True, kw_only=True):
    """Models are trained on subsets: held-out errors so far by model, each with its number of training trials."""

    done: int
    total: int
    errors: dict[str, tuple[tuple[int, Interval], ...]]


LearningEvent: TypeAlias = TaskProgress | TrainingRound | RoundScored | CurvePoint
"""Any event of training."""

OnLearningEvent: TypeAlias = Callable[[LearningEvent], None]
"""Consumer of events of training."""
