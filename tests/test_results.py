"""Results of runs: what is written is read again equal, and a page is drawn again from the run folder alone."""

import dataclasses
import json
import shutil

import pytest
import torch
from commands import run
from evaluations import evaluation, evaluation_of, interval, learning_curve, provenance, training

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.serialisation import to_json
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import METRICS
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Prediction
from contactlearn.mechanics.shapes import make_shape, shape_entries
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.page.runs import has_page, redraw
from contactlearn.results import folder as run_folder
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
    (3, "errors", "^errors is not there"),
    (99, None, "^is of format 99, and the newest known is 3: upgrade contactlearn"),
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
    with pytest.raises(DataError, match="is no table of predictions"):
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
    assert capsys.readouterr().out == f"open     {page}\n"
    assert page.read_bytes() == drawn


def test_a_damaged_run_is_not_drawn(small, tmp_path, capsys):
    result, _ = small
    run_folder.write_result(tmp_path, result)
    with pytest.raises(DataError, match=r"held_out\.parquet: no such file"):
        redraw(tmp_path)
    assert main(["report", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "report.html").exists()
