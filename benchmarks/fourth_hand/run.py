"""Diagnose the sets of a fourth hand, and say frankly what is right.

    python benchmarks/fourth_hand/run.py --keep fourth.jsonl [--only 05,26] [--seconds 60] [--table] [--write folder]

With --keep, every finished set is a line of a file, and an interrupted run goes on from there; --table prints the
tables of such a file without asking anything; --write puts the 30 tables into a folder, as CSV.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fourth_hand import sets
from fourth_hand.judge import along, ask, score
from fourth_hand.laboratory import Scene
from second_nature.tables import share, table
from third_hand.judge import Said
from third_hand.run import command

QUESTIONS = {
    "unknown": "unknown said",
    "sentence": "right about the sequence",
    "first": "first name",
    "silent": "no name",
    "false_unknown": "unknown said of nothing unknown",
}
KINDS = (
    "unknown, along the sequence",
    "known and unknown, along the sequence",
    "unknown",
    "known and unknown",
    "nothing",
    "known",
)
SUMS = ("all unknown, along the sequence", "all unknown, not along it")


def kind(scene: Scene) -> str:
    """In words, for the tables."""
    if not scene.unknown:
        return "known" if scene.known else "nothing"
    return f"{'known and unknown' if scene.known else 'unknown'}{', along the sequence' if along(scene) else ''}"


def by_kind(said: Sequence[Said]) -> str:
    """Every question by the kind of the sets, and over all unknown physics."""
    kinds: dict[str, list[Said]] = {}
    for one in said:
        kinds.setdefault(kind(sets.SETS[one.name]), []).append(one)
    for one in (one for one in said if sets.SETS[one.name].unknown):
        kinds.setdefault(SUMS[not along(sets.SETS[one.name])], []).append(one)
    return table(
        ["kind", "sets", *QUESTIONS.values()], [[name, str(len(some)), *_cells(some)] for name, some in kinds.items()]
    )


def _cells(said: Sequence[Said]) -> list[str]:
    scores = [score(one) for one in said]
    return [share([a for one in scores if (a := getattr(one, question)) is not None]) for question in QUESTIONS]


def wrong(said: Sequence[Said]) -> str:
    """Every set with a wrong answer."""
    rows = []
    for one in said:
        scene, points = sets.SETS[one.name], score(one)
        bad = [
            words for question, words in QUESTIONS.items() if getattr(points, question) is (question == "false_unknown")
        ]
        if bad:
            hidden = " + ".join(effect.what for effect in scene.effects) or "nothing"
            heard = f"{' + '.join(one.forms) or 'nothing'} ({one.verdict}) {one.error}"
            rows.append([one.name, str(scene.n), hidden, heard, _sequence(one), ", ".join(bad)])
    return table(["set", "n", "hidden", "said", "of the sequence", "wrong"], rows)


def _sequence(said: Said) -> str:
    told = said.succession
    return "" if told is None else f"{told['words']}, {100 * told['share']:.1f} % of the error"


def tables(said: Sequence[Said]) -> str:
    """All tables."""
    ordered = sorted(said, key=lambda one: (KINDS.index(kind(sets.SETS[one.name])), one.name))
    return "\n\n".join([by_kind(ordered), wrong(ordered)])


if __name__ == "__main__":
    command(__doc__, sets, ask, tables)
