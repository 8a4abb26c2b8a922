"""What a diagnosis said of a set, scored against the truth.  `Said` is a line of the file that is kept."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from threadpoolctl import threadpool_limits

from contactlearn import diagnose
from second_nature.truth import Asked, PlantedSet, Truth


@dataclass(frozen=True, kw_only=True)
class Said:
    """What the diagnosis said: names in their order with confidence, the law, the verdict, and what else it shows."""

    name: str
    group: str
    half: str
    n: int
    truth: dict[str, Any]
    effects: list[str]
    forms: list[str]
    confidence: list[float]
    parameters: list[dict[str, float]]
    rivals: list[list[str]]
    law: str | None
    verdict: str
    physics: str | None
    findings: list[str]
    remainder: list[str]
    """Variables of the predictable residual by their share, the largest first; empty where nothing was found."""
    formulas: list[str]
    models: list[tuple[str, list[str], float]] | None
    """Law, names and share of belief of each model that is reported; None where the result has none."""
    seconds: float
    gains: list[float]
    """Share of the error that each named effect takes away, the others in the model."""
    shares: list[float]
    """Share of the plausible models that has each named effect."""
    left: float
    """Share of the error that flexible models take away beyond the named effects."""
    simpler: list[str] | None = None
    """Names of the model that is reported to do nearly as well with fewer effects."""
    complete: bool = True
    error: str = ""


def ask(planted_set: PlantedSet) -> dict[str, Any]:
    """Draw a set, let the diagnosis look at its impacts alone, and write down what it says."""
    torch.set_num_threads(1)
    with threadpool_limits(1):
        planted = planted_set.draw()
        start = time.perf_counter()
        try:
            found, error = diagnose(planted.impacts), ""
        except Exception as problem:  # a diagnosis that fails is a wrong answer, and the others go on
            found, error = None, f"{type(problem).__name__}: {problem}"
        seconds = time.perf_counter() - start
    known = {
        "name": planted_set.name,
        "group": planted_set.group,
        "half": planted_set.half,
        "n": len(planted.impacts),
        "truth": asdict(planted.truth),
        "seconds": seconds,
        "error": error,
    }
    return known | (_written(found) if found else _NOTHING)


_NOTHING = asdict(
    Said(
        name="", group="", half="", n=0, truth={}, effects=[], forms=[], confidence=[], parameters=[], rivals=[],
        law=None, verdict="failed", physics="failed", findings=[], remainder=[], formulas=[], models=None, seconds=0,
        gains=[], shares=[], left=0.0,
    )
)  # fmt: skip
_NOTHING = {k: v for k, v in _NOTHING.items() if k not in ("name", "group", "half", "n", "truth", "seconds", "error")}


def _gain(reduction: float, found) -> float:
    """The reduction of the error by an effect, as a share of the error without it."""
    return reduction / max(found.budget.named.mean + reduction, 1e-300)


def _written(found) -> dict[str, Any]:
    models = found.models
    remainder = found.remainder if found.remainder is not None and found.remainder.found else None
    variables = sorted(remainder.variables, key=lambda one: -one.share) if remainder else []
    return {
        "effects": list(found.effects),
        "forms": [str(one.effect) for one in found.missing],
        "confidence": [one.confidence for one in found.missing],
        "parameters": [{p.name: p.value for p in one.parameters} for one in found.missing],
        "rivals": [[rival.effect.name for rival in one.rivals] for one in found.missing],
        "law": found.law,
        "verdict": str(found.verdict),
        "physics": None if found.physics is None else str(found.physics),
        "findings": [str(getattr(finding, "name", finding)) for finding in found.findings],
        "remainder": [one.symbol for one in variables],
        "formulas": [one.text for one in found.formulas],
        "models": [(str(one.law), [e.name for e in one.effects], one.share) for one in models] if models else None,
        "gains": [_gain(one.error_reduction, found) for one in found.missing],
        "shares": [one.share for one in found.missing],
        "left": 0.0 if found.remainder is None else found.remainder.share.mean,
        "simpler": None if found.simpler is None else [one.name for one in found.simpler.effects],
        "complete": found.complete,
    }


SAME = {"corner_radius": "shape_error"}
"""Names that the catalogue has for a part of what another name means in the truth."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Answers to the questions of a set; None where a question is not asked of it."""

    first: bool | None = None
    exact: bool | None = None
    inside: bool | None = None
    false_name: bool | None = None
    unknown: bool | None = None
    variable: bool | None = None
    twins: bool | None = None
    named: tuple[tuple[int, bool], ...] = ()
    """Place of each named effect among the names, and whether it is in the set, where all effects of that are known."""


def score(said: Said) -> Score:
    """Compare what was said with the truth."""
    truth = Truth(**said.truth)
    hidden, names = [set(accepted) for accepted in truth.effects], [SAME.get(name, name) for name in said.effects]
    if truth.asked == Asked.INCLUDES:
        return Score(first=bool(hidden[0] & set(names))) if hidden else Score()
    if truth.asked == Asked.ORDERED:
        right = [name in accepted for name, accepted in zip(names, hidden, strict=False)]
        return Score(first=right[:1] == [True], exact=right == [True] * len(hidden))
    if truth.asked == Asked.UNKNOWN:
        said_so = said.physics == "unknown"
        right = bool(set(said.remainder[:2]) & set(truth.variables))
        known = tuple((k, False) for k, name in enumerate(names) if name not in truth.tolerated)
        return Score(unknown=said_so, variable=said_so and right, named=known)
    shown = {*names, *(rival for rivals in said.rivals for rival in rivals)}
    shown |= {name for _, model, _ in said.models or () for name in model}
    if truth.asked == Asked.TWIN:
        either = hidden[0] | set(truth.rivals)
        seen = bool(shown & hidden[0]) and bool(shown & set(truth.rivals))
        return Score(first=bool(names) and names[0] in either, exact=len(names) == 1 and names[0] in either, twins=seen)
    all_names, names = names, _without_bodies(names)
    models = [_without_bodies(model) for _, model, _ in said.models or ()]
    models += [] if said.simpler is None else [_without_bodies(said.simpler)]
    inside = None if said.models is None else any(matches(model, hidden) for model in models)
    right = tuple(
        (k, any(name in accepted for accepted in hidden)) for k, name in enumerate(all_names) if "body" not in name
    )
    if not hidden:
        return Score(exact=not names, false_name=bool(names), inside=inside, named=right)
    first = bool(names) and any(names[0] in accepted for accepted in hidden)
    return Score(first=first, exact=matches(names, hidden), inside=inside, named=right)


def _without_bodies(names: Sequence[str]) -> list[str]:
    """Names but for parameters by body."""
    return [name for name in names if "body" not in name]


def matches(names: Sequence[str], hidden: Sequence[set[str]]) -> bool:
    """Whether each name is accepted for one hidden effect of its own, and none is left on either side."""
    if len(names) != len(hidden):
        return False
    if not names:
        return True
    return any(
        names[0] in accepted and matches(names[1:], [*hidden[:k], *hidden[k + 1 :]])
        for k, accepted in enumerate(hidden)
    )
