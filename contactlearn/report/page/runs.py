"""Pages from run folders alone: no data source is read and nothing is fitted.

redraw       the page of one run
write_runs   several runs as one page: what they differ in, their errors and learning curves, and what was found
"""

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.events import ignore
from contactlearn.core.numerics import is_number
from contactlearn.diagnosis.events import OnEvent
from contactlearn.diagnosis.record import Record
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import METRICS, Interval
from contactlearn.report.figures.browser import as_plotly, plotly_style
from contactlearn.report.figures.learning import run_curves
from contactlearn.report.figures.style import BOUNDS, MODEL_STYLE, STYLES, LawStyle, law_style
from contactlearn.report.page.diagnosis import write_page
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import FILE, render, save, write
from contactlearn.report.page.trials import digits
from contactlearn.report.terminal import next_commands
from contactlearn.report.text.names import base_label, effect_label, join_words, label, rung_label
from contactlearn.report.text.sentences import conclusion, phrase, phrases
from contactlearn.results import folder as run_folder
from contactlearn.results.folder import is_run
from contactlearn.results.runs import (
    ComparedRun,
    Settings,
    absolute,
    as_table,
    common_metric,
    distinguishing,
    printable,
    read_runs,
    shared,
    varying,
)
from contactlearn.results.tables import HeldOut
from contactlearn.results.types import IRB, DiagnosisRun, Evaluation

MARK = "contactlearn report"
"""Mark by which such a page is recognised."""
_SETTINGS_IN_FRONT = 5  # settings that come before what was found, not after it
_HASH = 10  # digits of the hash of data that are shown
_SIZE = "train.size"
_NUMBER = re.compile(r"[-+]?(\d{1,15}\.?\d{0,17}|\.\d+)(e[-+]?\d{1,2})?")
_PLAIN = ("law", "command", "data")  # traits of a line that are written without their key
_LOOKS = [style for name, style in (MODEL_STYLE | STYLES).items() if name not in BOUNDS]  # where its own is taken
_NOT_RUN = Interval(math.nan, math.nan, math.nan)


def has_page(folder: Path) -> bool:
    """Whether a folder holds one run, of a kind that has a page of its own: an evaluation or a diagnosis."""
    files = [*run_folder.files(folder)]
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
    result = run_folder.read_result(path)
    try:
        if isinstance(result, Evaluation):
            return write(folder, of_evaluation(result, HeldOut.load(folder, result)))
        if isinstance(result, DiagnosisRun):
            diagnosis = result.diagnosis
            diagnosis = replace(diagnosis, record=None if diagnosis.choices is None else Record.load(folder))
            use, coming = result.use if diagnosis.missing else "", next_commands(result, folder)
            return write_page(folder, diagnosis, result.provenance, use=use, next_commands=coming)
    except OSError as error:
        raise ContactLearnError(f"{folder}: cannot be written: {error.strerror}") from None
    raise ContactLearnError(f"{folder}: a run of kind {result.kind} has no page of its own")


def write_runs(
    folders: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    on_event: OnEvent = ignore,
) -> tuple[Path, list[ComparedRun], list[tuple[str, str]]]:
    """Write one page over all runs in some folders and below them.

    Args:
        folders: runs, sweeps, or trees of them.
        out: the page; else report.html in the one folder, or here if that is a run or there are several.
        on_event: receives the progress.

    Returns:
        The page, the runs on it, and why others are not, by name.

    Raises:
        ContactLearnError: nothing can be read, or the page would replace something that is not one.
    """
    roots = absolute(folders)
    target = _target(roots, out)
    runs, skipped = read_runs(roots, on_event)
    content = of_runs(runs, skipped, target.parent)
    try:
        return save(target, render(content, "runs.html.j2", scripts=("runs.js",))), runs, skipped
    except OSError as error:
        raise ContactLearnError(f"{target}: cannot be written: {error.strerror}") from None


def _target(roots: Sequence[Path], out: str | os.PathLike[str] | None) -> Path:
    """Return the path of the page; it replaces nothing but another page over several runs."""
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


def of_runs(runs: Sequence[ComparedRun], skipped: Sequence[tuple[str, str]], folder: Path) -> dict[str, Any]:
    """Return the content of the page, with links relative to `folder`; scripts do not get entries that begin with _."""
    settings, metric = varying(runs), common_metric(runs)
    errors = _errors(as_table(runs), metric)
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
                **{key: digits(values[k], 8) for key, values in errors.items()},
            }
            for k, (run, traits) in enumerate(zip(runs, _traits(runs), strict=True))
        ],
        **learning_lines(runs, settings, metric),
        "error": METRICS[metric].label,
        "_mark": MARK,
        "_measure": phrase("measure", METRICS[metric].norm),
        "_sentences": _sentences(runs, metric),
        "_warnings": _warnings(runs, settings),
        "_data": [asdict(data) | {"runs": sum(run.data.sha256 == key for run in runs)} for key, data in bases.items()],
        "_skipped": skipped,
        "_shared": shared(runs),
        "_columns": _columns(runs, errors, settings, families, several, f"Held-out {METRICS[metric].name}"),
        "_links": [_link(run, folder) for run in runs],
        "_ladders": [
            {
                "run": k,
                "name": run.name,
                "law": _with(run),
                "ladder": [
                    {**asdict(one.error), "name": printable(rung_label(one, base_label(found)))} for one in found.ladder
                ],
            }
            for k, run in enumerate(runs)
            if (found := run.diagnosis) is not None and found.ladder
        ],
    }


def _traits(runs: Sequence[ComparedRun]) -> list[list[tuple[str, str]]]:
    """Return the settings that distinguish each run, by the last word of their names, or else its name."""
    settings = [(key.rpartition(".")[2], values) for key, values in distinguishing(runs).items()]
    traits = [[(key, x) for key, values in settings if (x := values[k]) is not None] for k in range(len(runs))]
    times = Counter(map(tuple, traits))
    return [
        one if one and times[tuple(one)] == 1 else [*one, ("run", run.name)]
        for one, run in zip(traits, runs, strict=True)
    ]


def _errors(table: pd.DataFrame, metric: str) -> dict[str, list[dict[str, float] | None]]:
    """Return the held-out errors of each run: its own model, the law alone, the noise and the bound."""
    rows = {"error": table.own, "base": table.law_alone, "noise": table.model == "noise", "bound": table.model == IRB}
    columns = {metric: "mean", f"{metric}_low": "low", f"{metric}_high": "high"}
    return {
        key: [
            None if pd.isna(one["mean"]) else one
            for one in table[which].set_index("run").rename(columns=columns)[[*columns.values()]]
            .reindex(table.run.unique()).to_dict("records")
        ]
        for key, which in rows.items()
    }  # fmt: skip


def _columns(
    runs: Sequence[ComparedRun],
    errors: Mapping[str, list[Any]],
    settings: Settings,
    families: Sequence[str],
    several: bool,
    error: str,
) -> list[dict[str, Any]]:
    """Return name, kind (text, number, tick or error) and cells (text, sort key) of each column.

    `error` is the name of the column of the runs' own errors.
    """

    def column(
        name: str, values: Iterable[Any], kind: str = "text", shown: Callable[[Any], str] = str
    ) -> dict[str, Any]:
        cells = [("–", None) if value is None else (shown(value), value) for value in values]
        return {"name": name, "kind": kind, "cells": cells}

    def of_errors(name: str, key: str) -> dict[str, Any]:
        return {"name": name, "kind": "error", "cells": [(x, None if x is None else x["mean"]) for x in errors[key]]}

    def ticks(family: str) -> dict[str, Any]:
        return {"name": printable(label(family)), "kind": "tick", "cells": [_tick(run, family) for run in runs]}

    found = [of_errors(error, "error")]
    if len({run.command for run in runs}) > 1:
        found.append(column("Command", [run.command for run in runs]))
    own = [
        column(name, [None if value is None else float(value) for value in values], "number", lambda x: f"{x:.12g}")
        if all(value is None or _NUMBER.fullmatch(value) for value in values)
        else column(name, values)
        for name, values in settings.items()
    ]
    found += own if len(own) <= _SETTINGS_IN_FRONT else []
    found.append(column("Law", [None if run.law is None else law_style(run.law).label for run in runs]))
    if any(run.learned for run in runs):
        found.append(column("Model", [law_style(run.learned or "law").label for run in runs]))
    found += [
        column("Verdict", map(_verdict, runs)),
        column("Missing effects", [", ".join(map(_words, run.found)) or None for run in runs]),
        of_errors("Law alone", "base"),
        of_errors("Noise floor", "noise"),
        of_errors("IRB bound", "bound"),
    ]
    found += [ticks(family) for family in families]
    found += own if len(own) > _SETTINGS_IN_FRONT else []
    if several:
        found += [
            column("Data", [run.data.source for run in runs]),
            column("Trials", [run.data.trials for run in runs], "number"),
            column("SHA-256 of the data", [run.data.sha256[:_HASH] for run in runs], "hash"),
        ]
    needed = {error, "Law"}
    return [one for one in found if one["name"] in needed or any(key is not None for _, key in one["cells"])]


def _tick(run: ComparedRun, family: str) -> tuple[str, int | None]:
    """Describe whether an effect of a family was found or given, with a rank to sort by."""
    if any(effect.name == family for effect in run.found):
        return "found", 2
    return "", 1 if any(effect.name == family for effect in run.given) else None


def _words(effect: EffectId) -> str:
    return printable(effect_label(effect))


def _verdict(run: ComparedRun) -> str | None:
    if (diagnosis := run.diagnosis) is None:
        return None
    return printable(conclusion(diagnosis.verdict, diagnosis.physics, diagnosis.corrections))


def _with(run: ComparedRun) -> str:
    """Name the law with the effects that were given."""
    law, given = law_style(run.law or "no law").label, join_words(map(_words, run.given)) if run.given else ""
    return f"{law} with {given}" if given else law


def _sentences(runs: Sequence[ComparedRun], metric: str) -> list[str]:
    """Count the runs, and name the one with the lowest error on each set of data."""
    best = []
    for data in {run.data.sha256: run.data for run in runs}.values():
        there = [(run, error) for run in runs if run.data.sha256 == data.sha256 and (error := run.error(metric))]
        if len(there) > 1:
            first, least = min(there, key=lambda one: one[1].mean)
            overlaps = sum(run is not first and error.low <= least.high for run, error in there)
            best.append((data, len(there), first.name, least, overlaps))
    return phrases("runs_summary", Counter(run.command for run in runs), best)


def _warnings(runs: Sequence[ComparedRun], settings: Settings) -> list[str]:
    """Explain why errors may not be comparable."""
    diagnosed = sum(run.command == "diagnose" for run in runs)
    split = [key for key in settings if key in ("split_seed", "test")]
    versions = sorted({run.versions.get("contactlearn", "?") for run in runs})
    data, norms = len({run.data.sha256 for run in runs}), len({run.norm for run in runs})
    return phrases("runs_warnings", data, norms, diagnosed, len(runs) - diagnosed, split, versions)


def _link(run: ComparedRun, folder: Path) -> str | None:
    """Return the link to the page of a run: a relative path, whatever the folders are called."""
    own = run.path.parent / FILE
    if not own.is_file():
        return None
    try:
        return "./" + quote(os.fsencode(Path(os.path.relpath(own, folder)).as_posix()))
    except ValueError:  # another drive
        return own.as_uri()


# --- Learning curves ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Line:
    """A line of the figure.

    Args:
        model: by name.
        traits: the words that distinguish it from other lines, by setting; those of the model have the key "".
        sha256: hash of its data.
        points: error by number of training trials.
        rows: its runs.
    """

    model: str
    traits: Mapping[str, str]
    sha256: str
    points: dict[float, Interval] = field(default_factory=dict)
    rows: list[int] = field(default_factory=list)


def learning_lines(runs: Sequence[ComparedRun], settings: Settings, metric: str) -> dict[str, Any]:
    """Return `curves`, lines {label, sizes, intervals, level, runs}, and their figure, in which a `gid` is their place.

    A line is of runs that differ in `train.size` and in nothing else; without such, of a model of an evaluation that
    has learning curves.  The bounds on the same data come last.
    """
    lines = [line for line in _across(runs, settings, metric) or _within(runs, metric) if line.points]
    if not lines:
        return {"curves": []}
    ends = min(size for line in lines for size in line.points), max(size for line in lines for size in line.points)
    yardsticks = _yardsticks(runs, settings, metric, {line.sha256 for line in lines})
    yardsticks = [one for one in yardsticks if one.model not in {line.model for line in lines}]
    drawn, words = [*lines, *yardsticks], [*_labels(lines), *_labels(yardsticks)]
    looks = [*_distinct_styles(lines), *(law_style(line.model) for line in yardsticks)]
    entries, curves, levels = list[dict[str, Any]](), dict[str, dict[float, Interval]](), dict[str, Interval]()
    for gid, line in enumerate(drawn):
        points = dict(sorted(line.points.items()))
        level = not line.rows and len({value.mean for value in points.values()}) == 1
        if level:
            levels[str(gid)] = next(iter(points.values()))
            points = dict.fromkeys(ends, levels[str(gid)])
        else:
            curves[str(gid)] = points
        intervals = [digits(asdict(point), 8) for point in points.values()]
        entries.append(
            {"label": words[gid], "sizes": [*points], "intervals": intervals, "level": level, "runs": line.rows}
        )
    sizes = sorted({size for points in curves.values() for size in points})
    table = {gid: np.array([[*points.get(size, _NOT_RUN)] for size in sizes]) for gid, points in curves.items()}
    styles = {str(gid): look._replace(label=words[gid]) for gid, look in enumerate(looks)}
    figure = run_curves(sizes, table, levels, styles, METRICS[metric].axis)
    return {"curves": entries, "figures": {"curve": digits(as_plotly(figure), 8)}}


def _across(runs: Sequence[ComparedRun], settings: Settings, metric: str) -> list[_Line]:
    """Return lines of runs that differ in nothing but their size."""
    lines: dict[tuple[tuple[str, str], ...], _Line] = {}
    for k, size, traits in _sized(runs, settings):
        run = runs[k]
        if (error := run.error(metric)) is not None:
            name = run.learned or run.law or "no law"
            law = {"law": law_style(run.law).label} if run.law and name != run.law else {}
            traits = {"": law_style(name).label, **law, **traits, "command": f"{run.command}.py"}
            line = lines.setdefault(tuple(traits.items()), _Line(model=name, traits=traits, sha256=run.data.sha256))
            line.points.setdefault(size, error)
            line.rows.append(k)
    return [line for line in lines.values() if len(line.points) > 1]


def _within(runs: Sequence[ComparedRun], metric: str) -> list[_Line]:
    """Return the learning curves of evaluations."""
    return [
        _Line(
            model=printable(name),
            traits={"": law_style(printable(name)).label, **_parts(run), "run": run.name},
            sha256=run.data.sha256,
            points=dict(zip(curve.sizes, curve.of(metric), strict=True)),
            rows=[k],
        )
        for k, run in enumerate(runs)
        if isinstance(run.result, Evaluation)
        for name, curve in run.result.learning_curves.items()
        if metric in curve.intervals
    ]


def _yardsticks(runs: Sequence[ComparedRun], settings: Settings, metric: str, data: Container[str]) -> list[_Line]:
    """Return the bounds of evaluations on these data; equal ones once."""
    lines: dict[tuple[str | tuple[str, str], ...], _Line] = {}
    for k, size, traits in _sized(runs, settings):
        run = runs[k]
        if run.data.sha256 in data and run.command == "evaluate":
            for name in run.bounds:
                value = run.error(metric, name)
                if value is None:
                    continue
                line = _Line(model=name, traits={"": law_style(name).label, **traits}, sha256=run.data.sha256)
                lines.setdefault((name, *traits.items()), line).points.setdefault(size, value)
    unique = {(line.model, line.sha256, *(x.mean for x in line.points.values())): line for line in lines.values()}
    return list(unique.values())


def _sized(runs: Sequence[ComparedRun], settings: Settings) -> Iterator[tuple[int, float, dict[str, str]]]:
    """Yield place, number of training trials and all other differing settings of each run."""
    for k, run in enumerate(runs):
        train = run.config.get("train")
        size = train.get("size") if isinstance(train, Mapping) else None
        if is_number(size) and 0 < size < 1e12:
            others = {key: x for key, values in settings.items() if key != _SIZE and (x := values[k]) is not None}
            yield k, size, _parts(run) | others


def _parts(run: ComparedRun) -> dict[str, str]:
    effects = {"effects": ", ".join(map(effect_label, run.given))} if run.given else {}
    return effects | {"data": f"{run.data.source} {run.data.sha256[:_HASH]}"}


def _labels(lines: Iterable[_Line]) -> list[str]:
    """Label each line by its model and by the traits in which the lines differ, data last."""
    traits = [line.traits for line in lines]
    values = {key: {one.get(key) for one in traits} for one in traits for key in one if key}
    differing = [key for key in values if len(values[key] - (set() if key in ("effects", "run") else {None})) > 1]
    differing.sort(key=lambda key: (key != "law", key != "effects", key == "data"))
    return [
        ", ".join((one[""], *(one[key] if key in _PLAIN else f"{key} {one[key]}" for key in differing if key in one)))
        for one in traits
    ]


def _distinct_styles(lines: Sequence[_Line]) -> list[LawStyle]:
    """Give a line a free colour if another line has its own; colours repeat when none is free."""
    styles, taken = [law_style(line.model) for line in lines], set[str]()
    free = [style for style in _LOOKS if style.color not in {one.color for one in styles}]
    for place, style in enumerate(styles):
        if style.color in taken:
            styles[place] = free.pop(0) if free else _LOOKS[place % len(_LOOKS)]
        taken.add(styles[place].color)
    return styles
