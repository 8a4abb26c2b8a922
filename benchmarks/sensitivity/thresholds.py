"""What does each threshold of the diagnosis decide?  False alarms and power over a range of its values.

    python benchmarks/sensitivity/thresholds.py [--only PREFIX] [--keep FILE] [--workers 2] [--table FILE]

A study has null cases, in which an alarm is false, and planted ones, in which it is right; the diagnosis decides about
each by its own code, with one threshold at another value and all others at their defaults.  Whatever is expensive and
depends on no threshold of the study is made once for each case.  A threshold over which no decision changes has no
reason to exist.  With --keep, decisions are kept in a file, and a run that was interrupted goes on from there.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from rich.progress import track
from threadpoolctl import threadpool_limits

from contactlearn.inference.learning.curves import run
from sensitivity.studies import (
    conventions,
    descriptions,
    fits,
    flights,
    frames,
    measurements,
    residuals,
    rivals,
    samples,
    search,
    state_dependence,
)
from sensitivity.studies.memory import memory
from sensitivity.studies.study import AllThresholds, Row, paths, replaced

ROWS: tuple[Row, ...] = (
    *flights.ROWS,
    *frames.ROWS,
    *measurements.ROWS,
    *conventions.ROWS,
    *search.ROWS,
    *rivals.ROWS,
    *residuals.ROWS,
    *descriptions.ROWS,
    *fits.ROWS,
    *samples.ROWS,
    *state_dependence.ROWS,
)
STUDIES = {row.study.name: row.study for row in ROWS}

Setting = tuple[str, Any]
"""A field and a value of it."""
Question = tuple[str, str, list[Setting]]
"""A study, one of its cases, and the settings under which it is decided about."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Whether there is an alarm about a case with a threshold at a value."""

    field: str
    value: Any
    case: str
    planted: bool
    alarm: bool

    @property
    def key(self) -> tuple[str, str, str]:
        """The same for a decision that was read from a file."""
        return self.field, json.dumps(self.value), self.case


def decide(questions: Sequence[Question]) -> list[Decision]:
    """Decide about one case under each setting of one or more studies; equal thresholds are decided about once."""
    material, default, known, found = None, AllThresholds(), {}, []
    with memory():
        for name, case, settings in questions:
            study = STUDIES[name]
            planted, arguments = next((p, a) for other, p, a in study.cases() if other == case)
            material = study.prepare(*arguments) if material is None else material
            alarm = study.alarm if planted else study.false_alarm or study.alarm
            for field, value in settings:
                asked = alarm, replaced(default, field, value)
                if asked not in known:
                    known[asked] = alarm(material, asked[1])
                found.append(Decision(field=field, value=value, case=case, planted=planted, alarm=known[asked]))
    return found


def tasks(rows: Iterable[Row], known: set[tuple[str, str, str]]) -> list[tuple[list[Question]]]:
    """What is not decided yet, in questions about the same material."""
    settings: dict[Any, dict[tuple[str, str], list[Setting]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for case, _, arguments in row.study.cases():
            for value in row.values:
                if (row.field, json.dumps(value), case) not in known:
                    settings[row.study.prepare, arguments][row.study.name, case].append((row.field, value))
    return [([(*names, wanted) for names, wanted in questions.items()],) for questions in settings.values()]


def kept(path: Path | None) -> list[Decision]:
    """Decisions of earlier runs; a line that was not written to its end is taken out of the file."""
    if path is None or not path.exists():
        return []
    text = path.read_text()
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole)
    return [Decision(**json.loads(line)) for line in whole.splitlines()]


def decisions(rows: Sequence[Row], keep: Path | None = None, workers: int = 1) -> list[Decision]:
    """All decisions of some rows: those kept, and the others made now."""
    wanted = {(row.field, json.dumps(value)) for row in rows for value in row.values}
    found = [d for d in kept(keep) if d.key[:2] in wanted]
    left = tasks(rows, {d.key for d in found})
    for batch in track(run(decide, left, workers), "cases", total=len(left)):
        found += batch
        if keep:
            with keep.open("a") as file:
                file.write("".join(json.dumps(vars(d)) + "\n" for d in batch))
    return found


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Alarms of a row's null and planted cases at each value, as counts of those cases that are decided at every value.

    `changes` is whether the decision about any case changes over the values.
    """

    row: Row
    null: int
    planted: int
    false_alarms: tuple[int, ...]
    power: tuple[int, ...]
    changes: bool

    @classmethod
    def of(cls, row: Row, made: Iterable[Decision]) -> "Outcome":
        """Count the decisions of a row."""
        by_case: dict[tuple[bool, str], dict[str, bool]] = defaultdict(dict)
        for decision in made:
            if decision.field == row.field:
                by_case[decision.planted, decision.case][json.dumps(decision.value)] = decision.alarm
        keys = [json.dumps(value) for value in row.values]
        done = [(planted, [alarm[k] for k in keys]) for (planted, _), alarm in by_case.items() if {*keys} <= {*alarm}]
        null, planted = ([alarms for which, alarms in done if which == wanted] for wanted in (False, True))
        return cls(
            row=row,
            null=len(null),
            planted=len(planted),
            false_alarms=tuple(map(sum, zip(*null, strict=True))) or (0,) * len(keys),
            power=tuple(map(sum, zip(*planted, strict=True))) or (0,) * len(keys),
            changes=any(len(set(alarms)) > 1 for alarms in null + planted),
        )

    @property
    def verdict(self) -> str:
        """Whether the threshold decides anything over these values."""
        if not self.null + self.planted:
            return "not run"
        return "decides" if self.changes else "nothing changes"


HEAD = """# Thresholds: false alarms and power

`python benchmarks/sensitivity/thresholds.py` makes this table; its first lines say how. Each row is a field of
`contactlearn.diagnosis.thresholds.Thresholds`, or below `tracks` of
`contactlearn.data.recordings.thresholds.TrackThresholds`.
At each value, the default one bold: false alarms of so many null cases, and right alarms of so many planted ones.
Planted mistakes and effects are small on purpose, so that some are missed.
A row that says "not run", or has fewer cases than its study, is still to be decided: `--keep` goes on from there.
A threshold that serves several decisions has the row of one of them; the others were made at the default value.
"""


def table(outcomes: Iterable[Outcome]) -> str:
    """Markdown; the default value of each threshold is bold."""
    defaults = dict(paths(AllThresholds()))
    lines = ["| field | decided in | value: false alarms, power | verdict |", "| --- | --- | --- | --- |"]
    for outcome in outcomes:
        row, cells = outcome.row, []
        for value, false, right in zip(row.values, outcome.false_alarms, outcome.power, strict=True):
            said = f"**{_said(value)}**" if value == defaults[row.field] else _said(value)
            counts = f": {false}/{outcome.null}, {right}/{outcome.planted}" if outcome.null + outcome.planted else ""
            cells.append(said + counts)
        lines.append(f"| `{row.field}` | {row.study.name} | {'; '.join(cells)} | {outcome.verdict} |")
    return "\n".join(lines)


def _said(value: Any) -> str:
    if isinstance(value, tuple):
        return "–".join(map(_said, value))
    return ("−∞" if value < 0 else "∞") if abs(value) >= 1e8 else f"{value:.3g}"


def main() -> None:
    """Decide, print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="beginning of the fields to be decided")
    parser.add_argument("--keep", type=Path, help="file of the decisions, one a line")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--table", type=Path, help="Markdown file that the table is written to")
    parser.add_argument("--redraw", action="store_true", help="the table of what is kept, no decisions")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    rows = [row for row in ROWS if row.field.startswith(options.only)]
    made = kept(options.keep) if options.redraw else decisions(rows, options.keep, options.workers)
    text = table(Outcome.of(row, made) for row in rows)
    print(text)
    if options.table:
        options.table.write_text(f"{HEAD}\n{text}\n")


if __name__ == "__main__":
    main()
