"""Events of a run on the terminal, and the verdict of a diagnosis at its end."""

import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from contactlearn.diagnosis.events import (
    FILE,
    AuditFindings,
    CandidatesExcluded,
    CurvePoint,
    EffectsFound,
    Event,
    FormulasSkipped,
    LawChanged,
    LawsCompared,
    LearningProgress,
    LimitsEstimated,
    OnEvent,
    RegionsFound,
    RemainderLearned,
    RoundScored,
    SampleConfirmed,
    SubsampleStarted,
    TaskProgress,
    TrainingRound,
    VelocitiesAveraged,
    append_event,
    ignore,
)
from contactlearn.diagnosis.result import Diagnosis, Finding, Verdict
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.terminal import console, print_line
from contactlearn.report.text import (
    base_label,
    error,
    formula_overrides,
    headline,
    listed_models,
    listed_name,
    misfit,
    phrase,
    phrases,
    rung_label,
    search_notes,
    searched_name,
    sentence,
    share_of_whole,
)

_LONG = 5.0  # s after which a task is named where no bar is seen


class TerminalObserver:
    """Print the results among the events, and count long tasks on a display if there is one.

    Without a terminal that can show bars, a task that takes long is named once.
    """

    def __init__(self, display: Progress | None = None) -> None:
        self._display, self._tasks = display, dict[str, TaskID]()
        self._began = dict[str, float]()

    def __call__(self, event: Event) -> None:
        """Show an event."""
        if isinstance(event, TaskProgress) and self._display is not None:
            if event.done == 0:
                self._tasks[event.task] = self._display.add_task(event.task, total=event.total)
                self._began[event.task] = time.monotonic()
            self._display.update(self._tasks[event.task], completed=event.done, total=event.total)
            waited = event.done and time.monotonic() - self._began.get(event.task, time.monotonic()) > _LONG
            if waited and not self._display.console.is_terminal:
                del self._began[event.task]
                print_line(f"{event.task} …")
        for line in event_lines(event):
            print_line(line)


@contextmanager
def progress(folder: Path | None = None, tracker: OnEvent = ignore) -> Generator[OnEvent]:
    """Show events on the terminal, with bars that disappear at the end.

    Args:
        folder: of the run, whose `progress.jsonl` the events are appended to; None writes no file.
        tracker: receives them too.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as display:
        show = TerminalObserver(display)

        def on_event(event: Event) -> None:
            show(event)
            if folder is not None:
                append_event(folder / FILE, event)
            tracker(event)

        yield on_event


def event_lines(event: Event) -> list[str]:
    """Describe an event in lines of text; none for bare progress, and for what the verdict describes."""
    match event:
        case AuditFindings():
            return [_finding_line("audit", one) for one in event.findings] or [f"audit: {phrase('consistent')}"]
        case SubsampleStarted():
            return [f"sample: {phrase('step', event)}"]
        case LawsCompared():
            return [f"law: {phrase('laws', event.law, event.fits)}"]
        case CandidatesExcluded():
            return [f"note: {phrase('left_out', event.candidates)}"]
        case VelocitiesAveraged():
            return [_finding_line("note", one) for one in event.findings]
        case LimitsEstimated():
            return [f"budget: {phrase('limits', event.limits)}"]
        case RegionsFound():
            return [f"region: {phrase('region', one)}" for one in event.regions] or [f"region: {phrase('no_region')}"]
        case LawChanged():
            return [f"law: {phrase('law_changed', event.law)}"]
        case EffectsFound():
            lines: list[str] = []
            for effect in event.effects:
                lines.append(f"missing: {phrase('missing_effect', effect)}")
                lines += [f"  {improvement}" for improvement in phrases("improvements", effect, event.regions)]
            return lines
        case FormulasSkipped():
            return [f"note: no formulas for the residual: {event.reason}"]
        case SampleConfirmed():
            return [f"all trials: {one}" for one in phrases("sample_summary", event.sample)]
        case TaskProgress() | RemainderLearned() | TrainingRound() | RoundScored() | CurvePoint() | LearningProgress():
            return []


def _finding_line(kind: str, finding: Finding) -> str:
    """Describe a finding, and its correction if it is corrected."""
    return f"{kind}: {sentence(finding.sentence)} {phrase('correction_note', finding)}".rstrip()


def show_verdict(found: Diagnosis, command: str) -> None:
    """Print rivals, the next experiment, the residual, the ladder and the verdict.

    Args:
        found: the diagnosis.
        command: that evaluates the model with the missing effects.
    """
    for model in found.frontier:
        print_line(f"frontier: {_error_columns(model.error)}  {searched_name(found, model)}")
    for model in listed_models(found):
        print_line(f"model: {share_of_whole(model.share)}  {listed_name(found, model)}")
    for note in search_notes(found):
        print_line(f"note: {note}")
    for missing in found.missing:
        if missing.rivals:
            print_line(f"rivals: {phrase('rivals', missing)}")
    if found.experiment is not None:
        for drop in found.experiment.drops:
            print_line(f"next experiment: {phrase('drop', drop, found.experiment)}")
        for separation in found.experiment.separations:
            print_line(f"next experiment: {phrase('needed_drops', separation)}")
    if found.remainder is not None:
        print_line(f"residual: {' '.join(phrases('residual', found.remainder))}")
    for formula in found.formulas:
        print_line(f"formula: {phrase('formula_change', formula)}: {formula_overrides(formula)}")
    for rung in found.ladder:
        print_line(f"  {_error_columns(rung.error)}  {rung_label(rung, base_label(found))}")
    if found.budget is not None:
        print_line(f"budget: {phrase('noise', found.budget)} {phrase('shares', found.budget)}")
    if found.equation:
        print_line(found.equation)
    print_line(f"verdict: {headline(found)}")
    if misfit(found):
        print_line(f"note: {misfit(found)}")
    if found.better_law is not None and found.physics is not Verdict.UNKNOWN:  # whose headline says it
        print_line(f"note: {phrase('better_law', found)}")
    if found.missing:
        print_line(f"to use it: {command}")


def _error_columns(x: Interval) -> str:
    """Write a mean error and its 95 % interval in columns."""
    mean, low, high = map(error, x)
    return f"{mean}  {low}–{high}"
