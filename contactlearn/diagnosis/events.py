"""Progress of a diagnosis as typed events, and every event that a command writes to its run folder.

Terminal, workbench and tests consume the same types.  For example

    def on_event(event: Event) -> None:
        if isinstance(event, EffectsFound):
            print(event.effects)

    diagnose(impacts, on_event=on_event)

The commands also append their events to `progress.jsonl` in the run folder, one JSON object per line, so that another
process can follow a run: `read_events` decodes them.
"""

from pathlib import Path
from typing import Protocol, TypeAlias

import msgspec

from contactlearn.core.events import EventBase, TaskProgress
from contactlearn.diagnosis.result import ErrorLimits, Finding, LawFit, MissingEffect, Region, Remainder, Sample
from contactlearn.effects import EffectId
from contactlearn.inference.learning.events import CurvePoint, LearningProgress, RoundScored, TrainingRound

FILE = "progress.jsonl"
"""Name of the file of events in a run folder."""


class AuditFindings(EventBase, frozen=True, kw_only=True):
    """The audit, or a later stage, has findings about the measurements; empty if the audit has none."""

    findings: tuple[Finding, ...]


class SubsampleStarted(EventBase, frozen=True, kw_only=True):
    """The next subsample of a large table is diagnosed; the following events are about it.

    Args:
        trials: of the subsample.
        table_trials: of the whole table.
        objects: of the whole table.
        objects_seen: of the subsample.
        seconds: estimated computing time.
        gigabytes: estimated memory.
        resumed: an earlier run has diagnosed this subsample, and its result is reused.
    """

    trials: int
    table_trials: int
    objects: int
    objects_seen: int
    seconds: float
    gigabytes: float
    resumed: bool = False


class LawsCompared(EventBase, frozen=True, kw_only=True):
    """The held-out errors of all laws are known; `law` is the given one, or else the best."""

    law: str
    fits: tuple[LawFit, ...]


class CandidatesExcluded(EventBase, frozen=True, kw_only=True):
    """These candidate effects cannot be decided: they need a body's shape, or more trials."""

    candidates: tuple[EffectId, ...]


class MeasurementsReplaced(EventBase, frozen=True, kw_only=True):
    """Velocities before impact are replaced by their means, or contact points by those of the shape."""

    findings: tuple[Finding, ...]


class LimitsEstimated(EventBase, frozen=True, kw_only=True):
    """The errors of the law, of the flexible ceiling and of the rigid bound are known; again if the law changes."""

    limits: ErrorLimits


class RegionsFound(EventBase, frozen=True, kw_only=True):
    """The regions in which the law fails are known; again if the law changes."""

    regions: tuple[Region, ...]


class LawChanged(EventBase, frozen=True, kw_only=True):
    """With the effects, this law predicts better than the one chosen before."""

    law: str


class EffectsFound(EventBase, frozen=True, kw_only=True):
    """The missing effects, without rivals so far, and the regions that they improve."""

    effects: tuple[MissingEffect, ...]
    regions: tuple[Region, ...]


class RemainderLearned(EventBase, frozen=True, kw_only=True):
    """The predictable part of the residual of the full model."""

    remainder: Remainder


class FormulasSkipped(EventBase, frozen=True, kw_only=True):
    """The search for formulas of the predictable residual is skipped."""

    reason: str


class SampleConfirmed(EventBase, frozen=True, kw_only=True):
    """The result on the last subsample has been tested on all trials of a large table."""

    sample: Sample


Event: TypeAlias = (
    TaskProgress
    | AuditFindings
    | SubsampleStarted
    | LawsCompared
    | CandidatesExcluded
    | MeasurementsReplaced
    | LimitsEstimated
    | RegionsFound
    | LawChanged
    | EffectsFound
    | RemainderLearned
    | FormulasSkipped
    | SampleConfirmed
    | TrainingRound
    | RoundScored
    | CurvePoint
    | LearningProgress
)
"""Any event."""


class OnEvent(Protocol):
    """Consumer of events."""

    def __call__(self, event: Event, /) -> None:
        """Take one event."""
        ...


_decoder = msgspec.json.Decoder(Event)


def append_event(path: Path, event: Event) -> None:
    """Append an event to a file as one line of JSON."""
    with path.open("ab") as file:
        file.write(msgspec.json.encode(event) + b"\n")


def read_events(path: Path) -> list[Event]:
    """Read the events of a file; a last line without an end is still being written.

    Raises:
        msgspec.ValidationError: a line is no event.
    """
    lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
    return [_decoder.decode(line) for line in lines]
