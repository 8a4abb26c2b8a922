"""A run from its file, diagnosis.json or results.json: what a page over several runs says of it.

Nothing in a file is believed: each part is checked when it is read, and a file that lacks one is refused with the
reason.
"""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from contactlearn.errors import ContactLearnError
from contactlearn.evaluation.metrics import HEADLINE
from contactlearn.report.figures.style import BOUNDS

FILES = ("diagnosis.json", "results.json")
VERDICTS = {
    "effects": "effects are missing",
    "none": "nothing is missing",
    "unknown": "something unknown is missing",
    "bad_data": "the data are doubtful",
}
HASH = 10
"""Digits of the hash of data that are shown."""
_LARGEST = 64 * 2**20  # bytes of a file that is read
_HIGHEST = 1e9  # of an error or of a number of trials
_NEEDED = object()
_KINDS = {Mapping: "an object", list: "a list", str: "a text", int: "a whole number"}


@dataclass
class Run:
    """One row; errors are {mean, low, high} or None."""

    path: Path  # of its file
    command: str
    law: str | None
    model: str  # the learned one, or "law"
    given: list[str]
    found: list[str]
    data: dict[str, Any]
    config: Mapping[str, Any]
    version: str
    error: dict[str, float] | None = None
    base: dict[str, float] | None = None
    noise: dict[str, float] | None = None
    bounds: dict[str, dict[str, float]] = field(default_factory=dict)
    verdict: str | None = None  # in words
    ladder: list[dict[str, Any]] = field(default_factory=list)
    curves: dict[str, tuple[list[float], list[dict[str, float]]]] = field(default_factory=dict)
    name: str = ""


def is_run(folder: Path) -> bool:
    return any((folder / name).exists() for name in FILES)


def files(root: Path) -> Iterator[Path]:
    """Files of runs, and folders of runs that have none; hidden folders are left out."""
    for folder, folders, names in os.walk(root):
        if not (there := [name for name in FILES if name in names]) and ".hydra" in folders:
            yield Path(folder)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(folder, name) for name in there)


def read(path: Path) -> Run:
    """A run.

    Raises:
        ContactLearnError: what it lacks.
    """
    if path.name not in FILES:
        raise ContactLearnError("has neither results.json nor diagnosis.json: the run failed, or goes on")
    try:
        if path.stat().st_size > _LARGEST:
            raise ContactLearnError(f"is larger than {_LARGEST >> 20} MiB")
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except OSError as error:
        raise ContactLearnError(f"cannot be read: {error.strerror}") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ContactLearnError(f"is not JSON, or was cut off: {error}") from None
    except RecursionError:
        content = None
    except ContactLearnError:
        raise
    except ValueError as error:
        raise ContactLearnError(f"is not JSON: {error}") from None
    if content is None or _deep(content):
        raise ContactLearnError("is nested too deeply for a file of this program")
    data, config = _get(content, "data", Mapping), _get(content, "config", Mapping)
    for key, kind in (("source", str), ("trials", int), ("sha256", str)):
        _get(content, f"data.{key}", kind)
    common = {
        "path": path,
        "data": {"source": text(data["source"]), "trials": data["trials"], "sha256": text(data["sha256"])},
        "config": config,
        "version": text(_get(content, "versions", Mapping, {}).get("contactlearn", "?")),
        "given": [text(name) for name in _get(content, "config.effect", Mapping, {})],
    }
    if path.name == FILES[0]:
        return _diagnosis(content, common)
    if "transfer" in content and "errors" not in content:
        raise ContactLearnError("is a transfer to other bodies, which has no one held-out error; see its own figures")
    return _results(content, config, common)


def _diagnosis(content: Mapping, common: dict) -> Run:
    found = [text(_get(one, "name", str)) for one in _get(content, "missing_effects", list)]
    verdict = _get(content, "verdict", str)
    if verdict not in VERDICTS:
        raise ContactLearnError(f"verdict must be one of {', '.join(VERDICTS)}, got {verdict!r}")
    rungs = _get(content, "ladder", list)
    ladder = [{"name": text(_get(one, "step", str)), **_interval(one, f"ladder.{k}")} for k, one in enumerate(rungs)]
    if ladder and len(ladder) <= len(found):
        raise ContactLearnError("ladder has fewer steps than there are missing_effects")
    bare = [{key: one[key] for key in ("mean", "low", "high")} for one in ladder]
    budget = _get(content, "budget", Mapping, {})
    known = {key: _interval(budget[key], f"budget.{key}") for key in ("base", "noise", "bound") if key in budget}
    return Run(
        command="diagnose",
        law=text(_get(content, "law", str)) if ladder else None,
        model="law",
        found=found,
        error=bare[len(found)] if bare else None,
        base=known.get("base") or (bare[0] if bare else None),
        noise=known.get("noise"),
        bounds={"irb": known["bound"]} if "bound" in known else {},
        verdict=_said(content, verdict),
        ladder=ladder,
        **common,
    )


def _said(content: Mapping, verdict: str) -> str:
    """The verdict in words; where the data had to be corrected, what they say then."""
    physics = _get(content, "physics", str, None)
    if physics is not None and physics not in VERDICTS:
        raise ContactLearnError(f"physics must be one of {', '.join(VERDICTS)}, got {text(physics)[:60]}")
    if verdict != "bad_data" or "physics" not in content:  # an older file
        return VERDICTS[verdict]
    if physics is None:
        return "the data contradict themselves"
    problems = _get(content, "data_problems", list, [])
    done = [one for one in (_get(problem, "correction", str, None) for problem in problems) if one]
    doubt = f"corrected ({', '.join(map(text, done))})" if done else VERDICTS[verdict]
    return f"{doubt}; {VERDICTS[physics]}"


def _results(content: Mapping, config: Mapping, common: dict) -> Run:
    """Its model is the law with its effects, or the learned one; of an evaluation without effects its law."""
    table, joint = _get(content, "errors", Mapping), list(_get(content, "joint", Mapping, {}))
    if not table:
        raise ContactLearnError("errors is empty")
    errors = {name: _interval(_get(entry, HEADLINE, Mapping), f"errors.{name}") for name, entry in table.items()}
    bounds = {name: errors[name] for name in BOUNDS if name in errors}
    models = {name: error for name, error in errors.items() if name not in BOUNDS} or errors
    law, model = _get(config, "law", str, None), "law"
    if "processes" in content or "laws" not in config:  # train
        command, chosen = "train", list(models)[-1]
        recipe = next(iter(_get(config, "model", Mapping, {}).items()), None)
        if recipe is not None and recipe[0] != "analytical":
            model, law = text(recipe[0]), _get(recipe[1], "law", str, None)
    else:
        command = "evaluate"
        best = min(models, key=lambda name: models[name]["mean"])
        chosen = joint[-1] if joint and joint[-1] in models else law if law in models else best
        law = law if joint or law in models else best
    alone = next((errors[name] for name in joint if name != chosen and name in errors), None)
    curves = {}
    for name, curve in _get(content, "learning_curves", Mapping, {}).items():
        sizes, values = _get(curve, "sizes", list), _get(curve, HEADLINE, list)
        where = f"learning_curves.{name}"
        if len(sizes) != len(values):
            raise ContactLearnError(f"{where} has {len(sizes)} sizes and {len(values)} errors")
        numbers = [_number(size, f"{where}.sizes") for size in sizes]
        curves[text(name)] = (numbers, [_interval(value, where) for value in values])
    return Run(
        command=command,
        law=law and text(law),
        model=model,
        found=[],
        error=models[chosen],
        base=alone,
        bounds=bounds,
        curves=curves,
        **common,
    )


def _get(content: Any, path: str, kind: type, default: Any = _NEEDED) -> Any:
    """What is at a dotted path, if it is of a kind; without a default it must be there and not null."""
    for key in path.split("."):
        content = content.get(key) if isinstance(content, Mapping) else None
    if content is None and default is not _NEEDED:
        return default
    if content is None:
        raise ContactLearnError(f"{path} is not there: not from this program, or from an older version of it")
    if not isinstance(content, kind) or isinstance(content, bool):
        raise ContactLearnError(f"{path} must be {_KINDS[kind]}, got {text(content)[:60]}")
    return content


def _number(x: Any, where: str) -> float:
    if not isinstance(x, (int, float)) or isinstance(x, bool) or not 0 <= x < _HIGHEST:
        raise ContactLearnError(f"{where} must be a number, 0 or more, got {text(x)[:60]}")
    return x


def _interval(x: Any, where: str) -> dict[str, float]:
    x = x if isinstance(x, Mapping) else {}
    return {key: float(_number(x.get(key), f"{where}.{key}")) for key in ("mean", "low", "high")}


def _deep(x: Any, left: int = 40) -> bool:
    inner = x.values() if isinstance(x, Mapping) else x if isinstance(x, list) else ()
    return left == 0 or any(_deep(one, left - 1) for one in inner)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def text(x: Any) -> str:
    """A value as a cell or a terminal shows it; what is no printable character is a blank."""
    x = x if isinstance(x, str) else json.dumps(x, ensure_ascii=False)
    return "".join(c if c.isprintable() else " " for c in x)
