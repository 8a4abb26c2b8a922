"""The tables of answers about sets by a hand whose names and unknown physics are told apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

from fifth_hand.judge import Truth, predictable
from second_nature.tables import reliability_of, share, table
from third_hand.judge import Said

QUESTIONS = {
    "silent": "no name, nothing unknown",
    "first": "first name",
    "exact": "exact set",
    "inside": "exact, or the simpler model is",
    "false_unknown": "unknown said of nothing unknown",
    "unknown": "unknown said",
    "accepted": "unknown, or acceptable names alone",
    "sentence": "right coefficient or variable",
    "both": "right coefficient and what it follows",
}
SUMS = {
    "one": "all with names",
    "several": "all with names",
    "unknown, of the state": "all unknown",
    "unknown, along the sequence": "all unknown",
}


@dataclass(frozen=True)
class Report:
    """Tables of answers about the sets of a module, held against the truth."""

    sets: ModuleType
    truth: Truth

    def by_kind(self, said: Sequence[Said]) -> str:
        """Every question by the kind of the sets, and over all of named effects and of unknown physics."""
        kinds: dict[str, list[Said]] = {}
        for one in said:
            kinds.setdefault(self.sets.KIND[one.name], []).append(one)
        for one in (one for one in said if self.sets.KIND[one.name] in SUMS):
            kinds.setdefault(SUMS[self.sets.KIND[one.name]], []).append(one)
        return table(
            ["kind", "sets", *QUESTIONS.values()],
            [[name, str(len(some)), *self._cells(some)] for name, some in kinds.items()],
        )

    def _cells(self, said: Sequence[Said]) -> list[str]:
        scores = [self.truth.score(one) for one in said]
        return [share([a for one in scores if (a := getattr(one, question)) is not None]) for question in QUESTIONS]

    def beside_unknown(self, said: Sequence[Said]) -> list[Said]:
        """Answers about sets with unknown physics."""
        return [one for one in said if SUMS.get(self.sets.KIND[one.name]) == "all unknown"]

    def confidences(self, said: Sequence[Said]) -> str:
        """Names by their confidence: where all effects have names, and beside unknown physics."""
        unknown = self.beside_unknown(said)
        known = [one for one in said if one not in unknown]
        beside = f"Names of unknown physics, right where acceptable:\n\n{self._reliability(unknown)}"
        return f"{self._reliability(known)}\n\n{beside}"

    def _reliability(self, said: Sequence[Said]) -> str:
        return reliability_of(
            (confidence, name in self.truth.names(one.name))
            for one in said
            for confidence, name in zip(one.confidence, one.effects, strict=True)
        )

    def wrong(self, said: Sequence[Said]) -> str:
        """Every set with a wrong answer."""
        rows = []
        for one in said:
            scene, points = self.sets.SETS[one.name], self.truth.score(one)
            bad = [
                words
                for question, words in QUESTIONS.items()
                if getattr(points, question) is (question == "false_unknown")
            ]
            if bad:
                hidden = " + ".join(effect.what for effect in scene.hidden) or "nothing"
                heard = f"{' + '.join(one.forms) or 'nothing'} ({one.verdict}) {one.error}"
                rows.append([one.name, str(scene.n), hidden, heard, _remains(one), ", ".join(bad)])
        return table(["set", "n", "hidden", "said", "of what remains", "wrong"], rows)

    def ordered(self, said: Sequence[Said]) -> list[Said]:
        """Answers by the kinds of their sets."""
        return sorted(said, key=lambda one: (list(self.sets.KINDS).index(self.sets.KIND[one.name]), one.name))

    def tables(self, said: Sequence[Said]) -> str:
        """All tables."""
        ordered = self.ordered(said)
        return "\n\n".join([self.by_kind(ordered), self.confidences(ordered), self.wrong(ordered)])


def _remains(said: Said) -> str:
    """Words about what remains."""
    variables = [] if said.remainder is None else predictable(said.remainder)
    words = [f"depends on {', '.join(variables)}"] if variables else []
    told = said.succession
    return "; ".join(words + ([f"{told['words']}, {100 * told['share']:.1f} % of the error"] if told else []))
