"""Progress of a diagnosis, a training or an evaluation, as typed events.

A function that takes long calls `on_event` with one event for each result and for each step of a long task.  Terminal,
workbench and tests consume the same types.  For example

    def on_event(event: Event) -> None:
        if isinstance(event, EffectsFound):
            print(event.effects)

    diagnose(impacts, on_event=on_event)

The commands also append their events to `progress.jsonl` in the run folder, one JSON object per line, so that another
process can follow a run: `read_events` decodes them.
"""

import time
from collections.abc import Iterable, Iterator, Sized
from pathlib import Path
from typing import Protocol, TypeAlias, TypeVar

import msgspec

from contactlearn.diagnosis.result import ErrorLimits, Finding, LawFit, MissingEffect, Region, Remainder, Sample
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval

FILE = "progress.jsonl"
"""Name of the file of events in a run folder."""
_INTERVAL = 0.1  # s between two events of a task
_Item = TypeVar("_Item")


class _Event(msgspec.Struct, frozen=True, tag_field="event"):
    """Common base: immutable, written to JSON with the name of its class."""


class TaskProgress(_Event, frozen=True, kw_only=True):
    """Progress of a long task: `done` steps of `total`; `total` is None while it is unknown."""

    task: str
    done: int
    total: int | None


class AuditFindings(_Event, frozen=True, kw_only=True):
    """The audit, or a later stage, has findings about the measurements; empty if the audit has none."""

    findings: tuple[Finding, ...]


class SubsampleStarted(_Event, frozen=True, kw_only=True):
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


class LawsCompared(_Event, frozen=True, kw_only=True):
    """The held-out errors of all laws are known; `law` is the given one, or else the best."""

    law: str
    fits: tuple[LawFit, ...]


class CandidatesExcluded(_Event, frozen=True, kw_only=True):
    """These candidate effects cannot be decided: they need a body's shape, or more trials."""

    candidates: tuple[EffectId, ...]


class VelocitiesAveraged(_Event, frozen=True, kw_only=True):
    """Some measured velocities are replaced by their means."""

    findings: tuple[Finding, ...]


class LimitsEstimated(_Event, frozen=True, kw_only=True):
    """The errors of the law, of the flexible ceiling and of the rigid bound are known; again if the law changes."""

    limits: ErrorLimits


class RegionsFound(_Event, frozen=True, kw_only=True):
    """The regions in which the law fails are known; again if the law changes."""

    regions: tuple[Region, ...]


class LawChanged(_Event, frozen=True, kw_only=True):
    """With the effects, this law predicts better than the one chosen before."""

    law: str


class EffectsFound(_Event, frozen=True, kw_only=True):
    """The missing effects, without rivals so far, and the regions that they improve."""

    effects: tuple[MissingEffect, ...]
    regions: tuple[Region, ...]


class RemainderLearned(_Event, frozen=True, kw_only=True):
    """The predictable part of the residual of the full model."""

    remainder: Remainder


class FormulasSkipped(_Event, frozen=True, kw_only=True):
    """The search for formulas of the predictable residual is skipped."""

    reason: str


class SampleConfirmed(_Event, frozen=True, kw_only=True):
    """The result on the last subsample has been tested on all trials of a large table."""

    sample: Sample


class TrainingRound(_Event, frozen=True, kw_only=True):
    """A model after a round of its training: loss in nats a trial and hyperparameters, by output.

    Args:
        model: its name.
        trained_on: number of training trials.
        round: counted from 1.
        loss: of each output.
        noise: standard deviation, in the output's unit.
        length_scales: by feature, in standard deviations of the feature.
    """

    model: str
    trained_on: int
    round: int
    loss: dict[str, float]
    noise: dict[str, float]
    length_scales: dict[str, dict[str, float]]


class RoundScored(_Event, frozen=True, kw_only=True):
    """Held-out trials by a model after a round of its training: mean errors by metric, mean −log density in nats."""

    model: str
    trained_on: int
    round: int
    errors: dict[str, float]
    negative_log_density: float


class CurvePoint(_Event, frozen=True, kw_only=True):
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


class LearningProgress(_Event, frozen=True, kw_only=True):
    """Models are trained on subsets: held-out errors so far by model, each with its number of training trials."""

    done: int
    total: int
    errors: dict[str, tuple[tuple[int, Interval], ...]]


Event: TypeAlias = (
    TaskProgress
    | AuditFindings
    | SubsampleStarted
    | LawsCompared
    | CandidatesExcluded
    | VelocitiesAveraged
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


def ignore(event: Event) -> None:
    """Consume an event without effect."""


def track(items: Iterable[_Item], task: str, on_event: OnEvent, total: int | None = None) -> Iterator[_Item]:
    """Yield the items of a long task, and report how many are done.

    Args:
        items: steps of the task.
        task: its name for the user.
        on_event: receives a `TaskProgress` at the beginning, at the end, and at most every 0.1 s in between.
        total: number of items if they have no length.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    done, latest = 0, time.monotonic()
    on_event(TaskProgress(task=task, done=0, total=total))
    for done, item in enumerate(items, 1):
        yield item
        if time.monotonic() - latest > _INTERVAL:
            latest = time.monotonic()
            on_event(TaskProgress(task=task, done=done, total=total))
    on_event(TaskProgress(task=task, done=done, total=done))


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
