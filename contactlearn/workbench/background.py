"""Callbacks of searches and saved runs in processes of their own."""

from typing import Any

from dash import Dash, Input, Output, State, ctx, no_update
from dash.development.base_component import Component

from contactlearn.core.errors import ContactLearnError
from contactlearn.workbench.commands import words_of
from contactlearn.workbench.jobs import BackgroundRun, Jobs, RunStatus
from contactlearn.workbench.panes import missing
from contactlearn.workbench.saved import Saved
from contactlearn.workbench.session import Session

_LINES = 6
_WORDS = {
    RunStatus.RUNNING: "Running",
    RunStatus.DONE: "Done",
    RunStatus.FAILED: "Failed",
    RunStatus.CANCELLED: "Cancelled",
}


class Background:
    """The callbacks of jobs."""

    def __init__(self, jobs: Jobs, saved: Saved) -> None:
        self.jobs, self.saved = jobs, saved

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        app.callback(
            Output("job", "data"), Output("trouble", "children", allow_duplicate=True),
            Input("search", "n_clicks"), Input("save", "n_clicks"), Input("cancel", "n_clicks"),
            State("address", "search"), State("job", "data"), prevent_initial_call=True,
        )(self.press)  # fmt: skip
        app.callback(
            Output("job-said", "children"), Output("job-lines", "children"), Output("job-lines", "hidden"),
            Output("clock", "disabled"), Output("found", "children"), Output("job-bar", "value"),
            Output("job-bar", "hidden"), Output("cancel", "hidden"),
            Input("clock", "n_intervals"), Input("job", "data"), State("address", "search"),
        )(self.follow)  # fmt: skip

    def press(self, *values: Any) -> tuple[Any, Any]:
        """Start a search or the run of the present model, or cancel what is running."""
        *_, address, name = values
        try:
            session = Session.read(address or "")
            if ctx.triggered_id == "search":
                return self.jobs.start([*session.data, "law=best", f"seed={session.seed}"]).folder.name, ""
            if ctx.triggered_id == "save":
                return self.jobs.start(words_of(session)).folder.name, ""
        except ContactLearnError as error:
            return no_update, str(error)
        if name and (job := self.jobs.find(name)):
            job.cancel()
        return no_update, no_update

    def follow(self, _: int | None, name: str | None, address: str | None) -> tuple[Any, ...]:
        """Say where the job of this page stands, and show what it has found once it is done."""
        job = self.jobs.find(name) if name else None
        still = ("0", True, True)  # no bar, nothing to cancel
        if not name:
            return "", "", True, True, no_update, *still
        if job is not None and job.status is RunStatus.RUNNING:
            lines = "\n".join(list(job.lines)[-_LINES:])
            return self._said(job), lines, not lines, False, no_update, f"{job.progress:.3f}", False, False
        try:
            run = self.saved.diagnosis(f"diagnose/{name}")
        except ContactLearnError as error:
            said = str(error) if job is None else self._said(job)
            lines = "" if job is None or job.status is RunStatus.CANCELLED else "\n".join(list(job.lines)[-_LINES:])
            return said, lines, not lines, True, no_update, *still
        found: list[Component] = missing.found_content(run, f"diagnose/{name}", Session.read(address or ""))
        return f"Written to diagnose/{name}.", "", True, True, found, *still

    def _said(self, job: BackgroundRun) -> str:
        return f"{_WORDS[job.status]}: {job.folder.name}, {job.seconds:.0f} s"
