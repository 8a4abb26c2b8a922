"""All runs below some folders as one tidy table: a row for each run and model of it, for pandas and the like.

| columns | content |
| --- | --- |
| `run`, `command`, `path` | name of the run's folder, the command, the file of its result |
| `model`, `own`, `bound` | name of the model; whether runs are compared by it; whether it is a bound and no model |
| `law`, `learned`, `given`, `found` | of the run: law, learned model, effects in it, effects that a diagnosis found |
| `trained_on` | number of training trials |
| `mass_error`, `mass_error_low`, `mass_error_high` … | each error with its 95 % interval; dimensionless, or m/s |
| `outside_admissible` | share of impulses that gain energy, pull or leave penetration |
| `data`, `trials`, `data_sha256` | the impacts |
| `job`, `config_sha256`, `code` | identity of the run, see docs/sweeps.md; empty for runs of versions without it |
| `version_contactlearn`, `version_python` … | versions |
| `seed`, `setting_train.size` … | every setting in which the runs differ; empty where a run does not have it |
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.inference.evaluation.metrics import HEADLINE, METRICS, Interval
from contactlearn.report.figures.style import BOUNDS
from contactlearn.report.page.runs.reading import Progress, absolute, read_runs, silent
from contactlearn.report.page.runs.rows import LAW, Row
from contactlearn.report.page.runs.settings import varying
from contactlearn.results.state import read_done
from contactlearn.results.tables import FORMATS, write_frames


def write_table(
    folders: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], progress: Progress = silent
) -> tuple[pd.DataFrame, list[tuple[str, str]]]:
    """Write the table of all runs in folders and in what is below them.

    Args:
        folders: runs, sweeps, or trees of them.
        out: a .parquet or .csv file.
        progress: wraps the reading of the files, with a description.

    Returns:
        The table, and why runs are not in it, by name.

    Raises:
        ContactLearnError: nothing can be read, or the file cannot be written.
        UnknownNameError: a suffix that is no table format.
    """
    path = Path(out)
    suffix = path.suffix.removeprefix(".")
    if suffix not in FORMATS:
        raise UnknownNameError("table format", suffix, FORMATS)
    runs, skipped = read_runs(absolute(folders), progress)
    frame = as_table(runs)
    try:
        write_frames([frame], path)
    except OSError as error:
        raise ContactLearnError(f"{path}: cannot be written: {error.strerror}") from None
    return frame, skipped


def as_table(runs: Sequence[Row]) -> pd.DataFrame:
    """Return the rows of all models of some runs."""
    settings = {key: _typed(values) for key, values in varying(runs)}
    entries = []
    for k, run in enumerate(runs):
        about = _about(run) | {f"setting_{key}": values[k] for key, values in settings.items()}
        entries += [about | model for model in _models(run)]
    frame = pd.DataFrame(entries)
    first = ["run", "command", "model", "own", "bound", *(f"{HEADLINE}{end}" for end in ("", "_low", "_high"))]
    return frame[[*first, *(name for name in frame.columns if name not in first)]]


def _about(run: Row) -> dict[str, Any]:
    """What all models of a run share."""
    done = read_done(run.path.parent)
    return {
        "run": run.name,
        "command": run.command,
        "path": str(run.path),
        "law": run.law,
        "learned": None if run.model == LAW else run.model,
        "given": ", ".join(map(str, run.given)),
        "found": ", ".join(map(str, run.found)),
        "verdict": run.verdict,
        "trained_on": run.trained_on,
        "data": run.data.source,
        "trials": run.data.trials,
        "data_sha256": run.data.sha256,
        "job": None if done is None else done.job,
        "config_sha256": None if done is None else done.config,
        "code": None if done is None else done.code,
        **{f"version_{name}": number for name, number in run.versions.items()},
    }


def _models(run: Row) -> Iterator[dict[str, Any]]:
    """Name and errors of each model of a run; of a diagnosis the law alone, the whole model, noise and bound."""
    for name, errors in run.errors.items():
        columns = {metric: errors.of(metric) for metric in METRICS}
        model = {"model": name, "own": name == run.compared, "bound": name in BOUNDS}
        yield model | _intervals(columns) | {"outside_admissible": errors.outside_admissible}
    if not run.errors and run.error is not None:
        parts = {"named": run.error, "law": run.base, "noise": run.noise, **run.bounds}
        for name, error in parts.items():
            if error is not None:
                model = {"model": name, "own": name == "named", "bound": name in ("noise", *BOUNDS)}
                yield model | _intervals({HEADLINE: error})


def _intervals(columns: Mapping[str, Interval]) -> dict[str, float]:
    ends = {"": "mean", "_low": "low", "_high": "high"}
    return {f"{name}{end}": getattr(one, part) for name, one in columns.items() for end, part in ends.items()}


def _typed(values: Sequence[str | None]) -> list[Any]:
    """Settings as numbers, if all are."""
    numbers = pd.to_numeric(pd.Series(values, dtype=object), errors="coerce")
    text = any(value is not None and pd.isna(number) for value, number in zip(values, numbers, strict=True))
    return list(values) if text else numbers.tolist()
