"""Results of the commands as types: each is written whole to its run folder, once, before anything is shown.

Provenance              data, versions, configuration and command behind every result
LawEstimate … ModelErrors   laws, laws with effects, learned models and errors, as numbers
Training, Evaluation, Transfer, DiagnosisRun    the result of each command
"""

import math
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, Literal, TypeVar

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.result.effects import FittedParameter
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import METRICS, Interval, Norm, bounded_metrics, headline_metric
from contactlearn.mechanics.apparatus import KnownParameter

# --- Provenance -----------------------------------------------------------------------------------


FORMAT = 4
"""Number of the format of result files; a file without one is of format 1."""


class RunKind(StrEnum):
    """The kind of a run: the command that made it, evaluate having two."""

    TRAINING = "training"
    EVALUATION = "evaluation"
    TRANSFER = "transfer"
    DIAGNOSIS = "diagnosis"


@dataclass(frozen=True, kw_only=True)
class DataSource:
    """The impacts of a run.

    Args:
        source: in words.
        trials: their number.
        sha256: of all their numbers and names.
        mass: least and largest in kg; stated by a training alone.
        inertia: as `mass`, in kg m².
        space: plane or space.
    """

    source: str
    trials: int
    sha256: str
    mass: "Pair | None" = None
    inertia: "Pair | None" = None
    space: str = "plane"


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Everything that is needed to reproduce a result.

    Args:
        data: the impacts.
        versions: of this program, Python and the libraries that compute, by name.
        config: the composed configuration, resolved.
        command: the line that was typed.
        device: that computed it, a GPU with its name.
    """

    data: DataSource
    versions: Mapping[str, str] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)
    command: str = ""
    device: str = "cpu"


# --- Estimates ------------------------------------------------------------------------------------


HIGHEST_ERROR = 1e9
"""Bound of the errors that a page can draw."""

Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class LawEstimate:
    """Shared (μ, ε) of a law, identified from random subsets of the training pool.

    Args:
        law: its name.
        variant: of the law.
        options: of the law, other than μ and ε.
        trials: in each subset.
        repetitions: number of subsets.
        mu: mean over the subsets.
        mu_std: standard deviation over the subsets; None where all have one value.
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
        loss: negative logarithm a trial of the marginal likelihood, or posterior, in nats.
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


Errors = TypeVar("Errors")


@dataclass(frozen=True, kw_only=True)
class ErrorsByMetric(Generic[Errors]):
    """Errors of a model, each an interval or one a size; of a bound those that it bounds, see `evaluation.metrics`."""

    mass_error: Errors | None = None
    euclidean_error: Errors | None = None
    normalised_euclidean_error: Errors | None = None
    velocity_error: Errors | None = None

    @property
    def intervals(self) -> dict[str, Errors]:
        """The means and intervals that there are, by the metric's name in `METRICS`."""
        return {name: errors for name in METRICS if (errors := getattr(self, name)) is not None}

    def of(self, metric: str) -> Errors:
        """The means and intervals of a metric by its name in `METRICS`.

        Raises:
            ContactLearnError: it is not there.
        """
        if metric not in self.intervals:
            raise ContactLearnError(f"{metric} is missing; there are {', '.join(self.intervals) or 'none'}")
        return self.intervals[metric]


@dataclass(frozen=True, kw_only=True)
class ModelErrors(ErrorsByMetric[Interval]):
    """Errors of a model on the held-out trials, see `evaluation.metrics`; of a bound those that it bounds.

    `outside_admissible` is the share of impulses that gain energy, pull or leave penetration, `back_spin` that of
    outcomes beyond the line of sticking.

    Raises:
        ContactLearnError: a mean error that is negative or not of this world.
    """

    outside_admissible: float
    back_spin: float

    def __post_init__(self) -> None:
        for name, interval in self.intervals.items():
            ends = (end for end in (interval.low, interval.high) if not math.isnan(end))
            if not all(0 <= x < HIGHEST_ERROR for x in (interval.mean, *ends)):
                raise ContactLearnError(f"{name} must be a number, 0 or more, and less than {HIGHEST_ERROR:g}")


def metrics_of(model: str, norm: Norm) -> tuple[str, ...]:
    """Return the metrics in which a model is judged: all of them, or for a bound of a norm those that it bounds."""
    return bounded_metrics(norm) if model in (BEST_POST_HOC, IRB) else tuple(METRICS)


# --- Training -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class HeldOutResult(ABC):
    """Models and their errors on the held-out trials, of a training or an evaluation.

    Args:
        provenance: of the run.
        model: name in `errors` of the model that the run is compared with others by.
        law: that it is, or builds on; None for a model without a law.
        effects: around the law.
        norm: in which the bounds come closest; it decides the metric by which models are compared.
        fits: laws, identified from random subsets.
        joint: the law alone and with its effects, by name, where there are effects.
        errors: of all models and of both bounds.
        back_spin: share of the measured outcomes beyond the line of sticking.

    Raises:
        ContactLearnError: a model without errors, or errors without the metric.
    """

    kind: RunKind
    format: int = FORMAT
    provenance: Provenance
    model: str
    law: str | None
    effects: tuple[EffectId, ...]
    norm: Norm
    fits: tuple[LawEstimate, ...]
    joint: Mapping[str, JointEstimate]
    errors: Mapping[str, ModelErrors]
    back_spin: float

    def __post_init__(self) -> None:
        self._check(self.model)
        for errors in self.errors.values():
            errors.of(self.metric)

    def _check(self, *models: str) -> None:
        """Refuse the names of models without errors."""
        for model in models:
            if model not in self.errors:
                known = ", ".join(self.errors) or "none"
                raise ContactLearnError(f"a model must be one of those in errors ({known}), got {model}")

    @property
    def metric(self) -> str:
        """The metric by which models are compared."""
        return headline_metric(self.norm)


@dataclass(frozen=True, kw_only=True)
class Training(HeldOutResult):
    """A trained model and its errors; the model itself is the checkpoint beside the file.

    `fits` holds the law of a model without effects; `errors` has the model behind its law or the models in `joint`.

    Args:
        learned: name of the learned model in the configuration; None for a law, with effects or without.
        trained_on: trials of the subset.
        equation: the model as text.
        processes: Gaussian processes of a learned model, one an output.
        processes_kind: `exact` or `sparse`; None without processes.
    """

    kind: RunKind = RunKind.TRAINING
    learned: str | None
    trained_on: int
    equation: str
    processes: tuple[ProcessEstimate, ...]
    processes_kind: str | None


# --- Evaluation -----------------------------------------------------------------------------------


BEST_POST_HOC, IRB = "best_post_hoc", "irb"
"""Names of the bounds among the errors."""


@dataclass(frozen=True, kw_only=True)
class CurveCalibration:
    """Quality of the predicted covariances of a model, at each size of its learning curve.

    Args:
        processes: kind of the Gaussian processes, `exact` or `sparse`.
        converged: share of the processes with a training that settled.
        negative_log_density: mean −log density of the measured v_post, in nats.
        coverage: share of trials inside the predicted 95 % ellipsoid.
        component_coverage: share of trials with each component of the velocity inside its 95 % interval.
    """

    processes: tuple[str, ...]
    converged: tuple[float, ...]
    negative_log_density: tuple[float, ...]
    coverage: tuple[float, ...]
    component_coverage: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class LearningCurve(ErrorsByMetric[tuple[Interval, ...]]):
    """Errors of one model against the number of training trials; intervals are over trials and subsets.

    Args:
        sizes: numbers of training trials, increasing.
        mass_error: one entry a size, as the other errors, see `evaluation.metrics`.
        euclidean_error: as `mass_error`.
        normalised_euclidean_error: as `mass_error`.
        velocity_error: as `mass_error`.
        below: by metric and bound of it, the least size at which the mean is below the bound; None if it never is.
        settled: by metric, the size from which on the mean stays near its least; None if it has not settled.
        calibration: of the predicted covariances; None for a model that predicts none.

    Raises:
        ContactLearnError: errors that are not one a size.
    """

    sizes: tuple[int, ...]
    below: Mapping[str, Mapping[str, int | None]]
    settled: Mapping[str, int | None]
    calibration: CurveCalibration | None = None

    def __post_init__(self) -> None:
        for errors in self.intervals.values():
            if len(errors) != len(self.sizes):
                raise ContactLearnError(f"{len(self.sizes)} sizes and {len(errors)} errors must be as many")


@dataclass(frozen=True, kw_only=True)
class JudgedModel:
    """A trained model from a file, judged as it is.

    Args:
        path: of the file.
        sha256: of its content.
        data: that it was trained on; None where the file does not state it.
        trained_on: number of training trials; None as `data`.
        equation: the model as text.
        coverage: share of the held-out (v_x, v_y, ω) inside its 95 % ellipsoids; None for a model without covariances.
        negative_log_density: mean −log density of them, in nats; None as `coverage`.
    """

    path: str
    sha256: str
    data: DataSource | None
    trained_on: int | None
    equation: str
    coverage: float | None
    negative_log_density: float | None


@dataclass(frozen=True, kw_only=True)
class Evaluation(HeldOutResult):
    """Models side by side on the held-out trials.

    Args:
        reach: by law, the mean share of the admissible impulses that it gives with some μ and ε in [0, 1].
        best: name in `errors` of the model with the least error, bounds aside.
        differences: error of each other model less that of the best, paired by trial; the smallest first.
        tables: format of the tables beside the file.
        shape: of the bodies, as `bodies.make_shapes` reads it; None where it is not known.
        trained: models from checkpoints, by name in `errors`.
        learning_curves: by model.
    """

    kind: RunKind = RunKind.EVALUATION
    reach: Mapping[str, float]
    best: str
    differences: Mapping[str, Interval]
    tables: Literal["parquet", "csv"]
    shape: Mapping[str, Any] | None
    trained: Mapping[str, JudgedModel] = field(default_factory=dict)
    learning_curves: Mapping[str, LearningCurve] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check(self.best, *self.differences, *(fit.law for fit in self.fits), *self.joint, *self.trained)
        if not self.fits:
            raise ContactLearnError("fits must hold at least one law")
        super().__post_init__()


# --- Transfer -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class BodyTransfer:
    """Headline error of a model on another body.

    Args:
        zero_shot: as trained, without a trial of the body; one entry.
        prior: the trained model with processes on its residual, against `Transfer.sizes`.
        scratch: the same recipe trained on the body's trials alone, against `Transfer.sizes`.
    """

    zero_shot: tuple[Interval, ...]
    prior: tuple[Interval, ...]
    scratch: tuple[Interval, ...]


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Learning curves on other bodies, by model and body; `sizes` are numbers of trials of the body.

    `norm` decides the metric, as that of an evaluation.
    """

    kind: RunKind = RunKind.TRANSFER
    format: int = FORMAT
    provenance: Provenance
    norm: Norm
    sizes: tuple[int, ...]
    transfer: Mapping[str, Mapping[str, BodyTransfer]]


# --- Diagnosis ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DiagnosisRun:
    """A diagnosis as diagnosis.json holds it; its record of impacts and models lies beside the file.

    `use` is the command that evaluates the diagnosed model on the same data, `headline` the verdict in one sentence.
    """

    kind: RunKind = RunKind.DIAGNOSIS
    format: int = FORMAT
    provenance: Provenance
    use: str
    headline: str = ""
    diagnosis: Diagnosis
