"""The benchmark of thresholds has a row for each of them, and decides and resumes as it says."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from sensitivity import thresholds as benchmark
from sensitivity.studies.study import AllThresholds, paths, replaced

DEFAULTS = dict(paths(AllThresholds()))


def test_every_threshold_has_one_row():
    assert sorted(row.field for row in benchmark.ROWS) == sorted(DEFAULTS)


def test_a_study_has_one_name():
    assert all(benchmark.STUDIES[row.study.name] is row.study for row in benchmark.ROWS)


@pytest.mark.parametrize("row", benchmark.ROWS, ids=lambda row: row.field)
def test_values_are_different_and_contain_the_default(row):
    assert DEFAULTS[row.field] in row.values
    assert len(set(row.values)) == len(row.values) > 1


def test_another_value_changes_nothing_else():
    changed = dict(paths(replaced(AllThresholds(), "audit.gross_ratio", 3.0)))
    assert changed == DEFAULTS | {"audit.gross_ratio": 3.0}


def test_a_cheap_row_decides_and_goes_on_where_it_was_interrupted(tmp_path):
    rows = [row for row in benchmark.ROWS if row.field == "audit.gross_ratio"]
    keep = tmp_path / "decisions.jsonl"
    first = benchmark.Outcome.of(rows[0], benchmark.decisions(rows, keep))
    lines = keep.read_text().splitlines(keepends=True)
    keep.write_text("".join(lines[: len(lines) // 2]) + lines[-1][:20])  # the last line was not written to its end
    again = benchmark.decisions(rows, keep)
    assert benchmark.Outcome.of(rows[0], again) == first
    assert first.changes
    assert first.false_alarms[0] >= first.false_alarms[-1]
    assert first.power[0] > first.power[-1]
    assert "**2**: 0/24" in benchmark.table([first])
