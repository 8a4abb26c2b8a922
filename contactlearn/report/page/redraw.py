"""The page of one run, drawn again from its folder alone: no data source is read and nothing is fitted."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.record import Record
from contactlearn.report.page.diagnosis import of_diagnosis
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import write
from contactlearn.results import folder as run_folder
from contactlearn.results.folder import Result
from contactlearn.results.tables import HeldOut
from contactlearn.results.types import DiagnosisRun, Evaluation


def has_page(folder: Path) -> bool:
    """Whether a folder holds one run, of a kind that has a page of its own: an evaluation or a diagnosis."""
    files = [path for path in run_folder.files(folder)]
    try:
        return len(files) == 1 and isinstance(run_folder.read_result(files[0]), Evaluation | DiagnosisRun)
    except ContactLearnError:
        return False


def redraw(folder: Path) -> Path:
    """Write report.html of a run from its result and the tables beside it; the same page as the run's own.

    Raises:
        ContactLearnError: a file of the run that is missing or damaged, or a run of a kind without a page.
    """
    (path,) = run_folder.files(folder)
    try:
        return write(folder, _content(folder, run_folder.read_result(path)))
    except OSError as error:
        raise ContactLearnError(f"{folder}: cannot be written: {error.strerror}") from None


def _content(folder: Path, result: Result) -> dict[str, Any]:
    if isinstance(result, Evaluation):
        return of_evaluation(result, HeldOut.load(folder, result))
    if isinstance(result, DiagnosisRun):
        found = result.diagnosis
        record = None if found.choices is None else Record.load(folder)
        return of_diagnosis(replace(found, record=record), result.provenance, use=result.use if found.missing else "")
    raise ContactLearnError(f"{folder}: a run of kind {result.kind} has no page of its own")
