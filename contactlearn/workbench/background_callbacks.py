"""Callbacks of background runs: searches, saved runs and learning studies, with their progress."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from dash import ClientsideFunction, Dash, Input, Output, State, ctx, no_update

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.events import TaskProgress
from contactlearn.diagnosis.events import (
    AuditFindings,
    EffectsFound,
    Event,
    LawsCompared,
    RegionsFound,
    RemainderLearned,
)
from contactlearn.inference.learning.events import LearningProgress
from contactlearn.report.events import event_lines
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.diagnosis import ERROR
from contactlearn.report.figures.learning import learning_curve
from contactlearn.report.page.trials import digits
from contactlearn.workbench import content
from contactlearn.workbench.background import ALONE, STUDIES, BackgroundRun, BackgroundRuns, RunStatus
from contactlearn.workbench.commands import words_of
from contactlearn.workbench.files import SavedRuns
from contactlearn.workbench.models import Models
from contactlearn.workbench.session import Session

_LINES = 6
_STAGES = (AuditFindings, LawsCompared, RegionsFound, EffectsFound, RemainderLearned)
_CONTROLS = (("bar", "hidden"), ("bar", "value"), ("cancel", "hidden"), ("status", "children"))


class BackgroundCallbacks:
    """The callbacks of diagnoses and learning studies."""

    def __init__(self, models: Models, runs: BackgroundRuns, saved: SavedRuns) -> None:
        self.models, self.runs, self.saved = models, runs, saved

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        buttons = {"diagnosis": ("search", "save")} | {kind: ("start",) for kind in STUDIES}
        for kind, names in buttons.items():  # each with a store of its own, so that two started at once are both known
            app.callback(
                Output(f"{kind}-run", "data"), Output("trouble", "children", allow_duplicate=True),
                *(Input(f"{kind}-{name}", "n_clicks") for name in (*names, "cancel")),
                State(f"{kind}-run", "data"), State("address", "search"), prevent_initial_call=True,
            )(self.start)  # fmt: skip
        controls = {kind: [Output(f"{kind}-{part}", name) for part, name in _CONTROLS] for kind in buttons}
        app.callback(
            Output("diagnosis-clock", "disabled"), Output("diagnosis-lines", "children"),
            Output("diagnosis-lines", "hidden"), Output("found", "children"), *controls["diagnosis"],
            Input("diagnosis-clock", "n_intervals"), Input("diagnosis-run", "data"), State("address", "search"),
        )(self.follow_diagnosis)  # fmt: skip
        app.callback(
            Output("study-clock", "disabled"), Output("curve-sent", "data"), Output("curve-place", "hidden"),
            Output("learned-found", "children"), *(output for kind in STUDIES for output in controls[kind]),
            Input("study-clock", "n_intervals"), *(Input(f"{kind}-run", "data") for kind in STUDIES),
        )(self.follow_studies)  # fmt: skip
        app.clientside_callback(
            ClientsideFunction("workbench", "curve"), Output("curve-drawn", "children"), Input("curve-sent", "data")
        )

    def start(self, *values: Any) -> tuple[Any, str]:
        """Start a search, a diagnosis of the model, or a study in place of that of another model; or cancel a run."""
        kind, _, button = str(ctx.triggered_id).partition("-")
        *_, name, address = values
        before = self.runs.find(name or "")
        if button == "cancel":
            if before is not None:
                before.cancel()
            return name, ""
        try:
            session = Session.read(address or "")
            if kind == "diagnosis":
                search = [*session.data, "law=best", f"seed={session.seed}"]
                return self.runs.diagnose(search if button == "search" else words_of(session)), ""
            self.models.fitted(session)
            if before is not None and before.question != session.model_only:
                before.cancel()
            return self.runs.study(kind, session.model_only, self.models.fingerprint(session)), ""
        except ContactLearnError as error:
            return no_update, str(error)

    def follow_diagnosis(self, _: int | None, name: str | None, address: str | None) -> tuple[Any, ...]:
        """Show the progress of the diagnosis of this page, and its result once it is done."""
        if not name:
            return True, "", True, no_update, *_controls(None, 0.0, "")
        run = self.runs.find(name)
        if run is not None and run.status is RunStatus.RUNNING:
            events = run.events
            lines = "\n".join([line for event in events for line in event_lines(event)][-_LINES:])
            controls = _controls(run, diagnosis_progress(events), f"{_status(run, name)}{_task(events)}")
            return False, lines, not lines, no_update, *controls
        try:
            result = self.saved.diagnosis(f"diagnose/{name}")
        except ContactLearnError as error:
            lines = run.error if run is not None and run.status is not RunStatus.CANCELLED else ""
            status = str(error) if run is None else _status(run, name)
            return True, lines, not lines, no_update, *_controls(run, 0.0, status)
        found = content.diagnosis_content(result, f"diagnose/{name}", Session.read(address or ""))
        return True, "", True, found, *_controls(run, 1.0, f"Written to diagnose/{name}.")

    def follow_studies(self, _: int | None, *names: str | None) -> tuple[Any, ...]:
        """Show the progress of the studies of this page, and their results so far."""
        runs = {kind: self.runs.find(name or "") for kind, name in zip(STUDIES, names, strict=True)}
        steps = dict[str, LearningProgress | None]()
        for kind, run in runs.items():
            events = [] if run is None else [event for event in run.events if isinstance(event, LearningProgress)]
            steps[kind] = events[-1] if events else None
        running = any(run is not None and run.status is RunStatus.RUNNING for run in runs.values())
        controls = [part for kind in STUDIES for part in _study_controls(runs[kind], steps[kind])]
        curves = _curves(runs["curve"], steps["curve"])
        rows = no_update if runs["learned"] is None else self._learned_bars(runs["learned"], steps["learned"])
        return not running, curves or no_update, not curves, rows, *controls

    def _learned_bars(self, run: BackgroundRun, step: LearningProgress | None) -> Any:
        """Show the learned models so far, on the scale of the laws."""
        session = run.question
        if step is None or not isinstance(session, Session):
            return []
        largest = content.largest_error(self.models.comparison(session), self.models.fitted(session))
        errors = {name: points[-1][1] for name, points in step.errors.items()}
        return content.learned_bars(errors, session, len(self.models.split(session).pool), largest)


def diagnosis_progress(events: Sequence[Event]) -> float:
    """Return how far a diagnosis is, from 0 to 1: equal parts for its stages and the figures, each with its tasks."""
    stage, furthest = 0, 0.0
    for event in events:
        if isinstance(event, _STAGES):
            stage = max(stage, _STAGES.index(type(event)) + 1)
        task = event.done / event.total if isinstance(event, TaskProgress) and event.total else 0.0
        furthest = max(furthest, (stage + 0.9 * task) / (len(_STAGES) + 1))
    return furthest


def _controls(run: BackgroundRun | None, progress: float, status: str) -> tuple[Any, ...]:
    """Return bar, its value, the button that cancels, and the status of a run."""
    idle = run is None or run.status is not RunStatus.RUNNING
    return idle, "0" if idle else f"{progress:.3f}", idle, status


def _status(run: BackgroundRun, name: str) -> str:
    return f"{run.status.value.capitalize()}: {name}, {run.seconds:.0f} s"


def _task(events: Sequence[Event]) -> str:
    """Name the task that goes on."""
    event = events[-1] if events else None
    if not isinstance(event, TaskProgress) or event.done == event.total:
        return ""
    return f", {event.task}" + (f" {event.done} of {event.total}" if event.total else "")


def _study_controls(run: BackgroundRun | None, step: LearningProgress | None) -> tuple[Any, ...]:
    if run is None or not isinstance(run.question, Session):
        return _controls(None, 0.0, "")
    title, seconds = content.model_title(run.question), f"{run.seconds:.0f} s"
    count = f"{step.done} of {step.total}" if step is not None else "starting"
    status = {
        RunStatus.RUNNING: f"{title}: {count}, {seconds}",
        RunStatus.DONE: f"{title}: {seconds}",
        RunStatus.FAILED: run.error or f"{title}: the process ended without a result",
        RunStatus.CANCELLED: f"{title}: cancelled",
    }[run.status]
    if run.status is RunStatus.DONE and step is not None and not step.total:
        status = "There are too few trials for a learning curve."
    return _controls(run, 0.0 if step is None else step.done / max(step.total, 1), status)


def _curves(run: BackgroundRun | None, step: LearningProgress | None) -> dict[str, Any] | None:
    """Return the figure of the learning curves so far; None before there are any."""
    if run is None or step is None or not isinstance(run.question, Session):
        return None
    found = {name: dict(points) for name, points in step.errors.items() if points}
    sizes, missing = sorted({size for points in found.values() for size in points}), (math.nan,) * 3
    curves = {
        run.question.law if name == ALONE else "The model": torch.tensor(
            [tuple(points.get(size, missing)) for size in sizes], dtype=torch.float64
        )
        for name, points in found.items()
    }
    return digits(as_plotly(learning_curve(sizes, curves, {}, ERROR))) if curves else None
