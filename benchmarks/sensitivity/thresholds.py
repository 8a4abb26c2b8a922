"""Sensitivity of the answers to each threshold: false alarms and right alarms with it halved and doubled.

    python benchmarks/sensitivity/thresholds.py [--only PREFIX] [--again] [--workers 2] [--table]

A study has null cases, in which an alarm is false, and planted ones, in which it is right.  The package's own code
decides about each with one threshold changed and all others at their defaults.  Every finished study is written to
results.json, from which thresholds.md is made; rows that stand there are run again with --again only.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from rich.progress import track
from threadpoolctl import threadpool_limits

from contactlearn.inference.learning.curves import run
from sensitivity.studies import conventions, dependences, fits, flights, frames, measurements, residuals, rivals, search
from sensitivity.study import AllThresholds, Case, Study, paths, replaced

FOLDER = Path(__file__).parent
DEFAULTS = dict(paths(AllThresholds()))
FACTORS = {"halved": 0.5, "default": 1.0, "doubled": 2.0}


@dataclass(frozen=True)
class Row:
    """A threshold by its path, the study that shows its influence, and where its scale begins.

    Ratios and probabilities near 1 have `zero` = 1: their distance from 1 is halved and doubled.
    """

    field: str
    study: Study
    zero: int = 0

    @property
    def values(self) -> dict[str, float]:
        """The threshold halved, by default and doubled."""
        default = DEFAULTS[self.field]
        values = {name: self.zero + factor * (default - self.zero) for name, factor in FACTORS.items()}
        return {name: type(default)(round(value, 12)) for name, value in values.items()} | {"default": default}


ROWS = (
    Row("tracks.excess", flights.CONTACTS),
    Row("tracks.meets", flights.CONTACTS),
    Row("tracks.likely", flights.CONTACTS),
    Row("tracks.certainty", flights.CONTACTS, zero=1),
    Row("tracks.velocity_change", flights.JUMPS),
    Row("tracks.one_flight", flights.CONTACTS),
    Row("tracks.continues", flights.CONTACTS),
    Row("tracks.rest_speed", flights.SLIDING),
    Row("tracks.lies_height", flights.LYING),
    Row("tracks.hand_height", flights.HAND),
    Row("tracks.height_range", flights.HAND),
    Row("tracks.wrap", frames.WRAPPED),
    Row("tracks.off_sigmas", flights.FLOOR),
    Row("tracks.off_least", flights.FLOOR),
    Row("tracks.contacts_of_a_slope", flights.ZERO),
    Row("tracks.plane_distance", frames.APART),
    Row("tracks.plane_tilt", frames.TILTED),
    Row("tracks.scale", frames.SCALE),
    Row("tracks.leaning", frames.LEANING),
    Row("tracks.aligned", frames.ORDER),
    Row("tracks.reading", frames.READING),
    Row("audit.false_outliers", measurements.MODELLED),
    Row("audit.moment_sigmas", measurements.MOMENT),
    Row("audit.gross_ratio", measurements.WEIGHT, zero=1),
    Row("audit.dropped_share", measurements.DROPPED),
    Row("audit.rig_explains", conventions.RIG, zero=1),
    Row("audit.contact_point_off", measurements.SHAPE),
    Row("audit.scale_off", measurements.SCALE),
    Row("audit.convention_gain", conventions.CONVENTIONS),
    Row("audit.consistent", conventions.CONVENTIONS),
    Row("audit.sound", conventions.INCLINED),
    Row("audit.inertia_factor", conventions.INERTIA, zero=1),
    Row("audit.impossible", conventions.IMPOSSIBLE),
    Row("audit.open_balance", conventions.OPEN),
    Row("audit.doubted_balance", conventions.DOUBTED),
    Row("fewest_trials", search.FEW),
    Row("whole", search.NAMES),
    Row("trials_per_parameter", search.SMALL),
    Row("exact", residuals.UNKNOWN),
    Row("least_gain", search.SELECTION),
    Row("gain_level", search.SELECTION),
    Row("window", rivals.PLAUSIBLE),
    Row("chance_sigmas", rivals.RIVALS),
    Row("form_error", residuals.UNKNOWN),
    Row("certain_sigmas", residuals.COMPONENT),
    Row("minor_share", residuals.VARIABLES),
    Row("dependence_level", dependences.STATE),
    Row("region_level", residuals.REGIONS),
    Row("region_ratio", residuals.REGIONS, zero=1),
    Row("stated_noise_ratio", search.STATED, zero=1),
    Row("fit.outlier_weight", fits.OUTLIERS),
    Row("fit.open_share", fits.NOISE),
    Row("fit.collinearity", fits.SPEEDS, zero=1),
    Row("fit.effective_trials", fits.ORDER),
)
STUDIES = {row.study.name: row.study for row in ROWS}
Setting = tuple[str, Any]
"""A threshold and a value of it."""
Results = dict[str, dict[str, Any]]
"""For each threshold: its default, the date, the numbers of cases, and [false alarms, right alarms] by factor."""


def decide(study: str, planted: bool, case: Case, settings: list[Setting]) -> list[bool]:
    """Decide about one case under each setting; equal thresholds are decided about once."""
    of = STUDIES[study]
    alarm = of.alarm if planted else of.false_alarm or of.alarm
    material, changed = of.prepare(*case), [replaced(AllThresholds(), *setting) for setting in settings]
    known = {thresholds: alarm(material, thresholds) for thresholds in dict.fromkeys(changed)}
    return [known[thresholds] for thresholds in changed]


def measure(rows: list[Row], workers: int) -> Results:
    """Run the study of some rows, and count its alarms."""
    study = rows[0].study
    settings = [(row.field, value) for row in rows for value in row.values.values()]
    cases = [*((False, case) for case in study.null), *((True, case) for case in study.planted)]
    tasks = [(study.name, planted, case, settings) for planted, case in cases]
    alarms = list(track(run(decide, tasks, workers), study.name, total=len(tasks)))
    found: Results = {}
    for k, row in enumerate(rows):
        found[row.field] = {"default": DEFAULTS[row.field], "date": date.today().isoformat()}
        found[row.field] |= {"null": len(study.null), "planted": len(study.planted), "alarms": {}}
        for j, name in enumerate(FACTORS):
            counts = [
                sum(decided[len(FACTORS) * k + j] for (is_planted, _), decided in zip(cases, alarms, strict=True)
                    if is_planted == planted)
                for planted in (False, True)
            ]  # fmt: skip
            found[row.field]["alarms"][name] = counts
    return found


def read(path: Path) -> Results:
    """Read the results of thresholds that still exist and still have the same default."""
    results = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return {field: one for field, one in results.items() if DEFAULTS.get(field) == one["default"]}


def update(rows: Iterable[Row], path: Path, workers: int = 1, again: bool = False) -> Results:
    """Measure the rows that the file lacks, or all of them, and write the file after every study."""
    results, by_study = read(path), defaultdict(list)
    for row in rows:
        if again or set(results.get(row.field, {}).get("alarms", ())) != set(FACTORS):
            by_study[row.study.name].append(row)
    for group in by_study.values():
        results |= measure(group, workers)
        lines = ",\n".join(f"{json.dumps(field)}: {json.dumps(results[field])}" for field in sorted(results))
        path.write_text(f"{{\n{lines}\n}}\n", "utf-8")
    return results


HEAD = """# Sensitivity to thresholds

`python benchmarks/sensitivity/thresholds.py` makes this table. Each row is a public threshold: a field of
`contactlearn.diagnosis.thresholds.Thresholds`, or, below `tracks`, of
`contactlearn.data.recordings.thresholds.TrackThresholds`. It is halved and doubled; all others have their defaults.
Ratios and probabilities near 1 have their distance from 1 halved and doubled.

A cell has the value, false alarms of null cases, and right alarms of planted cases. Planted mistakes and effects are
small, so that some are missed. A threshold of several decisions has a row for one of them. Angles are in rad.
`results.json` has the date of each row.
`whole` would take 18 diagnoses of 6000 trials; answers of subsamples are tested on all trials.
"""


def table(results: Results) -> str:
    """Format the Markdown document of all rows."""
    lines = ["| threshold | study | default | halved | doubled |", "| --- | --- | --- | --- | --- |"]
    for row in ROWS:
        one = results.get(row.field, {"alarms": {}})
        cells = {}
        for name, value in row.values.items():
            if name in one["alarms"]:
                false, right = one["alarms"][name]
                cells[name] = f"{value:.3g}: {false}/{one['null']}, {right}/{one['planted']}"
            else:
                cells[name] = f"{value:.3g}: not measured"
        shown = " | ".join(cells[name] for name in ("default", "halved", "doubled"))
        lines.append(f"| `{row.field}` | {row.study.name} | {shown} |")
    return f"{HEAD}\n" + "\n".join(lines) + "\n"


def main() -> None:
    """Measure the rows that results.json lacks, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of thresholds")
    parser.add_argument("--again", action="store_true", help="measure also what results.json has")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--table", action="store_true", help="only write the table of results.json")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    rows = [] if options.table else [row for row in ROWS if row.field.startswith(tuple(options.only))]
    results = update(rows, FOLDER / "results.json", options.workers, options.again)
    (FOLDER / "thresholds.md").write_text(table(results), "utf-8")
    print(table(results))


if __name__ == "__main__":
    main()
