"""How often are serial and state dependence found where there is none, and where there is some?

    python benchmarks/accuracy/dependences.py [{serial,state}] [--answers FILE] [--null 420] [--planted 4] [--table]

Null sets have independent or correlated errors, effects in the fitted model, one that it lacks (serial), inputs that
follow the sequence, two bodies and throws that are nearly alike (state).  In planted ones a coefficient, or the outcome
(state), follows the sequence or depends on the state as no effect does.  The true model is fitted, and tested as a
diagnosis tests it: first for a drifting measurement, then for the dependence.

Every finished set is a line of the file of answers, and an interrupted run resumes from there.
"""

import argparse
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from rich.progress import track
from threadpoolctl import threadpool_limits

from blind.report import share, table
from contactlearn.diagnosis.drift import drifts
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.identification.joint import FitOptions
from sensitivity.studies.dependences import (
    BODIES,
    DEPENDS,
    DESIGNS,
    ERRORS,
    FOLLOWS,
    NAMED,
    NARROW,
    made,
    serial_dependence,
    state_dependence,
)

SIZES, STRENGTHS = (150, 300, 500, 800), (0.3, 0.5, 0.75, 1.0, 1.5)
CORRELATED = ("ar1", "weak ar1", "wander")
Case = dict[str, Any]
Line = dict[str, Any]


def nulls(kind: str, count: int) -> Iterator[Case]:
    """Yield sets without a dependence; a third of the models that are tested for a serial one lack an effect."""
    serial, named = kind == "serial", ("", *NAMED)
    first, designs = (10_000, DESIGNS) if serial else (70_000, (*DESIGNS, NARROW, BODIES))
    for k in range(count):
        design = designs[(k // 3) % len(designs)]
        own = named[(k // 5) % len(named)] if serial or design in DESIGNS[1:] else ""
        case = {"seed": first + k, "size": SIZES[k % 4], "errors": ERRORS[k % len(ERRORS)], "design": design}
        yield case | {"named": own} | ({"missed": 0.4 if k % 3 == 2 else 0.0} if serial else {})


def planted(kind: str, count: int) -> Iterator[Case]:
    """Yield sets with a dependence: so many for each driver and strength."""
    serial = kind == "serial"
    first, errors = (50_000, ("iid", "before")) if serial else (80_000, ("iid", "before", "heavy"))
    for (i, follows), (j, strength), k in product(
        enumerate(FOLLOWS if serial else DEPENDS), enumerate(STRENGTHS), range(count)
    ):
        yield {
            "seed": first + 1000 * i + 100 * j + k,
            "size": SIZES[(i + k) % 4],
            "design": DESIGNS[(i + k) % 2] if serial else ("throws", BODIES)[(i + j + k) % 2],
            "errors": errors[(j + k) % len(errors)],
            "follows": follows,
            "coefficient": ("mu", "eps")[(j + k // 2) % 2] if serial else DEPENDS[follows][0],
            "strength": strength,
        }


def ask(kind: str, case: Case) -> Line:
    """Test a set for a dependence."""
    drops = made(**case)
    drift = drifts(drops.fit, drops.impacts, FitOptions(), Thresholds())
    line = {"case": case, "drifts": drift is not None, "found": None, "variables": [], "large": False}
    if kind == "state":
        found = state_dependence(drops, Thresholds(), 1 if drift is None else drift.block)
    else:
        found = None if drift is not None else serial_dependence(drops, Thresholds())
    if found is None:
        return line
    line["variables"] = sorted(one.symbol for one in found.variables) if kind == "state" else [str(found.variable)]
    coefficient = "velocity" if found.coefficient is None else str(found.coefficient)
    return line | {"found": coefficient, "p": found.p_value, "share": found.share.mean, "large": found.large}


QUESTIONS: dict[str, Callable[[Line], bool]] = {
    "dependence found": lambda line: line["found"] is not None,
    "so large that the verdict is unknown": lambda line: line["large"],
    "the measurement drifts": lambda line: line["drifts"],
}


def by(lines: Sequence[Line], group: Callable[[Case], str]) -> str:
    """Tabulate every question by a group of cases."""
    groups = defaultdict(list)
    for line in lines:
        groups[group(line["case"])].append(line)
    rows = [
        [name, str(len(some)), *(share([question(one) for one in some]) for question in QUESTIONS.values())]
        for name, some in groups.items()
    ]
    return table(["sets", "number", *QUESTIONS], rows)


def tables(lines: Sequence[Line]) -> str:
    """Format false findings by errors and design, and power by strength, size, design and dependence."""
    null = [line for line in lines if "follows" not in line["case"]]
    power = [line for line in lines if "follows" in line["case"]]
    strong = [line for line in power if line["case"]["strength"] >= 0.75]
    parts = [
        by(null, lambda case: f"{'correlated' if case['errors'] in CORRELATED else 'independent'} errors"),
        by(power, lambda case: f"{case['strength']} of the noise"),
        by(power, lambda case: f"{case['size']} trials"),
        by(power, lambda case: f"{case['coefficient']}: {case['follows']}"),
        by(strong, lambda case: f"{case['follows']}, from 0.75 of the noise on"),
        drivers(power),
    ]
    return "\n\n".join(parts)


def drivers(lines: Sequence[Line]) -> str:
    """Tabulate what is found of each planted dependence."""
    found = [line for line in lines if line["found"] is not None]
    right = share([line["found"] == line["case"]["coefficient"] for line in found])
    counts = Counter((line["case"]["follows"], f"{line['found']}: {', '.join(line['variables'])}") for line in found)
    rows = [[planted, words, str(count)] for (planted, words), count in sorted(counts.items())]
    return f"the right coefficient: {right}\n\n" + table(["planted", "found", "sets"], rows)


def main() -> None:
    """Test the sets that the file has no line for, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("serial", "state"), nargs="?", default="serial")
    parser.add_argument("--answers", type=Path, help="file of finished sets, one JSON line each")
    parser.add_argument("--null", type=int, default=420)
    parser.add_argument("--planted", type=int, default=4)
    parser.add_argument("--table", action="store_true", help="only print the tables of the answers")
    options = parser.parse_args()
    kind, path = options.kind, options.answers
    torch.set_num_threads(1)
    lines = [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path and path.exists() else []
    known = {json.dumps(line["case"]) for line in lines}
    cases = [] if options.table else [*nulls(kind, options.null), *planted(kind, options.planted)]
    with threadpool_limits(1):
        for case in track([case for case in cases if json.dumps(case) not in known], description="sets"):
            lines.append(ask(kind, case))
            if path:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(lines[-1]) + "\n")
    print(tables(lines))


if __name__ == "__main__":
    main()
