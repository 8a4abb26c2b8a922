"""Diagnose the sets of a fifth hand, and say frankly what is right.

    python benchmarks/fifth_hand/run.py --keep fifth.jsonl [--only 05,26] [--seconds 60] [--table] [--write folder]

With --keep, every finished set is a line of a file, and an interrupted run goes on from there; --table prints the
tables of such a file without asking anything; --write puts the 56 tables into a folder, as CSV.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fifth_hand import sets
from fifth_hand.judge import ask, names, predictable, score
from second_nature.tables import reliability_of, share, table
from third_hand.judge import Said
from third_hand.run import command

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


def by_kind(said: Sequence[Said]) -> str:
    """Every question by the kind of the sets, and over all of named effects and of unknown physics."""
    kinds: dict[str, list[Said]] = {}
    for one in said:
        kinds.setdefault(sets.KIND[one.name], []).append(one)
    for one in (one for one in said if sets.KIND[one.name] in SUMS):
        kinds.setdefault(SUMS[sets.KIND[one.name]], []).append(one)
    return table(
        ["kind", "sets", *QUESTIONS.values()], [[name, str(len(some)), *_cells(some)] for name, some in kinds.items()]
    )


def _cells(said: Sequence[Said]) -> list[str]:
    scores = [score(one) for one in said]
    return [share([a for one in scores if (a := getattr(one, question)) is not None]) for question in QUESTIONS]


def confidences(said: Sequence[Said]) -> str:
    """Named effects by their confidence: where all effects have names, and beside unknown physics acceptable ones."""
    known, beside = [], []
    for one in said:
        right, some = names(one.name), beside if SUMS.get(sets.KIND[one.name]) == "all unknown" else known
        some += [(c, name in right) for c, name in zip(one.confidence, one.effects, strict=True)]
    return f"{reliability_of(known)}\n\nNames of unknown physics, right where acceptable:\n\n{reliability_of(beside)}"


def wrong(said: Sequence[Said]) -> str:
    """Every set with a wrong answer."""
    rows = []
    for one in said:
        scene, points = sets.SETS[one.name], score(one)
        bad = [
            words for question, words in QUESTIONS.items() if getattr(points, question) is (question == "false_unknown")
        ]
        if bad:
            hidden = " + ".join(effect.what for effect in scene.hidden) or "nothing"
            heard = f"{' + '.join(one.forms) or 'nothing'} ({one.verdict}) {one.error}"
            rows.append([one.name, str(scene.n), hidden, heard, _remains(one), ", ".join(bad)])
    return table(["set", "n", "hidden", "said", "of what remains", "wrong"], rows)


def _remains(said: Said) -> str:
    """Words about what remains."""
    variables = [] if said.remainder is None else predictable(said.remainder)
    words = [f"depends on {', '.join(variables)}"] if variables else []
    told = said.succession
    return "; ".join(words + ([f"{told['words']}, {100 * told['share']:.1f} % of the error"] if told else []))


def tables(said: Sequence[Said]) -> str:
    """All tables."""
    ordered = sorted(said, key=lambda one: (list(sets.KINDS).index(sets.KIND[one.name]), one.name))
    return "\n\n".join([by_kind(ordered), confidences(ordered), wrong(ordered)])


if __name__ == "__main__":
    command(__doc__, sets, ask, tables)
