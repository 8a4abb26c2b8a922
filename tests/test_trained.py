"""Trained models come back: judged on other data as they are, and as the start of another training."""

import json
import re
import shlex
import shutil
from unittest.mock import patch

import pytest
import torch
from commands import run

from contactlearn import Recipe, laws, learn
from contactlearn.cli import hydra_main
from contactlearn.cli.checkpoints import load_models
from contactlearn.cli.sweeps.identity import job_identity
from contactlearn.core.errors import ContactLearnError
from contactlearn.data import table
from contactlearn.data.blocks import joined
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation import metrics
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures.comparison import error_comparison
from contactlearn.results.runs import read_runs
from contactlearn.simulation import synthetic

TRAIN = ("data=synthetic", "data.size=60", "train.size=20", "bootstrap=50")
JUDGE = (
    "data=synthetic",
    "data.size=60",
    "train.size=20",
    "train.repetitions=2",
    "figures.repetitions=2",
    "bootstrap=50",
    "laws=[mirtich]",
)
OTHERS = (*JUDGE, "data.seed=5")


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A trained model in its run folder, and what the run printed."""
    folder = tmp_path_factory.mktemp("trained")
    return folder, run("train.py", *TRAIN, "model=x1_wrench", f"hydra.run.dir={folder}")


def results(folder):
    return json.loads((folder / "results.json").read_text())


def copied(model, folder, change=lambda provenance: provenance):
    """A checkpoint of the same model in another folder, its provenance changed."""
    folder.mkdir(exist_ok=True)
    loaded = checkpoint.load(model / "model.pt")
    return checkpoint.save(loaded, folder / "model.pt", provenance=change(loaded.provenance))


def test_the_printed_line_judges_it_on_other_data_and_trains_nothing(trained, tmp_path):
    folder, printed = trained
    before = (folder / "model.pt").read_bytes()
    (line,) = re.findall(r"^next: (contactlearn evaluate checkpoint=\S+) .*$", printed, re.MULTILINE)
    assert f"checkpoint={folder / 'model.pt'}" in line
    with patch("contactlearn.inference.learning.recipe.Regressor.fit", side_effect=AssertionError):
        printed = run(*shlex.split(line), *OTHERS, f"hydra.run.dir={tmp_path}")
    assert f"x1_wrench: {folder / 'model.pt'}\n" in printed
    found = results(tmp_path)
    assert list(found["errors"]) == ["mirtich", "best_post_hoc", "irb", "x1_wrench"]
    _, test = synthetic.load(size=60, seed=5).split(0.25, torch.Generator().manual_seed(0))
    model = checkpoint.load(folder / "model.pt")
    error = metrics.mass_error(test, model.predict(test)).mean().item()
    assert found["errors"]["x1_wrench"]["mass_error"]["mean"] == pytest.approx(error, rel=1e-9)
    assert (found["model"], found["law"]) == ("x1_wrench", None)
    judged = found["trained"]["x1_wrench"]
    assert judged["data"] == results(folder)["provenance"]["data"]
    inside = metrics.squared_distance(test, model.predict(test)) <= metrics.CHI_SQUARED_95[3]
    assert judged["coverage"] == pytest.approx(inside.double().mean().item())
    origin = "was trained on 20 impacts of synthetic drops (wang_mason, seed 0) in another run"
    told = f"{origin}; {100 * judged['coverage']:.1f}"
    assert f"x1_wrench {told} % of the held-out" in printed.replace("\u00a0", " ")
    assert "X1 → wrench was trained on 20" in (tmp_path / "report.html").read_text()
    (judging,), _ = read_runs([tmp_path])
    assert (judging.learned, judging.trained_on) == ("x1_wrench", 20)
    assert (tmp_path / "figures" / "calibration_of_trained.png").exists()
    assert (folder / "model.pt").read_bytes() == before
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [one["trained_on"] for one in lines if "mass_error/x1_wrench" in one] == [20]


def test_models_of_a_sweep_are_named_by_the_settings_in_which_they_differ(trained, tmp_path):
    folder, _ = trained
    for size in (10, 9):
        changed = lambda about, k=size: about | {"config": about["config"] | {"train": {"size": k}}}  # noqa: E731
        copied(folder, tmp_path / f"job{size}", changed)
    (tmp_path / "job9" / ".parts").mkdir()
    (tmp_path / "job9" / ".parts" / "x.pt").write_text("no model")
    assert list(load_models([str(tmp_path)], [])) == ["x1_wrench (train.size=9)", "x1_wrench (train.size=10)"]
    on = lambda about: about | {"config": about["config"] | {"checkpoint": "job9", "seed": 1}}  # noqa: E731
    on, first = copied(folder, tmp_path / "on", on), str(folder / "model.pt")
    assert list(load_models([first, str(on)], [])) == ["x1_wrench (seed=0)", "x1_wrench (checkpoint=job9, seed=1)"]
    same = copied(folder, tmp_path / "again")
    alike = [f"x1_wrench ({one})" for one in (folder.name, f"{tmp_path.name}/again")]
    assert list(load_models([str(folder), str(same)], [])) == alike
    assert list(load_models([str(folder)], ["x1_wrench"])) == ["x1_wrench (trained)"]
    law = ContactModel(laws.find("mirtich").at(0.1, 0.5))
    path = checkpoint.save(law, tmp_path / "law.pt", provenance={"by": "hand"})
    assert list(load_models([str(path)], [])) == ["mirtich"]


def test_a_model_is_not_judged_on_trials_that_it_has_seen(trained, tmp_path):
    folder, _ = trained
    word, where = f"checkpoint={folder}", f"hydra.run.dir={tmp_path / 'same'}"
    printed = run("evaluate.py", word, *JUDGE, "split_seed=1", where, status=2)
    assert "was trained on these data with test=0.25 split_seed=0, and has seen trials that" in printed
    assert not (tmp_path / "same").exists()
    assert "note: x1_wrench" not in run("evaluate.py", word, *JUDGE, where)
    found, before = results(tmp_path / "same"), results(folder)
    again, then = (one["errors"]["x1_wrench"]["mass_error"]["mean"] for one in (found, before))
    assert again == pytest.approx(then, rel=1e-9)
    every = copied(folder, tmp_path / "every", lambda about: about | {"config": {"seed": 0}})
    assert "was fitted to all trials of these data" in run("evaluate.py", f"checkpoint={every}", *JUDGE, status=2)
    more = synthetic.load(size=30, seed=5).replace(trial=tuple(f"t{k}" for k in range(30)))
    path = table.save(joined([synthetic.load(size=60), more]), tmp_path / "more.csv")
    words = ("data=table", f"data.path={path}", "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}", *JUDGE[2:])
    printed = run("evaluate.py", word, *words, f"hydra.run.dir={tmp_path / 'more'}")
    assert re.search(r"note: x1_wrench was trained on impacts that equal \d of the 22 held-out ones", printed)


def test_a_model_that_has_seen_one_body_says_so(tmp_path):
    model = learn(synthetic.load(size=20), Recipe("state", "velocity"), rows=torch.arange(20))
    path = checkpoint.save(model, tmp_path / "one_body.pt", provenance={})
    disc = "data.shape={kind: disc, radius: 0.03}"
    printed = run("evaluate.py", f"checkpoint={path}", *OTHERS, disc, f"hydra.run.dir={tmp_path / 'disc'}")
    assert "note: one_body has seen a single value of I, and ignores that these data have others" in printed


OTHER_BODIES = {
    "mass": ("train.py", OTHERS[:3], "data.mass=1.0", "1 kg, 0.000463 kg m²"),
    "disc": ("evaluate.py", OTHERS, "data.shape={kind: disc, radius: 0.03}", "0.0364 kg, 1.64e-05 kg m²"),
}


@pytest.mark.parametrize(("command", "words", "change", "body"), OTHER_BODIES.values(), ids=OTHER_BODIES)
def test_another_body_is_said(trained, command, words, change, body, tmp_path):
    """By its mass and moment of inertia; and features beyond those of the training by name."""
    printed = run(command, f"checkpoint={trained[0]}", *words, change, f"hydra.run.dir={tmp_path}")
    assert f"note: x1_wrench was trained on a body of 0.0364 kg, 1.68e-05 kg m²; these data have {body}" in printed
    far = "note: x1_wrench extrapolates to 100 % of these impacts: their M_c,tt, M_c,tn, M_c,nn" in printed
    assert far == (command == "train.py")


NO_DATA = [("evaluate.py",), ("evaluate.py", "data.size=60"), ("train.py", "train.size=9")]


@pytest.mark.parametrize("words", NO_DATA, ids=["judged", "changed", "trained"])
def test_a_checkpoint_is_not_combined_with_default_data(words, tmp_path):
    printed = run(*words, "checkpoint=nowhere.pt", f"hydra.run.dir={tmp_path / 'run'}", status=2)
    assert printed.count("\n") == 1
    assert "error: a checkpoint needs data=…" in printed


def test_settings_that_a_checkpoint_keeps_and_commands_that_take_none():
    line = run("train.py", "checkpoint=a.pt", "data=synthetic", "model.x1_wrench.features=x2", status=2)
    assert "checkpoint=a.pt keeps the features and target that it was trained with; take out model.x1_wrench" in line
    line = run("diagnose.py", "checkpoint=a.pt", "data=synthetic", status=2)
    assert "checkpoint is a setting of train and evaluate only" in line


def test_a_figure_shows_all_of_the_names_of_models():
    names = [f"x1_wrench (2026-11-23_17-18-{second}, train.size=100)" for second in ("02", "40")]
    figure = error_comparison(dict.fromkeys(names, torch.rand(20)), dict.fromkeys(names, (0.5, 0.4, 0.6)), "Error")
    shown = [label.get_text().replace("\n", "") for label in figure.axes[0].get_yticklabels()]
    assert [one.replace(" ", "") for one in shown] == [name.replace(" ", "") for name in names]


def _subsets(folder):
    rows = torch.arange(20).reshape(2, 10)
    model = learn(synthetic.load(size=20), Recipe("x1", "impulse"), rows=rows)
    return checkpoint.save(model, folder / "model.pt", provenance={})


def _needs_shape(folder):
    model = ContactModel(laws.find("mirtich").at(0.1, 0.5), effects={"shape_error": find_effect("shape_error")()})
    return checkpoint.save(model, folder / "model.pt", provenance={})


def _cut_off(folder):
    path = _subsets(folder)
    path.write_bytes(path.read_bytes()[:2000])
    return path


def _law(folder):
    return checkpoint.save(ContactModel(laws.find("mirtich").at(0.1, 0.5)), folder / "model.pt", provenance={})


def _two(folder):
    _law(folder)
    shutil.copy(folder / "model.pt", folder / "other.pt")
    return folder


NO_SHAPE = ("data=table", "data.path=drops.csv")
REFUSED = {
    "nowhere": ("evaluate.py", lambda folder: folder / "nowhere.pt", (), "no such file"),
    "no model": ("evaluate.py", lambda folder: folder, (), "no trained model is in this folder"),
    "no checkpoint": ("evaluate.py", lambda folder: folder / "drops.csv", (), "is not a checkpoint"),
    "cut off": ("evaluate.py", _cut_off, (), "is not a checkpoint, or not all of one"),
    "several subsets": ("evaluate.py", _subsets, (), "must predict one finite"),
    "no shape": ("evaluate.py", _needs_shape, NO_SHAPE, "does not fit these data: effect shape_error"),
    "a number": ("evaluate.py", lambda folder: 3, (), "3: no such file"),
    "transfer": ("evaluate.py", _law, ("experiment=transfer",), "a transfer trains its own models"),
    "a law": ("train.py", _law, (), "training cannot go on from it: the model has no learned part"),
    "several": ("train.py", _two, (), "holds 2 models"),
    "a list": ("train.py", lambda folder: f"[{folder}]", (), "training goes on from one checkpoint"),
    "a model": ("train.py", _law, ("model=x1_wrench",), "has its own model; take out model=…"),
    "effects": ("train.py", _law, ("effect=[spin_damping]",), "has its own effect; take out effect=…"),
}


@pytest.mark.parametrize(("command", "make", "words", "message"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(command, make, words, message, tmp_path):
    table.save(synthetic.load(size=30), tmp_path / "drops.csv")
    words = (f"checkpoint={make(tmp_path)}", "data=synthetic", *words, f"hydra.run.dir={tmp_path / 'run'}")
    printed = run(command, *words, cwd=tmp_path, status=2)
    (line,) = [line for line in printed.splitlines() if line.startswith("error: ")]
    assert message in line
    assert not (tmp_path / "run").exists()


def test_training_goes_on_from_a_model(trained, tmp_path):
    """With its recipe and name, on other data, in fewer evaluations than from the usual starts."""
    folder, _ = trained
    words = (*OTHERS[:3], "data.seed=5", "bootstrap=50", f"hydra.run.dir={tmp_path / 'on'}")
    printed = run("train.py", *words, f"checkpoint={folder}")
    came = "trained on 20 impacts of synthetic drops (wang_mason, seed 0)"
    assert f"goes on from {folder / 'model.pt'}, {came}\n" in printed.replace("\u00a0", " ")
    run("train.py", *OTHERS[:3], "data.seed=5", "bootstrap=50", "model=x1_wrench", f"hydra.run.dir={tmp_path / 'new'}")
    on, new = results(tmp_path / "on"), results(tmp_path / "new")
    assert on["learned"] == "x1_wrench"
    evaluations = [sum(one["evaluations"] for one in each["processes"]) for each in (on, new)]
    assert evaluations[0] < evaluations[1]
    assert list(load_models([str(tmp_path / "on")], [])) == ["x1_wrench"]


@pytest.mark.parametrize("target", ["velocity", "impulse", "wrench", "parameters_identified", "parameters_likelihood"])
def test_a_learned_model_knows_its_recipe(target):
    drops, law = synthetic.load(size=12), laws.find("whittaker").at(0.1, 0.5)
    recipe = Recipe("x2", target, law)
    base = ContactModel(law, effects={"side_drag": find_effect("side_drag")()}) if target == "wrench" else law
    model = learn(drops, recipe, rows=torch.arange(12), base=base)
    found = Recipe.of(model)
    assert (found.features, found.target, found.law.name) == ("x2", target, "whittaker")
    again = learn(drops, found, rows=torch.arange(12), base=base, like=model.processes)
    assert again.processes.training.loss.mean() < model.processes.training.loss.mean() + 0.05
    with pytest.raises(ContactLearnError, match="on top of a learned model"):
        Recipe.of(learn(drops, Recipe("x1", "impulse"), rows=torch.arange(12), base=model))


def test_a_job_is_another_one_if_its_checkpoint_changes(trained, tmp_path):
    def identity():
        cfg = hydra_main.compose("evaluate", [f"checkpoint={tmp_path}"], return_hydra_config=True)
        assert cfg.model == {}
        return job_identity(cfg, cfg.hydra)

    copied(trained[0], tmp_path)
    first = identity()
    assert identity() == first
    copied(trained[0], tmp_path, lambda about: about | {"command": "another"})
    assert identity().job != first.job
