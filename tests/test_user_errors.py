"""What a first hour meets: classes with a slip in them, two trials, a DataFrame, arrays, names in place of laws."""

import gc
import json
import re
import sys
from itertools import product

import numpy as np
import pandas as pd
import pytest
import torch
from commands import run

import contactlearn
from contactlearn import ContactModel, DiagnoseOptions, Recipe, diagnose, laws
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.events import track
from contactlearn.data import table
from contactlearn.data.recordings.track import Recording
from contactlearn.effects import find_effect, named_effects
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models.roll_out import Until
from contactlearn.report import events
from contactlearn.simulation import synthetic

SMALL = ("data.size=60", "train.size=20", "train.repetitions=2", "bootstrap=20", "model=analytical")
EFFECT = '''
from dataclasses import dataclass
from contactlearn.effects import Effect, parameter

{above}
class Mine(Effect):
    """Mine."""

    formula = "mine"
    k: float = parameter("k", "N m s", -0.001, 0.001)

    def wrench(self, state, wrench):
        return {returned}

    {more}
'''
DECORATED = "@dataclass(frozen=True, eq=False)"  # which a class may have
SLIPS = {
    "a method that fails": ("", "1 / 0", "", "fails in wrench, line 13: ZeroDivisionError: division by zero"),
    "a constructor that fails": (
        DECORATED, "wrench", 'def __post_init__(self): raise KeyError("a\\nb")', "in __post_init__, line 15: KeyError"
    ),
    "no formula": ("", "wrench", "del formula", "own.Mine must describe what it does, such as formula = "),
    "a name that is not there": ("@nobody", "wrench", "", "name 'nobody' is not defined); fix own first"),
    "another package": ("import nowhere", "wrench", "", "No module named 'nowhere'); fix own first"),
    "no syntax": ("def f(:", "wrench", "", "SyntaxError: invalid syntax"),
}  # fmt: skip


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Writes a module `own`, which is forgotten afterwards with its classes."""
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda text: (tmp_path / "own.py").write_text(text)
    sys.modules.pop("own", None)
    gc.collect()


@pytest.mark.parametrize(("above", "returned", "more", "message"), SLIPS.values(), ids=SLIPS)
def test_a_class_with_a_slip_is_one_line(above, returned, more, message, own, tmp_path):
    own(EFFECT.format(above=above, returned=returned, more=more))
    word = "+effect.mine._target_=own.Mine"
    printed = run("train.py", *SMALL, word, f"hydra.run.dir={tmp_path / 'run'}", status=2)
    assert message in printed
    assert len(printed.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_class_of_another_name_is_suggested(own, tmp_path):
    own(EFFECT.format(above=DECORATED, returned="wrench", more=""))
    printed = run("train.py", *SMALL, "+effect.mine._target_=own.Mime", f"hydra.run.dir={tmp_path / 'run'}", status=2)
    assert "own has no 'Mime', did you mean 'Mine'?" in printed
    assert len(printed.splitlines()) == 1


@pytest.mark.parametrize("command", ["train.py", "evaluate.py", "diagnose.py"])
def test_two_trials_are_too_few(command, tmp_path):
    table.save(synthetic.load(size=2), tmp_path / "two.csv")
    printed = run(command, "data=table", "data.path=two.csv", "hydra.run.dir=run", cwd=tmp_path, status=2)
    assert printed.splitlines()[-1].startswith("error: two.csv: ")
    assert "Traceback" not in printed


def test_sizes_follow_the_data(tmp_path):
    """Below 160 trials the paper's 120 for a subset are not there; a size that is asked for is not made smaller."""
    table.save(synthetic.load(size=40), tmp_path / "few.csv")
    words = ("train.py", "data=table", "data.path=few.csv", "train.repetitions=2", "bootstrap=20", "model=analytical")
    shape = "+data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    run(*words, shape, "hydra.run.dir=a", cwd=tmp_path)
    assert json.loads((tmp_path / "a" / "results.json").read_text())["trained_on"] == 24
    assert "use train.size=30 or less" in run(*words, "train.size=31", "hydra.run.dir=b", cwd=tmp_path, status=2)


def test_names_stand_for_laws_and_effects():
    drops = synthetic.load(size=60)
    by_name = joint.fit(drops, "mirtich", ["spin_damping"])
    by_hand = joint.fit(drops, laws.find("mirtich"), {"spin_damping": find_effect("spin_damping")()})
    assert str(by_name.model) == str(by_hand.model)
    as_effects = joint.fit(drops, "mirtich", [find_effect("spin_damping")()])
    assert str(by_name.model) == str(as_effects.model)
    with pytest.raises(ContactLearnError, match="effects are listed by name or as effects"):
        named_effects(find_effect("spin_damping")())
    (during,) = named_effects(["spin_damping:during"]).values()  # as results print it
    assert type(during) is find_effect("spin_damping", "during")
    (of_a_path,) = named_effects(["velocity_dependent_friction"], SPACE).values()  # others exist in the plane alone
    assert of_a_path.form == "viscous_path"
    only = [named_effects(["torsional_friction"], space)["torsional_friction"] for space in (PLANE, SPACE)]
    assert type(only[0]) is type(only[1])  # the plane refuses it by name
    assert fit_subsets(drops, "mirtich", sizes=(20,), repetitions=2).law.name == "mirtich"
    with pytest.raises(UnknownNameError, match="did you mean 'mirtich'"):
        diagnose(drops, "mirtisch")
    with pytest.raises(UnknownNameError, match="did you mean 'spin_damping'"):
        joint.fit(drops, "mirtich", ["spin_dampin"])
    for wrong in ("spin_damping", {"spin_damping": 0.1}, [3]):
        with pytest.raises(ContactLearnError):
            named_effects(wrong)
    with pytest.raises(ContactLearnError, match=r"such as laws.find\('mirtich'\).at\(0.2, 0.5\)"):
        ContactModel("mirtich")
    with pytest.raises(ContactLearnError, match="a model has effects by name with their values"):
        ContactModel(laws.find("mirtich").at(0.2, 0.5), effects=["spin_damping"])
    with pytest.raises(ContactLearnError, match="a recipe builds on a law"):
        Recipe("x1", "wrench", "mirtich")
    with pytest.raises(ContactLearnError, match="law must be a Law or its name"):
        joint.fit(synthetic.load(size=20), 3, [])
    # What an editor offers is there, without an import of its own.
    for room in ("data", "diagnosis", "inference", "mechanics", "models", "results", "simulation"):
        package = getattr(contactlearn, room)
        assert dir(package)
        for name in dir(package):
            assert getattr(package, name).__name__ == f"contactlearn.{room}.{name}"
    with pytest.raises(AttributeError, match="has no attribute 'mysteries'"):
        contactlearn.data.mysteries  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'laddr', did you mean 'ladder'\?; known: comparison, "):
        contactlearn.plot.laddr  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'diagnos', did you mean 'diagnose'\?; known: "):
        contactlearn.diagnos  # noqa: B018
    assert not hasattr(contactlearn.plot, "nonsense")


@pytest.mark.parametrize(
    ("impossible", "rule"),
    [
        pytest.param(lambda: laws.find("mirtich").at(-0.2, 0.5), "mu must be a finite number at least 0", id="μ"),
        pytest.param(lambda: laws.find("mirtich").at(0.2, 55), r"eps must be a finite number in \[0.0, 1.0\]", id="ε"),
        pytest.param(lambda: DiagnoseOptions(seconds=-5), "seconds must be a positive number", id="seconds"),
        pytest.param(lambda: Until(bounces=-3), "bounces must be a whole number of at least 0, got -3", id="bounces"),
        pytest.param(lambda: Until(time=-1.0), "time must be at least 0 s, got -1.0", id="time"),
    ],
)
def test_impossible_numbers_of_a_script(impossible, rule):
    with pytest.raises(ContactLearnError, match=rule):
        impossible()


@pytest.mark.nightly
def test_a_finished_sweep_shows_its_runs(tmp_path):
    words = ("-m", *SMALL[:1], *SMALL[2:], "train.size=10,20", f"hydra.sweep.dir={tmp_path}")
    first = run("train.py", *words)
    assert "Held-out errors of the sweep" in first
    assert re.search(r"train.size +mass error +95 %(.|\n)*\n *10 +0\.\d+ +0\.\d+–.*\n *20 +0\.\d+ ", first), first
    assert f"compare: contactlearn report {tmp_path}" in first
    assert "Held-out errors of the sweep" in run("train.py", *words)


def test_a_finished_sweep_names_the_laws_and_effects_in_which_it_differs(tmp_path):
    words = ("-m", *SMALL, "law=mirtich,whittaker", "effect=[],[spin_damping]", "fit.starts=2")
    table = run("train.py", *words, f"hydra.sweep.dir={tmp_path}").partition("Held-out errors of the sweep")[2]
    rows = [tuple(line.split()[:2]) for line in table.splitlines() if re.search(r"\d–\d", line)]
    assert re.search(r"law +effects +mass error", table)
    assert sorted(rows) == list(product(("mirtich", "whittaker"), ("none", "spin_damping:after")))


def test_ones_own_class_is_one_candidate_under_the_given_name(own, tmp_path):
    """An imported class is in the catalogue as well, which makes it no second candidate."""
    own(EFFECT.format(above=DECORATED, returned="wrench", more=""))
    words = ("data.size=24", "seconds=1", "+candidate.torque._target_=own.Mine", f"hydra.run.dir={tmp_path / 'run'}")
    assert "note: Tested, not selected: torque." in run("diagnose.py", *words)


def test_long_steps_are_named_where_no_bar_is_seen(capsys, monkeypatch):
    def steps():
        with events.progress() as on_event:
            assert list(track(range(3), "fitting mirtich", on_event)) == [0, 1, 2]
        return capsys.readouterr().out.split("\n")[:-1]

    assert "fitting mirtich …" not in steps()
    monkeypatch.setattr(events, "_LONG", -1.0)
    assert steps().count("fitting mirtich …") == 1


DROPS = synthetic.load(size=30)
LAW = laws.find("wang_mason").at(0.12, 0.55)


@pytest.mark.parametrize("use", [
    ContactModel(LAW).predict,
    lambda given: fit_subsets(given, LAW),
    lambda given: joint.fit(given, LAW),
    diagnose,
], ids=["predict", "fit_subsets", "fit", "diagnose"])  # fmt: skip
def test_non_impacts_are_refused_with_the_way_to_read_a_table(use):
    with pytest.raises(ContactLearnError, match=r"impacts must be Impacts, got DataFrame; .*Impacts\.from_frame\("):
        use(pd.DataFrame({"mass": [1.0]}))
    with pytest.raises(ContactLearnError, match=r"must be Impacts, got str; contactlearn\.read_table\('drops\.csv'"):
        use("drops.csv")


def test_impacts_are_made_of_columns_of_a_frame():
    names = {"r": ("rx", "ry"), "q": ("x", "y", "theta"), "v_pre": ("vx", "vy", "omega"), "v_post": ("a", "b", "c")}
    values = {name: getattr(DROPS, field)[:, k] for field, own in names.items() for k, name in enumerate(own)}
    frame = pd.DataFrame(values | {"mass": DROPS.mass, "inertia": DROPS.inertia})
    made = Impacts(frame["mass"], frame["inertia"], **{field: frame[[*own]] for field, own in names.items()})
    assert all(torch.equal(getattr(made, field), getattr(DROPS, field)) for field in ("mass", "inertia", *names))


def test_one_index_is_one_trial_and_a_loop_ends():
    assert DROPS[3].trial == ("4",)
    assert DROPS[-1].trial == ("30",)
    assert [one.trial[0] for one in DROPS] == list(DROPS.trial)
    with pytest.raises(IndexError):
        DROPS[30]
    with pytest.raises(ContactLearnError, match=r"such as torch\.Generator\(\)\.manual_seed\(0\), got 0"):
        DROPS.split(0.2, 0)
    assert len(DROPS.split(0.2, torch.Generator().manual_seed(0))[1]) == 6
    time = np.arange(300) / 240
    one = Recording(name="a", source="a.csv", time=time, position=np.zeros((300, 2)), angle=time)
    assert repr(one) == "Recording('a', 300 frames in 1.25 s, source='a.csv')"
    with pytest.raises(
        ContactLearnError, match=r"such as impacts\.W and impacts\.v_c, got Tensor \[30, 2, 2\] and .* \[30, 3\]"
    ):
        LAW.impulse(DROPS.W, DROPS.v_pre)
    with pytest.raises(ContactLearnError, match=r"must be tensors, .* got ndarray \[30, 2, 2\]"):
        LAW.impulse(DROPS.W.numpy(), DROPS.v_c.numpy())


def test_a_plugin_that_is_not_installed_is_named():
    printed = run("train.py", "-m", "hydra/sweeper=nevergrad", "seed=1,2", status=2)
    assert "no hydra/sweeper 'nevergrad' is installed; there are basic" in printed
    assert "pip install hydra-nevergrad-sweeper" in printed
