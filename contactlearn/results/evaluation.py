"""Result of an evaluation: laws and learned models beside the bounds, and learning curves."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import HEADLINE, Interval
from contactlearn.results.estimates import JointEstimate, LawEstimate, ModelErrors, known_model
from contactlearn.results.provenance import FORMAT, Provenance, RunKind

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
        component_coverage: share of trials with each of (v_x, v_y, ω) inside its 95 % interval.
    """

    processes: tuple[str, ...]
    converged: tuple[float, ...]
    negative_log_density: tuple[float, ...]
    coverage: tuple[float, ...]
    component_coverage: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """Errors of one model against the number of training trials; intervals are over trials and subsets.

    Args:
        sizes: numbers of training trials, increasing.
        mass_error: one entry a size, as the other errors, see `evaluation.metrics`.
        normalised_velocity_error: as `mass_error`.
        velocity_error: as `mass_error`.
        below: by metric and bound, the least size at which the mean is below the bound; None if it never is.
        settled: by metric, the size from which on the mean stays near its least; None if it has not settled.
        calibration: of the predicted covariances; None for a model that predicts none.

    Raises:
        ContactLearnError: errors that are not one a size.
    """

    sizes: tuple[int, ...]
    mass_error: tuple[Interval, ...]
    normalised_velocity_error: tuple[Interval, ...]
    velocity_error: tuple[Interval, ...]
    below: Mapping[str, Mapping[str, int | None]]
    settled: Mapping[str, int | None]
    calibration: CurveCalibration | None = None

    def __post_init__(self) -> None:
        if any(len(self.of(name)) != len(self.sizes) for name in ("mass_error", "velocity_error")):
            raise ContactLearnError(f"{len(self.sizes)} sizes and {len(self.mass_error)} errors must be as many")

    def of(self, metric: str) -> tuple[Interval, ...]:
        """The errors by a metric's name in `METRICS`."""
        return getattr(self, metric)

    @property
    def headline(self) -> tuple[Interval, ...]:
        """The errors by which models are compared."""
        return self.of(HEADLINE)


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Models side by side on the held-out trials.

    Args:
        provenance: of the run.
        model: name in `errors` of the model that the run is compared with others by.
        law: that it is, or builds on.
        effects: around the law.
        norm: in which the bounds come closest.
        fits: the laws, identified from random subsets.
        joint: the law alone and with its effects, by name, where there are effects.
        errors: of all models and of both bounds.
        best: name in `errors` of the model with the least mass error, bounds aside.
        differences: mass error of each other model less that of the best, paired by trial; the smallest first.
        tables: format of the tables beside the file.
        shape: of the bodies, as `bodies.make_shapes` reads it; None where it is not known.
        learning_curves: by model.
    """

    kind: RunKind = RunKind.EVALUATION
    format: int = FORMAT
    provenance: Provenance
    model: str
    law: str
    effects: tuple[EffectId, ...]
    norm: str
    fits: tuple[LawEstimate, ...]
    joint: Mapping[str, JointEstimate]
    errors: Mapping[str, ModelErrors]
    best: str
    differences: Mapping[str, Interval]
    tables: Literal["parquet", "csv"]
    shape: Mapping[str, Any] | None
    learning_curves: Mapping[str, LearningCurve] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in (self.model, self.best, *self.differences, *(fit.law for fit in self.fits), *self.joint):
            known_model(name, self.errors)
        if not self.fits:
            raise ContactLearnError("fits must hold at least one law")
