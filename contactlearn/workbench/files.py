"""Files of the workbench: saved runs, dropped tables, experiment files; and the hints to hidden effects."""

import base64
import binascii
import hashlib
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import make_archive
from tempfile import TemporaryDirectory
from typing import Any

from dash import ALL, Dash, Input, Output, State, ctx, dcc, html, no_update
from dash.development.base_component import Component
from flask import Flask, Response, abort

from contactlearn.cli.commands.export import TARGETS, export_model
from contactlearn.cli.commands.plan import write_plan
from contactlearn.cli.commands.replay import write_replay
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings, PlanSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import atomic_write
from contactlearn.data import table
from contactlearn.data.audit.findings import audit
from contactlearn.data.packed import ARCHIVES
from contactlearn.models import checkpoint
from contactlearn.report.page.page import FILE, RECORDINGS, REPLAY, has_recordings
from contactlearn.report.page.plan import PLAN
from contactlearn.report.page.runs import write_runs
from contactlearn.report.text.sentences import headline
from contactlearn.results.folder import Result, find_results, read_result
from contactlearn.results.types import DiagnosisRun
from contactlearn.simulation.hidden_effects import reveal
from contactlearn.workbench import content
from contactlearn.workbench.commands import experiment
from contactlearn.workbench.components import Child, action_button, items, note
from contactlearn.workbench.layout import HINTS
from contactlearn.workbench.models import Cache, Models
from contactlearn.workbench.session import Session

COMPARED = "runs.html"
"""Name of the page over several runs, in the folder of the runs."""
_PAGES = (FILE, RECORDINGS, REPLAY, COMPARED, PLAN)
_CACHED, _LISTED = 200, 20


@dataclass(frozen=True, kw_only=True)
class SavedRun:
    """A run folder below `outputs`.

    Args:
        name: path of the folder, relative to `outputs`.
        kind: of its result; "unreadable" if it cannot be read.
        description: of its result, or the reason why it cannot be read.
        has_page: it holds a report.
        has_replay: it holds predicted beside recorded trajectories.
        recorded: its data are recordings.
        session: its data and model, if the workbench can show them.
    """

    name: str
    kind: str
    description: str
    has_page: bool
    has_replay: bool = False
    recorded: bool = False
    session: Session | None = None


class SavedRuns:
    """The run folders below a folder."""

    def __init__(self, outputs: Path) -> None:
        self.outputs = outputs
        self._results: Cache[Result] = Cache(_CACHED)

    def latest(self) -> list[SavedRun]:
        """Return the runs that were written last, the newest first."""
        paths = [path for path in find_results(self.outputs) if path.is_file()] if self.outputs.is_dir() else []
        return [self._described(path) for path in sorted(paths, key=lambda path: -path.stat().st_mtime)[:_LISTED]]

    def diagnosis(self, name: str) -> DiagnosisRun:
        """Return the diagnosis in a run folder.

        Raises:
            ContactLearnError: there is none, or it cannot be read.
        """
        result = self._result(self.inside(name) / "diagnosis.json")
        if not isinstance(result, DiagnosisRun):
            raise ContactLearnError(f"{name} holds no diagnosis")
        return result

    def compare(self, names: Sequence[str]) -> None:
        """Write one page over several runs.

        Raises:
            ContactLearnError: a name is not that of a run.
        """
        write_runs([str(self.inside(name)) for name in names], str(self.outputs / COMPARED))

    def replay(self, name: str) -> None:
        """Write predicted beside recorded trajectories of a run, in its folder.

        Raises:
            ContactLearnError: it is no diagnosis of recordings, or has no model.
        """
        session = diagnosed_session(self.diagnosis(name))
        if session is None:
            raise ContactLearnError(f"{name}: its recordings are not known to the workbench; use contactlearn replay")
        folder, settings = self.inside(name), EvaluateSettings.from_config(compose("evaluate", [*session.data]))
        write_replay(str(folder), settings.data, folder)

    def inside(self, name: str) -> Path:
        """Return a path below the folder.

        Raises:
            ContactLearnError: it would lie elsewhere.
        """
        path = (self.outputs / name).resolve()
        if not path.is_relative_to(self.outputs.resolve()):
            raise ContactLearnError(f"a run is a folder below {self.outputs}, got {name!r}")
        return path

    def serve(self, server: Flask) -> None:
        """Serve the pages of runs below /runs/: report, recordings and replay of a folder, and that over several."""
        server.add_url_rule("/runs/<path:name>", "runs", self._page)

    def _page(self, name: str) -> Response:
        try:
            path = self.inside(name)
        except ContactLearnError:
            abort(404)
        if path.name not in _PAGES or not path.is_file():
            abort(404)
        # The page has a policy of its own, stricter than that of the workbench.
        policy = {"Content-Security-Policy": "frame-ancestors 'none'"}
        return Response(path.read_bytes(), mimetype="text/html", headers=policy)

    def _result(self, path: Path) -> Result:
        if not path.is_file():
            raise ContactLearnError(f"{path.parent.name} has no {path.name}: the run failed, or is still running")
        return self._results.get((path, path.stat().st_mtime_ns), lambda: read_result(path))

    def _described(self, path: Path) -> SavedRun:
        name, page = str(path.parent.relative_to(self.outputs)), (path.parent / FILE).is_file()
        try:
            result = self._result(path)
        except ContactLearnError as error:
            return SavedRun(name=name, kind="unreadable", description=str(error), has_page=page)
        if not isinstance(result, DiagnosisRun):
            source = result.provenance.data.source
            return SavedRun(name=name, kind=str(result.kind), description=source, has_page=page)
        described, session = headline(result.diagnosis), diagnosed_session(result)
        return SavedRun(
            name=name, kind="diagnosis", description=described, has_page=page, session=session,
            has_replay=(path.parent / REPLAY).is_file(), recorded=has_recordings(result.provenance.config),
        )  # fmt: skip


def diagnosed_session(run: DiagnosisRun) -> Session | None:
    """Return the session with the data and the model of a diagnosis; None if the workbench cannot show them."""
    found, words = run.diagnosis, shlex.split(run.provenance.command)
    data = tuple(word for word in words if word.startswith(("data=", "data.")))
    if found.law is None or any(one.name.startswith("line") for one in found.given):
        return None
    effects = tuple(dict.fromkeys((*found.given, *(one.effect for one in found.missing))))
    try:
        return Session(data=data or Session().data, law=found.law, effects=effects)
    except ContactLearnError:  # words that only a command line takes
        return None


def run_list(runs: Sequence[SavedRun]) -> list[Component]:
    """Return the saved runs, the newest first, with links to their pages and buttons that take their models over."""
    rows: list[list[Child]] = []
    for run in runs:
        row: list[Child] = [html.Code(run.name), f" ({run.kind}): {run.description} "]
        if run.has_page:
            row += [html.A("open", href=f"/runs/{run.name}/report.html", target="_blank"), " "]
        if run.has_replay:
            row += [html.A("replay", href=f"/runs/{run.name}/{REPLAY}", target="_blank"), " "]
        elif run.recorded:
            row += [html.Button("Replay", id={"replay": run.name}), " "]
        if run.session is not None:
            row.append(action_button("adopt", "Take its model", of=run.session.address))
        rows.append(row)
    return items(rows) or [note("There are no runs yet.")]


class FileCallbacks:
    """The callbacks of dropped tables, other data, experiment files, saved runs, and the hints."""

    def __init__(self, models: Models, saved: SavedRuns) -> None:
        self.models, self.saved = models, saved

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        address = State("address", "search")
        app.callback(
            Output("address", "search", allow_duplicate=True), Output("trouble", "children", allow_duplicate=True),
            Output("mistakes", "children", allow_duplicate=True),
            Input("upload", "contents"), Input("load", "n_clicks"), Input("words", "n_submit"),
            State("upload", "filename"), State("words", "value"), address, prevent_initial_call=True,
        )(self.load)  # fmt: skip
        app.callback(
            Output("download", "data"), Input("experiment", "n_clicks"), address, prevent_initial_call=True
        )(self.experiment)  # fmt: skip
        app.callback(
            Output("download", "data", allow_duplicate=True), Output("trouble", "children", allow_duplicate=True),
            Input("export", "n_clicks"), State("export-to", "value"), address, prevent_initial_call=True,
        )(self.export)  # fmt: skip
        app.callback(
            Output("planned", "children"), Input("plan-drops", "n_clicks"), State("rig", "value"),
            State("diagnosis-run", "data"), prevent_initial_call=True,
        )(self.plan)  # fmt: skip
        app.callback(
            Output("runs", "children"), Output("runs-status", "children"),
            Input("list-runs", "n_clicks"), Input("compare-runs", "n_clicks"), Input({"replay": ALL}, "n_clicks"),
            prevent_initial_call=True,
        )(self.runs)  # fmt: skip
        app.callback(
            Output("hints", "hidden"), Output("hint-title", "children"), Output("hint-text", "children"),
            Output("hint-next", "hidden"), Output("reveal", "hidden"), Output("hint", "data"),
            Input("hint-next", "n_clicks"), Input("hint-end", "n_clicks"), Input("settled", "data"),
            State("hint", "data"),
        )(self.hint)  # fmt: skip
        app.callback(
            Output("truth", "children"), Output("truth", "hidden"), Input("reveal", "n_clicks"), address,
            prevent_initial_call=True,
        )(self.reveal)  # fmt: skip

    def load(self, contents: str | None, *values: Any) -> tuple[Any, str, Any]:
        """Go to other data, a dropped file or words as on a command line, with the same model.

        Data that break a rule of impacts are audited, so that they can be loaded corrected.
        """
        *_, name, words, address = values
        try:
            session = Session.read(address or "")
            if ctx.triggered_id == "upload":
                if contents is None or name is None:
                    return no_update, "", no_update
                data = ("data=table", f"data.path={self.store_table(name, contents)}")
            else:
                data = _data_words(words or "")
            other = replace(session.model_only, data=data)
        except ContactLearnError as error:
            return no_update, str(error), no_update
        try:
            self.models.split(other)
        except ContactLearnError as error:
            return no_update, str(error), self.corrections(other)
        return other.address or "?", "", no_update

    def corrections(self, session: Session) -> Any:
        """Return what the audit finds in data that could not be loaded, with a button that loads them corrected."""
        try:
            return content.mistakes(audit(self.models.unvalidated(session)), session, loaded=False)
        except ContactLearnError:
            return no_update

    def store_table(self, name: str, contents: str) -> Path:
        """Write a dropped file under the hash of its content, once it can be read.

        Raises:
            DataError: it is no table, or breaks a rule of tables.
        """
        suffix = Path(name).suffix.lower()
        table.check_suffix(Path(name), (*table.READ, *ARCHIVES))
        inner = Path(Path(name).stem).suffix.lower() if suffix in ARCHIVES else ""  # of drops.csv.gz
        try:
            table_bytes = base64.b64decode(contents.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise DataError(f"{name}: did not arrive whole: {error}; drop it again") from None
        digest = hashlib.sha256(table_bytes).hexdigest()[:16]
        path = self.saved.outputs / "uploads" / f"{digest}{inner}{suffix}"
        if not path.exists():
            with atomic_write(path) as part:
                part.write_bytes(table_bytes)
        try:
            table.load(path, validate=False)  # data that break a rule of impacts may be corrected
        except ContactLearnError as error:
            path.unlink()
            raise DataError(str(error).replace(str(path), name)) from None
        return path

    def experiment(self, _: int, address: str | None) -> Any:
        """Return the experiment file of the session."""
        return dcc.send_string(experiment(Session.read(address or "")), "session.yaml")

    def export(self, _: int, to: str, address: str | None) -> tuple[Any, str]:
        """Return the model of the session as a file for use elsewhere, or several as an archive."""
        try:
            session = Session.read(address or "")
            model, impacts = self.models.manual(session).model, self.models.split(session).impacts
            with TemporaryDirectory() as folder:
                saved, out = Path(folder, "model.pt"), Path(folder, "impact")
                checkpoint.save(model, saved)
                export_model(
                    str(saved), to, str(out.with_suffix(TARGETS[to])), impacts, without_residual=False, force=True
                )
                saved.unlink()
                files = sorted(Path(folder).iterdir())
                if len(files) > 1:
                    files = [Path(make_archive(str(out), "zip", folder))]
                return dcc.send_bytes(files[0].read_bytes(), files[0].name), ""
        except ContactLearnError as error:
            return no_update, str(error)

    def plan(self, _: int, words: str | None, run: str | None) -> list[Component]:
        """Plan the next drops for what the last search left open, within what the rig can set."""
        try:
            if not run:
                raise ContactLearnError("search laws and effects first: the plan is for what the search leaves open")
            self.saved.diagnosis(f"diagnose/{run}")
            folder, out = self.saved.inside(f"diagnose/{run}"), self.saved.inside(f"plans/{run}")
            settings = PlanSettings.from_config(compose("plan", shlex.split(words or "")))
            lines = write_plan(settings, folder, out, force=True)
        except (ContactLearnError, ValueError) as error:
            return [html.P(str(error), role="alert")]
        page = html.A("the whole plan", href=f"/runs/plans/{run}/{PLAN}", target="_blank")
        return [html.Pre(lines), html.P(page)]

    def runs(self, _: int, __: int, clicks: Sequence[int | None]) -> tuple[Any, Any]:
        """Show the saved runs; write one page over all of them, or the replay of one, if its button was pressed."""
        if isinstance(ctx.triggered_id, dict) and not any(clicks):
            return no_update, no_update  # a button that has just been drawn
        runs = self.saved.latest()
        if ctx.triggered_id == "list-runs":
            return run_list(runs), ""
        try:
            if isinstance(ctx.triggered_id, dict):
                self.saved.replay(ctx.triggered_id["replay"])
                return run_list(self.saved.latest()), ""
            self.saved.compare([run.name for run in runs if run.kind != "unreadable"])
        except ContactLearnError as error:
            return no_update, str(error)
        return run_list(runs), html.A("open the comparison", href=f"/runs/{COMPARED}", target="_blank")

    def hint(self, clicks: int, ended: int, address: str | None, seen: list[int] | None) -> tuple[Any, ...]:
        """Show the next hint, for data with hidden effects; a box on the map and a tick lead to what follows them.

        `seen` is the place of the hint that is shown and the clicks that led to it: an answer to a click that the page
        drops, since something else changed meanwhile, is given again with the next one.
        """
        if not address or ended or "data=mystery" not in (session := Session.read(address)).data:
            return True, "", "", True, True, None
        done = 3 if session.effects else 2 if session.windows else 0
        shown, counted = seen or (0, 0)
        at = min(max(done, shown + (clicks or 0) - counted), len(HINTS) - 1)
        title, text = HINTS[at]
        last = at == len(HINTS) - 1
        return False, f"{at + 1} of {len(HINTS)}. {title}.", text, last, not last, [at, clicks or 0]

    def reveal(self, _: int, address: str | None) -> tuple[Any, Any]:
        """Show the ground truth of the data."""
        words = dict(word.split("=", 1) for word in Session.read(address or "").data)
        folder = words.get("data.folder", f"outputs/mystery/seed_{words.get('data.seed')}")
        try:
            return reveal(folder), False
        except ContactLearnError as error:
            return str(error), False


def _data_words(text: str) -> tuple[str, ...]:
    """Return the words of a command line that name data."""
    try:
        return tuple(shlex.split(text)) or Session().data
    except ValueError as error:
        raise ContactLearnError(f"{text!r} cannot be read as words: {error}") from None
