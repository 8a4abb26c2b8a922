"""Options of a diagnosis; `Thresholds` holds the limits of its decisions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId
from contactlearn.laws import Law


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions:
    """What a diagnosis may consider, what is known already, and what it may cost."""

    candidates: Mapping[EffectId, Effect] | None = None
    """Effects that may be missing; the whole catalogue if None.  `candidates.usable` refuses some."""
    laws: Sequence[Law] | None = None
    """Laws to compare; all of the catalogue that exist in the plane, or in space, if None."""
    noise: tuple[float, ...] | None = None
    """Standard deviations of the measured velocities in m/s and rad/s, three or in space six, where known."""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Limits of the set-up for the next experiment, see `next_experiment`."""
    seed: int = 0
    """Seed of folds, subsamples and resamples."""
    seconds: float = 60.0
    """Processor time of the search in s; after it the fitted models decide, and the result is incomplete."""
    memory: float | None = None
    """Bytes that the diagnosis may take; a large table is diagnosed on subsamples that need no more."""
    resume_folder: Path | None = None
    """Folder for the results of finished subsamples, which a later run of the same question reuses."""
    thresholds: Thresholds = field(default_factory=Thresholds)
    """Limits of every decision."""

    def __post_init__(self) -> None:
        """Refuse a time that is none."""
        if not self.seconds > 0:  # infinite is no limit
            raise ContactLearnError(f"seconds must be a positive number of seconds, got {self.seconds!r}")
