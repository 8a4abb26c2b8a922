"""How often is something said of the state of the trials, where it tells nothing and where it tells something?

    python benchmarks/state_dependence.py --keep state_dependence.jsonl [--null 560] [--planted 4] [--table]

Null sets have independent or correlated errors, effects in the fitted model, inputs that follow the sequence, two
bodies, and throws that are all but alike, so that errors of v_pre are as large as their scatter.  Planted ones have a
friction, a restitution or an outcome that depends on the state in a way that no effect has.  The true model is fitted,
and asked as a diagnosis asks it: first whether the measurement drifts, then what depends on the state beside it.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from blind.report import share, table
from contactlearn.diagnosis.drift import drifts
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.identification.joint import FitOptions
from serial_dependence import CORRELATED, SIZES, STRENGTHS, Case, Line, asked_all
from studies.follows import DEPENDS
from studies.serial_dependence import BODIES, DESIGNS, ERRORS, NAMED, NARROW, made
from studies.state_dependence import state_dependence

QUESTIONS: dict[str, Callable[[Line], bool]] = {
    "something is said of the state": lambda line: line["share"] is not None,
    "so much that the verdict is unknown": lambda line: line["large"],
    "the measurement drifts": lambda line: line["drifts"],
}


def nulls(count: int) -> Iterable[Case]:
    """Sets of which the fitted model is true."""
    named, designs = ("", *NAMED), (*DESIGNS, NARROW, BODIES)
    for k in range(count):
        design = designs[(k // 3) % len(designs)]
        yield {
            "seed": 70_000 + k,
            "size": SIZES[k % 4],
            "errors": ERRORS[k % len(ERRORS)],
            "design": design,
            "named": named[(k // 5) % len(named)] if design in DESIGNS[1:] else "",
        }


def planted(count: int) -> Iterable[Case]:
    """Sets of which something depends on the state: so many for each dependence and each strength."""
    for i, (name, (coefficient, _)) in enumerate(DEPENDS.items()):
        for j, strength in enumerate(STRENGTHS):
            for k in range(count):
                yield {
                    "seed": 80_000 + 1000 * i + 100 * j + k,
                    "size": SIZES[(i + k) % 4],
                    "design": ("throws", BODIES)[(i + j + k) % 2],
                    "errors": ("iid", "before", "heavy")[(j + k) % 3],
                    "follows": name,
                    "coefficient": coefficient,
                    "strength": strength,
                }


def asked(case: Case) -> Line:
    """What is said of a set."""
    drops = made(**case)
    drift = drifts(drops.fit, drops.impacts, FitOptions(), Thresholds().serial_dependence)
    found = state_dependence(drops, Thresholds(), 1 if drift is None else drift.block)
    said = {"drifts": drift is not None, "found": None, "variables": [], "p": None, "share": None, "large": False}
    if found is not None:
        said |= {
            "found": "velocity" if found.coefficient is None else str(found.coefficient),
            "variables": [one.symbol for one in found.variables],
            "p": found.p_value, "share": found.share.mean, "large": found.large,
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


def tables(lines: Sequence[Line]) -> str:
    """False statements by errors and design, and power by what is planted, by strength and by size."""
    null = [line for line in lines if "follows" not in line["case"]]
    power = [line for line in lines if "follows" in line["case"]]
    parts = [
        _counted(
            null, lambda line: f"{'correlated' if line['case']['errors'] in CORRELATED else 'independent'} errors"
        ),
        _counted(null, lambda line: line["case"]["errors"]),
        _counted(null, lambda line: line["case"]["design"]),
        _counted(power, lambda line: f"{line['case']['strength']} of the noise"),
        _counted(power, lambda line: f"{line['case']['size']} trials"),
        _counted(power, lambda line: line["case"]["design"]),
        _counted(power, lambda line: f"{line['case']['coefficient']}: {line['case']['follows']}"),
        _counted(
            [line for line in power if line["case"]["strength"] >= 0.75],
            lambda line: f"{line['case']['follows']}, from 0.75 of the noise on",
        ),
        _named(power),
    ]
    return "\n\n".join(parts)


def _named(lines: Sequence[Line]) -> str:
    """What is said of each dependence."""
    said = [line for line in lines if line["share"] is not None]
    right = share([line["found"] == line["case"]["coefficient"] for line in said])
    counts: dict[tuple[str, str], int] = defaultdict(int)
    for line in said:
        counts[line["case"]["follows"], f"{line['found']}: {', '.join(sorted(line['variables']))}"] += 1
    rows = [[follows, words, str(count)] for (follows, words), count in sorted(counts.items())]
    return f"the right coefficient: {right}\n\n" + table(["depends", "said", "sets"], rows)


if __name__ == "__main__":
    asked_all(__doc__, nulls, planted, asked, tables)
