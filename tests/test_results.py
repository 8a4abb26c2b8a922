"""Results of runs: read again as written, a page drawn again from the run folder alone, one table of all runs."""

import dataclasses
import json
import shutil

import pandas as pd
import pytest
import torch
from commands import run
from evaluations import evaluation, evaluation_of, interval, learning_curve, provenance, training
from test_report_runs import changed, diagnosed, evaluated, leave, ran, trained

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.serialisation import to_json
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import METRICS
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Prediction
from contactlearn.mechanics.shapes import make_shape, shape_entries
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.page.runs import has_page, redraw, write_runs
from contactlearn.results import folder as run_folder
from contactlearn.results.runs import write_table
from contactlearn.results.tables import HeldOut, save_held_out
from contactlearn.results.types import BodyTransfer, CurveCalibration, LearningCurve, ModelErrors, Transfer
from contactlearn.simulation import synthetic

CALIBRATION = CurveCalibration(
    processes=("exact",), converged=(1.0,), negative_log_density=(-3.1,), coverage=(0.9,),
    component_coverage=((0.9, 1.0, 0.95),),
)  # fmt: skip
CURVE = dataclasses.replace(learning_curve((10,), (0.1,)), calibration=CALIBRATION, settled={"mass_error": None})
TRANSFER = Transfer(
    provenance=provenance({}),
    norm="mass",
    sizes=(4, 8),
    transfer={
        "x1_wrench": {"disc": BodyTransfer(
            zero_shot=(interval(0.4),), prior=(interval(0.3), interval(0.2)), scratch=(interval(0.5), interval(0.4)))}
    },
)  # fmt: skip
RESULTS = {
    "training": training(effects=["surface_tilt"]),
    "evaluation": dataclasses.replace(evaluation(), learning_curves={"x1_wrench": CURVE}),
    "transfer": TRANSFER,
}


@pytest.mark.parametrize(("number", "entry", "message"), [
    (None, "errors", r"^is of format 1, by an earlier contactlearn: run its command again \(errors is not there"),
    (4, "errors", "^errors is not there"),
    (99, None, "^is of format 99, and the newest known is 4: upgrade contactlearn"),
])  # fmt: skip
def test_results_of_another_format_are_refused_in_one_line(number, entry, message, tmp_path):
    """Unless an earlier one has all that is needed."""
    path = run_folder.write_result(tmp_path, RESULTS["training"])
    content = {name: value for name, value in json.loads(path.read_text()).items() if name not in ("format", entry)}
    path.write_text(json.dumps(content | ({} if number is None else {"format": number})))
    with pytest.raises(ContactLearnError, match=message):
        run_folder.read_result(path)
    if number is None:
        path.write_text(json.dumps(content | {"errors": json.loads(to_json(RESULTS["training"]))["errors"]}))
        assert run_folder.read_result(path) == RESULTS["training"]


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_a_result_is_read_as_it_was_written(result, tmp_path):
    path = run_folder.write_result(tmp_path, result)
    assert run_folder.read_result(path) == result
    assert list(run_folder.find_results(tmp_path)) == [path]
    assert run_folder.is_run(tmp_path)
    assert json.loads(path.read_text())["kind"] == result.kind
    assert [one.name for one in tmp_path.iterdir()] == ["results.json"]


def test_a_number_that_is_not_finite_is_not_written(tmp_path, monkeypatch):
    for kind in (ModelErrors, LearningCurve):
        assert set(METRICS) <= {field.name for field in dataclasses.fields(kind)}
    wrong = dataclasses.replace(evaluation(), differences={"whittaker": interval(float("nan"))})
    with pytest.raises(ContactLearnError, match=r"differences\.whittaker\.mean: expected float, got null"):
        run_folder.write_result(tmp_path, wrong)
    assert not list(tmp_path.iterdir())
    run_folder.write_result(tmp_path, training())
    assert not has_page(tmp_path)
    with pytest.raises(ContactLearnError, match="has no page of its own"):
        redraw(tmp_path)


def test_shapes_are_rebuilt_from_their_entries():
    for entries in (
        {"kind": "disc", "radius": 0.02},
        {"kind": "ellipse", "semi_axes": [0.035, 0.025]},
        {"kind": "polygon", "vertices": [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]},
        None,
    ):
        shape = make_shape(entries)
        assert make_shape(json.loads(json.dumps(shape_entries(shape)))) == shape


@pytest.fixture
def small():
    impacts = synthetic.load(size=30)
    laws = {name: find(name).at(0.1, 0.5) for name in ("mirtich", "whittaker")}
    predictions = {name: ContactModel(law).predict(impacts) for name, law in laws.items()}
    return evaluation_of(impacts, predictions | {"irb": bounds.irb(impacts)}, laws, {})


def save(held_out, folder, tables):
    save_held_out(folder, tables, [held_out.impacts], [(held_out.impacts, held_out.predictions)])


@pytest.mark.parametrize("tables", ["parquet", "csv"])
def test_held_out_trials_are_read_as_they_were_written(small, tables, tmp_path):
    result, held_out = small
    result = dataclasses.replace(result, tables=tables)
    save(held_out, tmp_path, tables)
    again = HeldOut.load(tmp_path, result)
    assert again.impacts.fingerprint() == held_out.impacts.fingerprint()
    assert again.impacts.shape == held_out.impacts.shape
    assert list(again.predictions) == list(held_out.predictions)
    for name, prediction in held_out.predictions.items():
        assert torch.equal(again.predictions[name].v_post, prediction.v_post)
        assert torch.equal(again.predictions[name].wrench, prediction.wrench)


def test_tables_of_other_runs_are_refused(small, tmp_path):
    result, held_out = small
    save(held_out, tmp_path, "parquet")
    other = Prediction(held_out.impacts.v_post[:20], held_out.impacts.wrench[:20])
    save(HeldOut(impacts=held_out.impacts[:20], predictions={"irb": other}), tmp_path / "other", "parquet")
    shutil.copy(tmp_path / "other" / "predictions.parquet", tmp_path)
    with pytest.raises(DataError, match="are not the held-out ones"):
        HeldOut.load(tmp_path, result)
    (tmp_path / "predictions.parquet").write_text("PAR1")
    with pytest.raises(DataError, match="is no table of a run"):
        HeldOut.load(tmp_path, result)
    (tmp_path / "predictions.parquet").unlink()
    with pytest.raises(DataError, match="no such file"):
        HeldOut.load(tmp_path, result)


def test_the_page_of_an_evaluation_is_drawn_again_without_its_data(tmp_path, capsys):
    run("contactlearn", "export", str(tmp_path / "drops.csv"), "data.size=60")
    done = (
        *("evaluate.py", "data=table", f"data.path={tmp_path / 'drops.csv'}", "train.size=20", "train.repetitions=3"),
        *("laws=[whittaker,mirtich]", "figures.repetitions=1", "bootstrap=50", "model=[x1_wrench]", "workers=1"),
        *(
            "curves.sizes=[10]",
            "curves.seeds=1",
            "effect=[surface_tilt]",
            "effect.surface_tilt.form=seen",
            f"hydra.run.dir={tmp_path / 'run'}",
        ),
    )
    run(*done)
    page = tmp_path / "run" / "report.html"
    drawn = page.read_bytes()
    page.unlink()
    (tmp_path / "drops.csv").rename(tmp_path / "elsewhere.csv")
    assert has_page(tmp_path / "run")
    assert main(["report", str(tmp_path / "run")]) == 0
    assert capsys.readouterr().out == f"report: {page}\n"
    assert page.read_bytes() == drawn


def test_a_damaged_run_is_not_drawn(small, tmp_path, capsys):
    result, _ = small
    run_folder.write_result(tmp_path, result)
    with pytest.raises(DataError, match=r"held_out\.parquet: no such file"):
        redraw(tmp_path)
    assert main(["report", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


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
    done = json.loads((tmp_path / "b" / "done.json").read_text())
    assert "note: 1 of the runs repeats the job of another one, in another folder" in printed
    (tmp_path / "b" / "done.json").write_text(json.dumps(done | {"code": "0.0+older"}))
    for words in (("results", "-o", str(tmp_path / "more.csv")), ("report",)):
        assert "repeats the job of another one, with another version of the code" in run(
            "contactlearn", *words, str(tmp_path)
        ).replace("\n", " ")
    (tmp_path / "b" / "done.json").write_text(json.dumps(done | {"data": "0" * 64}))  # of a file that has changed
    assert "note" not in run("contactlearn", "results", str(tmp_path), "-o", str(tmp_path / "other.csv"))


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
