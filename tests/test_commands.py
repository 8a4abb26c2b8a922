"""The commands as a user types them, on small synthetic data, and what they leave behind."""

import json
import logging
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from types import SimpleNamespace
from unittest.mock import patch

import pandas as pd
import pytest
import torch
from commands import ROOT, SMALL, TRAIN, run, run_alone
from logged import Events
from matplotlib.text import Text
from pairings import paired

import contactlearn
from contactlearn import laws
from contactlearn.__main__ import _parser, main
from contactlearn.cli import hydra_main
from contactlearn.cli.commands import loading, record
from contactlearn.cli.commands.diagnose import _evaluation_command
from contactlearn.cli.commands.fitting import draw_cost_surface
from contactlearn.cli.config_files import choices, summaries
from contactlearn.cli.job import Run
from contactlearn.cli.settings import DiagnoseSettings, IdentificationSettings, TrainSettings, check_names
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.events import TaskProgress
from contactlearn.data import table
from contactlearn.data.blocks import sampled
from contactlearn.diagnosis.events import FILE, read_events
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.identification.shared import Box, cost_surface
from contactlearn.inference.learning import curves
from contactlearn.mechanics.features import Features
from contactlearn.models import checkpoint
from contactlearn.report.figures import laws as drawings
from contactlearn.report.tensorboard import shown_as
from contactlearn.report.text.names import model_label
from contactlearn.simulation import synthetic

CURVES = ("model=[x1_wrench,parameters_likelihood]", "curves.sizes=[10,20,500]", "curves.seeds=3", "workers=1")
FIGURES = (
    "energy_ellipse", "cost_surface", "convergence", "error_comparison", "trial_parameters", "patch_curve",
)  # fmt: skip


def assert_progress(folder, task):
    """A run folder holds the progress of its run."""
    steps = [one for one in read_events(folder / FILE) if isinstance(one, TaskProgress) and one.task == task]
    assert (steps[0].done, steps[-1].done) == (0, steps[-1].total)


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """One small evaluation: (what it printed, its folder, its figures)."""
    folder = tmp_path_factory.mktemp("evaluation")
    with patch.object(record, "save", wraps=record.save) as saved:
        printed = run("evaluate.py", *SMALL, "tables=csv", f"hydra.run.dir={folder}", figures=True)
    return printed, folder, {call.args[2]: call.args[0] for call in saved.call_args_list}


def test_an_evaluation_prints_and_leaves_results_tables_figures_and_events(evaluation):
    printed, folder, _ = evaluation
    assert "models are fitted to random subsets of 20 of them (train.size)" in printed
    assert re.search(r"back-spin +reach", printed)
    assert "back-spin: share of outcomes beyond the line of sticking" in printed
    for model in (*laws.PAPER_LAWS, "best_post_hoc", "irb"):
        assert re.search(rf"^ *{model_label(model)} ", printed, re.MULTILINE), model
    assert f"tensorboard --logdir {folder}" in printed
    results = json.loads((folder / "results.json").read_text())
    assert {fit["law"] for fit in results["fits"]} == set(laws.PAPER_LAWS)
    assert results["provenance"]["data"]["trials"] == 80
    assert len(results["provenance"]["data"]["sha256"]) == 64
    assert results["provenance"]["config"]["train"]["size"] == 20
    for model, entry in results["errors"].items():
        shown = ("mass_error",) if model in ("best_post_hoc", "irb") else metrics.METRICS
        assert [name for name in metrics.METRICS if entry[name] is not None] == [*shown]
        for metric in shown:
            assert entry[metric]["low"] <= entry[metric]["mean"] <= entry[metric]["high"]
    # The true law must win, and no law may beat the bounds, in the norm in which they are closest.
    error = {model: entry["mass_error"]["mean"] for model, entry in results["errors"].items()}
    assert min(laws.PAPER_LAWS, key=error.get) in ("wang_mason", "mirtich")
    assert error["irb"] <= error["best_post_hoc"] <= min(error[law] for law in laws.PAPER_LAWS)
    frame = pd.read_csv(folder / "predictions.csv")
    assert len(frame) == 20 * 8
    means = frame.groupby("model")["mass_error"].mean()
    for model, entry in results["errors"].items():
        assert means[model] == pytest.approx(entry["mass_error"]["mean"], rel=1e-12)
    parameters = pd.read_csv(folder / "trial_parameters.csv")
    assert len(parameters) == 80 * len(laws.PAPER_LAWS)
    assert (parameters["mu_low"] <= parameters["mu_high"]).all()
    for name in FIGURES:
        assert (folder / "figures" / f"{name}.png").stat().st_size > 5000
        assert (folder / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    events = Events(str(folder)).Reload()
    assert {shown_as(f"figures/{name}") for name in FIGURES} <= set(events.Tags()["images"])
    logged = events.Scalars(shown_as("mass_error/irb"))
    assert logged[0].step == 20
    assert logged[0].value == pytest.approx(results["errors"]["irb"]["mass_error"]["mean"], rel=1e-6)
    assert len(list(folder.glob("events.*"))) == 1  # hyperparameters make no run of their own
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    assert lines[0]["trained_on"] == 20
    (logged,) = [one["mass_error/wang_mason"] for one in lines if "mass_error/wang_mason" in one]
    assert logged == pytest.approx(results["errors"]["wang_mason"]["mass_error"]["mean"], rel=1e-6)
    assert_progress(folder, "every trial")


def test_figures_are_of_the_best_law_and_in_the_order_of_the_errors(evaluation):
    _, folder, drawn = evaluation
    errors = json.loads((folder / "results.json").read_text())["errors"]
    ordered = sorted(laws.PAPER_LAWS, key=lambda law: errors[law]["mass_error"]["mean"])
    shown = [label.get_text().replace("\n", " ") for label in drawn["error_comparison"].axes[0].get_yticklabels()]
    assert [" ".join(one.split()) for one in shown[:6]] == [model_label(law) for law in ordered]
    for name in ("cost_surface", "convergence", "trial_parameters"):
        words = " ".join(text.get_text() for text in drawn[name].findobj(Text)).replace("\n", " ")
        assert model_label(ordered[0]) in words, name


def test_the_log_holds_what_was_printed(evaluation):
    printed, folder, _ = evaluation
    logged = (folder / "evaluate.log").read_text("utf-8")
    logged = re.sub(r"^\[.*?\]\[contactlearn\]\[INFO\] - ", "", logged, flags=re.MULTILINE)
    assert logged.split() == printed.split()
    files = [getattr(one, "baseFilename", "") for one in logging.getLogger("contactlearn").handlers]
    assert str(folder / "evaluate.log") not in files  # else it would log the output of later runs too


@pytest.fixture(scope="module")
def euclidean(tmp_path_factory):
    """A training and an evaluation in the paper's norm: by command what it printed, its result, figures and tags."""
    folder, found = tmp_path_factory.mktemp("euclidean"), {}
    learned = ("law=whittaker", "model=[x1_impulse]", "curves.sizes=[10,20]", "curves.seeds=1", "workers=1")
    for name, *words in (("train", *TRAIN, "law=whittaker"), ("evaluate", *SMALL[:5], "laws=[whittaker]", *learned)):
        with patch.object(record, "save", wraps=record.save) as saved:
            place = f"hydra.run.dir={folder / name}"
            printed = run(f"{name}.py", *words, "bounds.norm=euclidean", place)
        lines = (folder / name / "metrics.jsonl").read_text().splitlines()
        found[name] = (
            printed,
            json.loads((folder / name / "results.json").read_text()),
            {call.args[2]: call.args[0] for call in saved.call_args_list},
            {tag for line in lines for tag in json.loads(line)},
        )
    return found


def test_training_seeds_keep_the_held_out_trials():
    def split(*words):
        return loading.split(TrainSettings.from_config(hydra_main.compose("train", ["data.size=60", *words])))

    first, again, other, neither = (
        split(*words) for words in ((), ("seed=1",), ("split_seed=1",), ("seed=1", "split_seed=1"))
    )
    assert torch.equal(first.held_out, again.held_out)
    assert torch.equal(other.held_out, neither.held_out)
    assert not torch.equal(first.held_out, other.held_out)
    drawn = [torch.rand(9, generator=one.generator) for one in (first, again, other, neither)]
    assert torch.equal(drawn[0], drawn[2])
    assert not torch.equal(drawn[0], drawn[1])


def test_train_then_evaluate_agree(euclidean):
    """Both commands identify the same parameters from the same subsets, and have the same rigid bound."""
    (_, trained, *_), (_, evaluated, *_) = euclidean.values()
    assert trained["fits"] == evaluated["fits"]
    assert len({one["errors"]["irb"]["euclidean_error"]["mean"] for one in (trained, evaluated)}) == 1


@pytest.mark.parametrize("command", ["train", "evaluate"])
def test_the_headline_follows_the_norm(euclidean, command):
    """Bounds have no error, no tag and no line in a measure that they do not bound."""
    printed, result, _, tags = euclidean[command]
    assert re.search(r"^ *model +Euclidean error m/s and rad/s", printed, re.MULTILINE)
    assert "normalised" in printed
    mean = {model: entry["euclidean_error"]["mean"] for model, entry in result["errors"].items()}
    assert mean["irb"] <= mean["best_post_hoc"] <= mean["whittaker"]
    for bound in ("best_post_hoc", "irb"):
        entry = result["errors"][bound]
        assert [name for name in metrics.METRICS if entry[name]] == ["euclidean_error", "normalised_euclidean_error"]
    assert {"euclidean_error/model", "euclidean_error/irb", "mass_error/whittaker"} <= tags
    bounds = {tag for tag in tags if tag.endswith(("/irb", "/best_post_hoc", "/model"))}
    assert {tag for tag in bounds if "euclidean_error/" not in tag} <= {
        f"{share}/{name}" for share in ("outside_admissible", "back_spin") for name in ("irb", "best_post_hoc")
    }


def test_figures_with_bounds_are_in_a_measure_that_they_bound(euclidean):
    """Figure 3.5 in the paper's measure is among them."""
    _, result, figures, _ = euclidean["evaluate"]
    bounded = {metrics.METRICS[name].axis for name in metrics.bounded_metrics("euclidean")}
    drawn = set()
    for name, figure in figures.items():
        legends = [*figure.legends, *(legend for axes in figure.axes if (legend := axes.get_legend()))]
        words = [text.get_text() for legend in legends for text in legend.get_texts()]
        words += [text.get_text() for axes in figure.axes for text in axes.get_yticklabels()]
        if any("IRB" in word or "Best Post Hoc" in word for word in words):
            labels = {label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel())}
            assert labels & bounded, name
            drawn.add(name)
    ends = ("", "_normalised_euclidean_error")
    wanted = {f"{name}{end}" for name in ("error_comparison", "learning_curve", "error_densities") for end in ends}
    assert drawn == wanted | {"patch_curve"}
    assert result["learning_curves"]["x1_impulse"]["below"].keys() == set(metrics.bounded_metrics("euclidean"))


def test_training_without_further_words_learns(tmp_path):
    """What a law leaves, beside that law and the bounds; each model row and each bound has its errors."""
    run("train.py", *TRAIN[:-1], f"hydra.run.dir={tmp_path}")
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["model"] == results["learned"] == "residual_wrench"
    error = {name: one["mass_error"]["mean"] for name, one in results["errors"].items()}
    assert list(error) == ["wang_mason", "residual_wrench", "best_post_hoc", "irb"]
    assert error["irb"] < error["best_post_hoc"] < error["wang_mason"]
    assert checkpoint.load(tmp_path / "model.pt").residual is not None


def test_cost_surface_is_that_of_one_subset(monkeypatch):
    law, pool, box = laws.find("whittaker"), synthetic.load(size=60), Box()
    settings = IdentificationSettings(size=None, repetitions=1, target="momentum", mu=box.mu, eps=box.eps)
    draw, given = drawings.cost_map, []
    monkeypatch.setattr(drawings, "cost_map", lambda *values: given.extend(values) or draw(*values))
    drawn = draw_cost_surface(law, pool, 20, settings)
    subset = pool[sampled(torch.ones(60, dtype=torch.bool), 20)]
    assert given[2].equal(cost_surface(law, subset, *box.axes()))
    assert "20 trials" in drawn.axes[0].get_title()


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """One small evaluation with learning curves: (what it printed, its folder)."""
    folder = tmp_path_factory.mktemp("study")
    return run("evaluate.py", *SMALL[:5], *CURVES, "tables=csv", f"hydra.run.dir={folder}"), folder


def test_learning_curves(study):
    printed, folder = study
    assert "note: sizes 500 are skipped: the pool has only 60 trials" in printed
    assert re.search(r"^ *X1 → wrench .*%", printed, re.MULTILINE)
    assert len(re.findall(r"^Gaussian processes.*: exact; ", printed, re.MULTILINE)) == 1
    results = json.loads((folder / "results.json").read_text())
    curves = results["learning_curves"]
    assert set(curves) == {*laws.PAPER_LAWS, "best_post_hoc", "x1_wrench", "parameters_likelihood"}
    for model, curve in curves.items():
        assert curve["sizes"] == [10, 20]
        assert (curve["mass_error"], curve["euclidean_error"]).count(None) == (model == "best_post_hoc")
        for metric in metrics.METRICS:
            assert all(entry["low"] <= entry["mean"] <= entry["high"] for entry in curve[metric] or ())
        assert (curve["calibration"] is not None) == (model in ("x1_wrench", "parameters_likelihood"))
    # More trials help a model that knows nothing, and the law's own parameters beat it.
    error = {model: [entry["mean"] for entry in curve["mass_error"]] for model, curve in curves.items()}
    assert error["x1_wrench"][1] < error["x1_wrench"][0]
    assert error["parameters_likelihood"][0] < error["x1_wrench"][0]
    # Best Post Hoc is that of the laws as identified on as many trials, and what models are compared with there.
    for place, best in enumerate(error["best_post_hoc"]):
        assert best <= min(error[law][place] for law in laws.PAPER_LAWS)
    assert error["best_post_hoc"][0] != error["best_post_hoc"][1]
    assert re.search(r"^ *Best Post Hoc +0", printed.partition("learning curves:")[2], re.MULTILINE)
    frame = pd.read_csv(folder / "learning_curves.csv")
    assert len(frame) == 9 * 2 * 3
    means = frame.groupby(["model", "trained_on"])["mass_error"].mean()
    for model, curve in results["learning_curves"].items():
        for size, entry in zip(curve["sizes"], curve["mass_error"], strict=True):
            assert means[model, size] == pytest.approx(entry["mean"], rel=1e-9)
    events = Events(str(folder)).Reload()
    steps = [event.step for event in events.Scalars(shown_as("curve_mass_error/x1_wrench"))]
    assert list(dict.fromkeys(steps)) == [10, 20]
    for name in ("learning_curve", "error_densities", "calibration"):
        assert (folder / "figures" / f"{name}.pdf").exists()


def test_trained_model_predicts_the_same_from_its_checkpoint(tmp_path):
    """The errors in results.json are those of the saved model on the same held-out trials."""
    words = ("model=residual_wrench", "law=whittaker", f"hydra.run.dir={tmp_path}")
    printed = run("train.py", *TRAIN, *words, figures=True)
    assert_progress(tmp_path, "held-out trials")
    assert "Gaussian processes: length scales" in printed
    results = json.loads((tmp_path / "results.json").read_text())
    model = checkpoint.load(tmp_path / "model.pt")
    assert model.provenance == results["provenance"]
    assert model.provenance["config"]["train"]["size"] == 20
    drops = synthetic.load(size=80)
    assert drops.fingerprint() == results["provenance"]["data"]["sha256"]
    _, test = drops.split(0.25, torch.Generator().manual_seed(0))
    error = metrics.mass_error(test, model.predict(test)).mean().item()
    assert error == pytest.approx(results["errors"]["residual_wrench"]["mass_error"]["mean"], rel=1e-12)
    assert {entry["output"] for entry in results["processes"]} == {"P_t", "P_n", "τ"}
    for name in ("predicted_against_measured", "calibration", "training"):
        assert (tmp_path / "figures" / f"{name}.png").stat().st_size > 5000


def test_transfer(tmp_path):
    small = ("data.size=60", "train.size=30", "transfer.sizes=[4,8]", "transfer.seeds=2", "bootstrap=50", "workers=1")
    printed = run("evaluate.py", "experiment=transfer", *small, f"hydra.run.dir={tmp_path}")
    assert "X1 → wrench on other bodies" in printed
    results = json.loads((tmp_path / "results.json").read_text())
    for bodies in results["transfer"].values():
        for ways in bodies.values():
            assert [len(ways[way]) for way in ("zero_shot", "prior", "scratch")] == [1, 2, 2]
    assert (tmp_path / "figures" / "transfer_x1_wrench.png").exists()
    assert (tmp_path / "residual_wrench.pt").exists()


def test_export_of_a_feature_space(tmp_path):
    words = ("contactlearn", "export", "x1.parquet", "data.size=20", "--features")
    run(*words, "x1", cwd=tmp_path)
    wanted = Features.of(synthetic.load(size=20), "x1")
    assert pd.read_parquet(tmp_path / "x1.parquet").equals(wanted.table())
    assert "unknown feature space 'x3', did you mean 'x2'?" in run(*words, "x3", "--force", cwd=tmp_path, status=2)


def test_own_table_round_trip(tmp_path):
    """Export a source, evaluate the file: the same data gives the same parameters."""
    run("contactlearn", "export", str(tmp_path / "drops.csv"), "data.size=60", "data.seed=3")
    assert (table.load(tmp_path / "drops.csv").v_post == synthetic.load(size=60, seed=3).v_post).all()
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    small = ("train.size=20", "train.repetitions=4", "bootstrap=50", "law=mirtich", "model=analytical")
    run("train.py", "data=table", "data.path=drops.csv", shape, *small, "hydra.run.dir=a", cwd=tmp_path)
    run("train.py", "data.size=60", "data.seed=3", *small, "hydra.run.dir=b", cwd=tmp_path)
    a, b = (json.loads((tmp_path / name / "results.json").read_text()) for name in "ab")
    assert a["fits"] == b["fits"]


def test_every_effect_and_law_has_half_a_sentence():
    for group in ("effect", "law"):
        assert summaries(group).keys() == {*choices(group)}
        assert all(5 < len(text) < 120 for text in summaries(group).values())


def test_what_results_print_can_be_typed():
    """As `found.effects` print themselves, the form behind a colon."""
    cfg = hydra_main.compose("evaluate", ["effect=[spin_damping:during,side_drag]"])
    assert cfg.effect.spin_damping.form == "during"
    assert "side_drag" in cfg.effect


def test_a_law_with_effects_is_fitted_to_all_that_is_not_held_out(tmp_path):
    """As a diagnosis is, whose model `train model=RUN` judges; a number of trials is taken as it is."""
    words = ("data.size=60", "model=analytical", "effect=[side_drag]", "fit.starts=2", "bootstrap=50")
    printed = run("train.py", *words, f"hydra.run.dir={tmp_path / 'all'}")
    assert "law and effects are fitted to these 45, and judged on the others; diagnose fits to all\n" in printed
    assert json.loads((tmp_path / "all" / "results.json").read_text())["provenance"]["config"]["train"]["size"] == 45
    printed = run("train.py", *words, "train.size=20", f"hydra.run.dir={tmp_path / 'few'}")
    assert "diagnose fits" not in printed


@pytest.mark.parametrize("words", [("contactlearn", "--version"), ("contactlearn", "--help"), ("train.py", "--help")])
def test_an_output_that_cannot_be_written_is_an_error(words):
    command = ["-m", *words] if words[0] == "contactlearn" else [str(ROOT / words[0]), *words[1:]]
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, *command], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: the output cannot be written: No space left on device\n")


@pytest.mark.nightly
def test_a_report_that_cannot_be_written_is_an_error(tmp_path):
    """As a command's own output, after it has read its data."""
    table.save(synthetic.load(size=40), tmp_path / "drops.csv")
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    words = ["audit", "data=table", shape, f"data.path={tmp_path}/drops.csv"]
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "contactlearn", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


def test_published_table_beside_ours(ellipse_drops, tmp_path):
    """experiment=fazeli2017 composes, runs on the real drops, and prints every difference in σ."""
    small = (
        "train.repetitions=2", "figures.repetitions=1", "bootstrap=20", "laws=[whittaker,anitescu_potra_newton]",
        "model=[x2_impulse]", "curves.sizes=[5,10]", "curves.seeds=1", "workers=1",
    )  # fmt: skip
    printed = run("evaluate.py", "experiment=fazeli2017", *small, f"hydra.run.dir={tmp_path}")
    assert "Published table beside ours" in printed
    for value in (r"0\.111 ± 0\.008", r"0\.484 ± 0\.011"):  # in tables that fit 80 columns
        assert re.search(rf"Whittaker +.*{value}", printed)
    assert re.search(r"settled +published", printed)
    assert re.search(r"Whittaker .* 50 *$", printed, re.MULTILINE)
    assert re.search(r"X2 → impulse .* 100 *$", printed, re.MULTILINE)


@pytest.mark.parametrize("script", ["train.py", "evaluate.py"])
def test_help(script):
    printed = run_alone(script, "--help")
    assert "Examples" in printed
    assert "data=mydata" in printed
    assert "spin_damping: The body loses a part of its spin" in printed
    assert "threads: 1" not in printed
    assert "threads: 1" in run_alone(script, "--settings")


def test_every_command_has_a_summary():
    printed = run_alone("-m", "contactlearn", "--help")
    groups = re.findall(r"^([A-Z][\w ]+):\n((?:    .*\n)+)", printed, re.MULTILINE)
    described = [name for _, lines in groups for name in re.findall(r"^    (\w+) +\w", lines, re.MULTILINE)]
    assert sorted(described) == sorted(_parser()[1]), printed
    assert {title for title, _ in groups} >= {
        title for title in re.findall(r"^## (.*)", (ROOT / "docs" / "commands.md").read_text("utf-8"), re.MULTILINE)
        if title.startswith(("Which", "Bring", "Compare", "Use"))
    }  # fmt: skip


def test_help_fits_80_columns():
    """But for commands, which are copied whole; any other flag leaves it to Hydra."""
    ours = run("evaluate.py", "--help", "law=mirtich").splitlines()
    assert all(len(line) <= 80 for line in ours if not line.startswith("  python "))
    assert "Compare analytical" in run("evaluate.py", "--help", "law=mirtich", "--config-name=evaluate")


def test_an_installed_package_needs_no_checkout(tmp_path):
    """From the folders that the wheel takes, in a folder that holds nothing else."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    for source, target in ({name: name for name in wheel["packages"]} | wheel["force-include"]).items():
        shutil.copytree(ROOT / source, tmp_path / target)
    printed = run_alone("-m", "contactlearn", "train", "--help", cwd=tmp_path)
    assert "data=mydata" in printed
    where = run_alone("-c", "from contactlearn.cli import hydra_main; print(hydra_main.CONFIGS)", cwd=tmp_path)
    assert where.strip() == str(tmp_path / "contactlearn" / "configs")


def test_examples_of_the_help_can_be_copied(capsys):
    """Each stands on a line of its own, however narrow the terminal is; what is said above them is wrapped."""
    with pytest.raises(SystemExit):
        main(["plan", "--help"])
    printed = capsys.readouterr().out
    *above, first, second = printed.splitlines()
    assert first.startswith("  contactlearn plan data=mystery data.seed=7 'rig.height=[0.05,0.5]' 'rig.theta=")
    assert second == "  contactlearn plan outputs/diagnose/2026-01-31_12-00-00 after=plans/1 -o plans/2"
    assert above[-1] == "examples:"
    assert max(map(len, above)) <= 80


ERRORS = {
    "law": (["evaluate.py", "laws=[witaker]"], "unknown law 'witaker', did you mean 'whittaker'?"),
    "law of the model": (["train.py", "law=mirtisch"], "unknown law 'mirtisch', did you mean 'mirtich'?"),
    "law with a hyphen": (["train.py", "law=wang-mason"], "unknown law 'wang-mason', did you mean 'wang_mason'?"),
    "path of settings": (["diagnose.py", "data=/tmp/elsewhere.yaml"],
        "data=NAME takes a name and no path; it reads NAME.yaml of the folder in which the command runs: in the folder "
        "/tmp say data=elsewhere"),
    "path of a table": (["diagnose.py", "data=drops.csv"], "say data=table data.path=drops.csv, or write its settings"),
    "group": (["evaluate.py", "-m", "effect=[],[spin_dampin]"], "unknown effect 'spin_dampin', did you mean"),
    "variant": (["train.py", "variant=fazeli"], "did you mean 'fazeli2017'?"),
    "too few": (["train.py", "train.size=1000"], "train.size=1000, but 600 of 800 trials"),
    "one held out": (["train.py", "data.size=20", "train.size=10", "test=0.05"],
        "holds out 1 of 20 trials, and an error of a single trial has no interval; use test=0.1 or more"),
    "few to fit": (["train.py", "data.size=7", "test=0.5"],
        "test=0.5 leaves 3 of 7 trials, but 2 parameters need at least 5; use test=0.29 or less"),
    "one too few to fit": (["train.py", "data.size=8", "test=0.5"],
        "test=0.5 leaves 4 of 8 trials, but 2 parameters need at least 5; use test=0.38 or less"),
    "few in all": (["train.py", "data.size=6"],
        "at least 7 trials are needed, got 6: 5 for 2 parameters, and 2 held out"),
    "seed": (["train.py", "seed=9223372036854775808"],
        "seed must be a whole number from 0 to 9223372036854775807, got"),
    "test share": (["train.py", "test=1.5"], "share in (0, 1)"),
    "no path": (["train.py", "data=table"], "data.path must be given"),
    "no file": (["train.py", "data=table", "data.path=nowhere.csv"], "nowhere.csv: no such file"),
    "norm": (["evaluate.py", "bounds.norm=euclid"], "unknown bounds.norm 'euclid', did you mean 'euclidean'?"),
    "target": (["evaluate.py", "train.target=moment"], "did you mean 'momentum'?"),
    "tables": (["evaluate.py", "tables=xls"], "unknown tables 'xls'"),
    "trial": (["evaluate.py", "figures.trial=nobody"], "figures.trial=nobody is not among the 200 held-out trials"),
    "no laws": (["evaluate.py", "laws=[]"], "at least one law"),
    "size": (["train.py", "train.size=2.5"],
        "train.size must be a whole number, 1 or more, or null for as many as there are, got 2.5"),
    "resamples": (["train.py", "bootstrap=0"], "bootstrap must be a whole number"),
    "restitution": (["train.py", "train.eps=[0,1.5]"], "bounds of eps must end at 1 or below, got [0, 1.5]"),
    "threads": (["train.py", "threads=0"], "threads must be a whole number"),
    "one law": (["evaluate.py", "laws=whittaker"], "such as [whittaker], got 'whittaker'"),
    "patch": (["evaluate.py", "bounds.patch=-1"], "bounds.patch must be a positive half-width in m, got -1"),
    "settled": (["evaluate.py", "reference={x1_wrench: {settled: 0}}"], "reference.x1_wrench must hold"),
    "reference": (["evaluate.py", "reference={mirtich: {mu: [0.1, 0.1]}}"], "reference.mirtich must hold"),
    "bounds": (["train.py", "train.mu=[1,0]"], "train.mu must be [low, high] in order, such as [0, 1], got [1, 0]"),
    "features": (["train.py", "model=x1_impulse", "model.x1_impulse.features=x3"], "unknown feature space 'x3'"),
    "learned target": (["train.py", "model=x1_impulse", "model.x1_impulse.target=force"], "unknown target 'force'"),
    "model setting": (["train.py", "+model.mine.lengthscale=3"], "model.mine must hold features, target and law"),
    "two models": (["train.py", "model=[x1_impulse,x1_wrench]"], "one model is trained at a time"),
    "no law": (["evaluate.py", "model=parameters_identified", "model.parameters_identified.law=null"],
        "target parameters_identified needs a law"),
    "sizes": (["evaluate.py", "curves.sizes=[20,10]"], "curves.sizes must be an increasing list"),
    "no size": (["evaluate.py", *SMALL[:5], "model=x1_wrench", "curves.sizes=[90]"], "curves.sizes begin at 90"),
    "body": (["evaluate.py", "experiment=transfer", "+transfer.bodies.mine={path: a.csv}"],
        "transfer.bodies.mine.path is a setting of other choices (data=cube_tosses, data=table, data=tracks)"),
    "one trial": (["train.py", "model=x1_wrench", "train.size=1"], "at least 2 training trials, got 1"),
    "workers": (["evaluate.py", "workers=0"], "workers must be a whole number, 1 or more, or null"),
    "transfer": (["evaluate.py", "experiment=transfer", "model=[]"], "transfer needs a learned model and a body"),
    "foreign target": (["train.py", "data._target_=os.system"], "must be a source under contactlearn.data"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), ERRORS.values(), ids=ERRORS)
def test_errors_are_one_message(arguments, message, tmp_path, monkeypatch, capsys):
    script, *overrides = arguments
    monkeypatch.setattr(sys, "argv", [script, *overrides, f"hydra.run.dir={tmp_path}"])
    with pytest.raises(SystemExit, match=r"^2$"):
        getattr(hydra_main, script.removesuffix(".py"))()
    printed = capsys.readouterr()
    assert message in printed.err
    assert "Traceback" not in printed.err + printed.out


def test_outcomes_at_rest_are_refused(tmp_path, monkeypatch, capsys):
    """Relative errors have no meaning there; nothing infinite reaches results.json."""
    drops = synthetic.load(size=60)
    table.save(drops.replace(v_post=0 * drops.v_post), tmp_path / "rest.csv")
    overrides = ["data=table", f"data.path={tmp_path / 'rest.csv'}", "train.size=20", f"hydra.run.dir={tmp_path}"]
    monkeypatch.setattr(sys, "argv", ["train.py", *overrides])
    with pytest.raises(SystemExit, match=r"^2$"):
        hydra_main.train()
    assert "must not be at rest; trial" in capsys.readouterr().err


def test_one_repetition_has_no_spread(tmp_path):
    printed = run("train.py", *TRAIN[:2], "train.repetitions=1", "bootstrap=50", f"hydra.run.dir={tmp_path}")
    assert "nan" not in printed
    fit = json.loads((tmp_path / "results.json").read_text())["fits"][0]
    assert fit["mu_std"] is None
    assert fit["mu_range"][0] <= fit["mu"] <= fit["mu_range"][1]


def test_as_few_trials_as_are_needed_are_enough(tmp_path):
    """With the share that the refusal of another one gives."""
    run("train.py", "data.size=7", "test=0.29", "train.repetitions=1", "bootstrap=10", "model=analytical",
        f"hydra.run.dir={tmp_path}")  # fmt: skip
    assert (tmp_path / "results.json").exists()


def test_a_stopped_diagnosis_says_that_nothing_is_left(tmp_path, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("contactlearn.diagnosis.pipeline.diagnose", stop)
    told = run("diagnose.py", "data.size=40", cwd=tmp_path, status=130)
    assert told.endswith("stopped; no result was written, and nothing can be resumed\n")


def test_a_stopped_evaluation_resumes_after_its_finished_trainings(tmp_path, monkeypatch):
    words = ("model=x1_wrench", "curves.sizes=[10,20]", "curves.seeds=2", "laws=[whittaker]", "workers=1")
    command = ("evaluate.py", *SMALL[:5], *words)
    sizes, train, allowed, shown = [], curves._Training.run, 1, []

    def counted(self):
        if len(sizes) == allowed:
            (events,) = tmp_path.glob("outputs/*/*/events.*")
            shown.append(Events(str(events)).Reload())  # before the end of the run closes the file
            raise KeyboardInterrupt
        sizes.append(self.size)
        return train(self)

    monkeypatch.setattr(curves._Training, "run", counted)
    told = run(*command, cwd=tmp_path, status=130)
    assert told.endswith("stopped; the same command goes on after the parts that are finished\n")
    (finished,) = tmp_path.glob("outputs/*/.parts/*/*/*.npz")
    assert finished.stem == "10"
    curve = {"x1_wrench": [10], "best_post_hoc": [10, 20], "irb": [10, 20]}
    for name, points in curve.items():
        steps = [event.step for event in shown[0].Scalars(shown_as(f"curve_mass_error/{name}"))]
        assert list(dict.fromkeys(steps)) == points
    allowed = 2
    assert "earlier run of the same command: 1\n" in run(*command, cwd=tmp_path)
    assert sizes == [10, 20]
    assert not list(tmp_path.glob("outputs/*/.parts"))
    (done,) = tmp_path.glob("outputs/*/*/done.json")
    assert json.loads((done.parent / "results.json").read_text())["learning_curves"]["x1_wrench"]["sizes"] == [10, 20]


MISSPELT = {
    "setting": ("train.sise=50", "unknown setting 'train.sise', did you mean 'train.size'?"),
    "after a plus": ("+train.sise=50", "unknown setting 'train.sise', did you mean 'train.size'?"),
    "after two": ("++train.sise=50", "unknown setting 'train.sise', did you mean 'train.size'?"),
    "taken out": ("~train.sise", "unknown setting 'train.sise', did you mean 'train.size'?"),
    "of the top": ("+lawe=mirtich", "unknown setting 'lawe', did you mean 'law'?"),
    "without its part": ("+sise=50", "unknown setting 'sise'"),
    "of the data": ("data.sizes=3", "unknown setting 'data.sizes', did you mean 'data.size'?"),
    "of the data, after a plus": ("+data.sizes=3", "unknown setting 'data.sizes', did you mean 'data.size'?"),
    "of other data": (
        "data.path=a.csv", "data.path is a setting of other choices (data=cube_tosses, data=table, data=tracks)"
    ),
    "of another law": ("law.e_t=0.3", "law wang_mason has no option 'e_t'; law=chatterjee_ruina has it"),
    "a name with brackets": ("'+data.columns={vx: v (m)}'", 'stands in double quotes: {x: "x (mm)"}'),
    "effect": ("effect=[spin_dampin]", "unknown effect 'spin_dampin', did you mean 'spin_damping'?"),
    "effect, after a plus": ("+effect=[spin_dampin]", "unknown effect 'spin_dampin', did you mean 'spin_damping'?"),
    "experiment": ("experiment=fazeli", "unknown experiment 'fazeli', did you mean 'fazeli2017'?"),
    "experiment, after a plus": ("+experiment=fazeli", "unknown experiment 'fazeli', did you mean 'fazeli2017'?"),
    "setting of an effect": ("effect.spin_damping.c=1", "spin_damping is not chosen; add effect=[spin_damping]"),
    "setting of a misspelt effect": ("effect.spin_dampin.c=1",
        "no effect is called 'spin_dampin', did you mean 'spin_damping'?"),
    "setting of a chosen effect": ("effect=[spin_damping] effect.spin_damping.fom=during",
        "spin_damping has no setting 'fom', did you mean 'form'?"),
    "model's without its name": ("model.features=x2",
        "the settings of a model stand under its name, model.NAME.features="),
    "model's": ("model=x1_wrench model.x1_wrench.feature=x2", "did you mean 'features'?"),
    "model's module": ("model=x1_wrench model.x1_wrench.kernl._target_=a.B", "did you mean 'kernel'?"),
    "setting of a model": ("model=x1_wrench model.x2_impulse.features=x2",
        "x2_impulse is not chosen; add model=[x2_impulse]"),
    "launcher": ("hydra/launcher=basik", "no hydra/launcher 'basik' is installed, did you mean 'basic'?"),
}  # fmt: skip


@pytest.mark.parametrize(("word", "message", "several"), paired(MISSPELT, {"run": False, "sweep": True}))
def test_misspelt_settings_are_refused(word, message, several, tmp_path):
    """In one line, before anything runs, and without leaving a folder."""
    command = "evaluate.py" if "experiment" in word else "train.py"
    place = f"hydra.sweep.dir={tmp_path / 'a'}" if several else f"hydra.run.dir={tmp_path / 'a'}"
    printed = run(command, *["-m"] * several, *shlex.split(word), place, status=2)
    assert message in printed
    assert len(printed.splitlines()) == 1
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("word", ["data.sise=3", "+sise=3"])
def test_misspelt_settings_of_tools_are_refused(word, tmp_path):
    printed = run("contactlearn", "export", str(tmp_path / "a.csv"), word, status=2)
    assert printed.startswith(("error: unknown setting", "error: export only takes data=… and data.KEY=…, got +sise=3"))
    assert len(printed.splitlines()) == 1


@pytest.mark.parametrize(("command", "parts"), [
    ("train", ("train", "bounds")), ("evaluate", ("train", "bounds", "reference", "figures")), ("diagnose", ()),
])  # fmt: skip
def test_every_command_takes_the_experiment_of_the_paper(command, parts):
    """Without the parts that the command has no use for; those of a typed setting are refused as ever."""
    cfg = hydra_main.compose(command, ["experiment=fazeli2017"])
    assert (cfg.variant, cfg.data.inertia) == ("fazeli2017", "fazeli2017")
    assert {"train", "bounds", "reference", "figures"} & {*map(str, cfg)} == {*parts}
    with pytest.raises(ContactLearnError, match=r"unknown setting 'bounds\.patchy'|bounds.norm is a setting of"):
        hydra_main.compose(command, ["experiment=fazeli2017", "+bounds.patchy=3"])


def test_the_command_after_a_diagnosis_has_its_experiment(tmp_path):
    words = ("experiment=fazeli2017", "data.correct=[mirrored_x]")
    settings = DiagnoseSettings.from_config(hydra_main.compose("diagnose", [*words]))
    done = Run(command="diagnose", overrides=words, config={}, folder=tmp_path, partial=tmp_path)
    found = SimpleNamespace(corrections=(), law="mirtich", effects=(), missing=(), record=None)
    wanted = [*words, "law=mirtich", "effect=[]", "model=[]"]
    assert shlex.split(_evaluation_command(settings, done, found))[-5:] == wanted


@pytest.mark.parametrize("command", ["train", "evaluate", "diagnose"])
def test_a_command_takes_the_experiments_that_its_help_lists(command):
    listed = re.search(r"^experiment: (.*)", run(f"{command}.py", "--help"), re.MULTILINE)[1].split(", ")
    for name in choices("experiment"):
        if name in listed:
            hydra_main.compose(command, [f"experiment={name}"])
        else:
            assert f"{command}.py lacks; it takes fazeli2017" in run(f"{command}.py", f"experiment={name}", status=2)


@pytest.mark.parametrize(("text", "message"), [
    ("train:\n  sise: 30", "experiment=mine: unknown setting 'train.sise', did you mean 'train.size'?"),
    ("reference: 3\nwhole: 4", "experiment=mine: unknown setting 'whole'"),
    ("train: {size: 30}\n  x", "a configuration file is not YAML: "),
])  # fmt: skip
def test_an_experiment_with_a_mistake_is_one_line(text, message, tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text(f"# @package _global_\n{text}")
    logging.getLogger("contactlearn").handlers.clear()  # of a run in this process before
    printed = run("train.py", f"--config-dir={tmp_path}", "experiment=mine", cwd=tmp_path, status=2)
    assert message in printed
    assert len(printed.splitlines()) == 1
    assert not (tmp_path / "outputs").exists()
    handlers = logging.getLogger("contactlearn").handlers  # a file's would log the output of later runs too
    assert not any(isinstance(one, logging.FileHandler) for one in handlers)


@pytest.mark.parametrize("name", ["train", "evaluate", "diagnose"])
def test_every_shipped_setting_is_known(name):
    """Also those that experiments and entries of open parts bring."""
    extra = {"evaluate": ["experiment=transfer", "+transfer.bodies.mine={size: 3}", "+model.mine={features: x1}"]}
    own = ["+effect.mine.tau='-c*rx*Pn'", "data=table", "data.path=a.csv", "+law.mine=3", *extra.get(name, [])]
    check_names(hydra_main.compose(name, own), name, own)


@pytest.mark.parametrize(("words", "expected"), [
    (["resluts", "outputs"], "no command is called 'resluts', did you mean 'results'?"),
    (["whatever"], "no command is called 'whatever'; --help lists all"),
    (["workbench", "--prot", "3"], "unknown argument '--prot', did you mean '--port'?"),
    (["report", "outputs", "--uot", "a.html"], "unknown argument '--uot', did you mean '--out'?"),
])  # fmt: skip
def test_misspelt_commands_and_their_options(words, expected, capsys):
    with pytest.raises(SystemExit):
        main(words)
    assert expected in capsys.readouterr().err


def test_the_version_is_printed(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"contactlearn {contactlearn.__version__}\n"


@pytest.mark.parametrize(("spin", "status", "word"), [(1.0, 0, "note: "), (-1.0, 1, "wrong: ")])
def test_the_audit_ends_with_1_where_the_data_are_wrong(spin, status, word, tmp_path):
    drops = synthetic.load(size=60)
    turned = torch.tensor([1.0, 1.0, spin], dtype=torch.float64)
    drops = drops.replace(v_pre=drops.v_pre * turned, v_post=drops.v_post * turned, validate=False)
    table.save(drops, tmp_path / "drops.csv")
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    printed = run("contactlearn", "audit", "drops.csv", shape, cwd=tmp_path, status=status)
    assert word in printed
    assert ("wrong: " in printed) == (status == 1)


@pytest.mark.parametrize("words", [("audit", "data=synthetic"), ("export", "drops.csv")])
def test_settings_that_would_do_nothing_are_refused(words, tmp_path):
    printed = run("contactlearn", *words, "device=cuda", cwd=tmp_path, status=2)
    assert printed == f"error: {words[0]} only takes data=… and data.KEY=…, got device=cuda\n"
