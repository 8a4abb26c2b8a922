"""A result of any kind as a row: of the page over several runs, and of the table of results."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.figures.style import BOUNDS
from contactlearn.report.text import base_label, conclusion, rung_label
from contactlearn.results import folder
from contactlearn.results.diagnosis import DiagnosisRun
from contactlearn.results.estimates import ModelErrors
from contactlearn.results.evaluation import Evaluation
from contactlearn.results.provenance import DataSource, Provenance
from contactlearn.results.training import Training
from contactlearn.results.transfer import Transfer

HASH = 10
"""Digits of the hash of data that are shown."""
_HIGHEST = 1e9
LAW = "law"
"""Model of a run without a learned one."""


@dataclass(frozen=True, kw_only=True)
class LadderRung:
    """A rung of a diagnosis' ladder: its words and its error."""

    name: str
    error: Interval


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run; errors are mass errors.

    Args:
        name: of the run on the page.
        path: of its file.
        command: train, evaluate or diagnose.
        law: by name; None where there is none.
        model: name of the learned model, or `LAW`.
        given: effects in the model from the start.
        found: effects that a diagnosis found missing.
        data: the impacts.
        config: the composed configuration.
        version: of this program.
        error: of the run's model.
        base: of the law without the effects.
        noise: of measurement noise alone.
        bounds: by name.
        verdict: of a diagnosis, in words.
        ladder: of a diagnosis.
        curves: sizes and errors of learning curves by model.
        versions: of this program, Python and the libraries that compute, by name.
        trained_on: training trials; None for a diagnosis.
        compared: name in `errors` of the model that `error` is of.
        errors: all errors of all models and bounds by name; none for a diagnosis.
    """

    name: str = ""
    path: Path
    command: str
    law: str | None
    model: str = LAW
    given: tuple[EffectId, ...]
    found: tuple[EffectId, ...] = ()
    data: DataSource
    config: Mapping[str, Any]
    version: str
    error: Interval | None = None
    base: Interval | None = None
    noise: Interval | None = None
    bounds: Mapping[str, Interval] = field(default_factory=dict)
    verdict: str | None = None
    ladder: tuple[LadderRung, ...] = ()
    curves: Mapping[str, tuple[tuple[float, ...], tuple[Interval, ...]]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    trained_on: int | None = None
    compared: str | None = None
    errors: Mapping[str, ModelErrors] = field(default_factory=dict)


def read_row(path: Path) -> Row:
    """Read the file of a run as a row.

    Raises:
        ContactLearnError: in one line, why it cannot be one.
    """
    result = folder.read_result(path)
    if isinstance(result, DiagnosisRun):
        return _diagnosis(path, result)
    if isinstance(result, Transfer):
        raise ContactLearnError("is a transfer to other bodies, which has no one held-out error; see its own figures")
    if isinstance(result, Training):
        return _training(path, result)
    if isinstance(result, Evaluation):
        return _evaluation(path, result)
    raise ContactLearnError("is a result of a kind without a row")


def _training(path: Path, result: Training) -> Row:
    return Row(
        **_common(path, result.provenance),
        command="train",
        law=None if result.law is None else printable(result.law),
        model=LAW if result.learned is None else printable(result.learned),
        given=result.effects,
        error=result.errors[result.model].headline,
        base=_alone(result),
        bounds={"irb": result.irb},
        trained_on=result.trained_on,
        **_errors(result),
    )


def _evaluation(path: Path, result: Evaluation) -> Row:
    return Row(
        **_common(path, result.provenance),
        command="evaluate",
        law=printable(result.law),
        given=result.effects,
        error=result.errors[result.model].headline,
        base=_alone(result),
        bounds={name: result.errors[name].headline for name in BOUNDS if name in result.errors},
        curves={printable(name): (curve.sizes, curve.headline) for name, curve in result.learning_curves.items()},
        trained_on=result.fits[0].trials,
        **_errors(result),
    )


def _errors(result: Training | Evaluation) -> dict[str, Any]:
    return {
        "compared": printable(result.model),
        "errors": {printable(name): errors for name, errors in result.errors.items()},
    }


def _diagnosis(path: Path, result: DiagnosisRun) -> Row:
    found, base = result.diagnosis, base_label(result.diagnosis)
    ladder = tuple(
        LadderRung(name=printable(rung_label(one, base)), error=_drawable(one.error)) for one in found.ladder
    )
    row = Row(
        **_common(path, result.provenance),
        command="diagnose",
        law=printable(found.law) if found.law is not None and ladder else None,
        given=found.given,
        found=tuple(one.effect for one in found.missing),
        verdict=printable(conclusion(found.verdict, found.physics, found.corrections)),
        ladder=ladder,
    )
    if (budget := found.budget) is None:
        return row
    error, base, noise, bound = map(_drawable, (budget.named, budget.base, budget.noise, budget.bound))
    return replace(row, error=error, base=base, noise=noise, bounds={"irb": bound})


def _drawable(error: Interval) -> Interval:
    """The error, if a page can draw it."""
    if not all(0 <= x < _HIGHEST for x in error):
        raise ContactLearnError(f"an error of the diagnosis must be 0 or more, and less than {_HIGHEST:g}")
    return error


def _common(path: Path, provenance: Provenance) -> dict[str, Any]:
    data = provenance.data
    return {
        "path": path,
        "data": DataSource(source=printable(data.source), trials=data.trials, sha256=printable(data.sha256)),
        "config": provenance.config,
        "version": printable(provenance.versions.get("contactlearn", "?")),
        "versions": {printable(name): printable(number) for name, number in provenance.versions.items()},
    }


def _alone(result: Training | Evaluation) -> Interval | None:
    """Error of the law that was fitted as the model with effects was; None without effects."""
    errors: Mapping[str, ModelErrors] = result.errors
    return next((errors[name].headline for name in result.joint if name != result.model and name in errors), None)


def printable(value: Any) -> str:
    """Return a value as a cell or a terminal shows it, with a blank for every character that is not printable."""
    value = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else " " for c in value)
