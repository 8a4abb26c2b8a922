"""How often is something said of the sequence of the trials, where it tells nothing and where it tells something?

    python benchmarks/serial_dependence.py --keep serial_dependence.jsonl [--null 400] [--planted 4] [--table]

Null sets have independent or correlated errors, other effects in the fitted model, one that it lacks, and inputs that
follow the sequence.  Planted ones have a friction or restitution that follows it.  The true model is fitted, and asked
as a diagnosis asks it: first whether the measurement drifts, and if not, whether a coefficient follows the sequence.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import torch
from rich.progress import track
from threadpoolctl import threadpool_limits

from blind.report import share, table
from contactlearn.diagnosis.drift import drifts
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.identification.joint import FitOptions
from studies.follows import FOLLOWS
from studies.serial_dependence import DESIGNS, ERRORS, NAMED, made, serial_dependence

SIZES, STRENGTHS = (150, 300, 500, 800), (0.3, 0.5, 0.75, 1.0, 1.5)
CORRELATED = ("ar1", "weak ar1", "wander")
Case = dict
Line = dict


def nulls(count: int) -> Iterable[Case]:
    """Sets whose coefficients do not follow the sequence; a third of them lack an effect."""
    named = ("", *NAMED)
    for k in range(count):
        yield {
            "seed": 10_000 + k,
            "size": SIZES[k % 4],
            "errors": ERRORS[k % len(ERRORS)],
            "design": DESIGNS[(k // 3) % len(DESIGNS)],
            "named": named[(k // 5) % len(named)],
            "missed": 0.4 if k % 3 == 2 else 0.0,
        }


def planted(count: int) -> Iterable[Case]:
    """Sets of which a coefficient follows the sequence: so many for each that it follows and each strength."""
    for i, follows in enumerate(FOLLOWS):
        for j, strength in enumerate(STRENGTHS):
            for k in range(count):
                yield {
                    "seed": 50_000 + 1000 * i + 100 * j + k,
                    "size": SIZES[(i + k) % 4],
                    "design": DESIGNS[(i + k) % 2],
                    "errors": ("iid", "before")[(j + k) % 2],
                    "follows": follows,
                    "coefficient": ("mu", "eps")[(j + k // 2) % 2],
                    "strength": strength,
                }


def asked(case: Case) -> Line:
    """What is said of a set."""
    drops = made(**case)
    drifting = drifts(drops.fit, drops.impacts, FitOptions(), Thresholds().serial_dependence) is not None
    found = None if drifting else serial_dependence(drops, Thresholds())
    said = {
        "drifts": drifting,
        "coefficient": None,
        "followed": None,
        "trials": None,
        "p": None,
        "share": None,
        "large": False,
    }
    if found is not None:
        said |= {
            "coefficient": None if found.coefficient is None else str(found.coefficient),
            "followed": str(found.variable), "trials": found.trials, "p": found.p_value, "share": found.share.mean,
            "large": found.large,
        }  # fmt: skip
    return {"case": case, **said}


def _counted(lines: Sequence[Line], groups: Callable[[Line], str]) -> str:
    rows = defaultdict(list)
    for line in lines:
        rows[groups(line)].append(line)
    cells = [
        [name, str(len(some)), *(share([question(one) for one in some]) for question in QUESTIONS.values())]
        for name, some in rows.items()
    ]
    return table(["sets", "number", *QUESTIONS], cells)


QUESTIONS: dict[str, Callable[[Line], bool]] = {
    "a coefficient follows the sequence": lambda line: line["followed"] is not None,
    "so much that the verdict is unknown": lambda line: line["large"],
    "the measurement drifts": lambda line: line["drifts"],
}


def tables(lines: Sequence[Line]) -> str:
    """False statements by errors, and power by what is followed, by strength and by size."""
    null = [line for line in lines if "follows" not in line["case"]]
    power = [line for line in lines if "follows" in line["case"]]
    parts = [
        _counted(
            null, lambda line: "correlated errors" if line["case"]["errors"] in CORRELATED else "independent errors"
        ),
        _counted(null, lambda line: line["case"]["errors"]),
        _counted(null, lambda line: line["case"]["design"]),
        _counted(null, lambda line: "an effect is missed" if line["case"]["missed"] else "the model is true"),
        _counted(power, lambda line: f"{line['case']['strength']} of the noise"),
        _counted(power, lambda line: f"{line['case']['size']} trials"),
        _counted(power, lambda line: f"{line['case']['coefficient']}: {line['case']['follows']}"),
        _named(power),
    ]
    return "\n\n".join(parts)


def _named(lines: Sequence[Line]) -> str:
    """Whether the coefficient is the right one where any is said to follow."""
    said = [line for line in lines if line["followed"] is not None]
    right = share([line["coefficient"] == line["case"]["coefficient"] for line in said])
    counts: dict[tuple[str, str], int] = defaultdict(int)
    for line in said:
        counts[line["case"]["follows"], line["followed"]] += 1
    rows = [[follows, f"{followed}", str(count)] for (follows, followed), count in sorted(counts.items())]
    return f"the right coefficient: {right}\n\n" + table(["follows", "said", "sets"], rows)


def asked_all(
    doc: str | None,
    nulls: Callable[[int], Iterable[Case]],
    planted: Callable[[int], Iterable[Case]],
    asked: Callable[[Case], Line],
    tables: Callable[[Sequence[Line]], str],
) -> None:
    """Ask about the sets that are not in the file yet, then print the tables."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="file of finished sets, one JSON line each")
    parser.add_argument("--null", type=int, default=400)
    parser.add_argument("--planted", type=int, default=4)
    parser.add_argument("--table", action="store_true", help="only print the tables of what is kept")
    options = parser.parse_args()
    torch.set_num_threads(1)
    lines = [json.loads(line) for line in options.keep.read_text().splitlines()] if options.keep.exists() else []
    known = {json.dumps(line["case"]) for line in lines}
    cases = [] if options.table else [*nulls(options.null), *planted(options.planted)]
    with threadpool_limits(1):
        for case in track([case for case in cases if json.dumps(case) not in known], description="sets"):
            lines.append(asked(case))
            with options.keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    print(tables(lines))


if __name__ == "__main__":
    asked_all(__doc__, nulls, planted, asked, tables)
