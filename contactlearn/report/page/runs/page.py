"""Several runs as one page: what they differ in, their held-out errors, and what was found."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import quote

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.figures.browser import plotly_style
from contactlearn.report.page.page import FILE, render, save
from contactlearn.report.page.runs.lines import learning_lines
from contactlearn.report.page.runs.reading import Progress, absolute, read_runs, silent
from contactlearn.report.page.runs.rows import HASH, LAW, Row, printable
from contactlearn.report.page.runs.settings import Settings, shared, telling, varying
from contactlearn.report.page.trials import digits
from contactlearn.report.text import effect_label, interval, join_words, label
from contactlearn.results.folder import is_run

MARK = "contactlearn report"
"""How such a page is known again."""
_FEW = 5  # settings that come before what was found, not after it


def write_runs(
    folders: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    progress: Progress = silent,
) -> tuple[Path, list[Row], list[tuple[str, str]]]:
    """One page over all runs in `folders` and in what is below them.

    Args:
        folders: runs, sweeps, or trees of them.
        out: the page; else report.html in the one folder, or here if that is a run or there are several.
        progress: wraps the reading of the files, with a description.

    Returns:
        The page, the runs on it, and why others are not, by name.

    Raises:
        ContactLearnError: nothing can be read, or the page would replace something that is not one.
    """
    roots = absolute(folders)
    target = _target(roots, out)
    runs, skipped = read_runs(roots, progress)
    content = of_runs(runs, skipped, target.parent)
    try:
        return save(target, render(content, "runs.html.j2", scripts=("runs.js",))), runs, skipped
    except OSError as error:
        raise ContactLearnError(f"{target}: cannot be written: {error.strerror}") from None


def _target(roots: Sequence[Path], out: str | os.PathLike[str] | None) -> Path:
    """Where the page goes: never in place of a run's own, nor of anything but such a page."""
    single = roots[0] if len(roots) == 1 and not is_run(roots[0]) else Path.cwd()
    path = Path(os.path.abspath(single / FILE if out is None else out))
    if path.suffix != ".html":
        raise ContactLearnError(f"--out must be an .html file, got {path.name}; try --out {path.stem or 'runs'}.html")
    if not path.parent.is_dir():
        raise ContactLearnError(f"{path.parent}: no such folder; --out makes a file, and no folders")
    if path.name == FILE and is_run(path.parent):
        raise ContactLearnError(f"{path} is the page of the run in that folder; name another with --out FILE")
    if path.is_dir():
        raise ContactLearnError(f"{path} is a folder; name a file with --out FILE")
    if path.exists() and f'content="{MARK}"' not in path.read_bytes()[:4096].decode(errors="replace"):
        raise ContactLearnError(f"{path} exists and is no page over several runs; name another with --out FILE")
    return path


def of_runs(runs: Sequence[Row], skipped: Sequence[tuple[str, str]], folder: Path) -> dict[str, Any]:
    """All that the page says and draws; links are from `folder`.  What begins with "_" the scripts do without."""
    settings = varying(runs)
    families = sorted({effect.name for run in runs for effect in (*run.given, *run.found)})
    several = len({run.data.sha256 for run in runs}) > 1
    bases = {run.data.sha256: run.data for run in runs}
    return {
        "title": f"{len(runs)} runs side by side" if len(runs) > 1 else "One run",
        "trials": None,
        "effects": [{"name": name, "label": printable(label(name))} for name in families],
        "runs": [
            {
                "name": run.name,
                "traits": traits,
                **plotly_style(run.law or "no law"),
                "effects": [effect.name for effect in (*run.given, *run.found)],
                **_errors(run),
            }
            for run, traits in zip(runs, _traits(runs), strict=True)
        ],
        "curves": learning_lines(runs, settings),
        "_mark": MARK,
        "_sentences": _sentences(runs),
        "_warnings": _warnings(runs, settings),
        "_data": [asdict(data) | {"runs": sum(run.data.sha256 == key for run in runs)} for key, data in bases.items()],
        "_skipped": skipped,
        "_shared": shared(runs),
        "_columns": _columns(runs, settings, families, several),
        "_links": [_link(run, folder) for run in runs],
        "_ladders": [
            {
                "run": k,
                "name": run.name,
                "law": _with(run),
                "ladder": [{**asdict(one.error), "name": one.name} for one in run.ladder],
            }
            for k, run in enumerate(runs)
            if run.ladder
        ],
    }


def _traits(runs: Sequence[Row]) -> list[list[tuple[str, str]]]:
    """The settings that tell each run from the others, by the last word of their names; and its name where none do."""
    settings = [(key.rpartition(".")[2], values) for key, values in telling(runs)]
    traits = [[(key, x) for key, values in settings if (x := values[k]) is not None] for k in range(len(runs))]
    times = Counter(map(tuple, traits))
    return [
        one if one and times[tuple(one)] == 1 else [*one, ("run", run.name)]
        for one, run in zip(traits, runs, strict=True)
    ]


def _columns(runs: Sequence[Row], settings: Settings, families: Sequence[str], several: bool) -> list[dict[str, Any]]:
    """Name, kind (text, number, tick or error) and cells (what is shown, what is sorted by) of each column."""

    def column(
        name: str, values: Iterable[Any], kind: str = "text", shown: Callable[[Any], str] = str
    ) -> dict[str, Any]:
        cells = [("–", None) if value is None else (shown(value), value) for value in values]
        return {"name": name, "kind": kind, "cells": cells}

    def errors(name: str, values: Iterable[Any]) -> dict[str, Any]:
        return {"name": name, "kind": "error", "cells": [_error_cell(value) for value in values]}

    def ticks(family: str) -> dict[str, Any]:
        return {"name": printable(label(family)), "kind": "tick", "cells": [_tick(run, family) for run in runs]}

    found = [errors("Held-out mass error", [run.error for run in runs])]
    if len({run.command for run in runs}) > 1:
        found.append(column("Command", [run.command for run in runs]))
    own = [
        column(name, [None if one is None else float(one) for one in values], "number", lambda x: f"{x:.12g}")
        if _numeric(values)
        else column(name, values)
        for name, values in settings
    ]
    found += own if len(own) <= _FEW else []
    found.append(column("Law", [None if run.law is None else plotly_style(run.law)["label"] for run in runs]))
    if any(run.model != LAW for run in runs):
        found.append(column("Model", [plotly_style(run.model)["label"] for run in runs]))
    found += [
        column("Verdict", [run.verdict for run in runs]),
        column(
            "Missing effects",
            [", ".join(map(_words, run.found)) or None for run in runs],
        ),
        errors("Law alone", [run.base for run in runs]),
        errors("Noise floor", [run.noise for run in runs]),
        errors("IRB bound", [run.bounds.get("irb") for run in runs]),
    ]
    found += [ticks(family) for family in families]
    found += own if len(own) > _FEW else []
    if several:
        found += [
            column("Data", [run.data.source for run in runs]),
            column("Trials", [run.data.trials for run in runs], "number"),
            column("SHA-256 of the data", [run.data.sha256[:HASH] for run in runs], "hash"),
        ]
    needed = {"Held-out mass error", "Law"}
    return [one for one in found if one["name"] in needed or any(key is not None for _, key in one["cells"])]


def _tick(run: Row, family: str) -> tuple[str, int | None]:
    """Whether an effect of a family was found, or was in the model from the start; and the rank of that."""
    if any(effect.name == family for effect in run.found):
        return "found", 2
    return "", 1 if any(effect.name == family for effect in run.given) else None


def _words(effect: EffectId) -> str:
    return printable(effect_label(effect))


def _errors(run: Row) -> dict[str, Any]:
    """Errors as the scripts have them."""
    values = {"error": run.error, "base": run.base, "noise": run.noise, "bound": run.bounds.get("irb")}
    return {name: None if value is None else digits(asdict(value), 8) for name, value in values.items()}


def _error_cell(value: Interval | None) -> tuple[dict[str, float] | None, float | None]:
    return (None, None) if value is None else (asdict(value), value.mean)


def _numeric(values: Iterable[str | None]) -> bool:
    return all(
        value is None or re.fullmatch(r"[-+]?(\d{1,15}\.?\d{0,17}|\.\d+)(e[-+]?\d{1,2})?", value) for value in values
    )


def _with(run: Row) -> str:
    """The law with the effects that were given to it."""
    law, given = plotly_style(run.law or "no law")["label"], join_words(map(_words, run.given)) if run.given else ""
    return f"{law} with {given}" if given else law


def _sentences(runs: Sequence[Row]) -> list[str]:
    """How many there are, and which leaves the least error on each set of data."""
    commands = {run.command: sum(other.command == run.command for other in runs) for run in runs}
    said = [f"Runs of {join_words(f'{command}.py ({count})' for command, count in commands.items())}."]
    for data in {run.data.sha256: run.data for run in runs}.values():
        there = [(run, run.error) for run in runs if run.data.sha256 == data.sha256 and run.error]
        if len(there) < 2:
            continue
        best, least = min(there, key=lambda one: one[1].mean)
        near = sum(run is not best and error.low <= least.high for run, error in there)
        overlap = {0: "no other interval overlaps its own", 1: "one other interval overlaps its own"}
        said.append(
            f"Of {len(there)} runs on {data.source} ({data.trials} trials, {data.sha256[:HASH]}) run {best.name} has "
            f"the lowest error, {interval(asdict(least))}; "
            f"{overlap.get(near, f'{near} other intervals overlap its own')}."
        )
    return said


def _warnings(runs: Sequence[Row], settings: Settings) -> list[str]:
    """Why errors may not be compared, in words."""
    said, count = [], len({run.data.sha256 for run in runs})
    if count > 1:
        said.append(
            f"These runs are on {count} different sets of data, so their errors cannot be compared with each other: "
            "only those with the same hash can."
        )
    held_out = [run.command for run in runs if run.command != "diagnose"]
    if held_out and len(held_out) < len(runs):
        said.append(
            "Errors of diagnose.py are cross-validated over all trials, those of the other commands are on one share "
            "of them that was held out; small differences between the two mean nothing."
        )
    split = [key for key, _ in settings if key in ("seed", "test")]
    if len(held_out) > 1 and split:
        said.append(
            f"Runs that differ in {join_words(split)} hold out different trials, so their errors differ by chance too."
        )
    versions = sorted({run.version for run in runs})
    if len(versions) > 1:
        said.append(f"They come from different versions of contactlearn: {', '.join(versions)}.")
    return said


def _link(run: Row, folder: Path) -> str | None:
    """From the page to the run's own; nothing in it but a relative path, whatever the folders are called."""
    own = run.path.parent / FILE
    if not own.is_file():
        return None
    try:
        return "./" + quote(os.fsencode(Path(os.path.relpath(own, folder)).as_posix()))
    except ValueError:  # another drive
        return own.as_uri()
