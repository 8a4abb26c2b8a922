"""What the configurations of several runs differ in, and what they share."""

from collections.abc import Mapping, Sequence
from typing import Any

from contactlearn.report.page.runs.rows import Row, printable

_NAMED = ("model", "effect", "candidate")  # hold entries by name
_ELSEWHERE = ("law", "law._target_", "data._target_")  # have columns of their own
_ABSENT = object()

Settings = list[tuple[str, list[str | None]]]
"""Key and each run's value as text, None where a run has no such setting."""


def varying(runs: Sequence[Row]) -> Settings:
    """Settings in which runs differ, by their dotted keys."""
    return [(key, values) for key, values in _settings(runs) if _differ(values)]


def telling(runs: Sequence[Row]) -> Settings:
    """Everything that tells runs apart: data, command, law and given effects first, where runs differ in them."""
    parts: Settings = [
        ("data", [run.data.source for run in runs]),
        ("command", [run.command for run in runs]),
        ("law", [run.law for run in runs]),
        ("effects", [", ".join(map(str, run.given)) or "none" for run in runs]),
    ]
    return [*((name, values) for name, values in parts if len(set(values)) > 1), *varying(runs)]


def shared(runs: Sequence[Row]) -> list[tuple[str, str]]:
    """Settings that are the same wherever they are, by their dotted keys."""
    found = []
    for key, values in _settings(runs):
        there = [(value, run.command) for value, run in zip(values, runs, strict=True) if value is not None]
        if there and not _differ(values):
            commands = sorted({command for _, command in there})
            few = len(commands) < len({run.command for run in runs})
            found.append((key, there[0][0] + (f" ({', '.join(commands)})" if few else "")))
    return found


def _settings(runs: Sequence[Row]) -> Settings:
    kinds = [(run.command,) for run in runs]
    return list(_under("", [run.config for run in runs], kinds))


def _differ(values: Sequence[str | None]) -> bool:
    return len({value for value in values if value is not None}) > 1


def _under(path: str, values: Sequence[Any], kinds: Sequence[tuple[str, ...]]) -> Settings:
    """Settings below a path.

    Where only some runs of one kind (command, source of data …) have a setting, having it is a difference.
    """
    there = [value for value in values if value is not _ABSENT]
    if not there or not all(isinstance(value, Mapping) for value in there):
        return [(path, [None if value is _ABSENT else printable(value) for value in values])]
    kinds = [
        kind if value is _ABSENT else (*kind, str(value.get("_target_", "")))
        for kind, value in zip(kinds, values, strict=True)
    ]
    found = []
    if path in _NAMED and path != "effect":  # of which each has a column
        names = [None if value is _ABSENT else ", ".join(map(printable, value)) or "none" for value in values]
        found.append((path, names))
    for key in dict.fromkeys(key for value in there for key in value):
        below = [value.get(key, _ABSENT) if isinstance(value, Mapping) else _ABSENT for value in values]
        where = f"{path}.{printable(key)}" if path else printable(key)
        options = where == "law" and all(isinstance(value, Mapping) for value in below)
        if (where in _ELSEWHERE and not options) or (path.startswith("model.") and key == "law"):
            continue
        having = {kind for kind, value in zip(kinds, below, strict=True) if value is not _ABSENT}
        lacking = any(
            value is _ABSENT and outer is not _ABSENT and kind in having
            for kind, value, outer in zip(kinds, below, values, strict=True)
        )
        if path in _NAMED or not lacking:
            found += _under(where, below, kinds)
        else:
            said = [
                printable(value) if value is not _ABSENT else "–" if kind in having else None
                for kind, value in zip(kinds, below, strict=True)
            ]
            found.append((where, said))
    return found
