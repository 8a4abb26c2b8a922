"""What a diagnosis said of a set, and its score."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from fifth_hand import sets
from fifth_hand.meanings import ACCEPTABLE, UNKNOWN, Right
from second_nature.judge import matches
from third_hand.judge import Said, hear


def ask(name: str, seconds: float) -> dict[str, Any]:
    """Read the file of a set and write down what the diagnosis says of it, within so many seconds."""
    outlines = {body: one.shape for body, one in zip("AB", sets.SETS[name].bodies, strict=False)}
    return ask_of(sets, name, outlines, seconds)


def ask_of(sets: ModuleType, name: str, outlines: Mapping[str, dict | None], seconds: float) -> dict[str, Any]:
    """The same of a set of any hand, with the outlines of its bodies."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.csv")
        sets.write(sets.draw(name), path)
        return hear(path, outlines, seconds)


@dataclass(frozen=True, kw_only=True)
class Score:
    """Answers to the questions of a set; None where a question is not asked of it.

    Where nothing is hidden, `silent`: no name is given, and nothing is called unknown.

    Of effects with a name, `first`: the first name is one of theirs or an acceptable one; `exact`: each name is, and
    none is left; `inside`: that, or the simpler model is.  `false_unknown`: the verdict is that something is unknown,
    where nothing is.

    Of unknown physics, `unknown`: the verdict says so; `accepted`: it does, or there are names, all of them acceptable;
    `sentence`: what is said of what remains names the right coefficient or a right variable; `both`: along the
    sequence, where a coefficient follows it, the right one and what it follows.
    """

    silent: bool | None = None
    first: bool | None = None
    exact: bool | None = None
    inside: bool | None = None
    false_unknown: bool | None = None
    unknown: bool | None = None
    accepted: bool | None = None
    sentence: bool | None = None
    both: bool | None = None


@dataclass(frozen=True)
class Truth:
    """What is hidden: the effects of each set by its number, what is right to say of unknown ones, and `acceptable`.

    The latter are names of known effects, by set and hidden effect, that are as right as the hidden one's.
    """

    hidden: Mapping[str, Sequence[str]]
    unknown: Mapping[str, Right]
    acceptable: Mapping[str, Mapping[str, Sequence[str]]] = field(default_factory=dict)

    def score(self, said: Said) -> Score:
        """Compare an answer with what is hidden."""
        unknown = said.verdict == "unknown"
        if not self.hidden[said.name]:
            return Score(silent=not said.effects and not unknown, false_unknown=unknown)
        if right := self._right(said.name):
            coefficient, follows = _of_the_sequence(right, said.succession)
            return Score(
                unknown=unknown,
                accepted=unknown or (bool(said.effects) and set(said.effects) <= set(right.acceptable)),
                sentence=coefficient or follows or _of_the_state(right, said),
                both=coefficient and follows if right.follows and right.coefficient else None,
            )
        accepted = self._accepted(said.name)
        models = [said.effects] if said.simpler is None else [said.effects, said.simpler]
        return Score(
            first=bool(said.effects) and said.effects[0] in self.names(said.name),
            exact=matches(said.effects, accepted),
            inside=any(matches(model, accepted) for model in models),
            false_unknown=unknown,
        )

    def names(self, name: str) -> set[str]:
        """All right and acceptable names of the set of this number."""
        if right := self._right(name):
            return set(right.acceptable)
        return set().union(*self._accepted(name))

    def _accepted(self, name: str) -> list[set[str]]:
        """The right names of each effect with a name that is hidden in the set of this number."""
        return [{one, *self.acceptable.get(name, {}).get(one, ())} for one in self.hidden[name]]

    def _right(self, name: str) -> Right | None:
        return next((self.unknown[one] for one in self.hidden[name] if one in self.unknown), None)


def _of_the_sequence(right: Right, told: dict[str, Any] | None) -> tuple[bool, bool]:
    """Whether the coefficient that follows the sequence, and what it follows, are right."""
    if told is None or not right.follows:
        return False, False
    follows = told["follows"] in right.follows
    if told["follows"] == "period" and right.period is not None:
        follows = abs(told["trials"] / right.period - 1) < 0.05
    return told["coefficient"] == right.coefficient, follows


def _of_the_state(right: Right, said: Said) -> bool:
    """Whether a coefficient that depends on the state is right, or one of the first two variables that are told."""
    told = [] if said.remainder is None else predictable(said.remainder)[:2]
    if said.modulation is not None:
        told += said.modulation["variables"][:2]
        if right.coefficient is not None and said.modulation["coefficient"] == right.coefficient:
            return True
    return not set(told).isdisjoint(right.variables)


def predictable(told: dict[str, Any]) -> list[str]:
    """Symbols that the residual depends on, by their shares; none where it is not predictable."""
    if not told["components"] or told["share"]["low"] <= 0:
        return []
    return [one["symbol"] for one in sorted(told["variables"], key=lambda one: -one["share"])]


TRUTH = Truth({name: [one.what for one in scene.hidden] for name, scene in sets.SETS.items()}, UNKNOWN, ACCEPTABLE)
