"""Events of a run on the terminal, and the verdict of a diagnosis at its end."""

import time
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from contactlearn.core.events import TaskProgress, ignore
from contactlearn.diagnosis import events
from contactlearn.diagnosis.events import FILE, Event, OnEvent, append_event
from contactlearn.diagnosis.result import Diagnosis, Finding, Verdict
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.terminal import console, print_line
from contactlearn.report.text.names import base_label, rung_label, sentence
from contactlearn.report.text.numbers import error, share_of_whole
from contactlearn.report.text.sentences import (
    formula_overrides,
    headline,
    listed_candidates,
    listed_models,
    listed_name,
    misfit,
    phrase,
    phrases,
    searched_name,
    set_up,
    undecided,
)

_CAVEATS = (
    "one_state", "constant_columns", "narrow_speed", "sorted_trials", "spin_not_measured", "energy_gained",
    "uneven_covariances",
)  # fmt: skip
"""Notes that limit what a verdict can say."""
_LONG = 5.0  # s after which a task is named where no bar is seen


class TerminalObserver:
    """Log the results among the events, and print them if `verbose`; count long tasks on a display if there is one.

    Without a terminal that can show bars, a task that takes long is named once.
    """

    def __init__(self, display: Progress | None = None, *, verbose: bool = False) -> None:
        self._display, self._tasks, self._verbose = display, dict[str, TaskID](), verbose
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
            print_line(line, shown=self._verbose)


@contextmanager
def progress(folder: Path | None = None, tracker: OnEvent = ignore, *, verbose: bool = False) -> Generator[OnEvent]:
    """Show events on the terminal, with bars that disappear at the end.

    Args:
        folder: of the run, whose `progress.jsonl` the events are appended to; None writes no file.
        tracker: receives them too.
        verbose: whether results among the events are printed, or only logged.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    display = Progress(*columns, console=console, transient=True)
    with display if console.is_interactive else nullcontext():  # which writes an empty line where no bar is seen
        show = TerminalObserver(display, verbose=verbose)

        def on_event(event: Event) -> None:
            show(event)
            if folder is not None:
                append_event(folder / FILE, event)
            tracker(event)

        yield on_event


def event_lines(event: Event) -> list[str]:
    """Describe an event in lines of text; none for progress, numbers of trainings, and what the verdict describes."""
    match event:
        case events.AuditFindings():
            return [_finding_line("audit", finding) for finding in event.findings]
        case events.SubsampleStarted():
            return [f"sample: {phrase('step', event)}"]
        case events.LawsCompared():
            return [f"law: {phrase('laws', event.law, event.fits)}"]
        case events.CandidatesExcluded():
            return [f"note: {phrase('left_out', event.candidates)}"]
        case events.MeasurementsReplaced():
            return [_finding_line("note", finding) for finding in event.findings]
        case events.LimitsEstimated():
            return [f"budget: {phrase('limits', event.limits)}"]
        case events.RegionsFound():
            return [f"region: {phrase('region', one)}" for one in event.regions] or [f"region: {phrase('no_region')}"]
        case events.LawChanged():
            return [f"law: {phrase('law_changed', event.law)}"]
        case events.EffectsFound():
            lines: list[str] = []
            for effect in event.effects:
                lines.append(f"missing: {phrase('missing_effect', effect)}")
                lines += [f"  {improvement}" for improvement in phrases("improvements", effect, event.regions)]
            return lines
        case events.FormulasSkipped():
            return [f"note: no formulas for the residual: {event.reason}"]
        case events.SampleConfirmed():
            return [f"all trials: {one}" for one in phrases("sample_summary", event.sample)]
        case _:
            return []


def _finding_line(kind: str, finding: Finding) -> str:
    """Describe a finding, and its correction if it is corrected."""
    grounds = sentence(finding.grounds) if finding.grounds else ""
    return (
        f"{kind}: {' '.join(filter(None, (sentence(finding.sentence), grounds, phrase('correction_note', finding))))}"
    )


def show_verdict(diagnosis: Diagnosis, *, verbose: bool = False) -> None:
    """Print the verdict, its size, names and parameters, what is undecided, and the next experiment.

    Args:
        diagnosis: the diagnosis.
        verbose: whether the search, the residual and the model as an equation are printed before, or only logged.
    """
    for line in _detail_lines(diagnosis):
        print_line(line, shown=verbose)
    for line in _verdict_lines(diagnosis):
        print_line(line)


def _verdict_lines(diagnosis: Diagnosis) -> list[str]:
    """The verdict and what it rests on, a line each."""
    verdict = headline(diagnosis)
    more = [one for one in phrases("qualifications", diagnosis) if one.rstrip(".").lower() not in verdict.lower()]
    lines = [f"verdict: {verdict}", *(f"  {one}" for one in more)]
    if diagnosis.ladder and diagnosis.budget is not None:
        lines.append(f"error: {phrase('size', diagnosis)}")
    if diagnosis.coefficients:
        lines.append(f"law: {phrase('coefficients', diagnosis)}")
    if measured := set_up(diagnosis):
        lines.append(f"set-up: {measured}")
    lines += [f"{effect.level}: {phrase('named', effect)}" for effect in diagnosis.missing]
    if candidates := listed_candidates(diagnosis):
        lines.append(f"candidates: {phrase('candidates', candidates)}")
    if equal := undecided(diagnosis):
        lines.append(f"cannot distinguish: {'; '.join(equal)}")
    said = (one for one in diagnosis.findings if one.correction or one.mistake)
    lines += [f"audit: {sentence(one.sentence)}" for one in said]
    if diagnosis.corrections:
        rig = ["rig"] if any(finding.name == "rig_applied" for finding in diagnosis.findings) else []
        lines.append(f"audit: {phrase('corrected', [*rig, *diagnosis.corrections])}")
    if diagnosis.experiment is not None:
        lines.append(f"next experiment: {phrase('next_experiment', diagnosis.experiment)}")
    if diagnosis.sample is not None:
        lines.append(f"sample: {phrase('sample_support', diagnosis.sample)}")
    notes = [phrase("unwanted", diagnosis), misfit(diagnosis)]
    notes += [sentence(one.sentence) for one in diagnosis.findings if one.name in _CAVEATS and not one.mistake]
    if diagnosis.physics is not Verdict.UNKNOWN:  # whose verdict says it
        notes.append(phrase("better_law", diagnosis))
    return lines + [f"note: {note}" for note in notes if note]


def _detail_lines(diagnosis: Diagnosis) -> list[str]:
    """The search, candidates, the next experiment, the residual, the ladder, the budget and the model."""
    lines = [
        f"frontier: {_error_columns(model.error)}  {searched_name(diagnosis, model)}" for model in diagnosis.frontier
    ]
    lines += [
        f"model: {share_of_whole(model.share)}  {listed_name(diagnosis, model)}" for model in listed_models(diagnosis)
    ]
    lines += [f"note: {note}" for note in phrases("notes", diagnosis)]
    lines += [f"candidate: {phrase('candidate', candidate)}" for candidate in listed_candidates(diagnosis)]
    if diagnosis.experiment is not None:
        lines += [f"next experiment: {phrase('drop', one, diagnosis.experiment)}" for one in diagnosis.experiment.drops]
        lines += [f"next experiment: {text}" for text in phrases("needed_drops", diagnosis.experiment)]
    if diagnosis.remainder is not None:
        lines.append(f"residual: {' '.join(phrases('residual', diagnosis.remainder))}")
    lines += [f"formula: {phrase('formula_change', one)}: {formula_overrides(one)}" for one in diagnosis.formulas]
    lines += [f"  {_error_columns(rung.error)}  {rung_label(rung, base_label(diagnosis))}" for rung in diagnosis.ladder]
    if diagnosis.budget is not None:
        lines.append(f"budget: {phrase('noise', diagnosis.budget)} {phrase('shares', diagnosis.budget)}")
    if diagnosis.scatter is not None:
        lines.append(f"scatter: {' '.join(phrases('scatter', diagnosis.scatter))}")
    return [*lines, diagnosis.equation] if diagnosis.equation else lines


def _error_columns(x: Interval) -> str:
    """Write a mean error and its 95 % interval in columns."""
    mean, low, high = map(error, x)
    return f"{mean}  {low}–{high}"
