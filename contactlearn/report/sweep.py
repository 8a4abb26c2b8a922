"""A finished sweep on the terminal: its runs side by side, and the commands that compare them."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from contactlearn.core.errors import ContactLearnError
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.page.runs.reading import absolute, read_runs
from contactlearn.report.page.runs.settings import telling
from contactlearn.report.terminal import new_table, print_table, say

_MOST = 20  # runs of the table
_WIDEST = 5  # settings of the table
_NONE = Interval(float("inf"), 0.0, 0.0)


def show_sweep(folders: Sequence[Path], place: Path) -> None:
    """Print the finished runs of a sweep, those with the least error where they are many, and how to compare all.

    Args:
        folders: of the runs.
        place: of the sweep.
    """
    try:
        runs, _ = read_runs(absolute(folders))
    except ContactLearnError:  # none of them has one held-out error
        return
    settings = telling(runs)[:_WIDEST]
    errors = [run.error or _NONE for run in runs]
    best = sorted(range(len(runs)), key=lambda k: errors[k].mean)[:_MOST]
    few = f", the {_MOST} of {len(runs)} runs with the least" if len(runs) > _MOST else ""
    found = any(run.found for run in runs)
    headings = (*(key for key, _ in settings), *(["found"] if found else []), "mass error", "95 %")
    table = new_table(f"Held-out errors of the sweep{few}", *headings)
    for k in sorted(best):
        cells = [values[k] or "" for _, values in settings]
        cells += [", ".join(map(str, runs[k].found)) or "none"] if found else []
        error = runs[k].error
        table.add_row(
            *cells, *(("", "") if error is None else (f"{error.mean:.4f}", f"{error.low:.4f}–{error.high:.4f}"))
        )
    print_table(table)
    for word, ending in (("report", ""), ("results", " -o results.parquet")):
        say(f"compare  python -m contactlearn {word} {shlex.quote(str(place))}{ending}")
