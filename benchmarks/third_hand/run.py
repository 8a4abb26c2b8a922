"""Diagnose the sets of a third hand, and say frankly what is right.

    python benchmarks/third_hand/run.py --keep third.jsonl [--only 06,16] [--seconds 60] [--table] [--write folder]

With --keep, every finished set is a line of a file, and an interrupted run goes on from there; --table prints the
tables of such a file without asking anything; --write puts the 48 tables into a folder, as CSV.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.progress import track

from second_nature.tables import reliability_of, share, table
from third_hand import sets
from third_hand.judge import Said, Score, ask, hidden_names, score

KINDS = ("single", "pair", "triple", "nothing", "unknown", "confounded", "measurement")
Ask = Callable[[str, float], dict]
QUESTIONS = {
    "first": "first name",
    "exact": "exact set",
    "inside": "named, or the simpler model",
    "silent": "no name",
    "unknown": "unknown said",
    "twins": "twins listed",
    "fault": "right about faults of measurement",
    "correction": "right correction",
}


def by_kind(said: Sequence[Said]) -> str:
    """Every question by the kind of the sets."""
    kinds: dict[str, list[Score]] = {}
    for one in said:
        kinds.setdefault(sets.SETS[one.name].kind, []).append(score(one))
    known = [one for kind in ("single", "pair", "triple") for one in kinds.get(kind, ())]
    rows = [[kind, str(len(scores)), *_cells(scores)] for kind, scores in kinds.items()]
    rows.append(["single, pair and triple", str(len(known)), *_cells(known)])
    return table(["kind", "sets", *QUESTIONS.values()], rows)


def _cells(scores: Sequence[Score]) -> list[str]:
    return [share([a for one in scores if (a := getattr(one, question)) is not None]) for question in QUESTIONS]


def confidences(said: Sequence[Said]) -> str:
    """Named effects by their confidence, on sets whose effects are all known."""
    names = []
    for one in said:
        scene = sets.SETS[one.name]
        if scene.kind in ("single", "pair", "triple", "nothing"):
            right = set().union(*hidden_names(scene))
            names += [(c, name in right) for c, name in zip(one.confidence, one.effects, strict=True)]
    return reliability_of(names)


def wrong(said: Sequence[Said]) -> str:
    """Every set with a wrong answer."""
    rows = []
    for one in said:
        scene, points = sets.SETS[one.name], score(one)
        bad = [words for question, words in QUESTIONS.items() if getattr(points, question) is False]
        if bad:
            hidden = " + ".join(effect.what for effect in scene.effects) or "nothing"
            heard = f"{' + '.join(one.forms) or 'nothing'} ({', '.join([one.verdict, *one.corrections])}) {one.error}"
            rows.append([one.name, scene.kind, str(scene.n), hidden, heard, ", ".join(bad)])
    return table(["set", "kind", "n", "hidden", "said", "wrong"], rows)


def read(path: Path | None) -> dict[str, Said]:
    """Finished sets of a file, by name."""
    lines = path.read_text("utf-8").splitlines() if path and path.exists() else []
    return {one.name: one for one in (Said(**json.loads(line)) for line in lines)}


def finish(waiting: Sequence[str], said: dict[str, Said], ask: Ask, options: argparse.Namespace) -> None:
    """Ask about the waiting sets, and keep each answer at once."""
    for name in track(waiting, description="sets", disable=not waiting):
        line = ask(name, options.seconds)
        said[name] = Said(**line)
        if options.keep:
            with options.keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def command(words: str, sets: ModuleType, ask: Ask, report: Callable[[Sequence[Said]], str]) -> None:
    """Ask about the sets that are not in the file yet, then print the report."""
    parser = argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="file of finished sets, one JSON line each")
    parser.add_argument("--only", default="", help="numbers of some sets, with commas")
    parser.add_argument("--seconds", type=float, default=60.0, help="limit of each diagnosis")
    parser.add_argument("--table", action="store_true", help="only print the tables of what is kept")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="only write the sets as CSV")
    options = parser.parse_args()
    names = list(filter(None, options.only.split(","))) or list(sets.SETS)
    if unknown := set(names) - set(sets.SETS):
        parser.error(f"no set {', '.join(sorted(unknown))}; they are 01 to {len(sets.SETS)}")
    if options.write:
        options.write.mkdir(parents=True, exist_ok=True)
        for name in names:
            sets.write(sets.draw(name), options.write / f"{name}.csv")
        return
    said = read(options.keep)
    finish([] if options.table else [name for name in names if name not in said], said, ask, options)
    finished = [said[name] for name in names if name in said]
    print(report(finished) if finished else "no set is finished")


def tables(said: Sequence[Said]) -> str:
    """All tables."""
    ordered = sorted(said, key=lambda one: (KINDS.index(sets.SETS[one.name].kind), one.name))
    return "\n\n".join([by_kind(ordered), confidences(ordered), wrong(ordered)])


if __name__ == "__main__":
    command(__doc__, sets, ask, tables)
