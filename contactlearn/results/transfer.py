"""Result of a transfer: models trained on one body, on other bodies."""

from collections.abc import Mapping
from dataclasses import dataclass

from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.results.provenance import FORMAT, Provenance, RunKind


@dataclass(frozen=True, kw_only=True)
class BodyTransfer:
    """Mass error of a model on another body.

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
    """Learning curves on other bodies, by model and body; `sizes` are numbers of trials of the body."""

    kind: RunKind = RunKind.TRANSFER
    format: int = FORMAT
    provenance: Provenance
    sizes: tuple[int, ...]
    transfer: Mapping[str, Mapping[str, BodyTransfer]]
