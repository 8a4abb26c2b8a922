"""A run folder: a result of any kind is written to it, found below a folder, and read back.

diagnosis.json   of diagnose
results.json     of train, evaluate and transfer; its entry `kind` says which

Results of a run that has not finished are not found, see `state`.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import atomic_write
from contactlearn.core.serialisation import LARGEST_FILE, from_json, to_json
from contactlearn.results.state import DONE, LOCK, is_locked, read_failed, unfinished
from contactlearn.results.types import FORMAT, DiagnosisRun, Evaluation, RunKind, Training, Transfer

Result = Training | Evaluation | Transfer | DiagnosisRun

FILES = ("diagnosis.json", "results.json")
"""Names of the files that hold a result."""
_TYPES = {
    RunKind.TRAINING: Training,
    RunKind.EVALUATION: Evaluation,
    RunKind.TRANSFER: Transfer,
    RunKind.DIAGNOSIS: DiagnosisRun,
}


@dataclass(frozen=True, kw_only=True)
class _Head:
    kind: RunKind
    format: int = 1


def write_result(folder: Path, result: Result) -> Path:
    """Write a result, whole or not at all; a diagnosis without its record, which is saved by itself.

    Raises:
        ContactLearnError: a number that is not finite where it must be.
    """
    path = folder / FILES[not isinstance(result, DiagnosisRun)]
    if isinstance(result, DiagnosisRun):
        result = replace(result, diagnosis=result.diagnosis.without_record())
    text = to_json(result)
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def files(folder: Path) -> list[Path]:
    """Return the files of results in a folder itself, if its run has finished."""
    return [] if unfinished(folder) else [folder / name for name in FILES if (folder / name).exists()]


def is_run(folder: Path) -> bool:
    """Whether a folder holds a result."""
    return bool(files(folder))


def find_results(root: Path) -> Iterator[Path]:
    """Yield the files of results in a folder and below it, and run folders without one; hidden folders are left out."""
    for folder, folders, names in os.walk(root):
        half = LOCK in names and DONE not in names
        there = [] if half else [name for name in FILES if name in names]
        if not there and (half or ".hydra" in folders):
            yield Path(folder)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(folder, name) for name in there)


def read_result(path: Path) -> Result:
    """Read the result in a file that `find_results` found.

    Raises:
        ContactLearnError: in one line, why it cannot be read.
    """
    if path.name not in FILES:
        if (failed := read_failed(path)) is not None:
            raise ContactLearnError(f"failed: {failed.reason}")
        if is_locked(path):
            raise ContactLearnError("is still running")
        if unfinished(path):
            raise ContactLearnError("was stopped before its end; the same command again makes a whole run")
        raise ContactLearnError("has neither results.json nor diagnosis.json: the run failed or was stopped")
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ContactLearnError(f"is larger than {LARGEST_FILE >> 20} MiB")
        text = path.read_bytes()
    except OSError as error:
        raise ContactLearnError(f"cannot be read: {error.strerror}") from None
    head = from_json(_Head, text)
    if head.format > FORMAT:
        raise ContactLearnError(f"is of format {head.format}, and the newest known is {FORMAT}: upgrade contactlearn")
    try:
        return from_json(_TYPES[head.kind], text)
    except ContactLearnError as error:
        if head.format == FORMAT:
            raise
        raise ContactLearnError(
            f"is of format {head.format}, by an earlier contactlearn: run its command again ({error})"
        ) from None
