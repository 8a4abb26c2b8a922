"""Diagnose tosses in space, and report how often the diagnosis is right.

    python benchmarks/tosses/run.py --answers tosses.jsonl [--half report] [--trials 150] [--only 205 605]

Answers of the half `look` are examined; `report` is only scored.  Every finished set is a line of the file of answers,
and an interrupted run resumes from there.  Both halves are asked in turn, so that it may be interrupted at any time.
"""

import argparse
import json
import sys
import time
from dataclasses import asdict, replace
from itertools import chain, zip_longest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch

from blind.judge import Answer, answer_of
from blind.report import by_group, judged, reliability, wrong
from blind.run import read
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from tosses import engine, impulse
from tosses.facts import Toss, draw, suite, truths

MAKERS = {"engine": engine.reported, "impulse": impulse.reported}


def ask(toss: Toss, trials: int) -> Answer:
    """Diagnose a set from its impacts alone; the time is the processor's."""
    impacts, began = MAKERS[toss.suite](draw(toss.hidden, toss.seed), trials, toss.seed), time.process_time()
    answer = answer_of(toss.suite, str(toss.seed), diagnose(impacts, options=DiagnoseOptions(seed=toss.seed)))
    return replace(answer, seconds=time.process_time() - began)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--answers", type=Path, required=True, help="file of answers, one JSON line each")
    parser.add_argument("--half", choices=("look", "report"))
    parser.add_argument("--trials", type=int, default=150, help="impacts of a set")
    parser.add_argument("--only", type=int, nargs="+", default=(), help="seeds of some sets")
    given = parser.parse_args()
    torch.set_num_threads(1)
    answers = read(given.answers)
    every = chain.from_iterable(filter(None, pair) for pair in zip_longest(suite("look"), suite("report")))
    for toss in every:
        wanted = given.half in (None, toss.half) and (not given.only or toss.seed in given.only)
        if not wanted or (toss.suite, str(toss.seed)) in answers:
            continue
        answer = answers[toss.suite, str(toss.seed)] = ask(toss, given.trials)
        with given.answers.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(answer)) + "\n")
        names = " | ".join(", ".join(some) or "–" for some in (answer.forms, answer.candidates))
        head = f"{toss.seed} {'+'.join(toss.hidden) or 'nothing':17} {answer.verdict:8} {answer.law}"
        print(f"{head} {names} | {answer.seconds:.0f} s", flush=True)
    for half in ("look", "report"):
        sets = [one for one in judged(answers.values(), truths) if one.truth.half == half]
        if sets:
            print(f"\n{half}\n\n" + "\n\n".join(filter(None, (by_group(sets), reliability(sets), wrong(sets)))))


if __name__ == "__main__":
    main()
