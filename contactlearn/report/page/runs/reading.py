"""Reads all runs in some folders as rows: for the page over several runs, and for the table of results."""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.page.runs.rows import Row, printable, read_row
from contactlearn.results.folder import FILES, find_results

Progress = Callable[[Iterable[Path], str], Iterable[Path]]
"""Wraps the reading of files, with a description."""


def silent(items: Iterable[Path], what: str) -> Iterable[Path]:
    """Show no progress."""
    return items


def absolute(folders: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return folders with their whole paths.

    Raises:
        ContactLearnError: one is not there.
    """
    roots = [Path(os.path.abspath(folder)) for folder in folders]
    for root in roots:
        if not root.is_dir():
            raise ContactLearnError(f"{root}: no such folder; give the folder of a run, of a sweep, or one above them")
    return roots


def read_runs(roots: Sequence[Path], progress: Progress = silent) -> tuple[list[Row], list[tuple[str, str]]]:
    """Read all runs in folders and in what is below them.

    Returns:
        The runs by name, run 10 behind run 9; and why others are not among them, by name.

    Raises:
        ContactLearnError: none can be read.
    """
    runs: list[Row] = []
    skipped: list[tuple[str, str]] = []
    top = Path(os.path.commonpath(roots))
    for path in progress(dict.fromkeys(path for root in roots for path in find_results(root)), "reading runs"):
        name = os.path.relpath(path.parent if path.name in FILES else path, top)
        name = printable(top.name if name == "." else name)
        try:
            run = read_row(path)
        except ContactLearnError as error:
            skipped.append((f"{name} ({path.name})" if path.name in FILES else name, printable(str(error))))
            continue
        both = all((path.parent / one).exists() for one in FILES)
        runs.append(replace(run, name=f"{name} ({path.stem})" if both else name))
    if not runs:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in skipped[:5])
        nothing = "neither diagnosis.json nor results.json is there, as train, evaluate and diagnose leave them"
        raise ContactLearnError(f"no run can be read in {', '.join(map(str, roots))}: {reasons or nothing}")
    return sorted(runs, key=lambda run: _natural(run.name)), skipped


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """Sorts run 10 behind run 9."""
    parts = re.split(r"(\d{1,15})", name, flags=re.ASCII)
    return [(k % 2 == 0, int(part) if k % 2 else 0, part) for k, part in enumerate(parts)]
