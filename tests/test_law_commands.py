"""Laws from the command line: options, variants, one of one's own in every command, and one announced by a package."""

import gc
import json
import os
import re
import sys

import pytest
from commands import ROOT, SMALL, TRAIN, run
from test_plugins import LAW

from contactlearn import laws
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import DiagnoseSettings, EvaluateSettings, TrainSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.laws import PAPER_LAWS
from contactlearn.models import checkpoint

SETTINGS = {"train": TrainSettings, "evaluate": EvaluateSettings, "diagnose": DiagnoseSettings}
CHOSEN = ("law._target_=bumpy.BumpyFloor", "+law.share=0.5")


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
    assert "bumpy_floor" in printed
    model, _ = checkpoint.load(tmp_path / "run" / "model.pt")
    assert model.base.share == 0.5


ERRORS = {
    "no law": ("train", ["law._target_=os.PathLike"], "_target_ must be a subclass of contactlearn.laws.Law"),
    "a function": ("train", ["law._target_=os.system"], "must be a subclass of contactlearn.laws.Law"),
    "the interface": ("train", ["law._target_=contactlearn.laws.Law"], "must be a subclass of contactlearn.laws.Law"),
    "nowhere": ("train", ["law._target_=nowhere.Law"], "is its package installed, or its folder on PYTHONPATH?"),
    "best": ("evaluate", ["law=best"], "only diagnose.py takes law=best"),
    "option": ("train", ["+law.e_t=0.3"], "unknown option of law wang_mason 'e_t'"),
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
    diagnosed = DiagnoseSettings.from_config(compose("diagnose", ["--verbose"]))
    names = (*PAPER_LAWS, "wang_mason_newton", "spring_dashpot")
    assert (diagnosed.law, [one.name for one in diagnosed.laws]) == (None, [*names])
    assert diagnosed.verbose
