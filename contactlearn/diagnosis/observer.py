"""Observer of a diagnosis: hears of each stage's result as soon as it is known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

from contactlearn.diagnosis.result import ErrorLimits, Finding, LawFit, MissingEffect, Region, Sample
from contactlearn.effects import EffectId

Item = TypeVar("Item")


class Task(StrEnum):
    """Parts of a diagnosis that take long."""

    LAWS = "laws"
    EFFECTS = "effects"
    RIVALS = "rivals"
    CHOICES = "choices"


@dataclass(frozen=True, kw_only=True)
class Step:
    """A subsample of a large table that is diagnosed next.

    Args:
        trials: of the subsample.
        of: trials of the table.
        objects: of the table.
        objects_seen: of the subsample.
        seconds: that it will take, about.
        gigabytes: of memory, likewise.
        kept: whether a run that was stopped has diagnosed it, so that nothing of that is done again.
    """

    trials: int
    of: int
    objects: int
    objects_seen: int
    seconds: float
    gigabytes: float
    kept: bool = False


class Observer:
    """Ignores everything; override the methods of interest.  They are called in the order in which they stand here."""

    def audit(self, findings: Sequence[Finding]) -> None:
        """Receive the findings about the measurements; empty where there are none."""

    def step(self, step: Step) -> None:
        """Receive the subsample that the following stages are about; not called for tables that are diagnosed whole."""

    def laws(self, law: str, laws: Sequence[LawFit]) -> None:
        """Receive the name of the law, given or chosen, and the held-out errors of all laws."""

    def left_out(self, candidates: Sequence[EffectId]) -> None:
        """Receive candidates that are refused: they need a body's shape, or more trials."""

    def averaging(self, notes: Sequence[Finding]) -> None:
        """Receive the velocities that are replaced by their means; not called without any."""

    def limits(self, limits: ErrorLimits) -> None:
        """Receive the errors of the law, of the ceiling and of the rigid bound; again if the law changes."""

    def regions(self, regions: Sequence[Region]) -> None:
        """Receive the regions in which the law fails; again if the law changes."""

    def law_changed(self, law: str) -> None:
        """Receive the name of the law that does better with the effects than the one chosen before."""

    def missing(self, effects: Sequence[MissingEffect], regions: Sequence[Region]) -> None:
        """Receive the missing effects, rivals not yet among them, and the regions of their improvements."""

    def no_formulas(self, reason: str) -> None:
        """Receive why no formulas were sought for the predictable residual."""

    def confirmed(self, sample: Sample) -> None:
        """Receive the subsamples and the test on all trials; not called for tables that are diagnosed whole."""

    def progress(self, task: Task, items: Iterable[Item]) -> Iterable[Item]:
        """Return the items of a long task, perhaps counted on the way."""
        return items
