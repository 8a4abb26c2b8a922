"""What a diagnosis said of a set, and its score."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from threadpoolctl import threadpool_limits

from contactlearn import diagnose
from contactlearn.data import table
from contactlearn.diagnosis.result import Diagnosis, Modulation, Succession
from contactlearn.report.text.modulation import depends
from contactlearn.report.text.sequence import follows
from second_nature.judge import matches
from third_hand import sets
from third_hand.meanings import CORRECTIONS, MEANINGS, TWINS
from third_hand.nature import Scene


@dataclass(frozen=True, kw_only=True)
class Said:
    """An answer: a line of the file that is kept.  Names are in their order, `rivals` beside each."""

    name: str
    verdict: str
    effects: list[str] = field(default_factory=list)
    forms: list[str] = field(default_factory=list)
    confidence: list[float] = field(default_factory=list)
    rivals: list[list[str]] = field(default_factory=list)
    simpler: list[str] | None = None
    """Names of the model with fewer effects that does nearly as well; None where there is none."""
    corrections: list[str] = field(default_factory=list)
    succession: dict[str, Any] | None = None
    """What follows the sequence of the trials, by `coefficient`, `follows`, `trials`, `share` and its `words`."""
    modulation: dict[str, Any] | None = None
    """What depends on the state of each trial, by `coefficient`, `variables`, `share` and its `words`."""
    remainder: dict[str, Any] | None = None
    """All that is said of what remains, as `Remainder` has it."""
    seconds: float = 0.0
    error: str = ""


def ask(name: str, seconds: float) -> dict:
    """Read the file of a set and write down what the diagnosis says of it, within so many seconds."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.csv")
        sets.write(sets.draw(name), path)
        return hear(path, {body.name: body.shape for body in sets.SETS[name].bodies}, seconds)


def hear(
    path: Path, outlines: Mapping[str, dict | None], seconds: float, columns: Mapping[str, str] | None = None
) -> dict:
    """Diagnose the file of a set, with the columns that have other names.

    The outlines of its bodies are told where all of them can be, by their names where there are several.
    """
    torch.set_num_threads(1)
    name, start = path.stem, time.perf_counter()
    with threadpool_limits(1):
        try:
            (first, *others) = outlines.values()
            shape = (outlines if others else first) if all(outlines.values()) else None
            impacts = table.load(path, columns=columns, shape=shape, validate=False)
            answer = written(name, diagnose(impacts, seconds=seconds))
        except Exception as problem:  # a diagnosis that fails is a wrong answer, and the others go on
            answer = Said(name=name, verdict="failed", error=f"{type(problem).__name__}: {problem}")
        return asdict(answer) | {"seconds": time.perf_counter() - start}


def written(name: str, found: Diagnosis) -> Said:
    """The answer in words."""
    return Said(
        name=name,
        verdict=str(found.verdict),
        effects=list(found.effects),
        forms=[str(one.effect) for one in found.missing],
        confidence=[one.confidence for one in found.missing],
        rivals=[[rival.effect.name for rival in one.rivals] for one in found.missing],
        simpler=None if found.simpler is None else [one.name for one in found.simpler.effects],
        corrections=[str(one) for one in found.corrections],
        succession=None if found.remainder is None else _succession(found.remainder.succession),
        modulation=None if found.remainder is None else _modulation(found.remainder.modulation),
        remainder=None if found.remainder is None else asdict(found.remainder),
    )


def _succession(found: Succession | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "coefficient": found.coefficient,
        "follows": found.follows,
        "trials": found.trials,
        "share": found.share.mean,
        "words": follows(found),
    }


def _modulation(found: Modulation | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "coefficient": found.coefficient,
        "variables": [one.symbol for one in found.variables],
        "share": found.share.mean,
        "words": depends(found),
    }


@dataclass(frozen=True, kw_only=True)
class Score:
    """Answers to the questions of a set; None where a question is not asked of it.

    `first`: the first name is hidden, or a twin of the hidden one.  `exact`: each name is a hidden effect, and none is
    left.  `inside`: that, or the simpler model is the hidden set.  `silent`: no name is given.  `unknown`: the verdict
    is that something is unknown.  `twins`: the hidden effect and a twin are both among names and rivals.  `fault`: the
    measurement is called wrong where it is, and nowhere else; `correction`: where it rightly is, the right one is
    made, or none where there is none.  An instrument whose errors follow one another, or are gross, may be called
    either.
    """

    first: bool | None = None
    exact: bool | None = None
    inside: bool | None = None
    silent: bool | None = None
    unknown: bool | None = None
    twins: bool | None = None
    fault: bool | None = None
    correction: bool | None = None


EITHER = ("ar1", "wander", "outliers")
"""Noise of which it is a matter of taste whether it is a fault of the measurement."""


def score(said: Said) -> Score:
    """Compare an answer with what is hidden."""
    scene = sets.SETS[said.name]
    fault = said.verdict == "bad_data"
    sound = None if scene.noise.kind in EITHER else not fault
    if scene.kind == "measurement":
        right = said.corrections == CORRECTIONS[scene.effects[0].what]
        return Score(fault=fault, correction=right if fault else None)
    if scene.kind == "nothing":
        return Score(silent=not said.effects, fault=sound)
    if scene.kind == "unknown":
        return Score(silent=not said.effects, unknown=said.verdict == "unknown", fault=sound)
    hidden = hidden_names(scene)
    twins = set(TWINS.get(said.name, ()))
    accepted = [*hidden[:-1], hidden[-1] | twins]
    models = [said.effects] if said.simpler is None else [said.effects, said.simpler]
    exact, inside = matches(said.effects, accepted), any(matches(model, accepted) for model in models)
    shown = {*said.effects, *(rival for rivals in said.rivals for rival in rivals)}
    return Score(
        first=bool(said.effects) and any(said.effects[0] in names for names in accepted),
        exact=exact,
        inside=inside,
        twins=bool(shown & hidden[0]) and bool(shown & twins) if twins else None,
        fault=sound,
    )


def hidden_names(scene: Scene) -> list[set[str]]:
    """The right names of each hidden effect of the catalogue's kind."""
    return [set(MEANINGS[effect.what]) for effect in scene.effects if effect.what in MEANINGS]
