"""Saved runs: folders below `outputs` that are listed, opened, compared, and taken over as sessions."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flask import Flask, Response, abort

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.page.page import FILE
from contactlearn.report.page.recordings import RECORDINGS
from contactlearn.report.page.runs.page import write_runs
from contactlearn.report.text import headline
from contactlearn.results.diagnosis import DiagnosisRun
from contactlearn.results.folder import Result, find_results, read_result
from contactlearn.workbench.models import Cache
from contactlearn.workbench.session import Session

COMPARED = "runs.html"
"""Name of the page over several runs, in the folder of the runs."""
_PAGES = (FILE, RECORDINGS, COMPARED)
_CACHED, _LISTED = 200, 20


@dataclass(frozen=True, kw_only=True)
class SavedRun:
    """A run folder below `outputs`.

    Args:
        name: path of the folder, relative to `outputs`.
        kind: of its result; "unreadable" if it cannot be read.
        description: of its result, or the reason why it cannot be read.
        has_page: it holds a report.
        session: its data and model, if the workbench can show them.
    """

    name: str
    kind: str
    description: str
    has_page: bool
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
        """Serve the pages of runs below /runs/: report.html of a folder, recordings.html, and the page over several."""
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
        return SavedRun(name=name, kind="diagnosis", description=described, has_page=page, session=session)


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
