"""All runs below some folders: what they differ in, and one flat table of them, a row for each run and model.

| columns | content |
| --- | --- |
| `run`, `command`, `path` | name of the run's folder, the command, the file of its result |
| `model`, `own` | name of the model; whether it is the run's own, by which runs are compared |
| `bound`, `law_alone` | whether it is a bound and no model; whether it is the law without the run's effects |
| `law`, `learned`, `given`, `found` | law of the run, learned model, given effects, effects that a diagnosis found |
| `verdict`, `physics` | of a diagnosis, and its conclusion about corrected data |
| `trained_on` | number of training trials |
| `mass_error`, `mass_error_low`, `mass_error_high` … | each error with its 95 % interval; of bounds those they bound |
| `outside_admissible` | share of impulses that gain energy, pull or leave penetration |
| `back_spin` | share of outcomes beyond the line of sticking |
| `data`, `trials`, `data_sha256` | the impacts |
| `job`, `config_sha256`, `code` | identity of the run, see docs/sweeps.md; empty for runs of versions without it |
| `version_contactlearn`, `version_python` … | versions |
| `seed`, `setting_train.size` … | every setting in which the runs differ; empty where a run does not have it |
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.events import ignore, track
from contactlearn.data import table
from contactlearn.diagnosis.events import OnEvent
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval, Norm, headline_metric
from contactlearn.results.folder import FILES, find_results, read_result
from contactlearn.results.state import read_done
from contactlearn.results.tables import FORMATS
from contactlearn.results.types import (
    BEST_POST_HOC,
    HIGHEST_ERROR,
    IRB,
    DataSource,
    DiagnosisRun,
    Evaluation,
    JudgedModel,
    ModelErrors,
    Training,
    Transfer,
)

_NAMED = ("model", "effect", "candidate")  # settings that hold entries by name
_IN_COLUMNS = ("law", "law._target_", "data._target_")  # settings with a column of their own
_ABSENT = object()

Settings = dict[str, list[str | None]]
"""Each run's value as text by the dotted key of a setting, None where a run has no such setting."""


@dataclass(frozen=True, kw_only=True)
class ComparedRun:
    """A run and its result; names in it can be printed.

    Args:
        name: of its folder, below the one that all runs are in.
        path: of the file of its result.
        result: as it was read.
    """

    name: str
    path: Path
    result: Training | Evaluation | DiagnosisRun

    @property
    def command(self) -> str:
        """Name of the command."""
        return {Training: "train", Evaluation: "evaluate", DiagnosisRun: "diagnose"}[type(self.result)]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """The diagnosis; None of another command."""
        return self.result.diagnosis if isinstance(self.result, DiagnosisRun) else None

    @property
    def data(self) -> DataSource:
        """The impacts."""
        data = self.result.provenance.data
        return replace(data, source=printable(data.source), sha256=printable(data.sha256))

    @property
    def config(self) -> Mapping[str, Any]:
        """The composed configuration."""
        return self.result.provenance.config

    @property
    def versions(self) -> dict[str, str]:
        """Versions of this program, Python and the libraries that compute, by name."""
        return {printable(name): printable(number) for name, number in self.result.provenance.versions.items()}

    @property
    def law(self) -> str | None:
        """Name of the law; None for a model without one, and for data that were refused."""
        if isinstance(self.result, DiagnosisRun):
            law = self.result.diagnosis.law if self.result.diagnosis.ladder else None
        else:
            law = self.result.law
        return None if law is None else printable(law)

    @property
    def learned(self) -> str | None:
        """Name of the learned model; None for a law, with effects or without."""
        learned = self.result.learned if isinstance(self.result, Training) else None
        if self._judged is not None and self._judged.coverage is not None:
            learned = self.own
        return None if learned is None else printable(learned)

    @property
    def _judged(self) -> JudgedModel | None:
        """The run's own model, if it is one from a checkpoint."""
        return self.result.trained.get(self.result.model) if isinstance(self.result, Evaluation) else None

    @property
    def given(self) -> tuple[EffectId, ...]:
        """Effects in the model from the start."""
        return self.result.diagnosis.given if isinstance(self.result, DiagnosisRun) else self.result.effects

    @property
    def found(self) -> tuple[EffectId, ...]:
        """Effects that a diagnosis found missing."""
        return () if self.diagnosis is None else tuple(missing.effect for missing in self.diagnosis.missing)

    @property
    def trained_on(self) -> int | None:
        """Number of training trials; None for a diagnosis."""
        if isinstance(self.result, Training):
            return self.result.trained_on
        if self._judged is not None:
            return self._judged.trained_on
        return self.result.fits[0].trials if isinstance(self.result, Evaluation) else None

    @property
    def own(self) -> str:
        """Name in `errors` of the model by which runs are compared."""
        return "named" if isinstance(self.result, DiagnosisRun) else printable(self.result.model)

    @property
    def law_alone(self) -> str | None:
        """Name in `errors` of the law without the effects, fitted as the model with them; None without effects."""
        if isinstance(self.result, DiagnosisRun):
            return "law"
        others = (x for x in self.result.joint if x != self.result.model and x in self.result.errors)
        return next(map(printable, others), None)

    @property
    def bounds(self) -> tuple[str, ...]:
        """Names in `errors` that are bounds and no models; of a diagnosis also the noise floor."""
        return ("noise", IRB) if isinstance(self.result, DiagnosisRun) else (BEST_POST_HOC, IRB)

    @property
    def norm(self) -> Norm:
        """The norm of the bounds; a diagnosis has errors in the mass norm alone."""
        return "mass" if isinstance(self.result, DiagnosisRun) else self.result.norm

    @property
    def errors(self) -> dict[str, Interval | ModelErrors]:
        """Held-out errors by model: all of them, or those of the headline; none of data that were refused."""
        if isinstance(self.result, DiagnosisRun):
            budget = self.result.diagnosis.budget
            if budget is None:
                return {}
            floor = {} if budget.noise is None else {"noise": budget.noise}
            return {"named": budget.named, "law": budget.base, **floor, IRB: budget.bound}
        return {printable(name): errors for name, errors in self.result.errors.items()}

    def error(self, metric: str, model: str | None = None) -> Interval | None:
        """Return a held-out error of a model, by default of the run's own; None where there is none."""
        error = self.errors.get(model or self.own)
        if isinstance(error, ModelErrors):
            return error.intervals.get(metric)
        return error if metric == headline_metric(self.norm) else None


def common_metric(runs: Iterable[ComparedRun]) -> str:
    """Return the metric by which runs are compared: their headline, or the mass error where they differ in it."""
    norms = {run.norm for run in runs}
    return headline_metric(norms.pop() if len(norms) == 1 else "mass")


# --- Reading --------------------------------------------------------------------------------------


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


def read_runs(roots: Sequence[Path], on_event: OnEvent = ignore) -> tuple[list[ComparedRun], list[tuple[str, str]]]:
    """Read all runs in folders and in what is below them.

    Returns:
        The runs by name, run 10 behind run 9; and why others are not among them, by name.

    Raises:
        ContactLearnError: none can be read.
    """
    runs: list[ComparedRun] = []
    skipped: list[tuple[str, str]] = []
    top = Path(os.path.commonpath(roots))
    paths = dict.fromkeys(path for root in roots for path in find_results(root))
    for path in track(paths, "reading runs", on_event):
        name = os.path.relpath(path.parent if path.name in FILES else path, top)
        name = printable(top.name if name == "." else name)
        try:
            result = _comparable(path)
        except ContactLearnError as error:
            skipped.append((f"{name} ({path.name})" if path.name in FILES else name, printable(str(error))))
            continue
        both = all((path.parent / file).exists() for file in FILES)
        runs.append(ComparedRun(name=f"{name} ({path.stem})" if both else name, path=path, result=result))
    if not runs:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in skipped[:5])
        nothing = "neither diagnosis.json nor results.json is there, as train, evaluate and diagnose leave them"
        raise ContactLearnError(f"no run can be read in {', '.join(map(str, roots))}: {reasons or nothing}")
    return sorted(runs, key=lambda run: natural_order(run.name)), skipped


def _comparable(path: Path) -> Training | Evaluation | DiagnosisRun:
    """Read the result of a run that others can be compared with.

    Raises:
        ContactLearnError: in one line, why it is none.
    """
    result = read_result(path)
    if isinstance(result, Transfer):
        raise ContactLearnError("is a transfer to other bodies, which has no one held-out error; see its own figures")
    if isinstance(result, DiagnosisRun) and (budget := result.diagnosis.budget) is not None:
        rungs = (rung.error for rung in result.diagnosis.ladder)
        errors = (budget.named, budget.base, budget.bound, *rungs)
        if not all(0 <= x < HIGHEST_ERROR for error in errors for x in error):
            raise ContactLearnError(f"an error of the diagnosis must be 0 or more, and less than {HIGHEST_ERROR:g}")
    return result


def natural_order(name: str) -> list[tuple[bool, int, str]]:
    """Return a key that sorts run 10 behind run 9."""
    parts = re.split(r"(\d{1,15})", name, flags=re.ASCII)
    return [(k % 2 == 0, int(part) if k % 2 else 0, part) for k, part in enumerate(parts)]


def printable(value: Any) -> str:
    """Return a value as a cell or a terminal shows it, with a blank for every character that is not printable."""
    value = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else " " for c in value)


# --- The flat table -------------------------------------------------------------------------------


def write_table(
    folders: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], on_event: OnEvent = ignore
) -> tuple[pd.DataFrame, list[tuple[str, str]]]:
    """Write the table of all runs in folders and in what is below them.

    Args:
        folders: runs, sweeps, or trees of them.
        out: a .parquet or .csv file.
        on_event: receives the progress.

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
    runs, skipped = read_runs(absolute(folders), on_event)
    frame = as_table(runs)
    table.write_frames([frame], path)
    return frame, skipped


def repeated_jobs(folders: Iterable[Path]) -> str:
    """Say how many runs repeat the job of another one, which a table counts twice; empty if none does."""
    codes = dict[tuple[str, str], list[str]]()
    for done in map(read_done, dict.fromkeys(folders)):
        if done is not None:
            codes.setdefault((done.config, done.data), []).append(done.code)
    count = sum(len(some) - 1 for some in codes.values())
    if not count:
        return ""
    versions = any(len({*some}) > 1 for some in codes.values())
    fix = "with another version of the code, which the column code names" if versions else "in another folder"
    return f"note: {count} of the runs {'repeats' if count == 1 else 'repeat'} the job of another one, {fix}"


def as_table(runs: Sequence[ComparedRun]) -> pd.DataFrame:
    """Return the rows of all models of some runs; a run without errors has one row without a model."""
    settings = {f"setting_{key}": _typed(values) for key, values in varying(runs).items()}
    entries: list[dict[str, Any]] = []
    for k, run in enumerate(runs):
        done, diagnosis = read_done(run.path.parent), run.diagnosis
        about = {
            "run": run.name,
            "command": run.command,
            "path": printable(str(run.path)),
            "law": run.law,
            "learned": run.learned,
            "given": ", ".join(map(str, run.given)),
            "found": ", ".join(map(str, run.found)),
            "verdict": None if diagnosis is None else str(diagnosis.verdict),
            "physics": None if diagnosis is None or diagnosis.physics is None else str(diagnosis.physics),
            "trained_on": run.trained_on,
            "data": run.data.source,
            "trials": run.data.trials,
            "data_sha256": run.data.sha256,
            "job": None if done is None else done.job,
            "config_sha256": None if done is None else done.config,
            "code": None if done is None else done.code,
            **{f"version_{name}": number for name, number in run.versions.items()},
        }
        about |= {key: values[k] for key, values in settings.items()}
        entries += [about | model for model in _models(run)]
    frame = pd.DataFrame(entries)
    first = ["run", "command", "model", "own", "bound", "law_alone", *_columns(common_metric(runs))]
    return frame.reindex(columns=[*first, *(name for name in frame.columns if name not in first)])


def _models(run: ComparedRun) -> Iterator[dict[str, Any]]:
    """Yield name and errors of each model of a run."""
    for name, errors in run.errors.items():
        if isinstance(errors, ModelErrors):
            intervals = errors.intervals
            rest = {"outside_admissible": errors.outside_admissible, "back_spin": errors.back_spin}
        else:
            intervals, rest = {headline_metric(run.norm): errors}, {}
        numbers = {key: x for metric, ends in intervals.items() for key, x in zip(_columns(metric), ends, strict=True)}
        roles = {"own": name == run.own, "bound": name in run.bounds, "law_alone": name == run.law_alone}
        yield {"model": name, **roles, **numbers, **rest}
    if not run.errors:
        yield {"model": None, "own": True, "bound": False, "law_alone": False}


def _columns(metric: str) -> tuple[str, str, str]:
    """Name the columns of an error and of the ends of its interval."""
    return metric, f"{metric}_low", f"{metric}_high"


def _typed(values: Sequence[str | None]) -> list[Any]:
    """Return settings as numbers, if all are."""
    numbers = pd.to_numeric(pd.Series(values, dtype=object), errors="coerce")
    text = any(value is not None and pd.isna(number) for value, number in zip(values, numbers, strict=True))
    return list(values) if text else numbers.tolist()


# --- Settings -------------------------------------------------------------------------------------


def varying(runs: Sequence[ComparedRun]) -> Settings:
    """Return the settings in which runs differ."""
    return differing([run.config for run in runs], [run.command for run in runs])


def differing(configs: Sequence[Mapping[str, Any]], commands: Sequence[str]) -> Settings:
    """Return the settings in which the configurations of some commands differ."""
    return {key: values for key, values in _settings(configs, commands).items() if _differ(values)}


def distinguishing(runs: Sequence[ComparedRun]) -> Settings:
    """Return everything in which runs differ: data, command, law and given effects first, then settings."""
    parts: Settings = {
        "data": [run.data.source for run in runs],
        "command": [run.command for run in runs],
        "law": [run.law for run in runs],
        "effects": [", ".join(map(str, run.given)) or "none" for run in runs],
    }
    return {key: values for key, values in parts.items() if len(set(values)) > 1} | varying(runs)


def shared(runs: Sequence[ComparedRun]) -> list[tuple[str, str]]:
    """Return the settings that are the same wherever they are, with the commands that have them where not all do."""
    settings = []
    for key, values in _settings([run.config for run in runs], [run.command for run in runs]).items():
        there = [(value, run.command) for value, run in zip(values, runs, strict=True) if value is not None]
        if there and not _differ(values):
            commands = sorted({command for _, command in there})
            few = len(commands) < len({run.command for run in runs})
            settings.append((key, there[0][0] + (f" ({', '.join(commands)})" if few else "")))
    return settings


def _differ(values: Sequence[str | None]) -> bool:
    return len({value for value in values if value is not None}) > 1


def _settings(configs: Sequence[Mapping[str, Any]], commands: Sequence[str]) -> Settings:
    return dict(_below("", configs, [(command,) for command in commands]))


def _below(
    path: str, values: Sequence[Any], kinds: Sequence[tuple[str, ...]]
) -> Iterator[tuple[str, list[str | None]]]:
    """Yield the settings below a path.

    Where only some runs of one kind (command, source of data …) have a setting, having it is a difference.
    """
    there = [value for value in values if value is not _ABSENT]
    if not there or not all(isinstance(value, Mapping) for value in there):
        yield path, [None if value is _ABSENT else printable(value) for value in values]
        return
    kinds = [
        kind if value is _ABSENT else (*kind, str(value.get("_target_", "")))
        for kind, value in zip(kinds, values, strict=True)
    ]
    if path in _NAMED and path != "effect":  # of which each has a column
        yield path, [None if value is _ABSENT else ", ".join(map(printable, value)) or "none" for value in values]
    for key in dict.fromkeys(key for value in there for key in value):
        below = [value.get(key, _ABSENT) if isinstance(value, Mapping) else _ABSENT for value in values]
        where = f"{path}.{printable(key)}" if path else printable(key)
        options = where == "law" and all(isinstance(value, Mapping) for value in below)
        if (where in _IN_COLUMNS and not options) or (path.startswith("model.") and key == "law"):
            continue
        having = {kind for kind, value in zip(kinds, below, strict=True) if value is not _ABSENT}
        lacking = any(
            value is _ABSENT and outer is not _ABSENT and kind in having
            for kind, value, outer in zip(kinds, below, values, strict=True)
        )
        if path in _NAMED or not lacking:
            yield from _below(where, below, kinds)
        else:
            blanks = ("–" if kind in having else None for kind in kinds)
            yield where, [x if value is _ABSENT else printable(value) for value, x in zip(below, blanks, strict=True)]
