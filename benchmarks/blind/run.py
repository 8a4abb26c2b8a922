"""Diagnose the sets of a suite, and report how often the diagnosis is right.

    python benchmarks/blind/run.py --suite author_a --answers a.jsonl [--half learn] [--groups nothing single]
        [--only 06 16] [--limit 20] [--workers 2] [--seconds 60] [--shapeless] [--every-name] [--table | --reveal]

Every finished set is a line of the file of answers, and an interrupted run resumes from there.  --table prints the
tables of such a file without diagnosing anything; --reveal prints the ground truth of the chosen sets.  --limit takes
sets evenly from all groups.  --shapeless withholds the outlines.  Wrong answers of the half "report" are not listed.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from rich.progress import track
from threadpoolctl import threadpool_limits

from blind.judge import Answer, answer_of, read_truth
from blind.load import SUITES, BlindSet, blind_sets, load, read_suite
from blind.planted import planted_parts
from blind.report import report
from contactlearn import diagnose
from contactlearn.diagnosis import stages
from contactlearn.diagnosis.options import DiagnoseOptions


def ask(blind_set: BlindSet, seconds: float, shapeless: bool = False) -> Answer:
    """Diagnose a set from its impacts alone, within so many seconds, on request without the shape."""
    torch.set_num_threads(1)
    start = time.perf_counter()
    with threadpool_limits(1):
        try:
            impacts = load(blind_set)
            impacts = impacts.replace(shape=None) if shapeless else impacts
            found = diagnose(impacts, options=DiagnoseOptions(seconds=seconds))
            answer = answer_of(blind_set.suite, blind_set.name, found)
            if blind_set.measured == "ellipse_drops":
                answer = replace(answer, planted=planted_parts(blind_set, found))
        except Exception as problem:  # a diagnosis that fails is a wrong answer, and the others go on
            error = f"{type(problem).__name__}: {problem}"
            answer = Answer(suite=blind_set.suite, name=blind_set.name, verdict="failed", physics="failed", error=error)
    return replace(answer, seconds=time.perf_counter() - start)


def name_all() -> None:
    """State every name as certain in this process."""
    stages.name_probability = lambda *_: 1.0


def choose(suite: str, half: str | None, groups: set[str], only: set[str], limit: int | None) -> list[BlindSet]:
    """Choose sets of a suite, at most `limit` of them, in turn from every group.

    Raises:
        ValueError: a suite, group or set that does not exist.
    """
    sets, group = blind_sets(suite), {name: one.group for name, one in read_truth(suite).items()}
    for word, given, known in (("group", groups, dict.fromkeys(group.values())), ("set", only, sets)):
        if unknown := given - set(known):
            raise ValueError(f"no {word} {', '.join(sorted(unknown))} in {suite}; there are {', '.join(known)}")
    chosen = [
        one
        for name, one in sets.items()
        if half in (None, one.half) and (not groups or group[name] in groups) and (not only or name in only)
    ]
    if limit is None:
        return chosen
    members: dict[str, list[str]] = {}
    for one in chosen:
        members.setdefault(group[one.name], []).append(one.name)
    rank = {name: k / len(names) for names in members.values() for k, name in enumerate(names)}
    return sorted(chosen, key=lambda one: rank[one.name])[:limit]


def read(path: Path | None) -> dict[tuple[str, str], Answer]:
    """Read a file of answers, by suite and name."""
    lines = path.read_text("utf-8").splitlines() if path and path.exists() else []
    return {(one.suite, one.name): one for one in (Answer(**json.loads(line)) for line in lines)}


def ask_all(sets: Sequence[BlindSet], options: argparse.Namespace) -> dict[tuple[str, str], Answer]:
    """Diagnose the sets that the file has no answer for, append each answer at once, and return all."""
    path, begin = options.answers, name_all if options.every_name else None
    answers = read(path)
    waiting = [one for one in sets if (one.suite, one.name) not in answers]
    if not waiting:
        return answers
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn"), initializer=begin) as pool:
        futures = [pool.submit(ask, one, options.seconds, options.shapeless) for one in waiting]
        for future in track(as_completed(futures), total=len(futures), description="sets"):
            answer = future.result()
            answers[answer.suite, answer.name] = answer
            if path:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(answer)) + "\n")
    return answers


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", choices=SUITES, default="independent")
    parser.add_argument("--answers", type=Path, help="file of answers, one JSON line each")
    parser.add_argument("--half", choices=("learn", "report"), help="of the independent suite")
    parser.add_argument("--groups", nargs="+", default=(), help="some groups only")
    parser.add_argument("--only", nargs="+", default=(), help="some sets only, by name")
    parser.add_argument("--limit", type=int, help="so many sets, evenly from all groups")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=60.0, help="limit of each diagnosis")
    parser.add_argument("--every-name", action="store_true", help="name all candidates, as calibrate.py needs them")
    parser.add_argument("--shapeless", action="store_true", help="do not state the shapes")
    parser.add_argument("--table", action="store_true", help="only print the tables of the answers")
    parser.add_argument("--reveal", action="store_true", help="only print the ground truth")
    options = parser.parse_args(arguments)
    try:
        sets = choose(options.suite, options.half, set(options.groups), set(options.only), options.limit)
    except ValueError as error:
        parser.error(str(error))
    if options.reveal:
        truth = read_suite(options.suite)["sets"]
        print(json.dumps({one.name: truth[one.name] for one in sets}, indent=1, ensure_ascii=False))
        return
    answers = read(options.answers) if options.table else ask_all(sets, options)
    print(report(answers[one.suite, one.name] for one in sets if (one.suite, one.name) in answers))


if __name__ == "__main__":
    main()
