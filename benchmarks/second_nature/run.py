"""Diagnose planted data whose physics is not the package's, and say frankly how often the diagnosis is right.

    python benchmarks/second_nature/run.py --half learn --keep learn.jsonl [--workers 2] [--groups single,pair]
        [--limit 20] [--table]

The diagnosis is given impacts alone.  With --keep, every finished set is a line of a file, and an interrupted run
goes on from there; --table prints the tables of such a file without asking anything.  --limit takes sets evenly from
all groups.  The half "report" is not to be looked at while the program is improved: its wrong answers are not listed.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.progress import track

from second_nature import tables
from second_nature.judge import Said, ask, score
from second_nature.sets import SETS
from second_nature.truth import PlantedSet


def ask_by_name(name: str) -> dict:
    """Ask about the set of this name: what a worker is sent."""
    return ask(next(one for one in SETS if one.name == name))


def spread(sets: Sequence[PlantedSet], limit: int) -> list[PlantedSet]:
    """At most `limit` sets, in turn from every group."""
    groups: dict[str, list[PlantedSet]] = {}
    for one in sets:
        groups.setdefault(one.group, []).append(one)
    rank = {one.name: (i / len(group), one.seed) for group in groups.values() for i, one in enumerate(group)}
    return sorted(sets, key=lambda one: rank[one.name])[:limit]


def read(path: Path | None) -> dict[str, Said]:
    """What a file has of finished sets, by name."""
    lines = path.read_text("utf-8").splitlines() if path and path.exists() else []
    return {one.name: one for one in (Said(**json.loads(line)) for line in lines)}


def report(said: Iterable[Said]) -> str:
    """All tables."""
    order = {one.name: i for i, one in enumerate(SETS)}
    said = sorted((one for one in said if one.name in order), key=lambda one: order[one.name])
    if not said:
        return "no set is finished"
    scores = [score(one) for one in said]
    parts = [
        tables.by_group(said, scores),
        tables.criteria(said, scores),
        tables.reliability(said, scores),
        tables.wrong(said, scores),
    ]
    failed = [f"{one.name}: {one.error}" for one in said if one.error]
    hurried = [one.name for one in said if not one.complete]
    return "\n\n".join(
        [*parts, *failed, f"The search ran out of time on {len(hurried)} sets: {', '.join(hurried) or '–'}"]
    )


def main() -> None:
    """Ask about the sets that are not in the file yet, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", choices=("learn", "report"), default="learn")
    parser.add_argument("--keep", type=Path, help="file of finished sets, one JSON line each")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--groups", "--classes", default="", help="some groups only, with commas")
    parser.add_argument("--limit", type=int, help="so many sets, evenly from all groups")
    parser.add_argument("--table", action="store_true", help="only print the tables of what is kept")
    options = parser.parse_args()
    groups = set(filter(None, options.groups.split(",")))
    unknown = groups - {one.group for one in SETS}
    if unknown:
        parser.error(
            f"no group {', '.join(sorted(unknown))}; there are {', '.join(dict.fromkeys(s.group for s in SETS))}"
        )
    sets = [one for one in SETS if one.half == options.half and (not groups or one.group in groups)]
    sets = spread(sets, options.limit) if options.limit else sets
    said = read(options.keep)
    waiting = [] if options.table else [one for one in sets if one.name not in said]
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(ask_by_name, one.name) for one in waiting]
        for future in track(as_completed(futures), total=len(futures), description="sets", disable=not futures):
            line = future.result()
            said[line["name"]] = Said(**line)
            if options.keep:
                with options.keep.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
    names = {one.name for one in sets}
    print(report(one for one in said.values() if one.name in names))


if __name__ == "__main__":
    main()
