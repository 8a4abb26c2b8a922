"""Finished subsamples on disk, so that a diagnosis that was stopped goes on behind them.

Each has a folder named by its number of trials: the files of its record, and diagnosis.json, which is written last.
What cannot be read is made again.
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import written_whole
from contactlearn.diagnosis.result import Diagnosis, Record

_RESULT = "diagnosis.json"


def keep(folder: Path, found: Diagnosis, trials: int) -> None:
    """Write the diagnosis of a subsample.

    Raises:
        ContactLearnError: a file cannot be written.
        OSError: likewise.
    """
    assert found.record is not None
    part = folder / str(trials)
    with suppress(FileNotFoundError):  # the same command beside this one has ended, and removed the folder
        found.record.save(part, {})
        with written_whole(part / _RESULT) as path:
            path.write_text(found.to_json(), encoding="utf-8")


def read_kept(folder: Path, trials: int) -> Diagnosis | None:
    """Read the diagnosis of a subsample; None if it was not finished."""
    part = folder / str(trials)
    try:
        found = Diagnosis.from_json((part / _RESULT).read_bytes())
        return replace(found, record=Record.load(part))
    except (OSError, ContactLearnError):
        return None
