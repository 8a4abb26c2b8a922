"""Callbacks of studies: the learning curve and the learned models, with their progress, on demand."""

from typing import Any

from dash import ClientsideFunction, Dash, Input, Output, State, ctx, no_update

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.page.trials import bounded, plotly_style
from contactlearn.report.text import law_label
from contactlearn.workbench.jobs import RunStatus
from contactlearn.workbench.models import Models
from contactlearn.workbench.panes import compare
from contactlearn.workbench.panes.model import model_title
from contactlearn.workbench.session import Session
from contactlearn.workbench.studies import ALONE, STUDIES
from contactlearn.workbench.tasks import StudyRun, StudyRuns, studied

_CONTROLS = (("bar", "hidden"), ("bar", "value"), ("cancel", "hidden"), ("said", "children"))


class Studying:
    """The callbacks of studies."""

    def __init__(self, models: Models, tasks: StudyRuns) -> None:
        self.models, self.tasks = models, tasks

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        for kind in STUDIES:  # each with a store of its own, so that two that are asked for at once are both kept
            app.callback(
                Output(f"{kind}-study", "data"), Output("trouble", "children", allow_duplicate=True),
                Input(f"{kind}-ask", "n_clicks"), Input(f"{kind}-cancel", "n_clicks"),
                State(f"{kind}-study", "data"), State("address", "search"), prevent_initial_call=True,
            )(self.press)  # fmt: skip
        shown = [Output(f"{kind}-{part}", name) for kind in STUDIES for part, name in _CONTROLS]
        app.callback(
            Output("study-clock", "disabled"), Output("curve-sent", "data"), Output("curve-place", "hidden"),
            Output("learned-found", "children"), *shown, Input("study-clock", "n_intervals"),
            *(Input(f"{kind}-study", "data") for kind in STUDIES),
        )(self.follow)  # fmt: skip
        app.clientside_callback(
            ClientsideFunction("workbench", "curve"), Output("curve-drawn", "children"), Input("curve-sent", "data")
        )

    def press(self, _asked: int, _cancelled: int, name: str | None, address: str | None) -> tuple[Any, str]:
        """Start a study of the present model in place of the one of another model, or cancel it."""
        kind, _, button = str(ctx.triggered_id).partition("-")
        before = self.tasks.find(name or "")
        if button == "cancel":
            if before is not None:
                before.cancel()
            return name, ""
        try:
            session = Session.read(address or "")
            if before is not None and before.session != studied(session):
                before.cancel()
            return self.tasks.start(kind, session), ""
        except ContactLearnError as error:
            return no_update, str(error)

    def follow(self, _: int | None, *names: str | None) -> tuple[Any, ...]:
        """Show how far the studies of this page are, and what they have found so far."""
        tasks = {kind: self.tasks.find(name or "") for kind, name in zip(STUDIES, names, strict=True)}
        running = any(task is not None and task.status is RunStatus.RUNNING for task in tasks.values())
        shown = [part for kind in STUDIES for part in self._controls(tasks[kind])]
        curve, learned = tasks["curve"], tasks["learned"]
        curves = None if curve is None else _curves(curve)
        rows = no_update if learned is None else self._rows(learned)
        return not running, curves or no_update, not curves, rows, *shown

    def _controls(self, task: StudyRun | None) -> tuple[Any, ...]:
        """Bar, its value, the button that cancels, and what is said."""
        if task is None:
            return True, "0", True, ""
        running, step = task.status is RunStatus.RUNNING, task.step
        value = 0.0 if step is None else step.done / max(step.total, 1)
        return not running, f"{value:.3f}", not running, self._said(task)

    def _said(self, task: StudyRun) -> str:
        title, step = model_title(task.session), task.step
        if task.trouble:
            return task.trouble
        if task.status is RunStatus.DONE and step is not None and not step.total:
            return "There are too few trials for a learning curve."
        count = f"{step.done} of {step.total}" if step is not None else "starting"
        said = {
            RunStatus.RUNNING: f"{title}: {count}, {task.seconds:.0f} s",
            RunStatus.DONE: f"{title}: {task.seconds:.0f} s",
            RunStatus.FAILED: f"{title}: the process ended without a result",
            RunStatus.CANCELLED: f"{title}: cancelled",
        }
        return said[task.status]

    def _rows(self, task: StudyRun) -> Any:
        """The learned models so far, on the scale of the laws."""
        if task.step is None:
            return []
        fitted = self.models.fitted(task.session)
        most = compare.largest(self.models.compared(task.session), fitted)
        errors = {name: points[-1][1] for name, points in task.step.errors.items()}
        return compare.learned_bars(errors, model_title(task.session), len(self.models.split(task.session).pool), most)


def _curves(task: StudyRun) -> list[dict[str, Any]]:
    """The learning curve so far, as the page draws it; empty before there is any."""
    style, curves = plotly_style(task.session.law), [] if task.step is None else task.step.errors.items()
    labels = {True: f"{law_label(task.session.law)} alone", False: "The model"}
    return [
        style
        | {
            "label": labels[name == ALONE],
            "dash": "dot" if name == ALONE else "solid",
            "level": False,
            "sizes": [size for size, _ in points],
            "intervals": [bounded(error) for _, error in points],
        }
        for name, points in curves
        if points
    ]
