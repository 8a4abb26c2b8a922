"""The table of sensitivities has one row for each public threshold, and measures only what it lacks."""

import json
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from sensitivity import thresholds as benchmark
from sensitivity.study import AllThresholds, paths, replaced

DEFAULTS = dict(paths(AllThresholds()))


def row(field):
    return next(one for one in benchmark.ROWS if one.field == field)


def test_every_threshold_has_one_row():
    assert sorted(one.field for one in benchmark.ROWS) == sorted(DEFAULTS)
    assert all(benchmark.STUDIES[one.study.name] is one.study for one in benchmark.ROWS)
    assert row("audit.gross_ratio").values == {"halved": 1.5, "default": 2.0, "doubled": 3.0}
    assert row("tracks.certainty").values == {"halved": 0.975, "default": 0.95, "doubled": 0.9}
    changed = dict(paths(replaced(AllThresholds(), "audit.gross_ratio", 3.0)))
    assert changed == DEFAULTS | {"audit.gross_ratio": 3.0}


@pytest.mark.parametrize("one", benchmark.ROWS, ids=lambda one: one.field)
def test_halved_and_doubled_values_lie_on_both_sides_of_the_default(one):
    assert one.values["default"] == DEFAULTS[one.field]
    low, middle, high = sorted(one.values.values())
    assert low < middle == DEFAULTS[one.field] < high


def test_the_table_is_that_of_the_results(tmp_path):
    results = benchmark.read(benchmark.FOLDER / "results.json")
    assert set(results) <= set(DEFAULTS)
    assert (benchmark.FOLDER / "thresholds.md").read_text("utf-8") == benchmark.table(results)
    results["audit.gross_ratio"]["default"] = 2.5
    (tmp_path / "results.json").write_text(json.dumps(results))
    assert set(results) - set(benchmark.read(tmp_path / "results.json")) == {"audit.gross_ratio"}


def test_a_row_is_measured_once(tmp_path, monkeypatch):
    path, rows = tmp_path / "results.json", [row("audit.gross_ratio")]
    results = benchmark.update(rows, path)
    false, right = zip(*(results["audit.gross_ratio"]["alarms"][name] for name in benchmark.FACTORS), strict=True)
    assert false[0] > false[2]
    assert right[0] > right[2]
    assert "2: 0/24, 24/24" in benchmark.table(results)
    monkeypatch.setattr(benchmark, "measure", None)
    assert benchmark.update(rows, path) == results
