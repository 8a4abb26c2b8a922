"""Result of a training: one model from one random subset, and its errors on the held-out trials."""

from collections.abc import Mapping
from dataclasses import dataclass

from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.results.estimates import JointEstimate, LawEstimate, ModelErrors, ProcessEstimate, known_model
from contactlearn.results.provenance import FORMAT, Provenance, RunKind


@dataclass(frozen=True, kw_only=True)
class Training:
    """One trained model; the model itself is the checkpoint beside the file.

    Args:
        provenance: of the run.
        model: its name in `errors`.
        learned: name of the learned model in the configuration; None for a law, with effects or without.
        law: that the model builds on; None for a model without a law.
        effects: around the law.
        trained_on: trials of the subset.
        equation: the model as text.
        fits: the law of a model without effects.
        joint: the law alone and with its effects, by name, where there are effects.
        errors: of the model, after those of the laws in `joint`.
        irb: error of the ideal rigid-body bound on the same trials.
        processes: Gaussian processes of a learned model, one an output.
        processes_kind: `exact` or `sparse`; None without processes.
    """

    kind: RunKind = RunKind.TRAINING
    format: int = FORMAT
    provenance: Provenance
    model: str
    learned: str | None
    law: str | None
    effects: tuple[EffectId, ...]
    trained_on: int
    equation: str
    fits: tuple[LawEstimate, ...]
    joint: Mapping[str, JointEstimate]
    errors: Mapping[str, ModelErrors]
    irb: Interval
    processes: tuple[ProcessEstimate, ...]
    processes_kind: str | None

    def __post_init__(self) -> None:
        known_model(self.model, self.errors)
