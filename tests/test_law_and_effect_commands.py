"""Laws and effects from the command line: options, forms, variants, sweeps, and one's own in several ways."""

import gc
import json
import os
import re
import sys

import pytest
import torch
from commands import ROOT, SMALL, TRAIN, run
from test_plugins import LAW

from contactlearn import laws
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import DiagnoseSettings, EvaluateSettings, TrainSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.effects import EffectId, find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.models import checkpoint
from contactlearn.simulation import synthetic

FAMILY = "contactlearn.effects.spin_damping.SpinDamping"
BOUNDS = ("best_post_hoc", "irb")
FORMULA = ('+effect.mine.tau="-c*I*omega_post"', "+effect.mine.parameters.c=[0,1]")


def trained(folder, *arguments, figures=False):
    """What a training printed and its results."""
    printed = run("train.py", *TRAIN, f"hydra.run.dir={folder}", *arguments, figures=figures)
    return printed, json.loads((folder / "results.json").read_text())


def test_training_fits_a_law_with_effects(tmp_path):
    printed, results = trained(tmp_path, "effect=[surface_tilt,spin_damping]", figures=True)
    name = "wang_mason + surface_tilt + spin_damping"
    assert list(results["errors"]) == ["wang_mason", name, *BOUNDS]
    found = results["joint"][name]
    assert [p["name"] for p in found["parameters"]] == ["mu", "eps", "surface_tilt.phi", "spin_damping.c"]
    tilt = found["parameters"][2]
    assert abs(tilt["value"]) < 5 * tilt["standard_error"]
    assert tilt["unit"] == "rad"
    assert f"+ surface_tilt: {find_effect('surface_tilt').formula}, φ = " in printed
    assert {path.stem for path in (tmp_path / "figures").glob("*.png")} == {
        "effect_surface_tilt",
        "effect_spin_damping",
        "predicted_against_measured",
    }
    model = checkpoint.load(tmp_path / "model.pt")
    assert str(model) == found["equation"]
    drops = synthetic.load(size=20, seed=3)
    assert model.predict(drops).v_post.isfinite().all()


@pytest.mark.parametrize("model", ["residual_wrench", "parameters_likelihood"])
def test_training_learns_what_a_law_with_effects_leaves(tmp_path, model):
    _, results = trained(tmp_path, f"model={model}", "effect=[gravity_impulse]", "law=mirtich")
    assert list(results["errors"]) == ["mirtich", "mirtich + gravity_impulse", f"{model} + gravity_impulse", *BOUNDS]
    loaded = checkpoint.load(tmp_path / "model.pt")
    assert "gravity_impulse" in str(loaded)


def test_evaluation_shows_effects_beside_the_laws(tmp_path):
    printed = run(
        *("evaluate.py", *SMALL, "effect=[side_drag]", "model=[residual_wrench]", "curves.sizes=[10,40]"),
        *("curves.seeds=2", "workers=1", f"hydra.run.dir={tmp_path}"),
    )
    results = json.loads((tmp_path / "results.json").read_text())
    assert {"wang_mason", "wang_mason (joint)", "wang_mason + side_drag", "irb"} <= results["errors"].keys()
    assert len(results["learning_curves"]["wang_mason + side_drag"]["mass_error"]) == 2
    assert (tmp_path / "figures" / "effect_side_drag.pdf").exists()
    joint = "(joint): the law fitted as it is with effects, to 60 trials at once; without (joint): the mean of"
    assert joint in printed
    assert joint in (tmp_path / "report.html").read_text()


@pytest.mark.nightly
def test_subsets_of_effects_are_swept(tmp_path):
    run("train.py", "-m", *TRAIN, "effect=[],[side_drag],[side_drag,spin_damping]", f"hydra.sweep.dir={tmp_path}")
    folders = [next(tmp_path.glob(f"effect={name}-*")) for name in ("none", "side_drag", "side_drag+spin_damping")]
    rows = [list(json.loads((folder / "results.json").read_text())["joint"]) for folder in folders]
    assert rows[0] == []
    assert rows[1][-1] == "wang_mason + side_drag"
    assert rows[2][-1] == "wang_mason + side_drag + spin_damping"


def test_a_line_of_mathematics_is_the_effect_that_it_spells(tmp_path):
    _, own = trained(tmp_path / "own", *FORMULA)
    _, known = trained(tmp_path / "known", "effect=[spin_damping]")
    values = [
        [p["value"] for p in results["joint"][f"wang_mason + {name}"]["parameters"]]
        for results, name in ((own, "mine"), (known, "spin_damping"))
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-6, abs=1e-9)
    model = checkpoint.load(tmp_path / "own" / "model.pt")
    assert "mine: τ ← τ + (-c*I*omega_post), c = " in str(model)


def test_a_class_user_candidates(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "examples")
    printed, results = trained(tmp_path, "+effect.cable._target_=cable_torque.CableTorque")
    assert "wang_mason + cable" in results["joint"]
    assert "cable: τ ← τ − k sin θ, k = " in printed
    assert "cable: τ ← τ − k sin θ, k = " in str(checkpoint.load(tmp_path / "model.pt"))
    sys.modules.pop("cable_torque")
    gc.collect()
    with pytest.raises(DataError, match="unknown effect 'cable_torque'"):
        checkpoint.load(tmp_path / "model.pt")  # its class is not imported any more


FORMS = {
    "the first": (["effect=[spin_damping]"], "after"),
    "another": (["effect=[spin_damping]", "effect.spin_damping.form=during"], "during"),
    "under a name of one's own": ([f"+effect.mine._target_={FAMILY}", "+effect.mine.form=during"], "during"),
    "of a family, none named": ([f"+effect.mine._target_={FAMILY}"], "after"),
    "by its class": ([f"+effect.mine._target_={FAMILY}During"], "during"),
}


@pytest.mark.parametrize(("arguments", "form"), FORMS.values(), ids=FORMS)
def test_a_form_is_a_setting(arguments, form):
    (effect,) = TrainSettings.from_config(compose("train", arguments)).effects.values()
    assert effect.id == EffectId("spin_damping", form)


REFUSED = {
    "no law": (["model=x1_wrench", "effect=[side_drag]"], "effects act around a law, and model x1_wrench has none"),
    "not an effect": (["+effect.mine._target_=os.system"], "must be a subclass"),
    "a class that is none": (["+effect.mine._target_=pathlib.Path"], "must be a subclass"),
    "not importable": (["+effect.mine._target_=no_such.Thing"], "cannot be imported"),
    "a fitted parameter": (["effect=[side_drag]", "+effect.side_drag.c=0.1"], "has no setting 'c' (it is fitted)"),
    "a form": (["effect=[spin_damping]", "effect.spin_damping.form=durring"],
        "effect.spin_damping: unknown form of spin_damping 'durring', did you mean 'during'?; "
        "known: after, quadratic, during, lasting"),
    "a form of a form": ([f"+effect.mine._target_={FAMILY}After", "+effect.mine.form=during"], "unknown form"),
    "a form of none": (["effect=[gravity_impulse]", "+effect.gravity_impulse.form=late"],
        "has no setting 'form'; it has: none"),
    "a formula": (['+effect.mine.tau="c*__import__"', "+effect.mine.parameters.c=[0,1]"], "^"),
    "identified": (["model=parameters_identified", "effect=[side_drag]"], "use model=parameters_likelihood"),
    "noise": (["fit.noise=[0.1,0.1]"], "three positive standard deviations"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_effect_is_refused(tmp_path, arguments, message):
    printed = run("train.py", *TRAIN, f"hydra.run.dir={tmp_path}", *arguments, status=2)
    assert message in printed
    assert "Traceback" not in printed


def test_a_checkpoint_keeps_leading_axes_and_constants(tmp_path):
    drops = synthetic.load(size=120)
    chosen = {name: find_effect(name)() for name in ("location_dependent_friction", "velocity_dependent_restitution")}
    rows = torch.arange(120).view(2, 60)
    model = joint.fit(drops, find("mirtich"), chosen, rows=rows).model
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    again = checkpoint.load(tmp_path / "model.pt")
    assert torch.equal(again.predict(drops).v_post, model.predict(drops).v_post)
    assert torch.equal(again.parameter_covariance, model.parameter_covariance)
    assert str(again) == str(model)


SETTINGS = {"train": TrainSettings, "evaluate": EvaluateSettings, "diagnose": DiagnoseSettings}
CHOSEN = ("law._target_=bumpy.BumpyFloor", "law.share=0.5")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A folder with a law on the path of the commands, which is forgotten afterwards."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "bumpy.py").write_text(LAW)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), str(ROOT))))
    yield folder
    sys.modules.pop("bumpy", None)
    gc.collect()
    assert "bumpy_floor" not in laws.names()


def results(folder, name="results.json"):
    return json.loads((folder / name).read_text())


@pytest.mark.nightly
def test_a_law_of_ones_own_takes_part_in_an_evaluation(package, tmp_path):
    curves = ("model=[residual_wrench]", "curves.sizes=[10]", "curves.seeds=2", "workers=1")
    printed = run("evaluate.py", *SMALL[:-1], *curves, *CHOSEN, "effect=[spin_damping]", "figures.surface=bumpy_floor",
                  "figures.parameters=bumpy_floor", f"hydra.run.dir={tmp_path / 'run'}")  # fmt: skip
    assert "bumpy_floor" in printed
    found = results(tmp_path / "run")
    (fit,) = (fit for fit in found["fits"] if fit["law"] == "bumpy_floor")
    assert fit["options"] == {"share": 0.5}
    assert {"bumpy_floor", "bumpy_floor + spin_damping"} <= found["errors"].keys()
    assert found["learning_curves"].keys() >= {"bumpy_floor", "residual_wrench"}
    assert "Bumpy floor" in (tmp_path / "run" / "report.html").read_text("utf-8")


@pytest.mark.nightly
def test_a_law_of_ones_own_takes_part_in_a_diagnosis(package, tmp_path):
    given = ("fit.noise=[0.01,0.01,0.5]", "+limits.v_y=[-3,-1]")
    printed = run("diagnose.py", "data.size=40", "seconds=1", *CHOSEN, *given, f"hydra.run.dir={tmp_path / 'run'}")
    assert "Bumpy floor" in printed
    found = results(tmp_path / "run", "diagnosis.json")
    assert found["diagnosis"]["law"] == "bumpy_floor"
    assert "Bumpy floor" in (tmp_path / "run" / "report.html").read_text("utf-8")
    assert all(word in found["use"] for word in (*CHOSEN, given[0]))


def test_a_trained_law_of_ones_own_comes_back(package, tmp_path):
    printed = run("train.py", *TRAIN, *CHOSEN, f"hydra.run.dir={tmp_path / 'run'}")
    assert "Bumpy floor" in printed
    model = checkpoint.load(tmp_path / "run" / "model.pt")
    assert model.base.share == 0.5


ERRORS = {
    "no law": ("train", ["law._target_=os.PathLike"], "_target_ must be a subclass of contactlearn.laws.Law"),
    "a function": ("train", ["law._target_=os.system"], "must be a subclass of contactlearn.laws.Law"),
    "the interface": ("train", ["law._target_=contactlearn.laws.Law"], "must be a subclass of contactlearn.laws.Law"),
    "nowhere": ("train", ["law._target_=nowhere.Law"], "is its package installed, or its folder on PYTHONPATH?"),
    "best": ("evaluate", ["law=best"], "only diagnose takes law=best"),
    "option": ("train", ["+law.e_t=0.3"], "law wang_mason has no option 'e_t'; law=chatterjee_ruina has it"),
    "range": ("train", ["law=chatterjee_ruina", "law.e_t=3"], "e_t must be a finite number in [-1, 1], got 3"),
    "variant": ("diagnose", ["variant=fazeli"], "did you mean 'fazeli2017'?"),
}


@pytest.mark.parametrize(("command", "words", "message"), ERRORS.values(), ids=ERRORS)
def test_what_is_no_law_is_refused(command, words, message):
    with pytest.raises(ContactLearnError, match=re.escape(message)):
        SETTINGS[command].from_config(compose(command, words))


def test_variants_and_options():
    """A name of the configuration's own file, and a law in full or by name, in any variant."""
    words = ["law=chatterjee_ruina", "law.e_t=0.3", "laws=[mirtich,wang_mason]", "variant=fazeli2017"]
    settings = EvaluateSettings.from_config(compose("evaluate", words))
    law, laws = settings.law, settings.laws
    assert (law.name, law.variant, law.options) == ("chatterjee_ruina", "textbook", {"e_t": 0.3})
    assert [(one.name, one.variant, one.options) for one in laws.values()] == [
        ("mirtich", "fazeli2017", {}),
        ("wang_mason", "textbook", {}),  # the authors computed the textbook's
        ("chatterjee_ruina", "textbook", {"e_t": 0.3}),
    ]
    train = TrainSettings.from_config(compose("train", ["law=mirtich", "variant=fazeli2017"]))
    assert type(train.law).__name__ == "MirtichFazeli2017"
    diagnosed = DiagnoseSettings.from_config(compose("diagnose", ["verbose=true"]))
    names = (*PAPER_LAWS, "wang_mason_newton", "chatterjee_ruina", "spring_dashpot")
    assert (diagnosed.law, [one.name for one in diagnosed.laws]) == (None, [*names])
    assert diagnosed.verbose
