"""One table of all runs: a row for each run and model, the same numbers as the page and the results."""

import json

import pandas as pd
import pytest
from commands import run
from evaluations import evaluation
from test_report_runs import changed, diagnosed, evaluated, leave, ran, trained

from contactlearn.__main__ import main
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.inference.evaluation.metrics import METRICS
from contactlearn.report.page.runs import write_runs
from contactlearn.results.runs import write_table


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """Runs of every command, some that are not finished, and names that try to be something else."""
    folder = tmp_path_factory.mktemp("mixed")
    leave(folder / "b10", trained(effects=["surface_tilt"], error=0.15))
    leave(folder / "b9", changed(trained(size=50, error=0.4), "provenance", "config", "seed", to=7))
    leave(folder / "evaluate", evaluated())
    leave(folder / "diagnose", diagnosed())
    leave(folder / "hostile\n<b>,;", trained(error=0.3))
    leave(folder / "refused", ran(Diagnosis(verdict=Verdict.BAD_DATA, law=None, variant=None, findings=())))
    for name in ("half", "failed"):
        leave(folder / name, trained(error=0.001))
        (folder / name / ".lock").touch()
    (folder / "failed" / "failed.json").write_text(json.dumps({"reason": "no luck"}))
    frame, skipped = write_table([folder], folder / "results.parquet")
    return folder, frame, dict(skipped)


def test_rows_and_numbers_are_those_of_the_results(mixed):
    folder, frame, skipped = mixed
    assert list(frame[frame.run == "evaluate"].model) == list(evaluation().errors)
    assert (frame.groupby("run").own.sum() == 1).all()
    assert not frame.duplicated(["run", "model"]).any()
    assert list(frame.run.drop_duplicates())[:2] == ["b9", "b10"]
    pd.testing.assert_frame_equal(pd.read_parquet(folder / "results.parquet"), frame, check_dtype=False)
    for name in ("b9", "b10", "evaluate"):
        result = json.loads((folder / name / "results.json").read_text())
        for model, entry in result["errors"].items():
            (row,) = frame[(frame.run == name) & (frame.model == model)].to_dict("records")
            for metric in METRICS:
                numbers = (row[metric], row[f"{metric}_low"], row[f"{metric}_high"])
                if entry[metric] is None:
                    assert row["bound"]
                    assert all(map(pd.isna, numbers))
                else:
                    assert numbers == tuple(entry[metric][part] for part in ("mean", "low", "high"))
            for share in ("outside_admissible", "back_spin"):
                assert row[share] == entry[share]
            assert row["data_sha256"] == result["provenance"]["data"]["sha256"]
            assert row["version_contactlearn"] == result["provenance"]["versions"]["contactlearn"]
    assert set(frame[frame.run == "diagnose"].model) == {"named", "law", "noise", "irb"}
    assert frame[frame.bound].model.isin(["irb", "best_post_hoc", "noise"]).all()
    # The law alone where there are effects; data that were refused have a row without a model.
    alone = frame[frame.law_alone].set_index("run")
    assert dict(alone.model) == {"b10": "mirtich", "diagnose": "law"}
    (refused,) = frame[frame.run == "refused"].to_dict("records")
    assert refused["own"]
    assert (refused["verdict"], pd.isna(refused["mass_error"])) == ("bad_data", True)
    assert set(frame[frame.run == "b9"]["setting_seed"]) == {7}
    assert frame["setting_seed"].dtype.kind == "f"
    # And names the same others with the same reasons.
    _, runs, left_out = write_runs([folder])
    assert [row.name for row in runs] == list(frame.run.drop_duplicates())
    errors = frame[frame.own].set_index("run").mass_error.dropna()
    assert {row.name: error.mean for row in runs if (error := row.error("mass_error"))} == errors.to_dict()
    assert dict(left_out) == skipped
    assert skipped["failed"] == "failed: no luck"
    assert "was stopped before its end" in skipped["half"]
    assert frame.mass_error.min() > 0.001


def test_identities_are_there(tmp_path):
    """Of runs that have one; two runs of the same settings have the same."""
    words = ("train.py", "data.size=40", "train.size=10", "train.repetitions=1", "bootstrap=10", "model=analytical")
    run(*words, f"hydra.run.dir={tmp_path / 'a'}")
    run(*words, f"hydra.run.dir={tmp_path / 'b'}")
    run(*words, "seed=1", f"hydra.run.dir={tmp_path / 'c'}")
    printed = run("contactlearn", "results", str(tmp_path), "-o", str(tmp_path / "all.csv"))
    assert f"3 runs, 6 rows written to {tmp_path / 'all.csv'}" in printed.replace("\n", " ") or "3 runs" in printed
    jobs = pd.read_csv(tmp_path / "all.csv").groupby("run")[["job", "config_sha256", "code"]].first()
    assert jobs.loc["a"].equals(jobs.loc["b"])
    assert jobs.loc["a", "job"] != jobs.loc["c", "job"]
    assert jobs.code.nunique() == 1


@pytest.mark.parametrize(("arguments", "message"), [
    (["nowhere", "-o", "a.csv"], "nowhere: no such folder"),
    ([".", "-o", "a.csv"], "no run can be read"),
    ([".", "-o", "a.xlsx"], "unknown table format 'xlsx'"),
    (["b", "-o", "b/results.json/a.csv"], "cannot be written: "),
])  # fmt: skip
def test_errors_of_the_table_are_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    leave(tmp_path / "elsewhere" / "b", trained())
    monkeypatch.chdir(tmp_path / "elsewhere")
    if arguments[0] == ".":
        monkeypatch.chdir(tmp_path)
        (tmp_path / "elsewhere" / "b" / "results.json").write_text("{}")
    assert main(["results", *arguments]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert len(printed.err.splitlines()) == 1
