"""A diagnosis from its diagnosis.json, entry by entry, until that is a typed result."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from contactlearn.effects import EffectId
from contactlearn.errors import ContactLearnError
from contactlearn.evaluation.metrics import Interval
from contactlearn.report.page.runs.rows import LadderRung, Row, printable
from contactlearn.results.provenance import DataSource
from contactlearn.serialisation import parsed

VERDICTS = {
    "effects": "effects are missing",
    "none": "nothing is missing",
    "unknown": "something unknown is missing",
    "bad_data": "the data are doubtful",
}
_HIGHEST = 1e9  # of an error or of a number of trials
_NEEDED = object()
_KINDS = {Mapping: "an object", list: "a list", str: "a text", int: "a whole number"}


def diagnosis_row(path: Path) -> Row:
    """Read a diagnosis as a row.

    Raises:
        ContactLearnError: an entry that it lacks, or that is of another kind.
    """
    content = parsed(path.read_bytes())
    _get(content, "data", Mapping)
    for key, kind in (("source", str), ("trials", int), ("sha256", str)):
        _get(content, f"data.{key}", kind)
    data = content["data"]
    common = {
        "path": path,
        "data": DataSource(source=printable(data["source"]), trials=data["trials"], sha256=printable(data["sha256"])),
        "config": _get(content, "config", Mapping),
        "version": printable(_get(content, "versions", Mapping, {}).get("contactlearn", "?")),
        "given": tuple(EffectId(name) for name in _get(content, "config.effect", Mapping, {})),
    }
    return _diagnosis(content, common)


def _diagnosis(content: Mapping, common: dict) -> Row:
    found = [printable(_get(one, "name", str)) for one in _get(content, "missing_effects", list)]
    verdict = _get(content, "verdict", str)
    if verdict not in VERDICTS:
        raise ContactLearnError(f"verdict must be one of {', '.join(VERDICTS)}, got {verdict!r}")
    rungs = _get(content, "ladder", list)
    ladder = tuple(
        LadderRung(name=printable(_get(one, "step", str)), error=_interval(one, f"ladder.{k}"))
        for k, one in enumerate(rungs)
    )
    if ladder and len(ladder) <= len(found):
        raise ContactLearnError("ladder has fewer steps than there are missing_effects")
    bare = [one.error for one in ladder]
    budget = _get(content, "budget", Mapping, {})
    known = {key: _interval(budget[key], f"budget.{key}") for key in ("base", "noise", "bound") if key in budget}
    return Row(
        command="diagnose",
        law=printable(_get(content, "law", str)) if ladder else None,
        found=tuple(map(EffectId.parse, found)),
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
        raise ContactLearnError(f"physics must be one of {', '.join(VERDICTS)}, got {printable(physics)[:60]}")
    if verdict != "bad_data" or "physics" not in content:  # an older file
        return VERDICTS[verdict]
    if physics is None:
        return "the data contradict themselves"
    problems = _get(content, "data_problems", list, [])
    done = [one for one in (_get(problem, "correction", str, None) for problem in problems) if one]
    doubt = f"corrected ({', '.join(map(printable, done))})" if done else VERDICTS[verdict]
    return f"{doubt}; {VERDICTS[physics]}"


def _get(content: Any, path: str, kind: type, default: Any = _NEEDED) -> Any:
    """What is at a dotted path, if it is of a kind; without a default it must be there and not null."""
    for key in path.split("."):
        content = content.get(key) if isinstance(content, Mapping) else None
    if content is None and default is not _NEEDED:
        return default
    if content is None:
        raise ContactLearnError(f"{path} is not there: not from this program, or from an older version of it")
    if not isinstance(content, kind) or isinstance(content, bool):
        raise ContactLearnError(f"{path} must be {_KINDS[kind]}, got {printable(content)[:60]}")
    return content


def _number(x: Any, where: str) -> float:
    if not isinstance(x, (int, float)) or isinstance(x, bool) or not 0 <= x < _HIGHEST:
        raise ContactLearnError(f"{where} must be a number, 0 or more, got {printable(x)[:60]}")
    return x


def _interval(x: Any, where: str) -> Interval:
    x = x if isinstance(x, Mapping) else {}
    return Interval(*(float(_number(x.get(key), f"{where}.{key}")) for key in ("mean", "low", "high")))
