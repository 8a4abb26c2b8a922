"""Run folders below `outputs`: listed, opened, compared, and taken over as sessions."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flask import Flask, Response, abort

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.effects import EffectId
from contactlearn.report.page.page import FILE
from contactlearn.report.page.recordings import RECORDINGS
from contactlearn.report.page.runs.page import write_runs
from contactlearn.report.text import headline
from contactlearn.results.diagnosis import DiagnosisRun
from contactlearn.results.folder import Result, find_results, read_result
from contactlearn.workbench.cache import Cache
from contactlearn.workbench.session import Session

COMPARED = "runs.html"
"""Name of the page over several runs, in the folder of the runs."""
_PAGES = (FILE, RECORDINGS, COMPARED)
_KEPT, _LISTED = 200, 20


@dataclass(frozen=True, kw_only=True)
class SavedRun:
    """A run: its folder below `outputs`, and its result, or why that cannot be read."""

    name: str
    kind: str
    said: str
    page: bool
    session: Session | None


class Saved:
    """The runs below a folder."""

    def __init__(self, outputs: Path) -> None:
        self.outputs = outputs
        self._read: Cache[Result] = Cache(_KEPT)

    def listed(self) -> list[SavedRun]:
        """Return the runs that were written last, the newest first."""
        paths = [path for path in find_results(self.outputs) if path.is_file()] if self.outputs.is_dir() else []
        newest = sorted(paths, key=lambda path: -path.stat().st_mtime)[:_LISTED]
        return [self._described(path) for path in newest]

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
            ContactLearnError: a name that is no run's.
        """
        write_runs([str(self.inside(name)) for name in names], str(self.outputs / COMPARED))

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
        return Response(
            path.read_bytes(), mimetype="text/html", headers={"Content-Security-Policy": "frame-ancestors 'none'"}
        )

    def inside(self, name: str) -> Path:
        """Return a path below the folder.

        Raises:
            ContactLearnError: it would lie elsewhere.
        """
        path = (self.outputs / name).resolve()
        if not path.is_relative_to(self.outputs.resolve()):
            raise ContactLearnError(f"a run is a folder below {self.outputs}, got {name!r}")
        return path

    def _result(self, path: Path) -> Result:
        if not path.is_file():
            raise ContactLearnError(f"{path.parent.name} has no {path.name}: the run failed, or goes on")
        return self._read.get((path, path.stat().st_mtime_ns), lambda: read_result(path))

    def _described(self, path: Path) -> SavedRun:
        name, page = str(path.parent.relative_to(self.outputs)), (path.parent / FILE).is_file()
        try:
            result = self._result(path)
        except ContactLearnError as error:
            return SavedRun(name=name, kind="unreadable", said=str(error), page=page, session=None)
        if isinstance(result, DiagnosisRun):
            said, session = headline(result.diagnosis), diagnosed(result)
            return SavedRun(name=name, kind="diagnosis", said=said, page=page, session=session)
        return SavedRun(name=name, kind=str(result.kind), said=result.provenance.data.source, page=page, session=None)


def diagnosed(run: DiagnosisRun) -> Session | None:
    """Return the session with the data and the model of a diagnosis; None where it has no model, or effects unknown."""
    found, words = run.diagnosis, shlex.split(run.provenance.command)
    data = tuple(word for word in words if word.startswith("data=") or word.startswith("data."))
    if found.law is None or any(one.name.startswith("line") for one in found.given):
        return None
    try:
        return Session(data=data or Session().data, law=found.law, effects=effects_found(found))
    except ContactLearnError:  # words that only a command line takes
        return None


def effects_found(found: Diagnosis) -> tuple[EffectId, ...]:
    """Return the effects of the model of a diagnosis: those given, and the missing ones."""
    return tuple(dict.fromkeys((*found.given, *(one.effect for one in found.missing))))
