"""Several things in a row: bodies, as red_vx_before, blue_vx_before, and tables, as Time Run 1, Time Run 2."""

import json
import re
from collections.abc import Sequence

from contactlearn.data.table.dialect import is_missing
from contactlearn.data.table.names import impact_vocabulary, recognise
from contactlearn.data.table.sheet import Sheet
from contactlearn.mechanics.space import PLANE

_NEEDED = ("vx", "vy", "vx_post", "vy_post")
_MIN_BESIDE = 3  # columns of a table that stands beside another
_RUN = re.compile(r"\s*\b(?:run|trial|take|throw|drop|toss|session|versuch|essai|séance)\W*(\d+)\W*$", re.I)
_MOVING = "a contact between two moving bodies is not covered, only those of a body with a floor or a wall at rest"
_BETWEEN = re.compile(r"[\W_]+")


def refusal_of_several(header: Sequence[str]) -> str:
    """Return how to choose one of several bodies whose impacts share each row; empty of a table of any other kind."""
    bodies = _bodies_in_row(header)
    if len(bodies) < 2:
        return ""
    (first, columns), *_ = bodies.items()
    mapped = ", ".join(
        f"{ours}: {name if name.isidentifier() else json.dumps(name, ensure_ascii=False)}"
        for ours, name in columns.items()
    )
    return (
        f"each row has the impacts of {len(bodies)} bodies, {', '.join(bodies)}; choose one, for {first} "
        f"'data.columns={{{mapped}}}', or write a row for each body, with its name in a column object; if these bodies "
        f"hit each other, {_MOVING}"
    )


def runs_in(header: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return names of columns by the number of the run and by their names without it, where runs stand side by side.

    Such are Time Run 1, Position Run 1, Time Run 2 …; none of any other header.
    """
    runs = dict[str, dict[str, str]]()
    for name in header:
        if match := _RUN.search(name):
            runs.setdefault(match[1], {})[name[: match.start()].strip()] = name
    first = next(iter(runs.values()), {})
    whole = len(first) > 1 and len(header) == len(first) * len(runs)
    return runs if len(runs) > 1 and whole and all(one.keys() == first.keys() for one in runs.values()) else {}


def runs_below(cells: Sheet) -> Sheet:
    """Return a table whose runs stand side by side with one below the other; any other as it is."""
    if not (runs := runs_in(cells.header)):
        return cells
    first = next(iter(runs.values()))
    places = [
        (run, row) for run, one in runs.items() for row in range(len(cells))
        if not all(is_missing(cells.columns[name][row]) for name in one.values())
    ]  # fmt: skip
    made = ((name, [cells.columns[runs[run][name]][row] for run, row in places]) for name in first)
    said = f"{len(runs)} runs side by side, their numbers in the column 'recording'"
    recordings = [f"run {run}" for run, _ in places]
    return cells.gathered([row for _, row in places]).with_columns([("recording", recordings), *made], said)


def refusal_side_by_side(header: Sequence[str]) -> str:
    """Return how to write tables that stand side by side, with the same names again; empty of any other header."""
    bare = [_RUN.sub("", name).strip() for name in header]
    repeated = [name for name in bare if name and bare.count(name) > 1]
    again = [*dict.fromkeys(repeated)]
    copies = len(repeated) // max(len(again), 1)
    known = {*recognise(again, impact_vocabulary(PLANE)).names}
    whole = any(map(_RUN.search, header)) or bool({"time", "vx_post", "vy_post"} & known)  # not axes of markers
    if len(again) < _MIN_BESIDE or repeated != again * copies or not whole:
        return ""
    if {"vx_post", "vy_post"} & known and any(bare.count(name) == 1 for name in bare if name):
        return (
            f"each row has {copies} bodies, each with {', '.join(map(repr, again))}: {_MOVING}; impacts with "
            "a floor that share a row are written one below the other, with the name of the body in a column object"
        )
    return (
        f"{copies} tables stand side by side, each with the columns {', '.join(map(repr, again))}; write them "
        "one below the other under these names, with a column recording (of frames) or trial (of impacts) that says "
        "which is which, or each into a file of its own in one folder"
    )


def _bodies_in_row(header: Sequence[str]) -> dict[str, dict[str, str]]:
    """Names of columns by ours, of each word without which some names are those of a whole table of impacts."""
    parts = {name: [part for part in _BETWEEN.split(name) if part] for name in header}
    bodies = dict[str, dict[str, str]]()
    for word in dict.fromkeys(part for split in parts.values() for part in split):
        without = {
            "_".join(part for part in split if part != word): name for name, split in parts.items() if word in split
        }
        known = recognise([*without], impact_vocabulary(PLANE))
        if {*_NEEDED} <= {*known.names}:
            bodies[word] = {ours: without[name] for ours, name in known.names.items()}
    whole = [*bodies.values()]
    apart = all(not {*one.values()} & {*other.values()} for k, one in enumerate(whole) for other in whole[:k])
    return bodies if apart else {}
