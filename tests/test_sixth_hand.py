"""The sets of a sixth hand are what they were, and answers are scored as they should be."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from contactlearn.diagnosis.result import Coefficient, Past
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.effects.registry import catalogue

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from fifth_hand.report import SUMS
from sixth_hand import judge, meanings, run, sets
from sixth_hand.impact import struck
from sixth_hand.laboratory import thrown
from third_hand.judge import Said

MEANS = (
    47.562187, 39.332742, 33.124843, 77.645276, 185.184080, 140.528847, 22.469463, 32.122790,
    33.616792, 58.599934, 24.726101, 40.246478, 200.027217, 35.844669, 42.933487, 41.301110,
    31.495005, 42.355894, 34.379174, 24.017449, 27.280272, 21.397864, 31.644108, 39.027620,
    33.147752, 32.986532, 27.824756, 67.545855, 48.345864, 50.151215, 128.501674, 32.844285,
    214.102224, 29.572092, 38.567206, 22.728576, 110.181218, 31.151833, 33.253968, 36.882995,
    98.807177, 39.721251, 54.459538, 63.482944, 48.889897, 24.394849, 34.342591, 107.795118,
    50.233186, 42.950339, 37.172104, 36.770666, 29.037339, 32.427561, 42.225562, 36.216693,
    150.025286, 32.326194, 42.112624, 30.185212, 42.938063, 124.038409, 32.084581, 29.206024,
)  # fmt: skip
"""Of the sum of the sizes of r, x, y, θ and the velocities before and after impact, of the sets in order, from the
files in which the author handed them over."""
TRIALS = (
    260, 700, 400, 80, 450, 100, 500, 800, 360, 900, 500, 400, 400, 250, 550, 500, 60, 350, 700, 150, 600, 1000,
    700, 900, 750, 450, 550, 300, 500, 200, 120, 800, 380, 400, 400, 800, 320, 500, 450, 300, 600, 300, 240, 400,
    600, 350, 700, 1000, 600, 1000, 350, 600, 500, 150, 650, 800, 420, 700, 280, 600, 600, 200, 1500, 450,
)  # fmt: skip
"""Of these files."""
HEADER = "object,trial,x,y,theta,vx_pre,vy_pre,omega_pre,vx_post,vy_post,omega_post,mass,inertia"


@pytest.mark.parametrize(
    ("name", "header", "first"),
    [
        ("01", f"{HEADER},rx,ry", "rubber ellipse,1,-0.14203,0.03777,1.13099,-1.54989,-2.89953,1.42222,-0.805573,"
         "1.79122,-23.5443,0.057,3.2433e-05,-0.009421,-0.037848"),
        ("12", HEADER, "box,1,0.05744,0.04617,1.06079,-0.4,-1.95,7.2,-0.48,0.96,8.8,0.092,6.52893e-05"),
    ],
)  # fmt: skip
def test_a_file_is_what_it_was(name, header, first, tmp_path):
    sets.write(sets.draw(name), tmp_path / "set.csv")
    lines = (tmp_path / "set.csv").read_text("utf-8").splitlines()
    (body, *numbers), (first_body, *expected) = lines[1].split(","), first.split(",")
    assert (lines[0], body, len(lines)) == (header, first_body, TRIALS[int(name) - 1] + 1)
    assert [len(one) for one in numbers] == [len(one) for one in expected]
    assert [float(x) for x in numbers] == pytest.approx([float(x) for x in expected], rel=1e-5, abs=1e-6)


def test_every_set_is_what_it_was():
    columns = [sets.draw(name).columns for name in sets.SETS]
    assert tuple(len(one["x"]) for one in columns) == TRIALS
    sizes = [sum(np.abs(one[name]) for name in one if name not in ("mass", "inertia")).mean() for one in columns]
    assert sizes == pytest.approx(MEANS, rel=1e-6)


def test_a_soft_contact_is_nearly_that_of_a_law():
    trials = thrown(sets.SETS["26"], np.random.default_rng(0))
    mu, eps = np.full(len(trials.x), 0.2), np.full(len(trials.x), 0.6)
    post, of_law = (struck(trials, law, mu, eps, []).post for law in ("soft", "mirtich"))
    scatter = np.std(of_law - trials.v, axis=0)
    assert np.all(np.sqrt(np.mean((post - of_law) ** 2, axis=0)) < 0.01 * scatter)


def test_the_generator_needs_numpy_alone():
    files = [one for one in Path(sets.__file__).parent.glob("*.py") if one.name not in ("judge.py", "run.py")]
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text("utf-8")))]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    hands = {"third_hand", "fourth_hand", "fifth_hand", "sixth_hand"}
    assert {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) == {"numpy", *hands}


def test_every_hidden_effect_has_a_meaning():
    hidden = judge.TRUTH.hidden
    unknown = {name for name, kind in sets.KIND.items() if SUMS.get(kind) == "all unknown"}
    assert sorted(one for name in unknown for one in hidden[name]) == sorted(meanings.UNKNOWN)
    assert set().union(*(hidden[name] for name in set(hidden) - unknown)) <= set(catalogue())
    for name in unknown:
        right = meanings.UNKNOWN[hidden[name][0]]
        assert right.coefficient in (*Coefficient, None)
        assert bool(right.follows) == (sets.KIND[name] == "unknown, along the sequence")
        assert set(right.variables) <= set(SYMBOLS)
        assert set(right.follows) <= set(Past)
    sizes = {kind: {scene.size > 0.5 for scene in scenes} for kind, scenes in sets.KINDS.items()}
    assert sizes == {kind: {kind != "nothing"} for kind in sets.KINDS}
    assert [len(scenes) for scenes in sets.KINDS.values()] == [16, 16, 10, 16, 6]


def test_scores_of_names():
    def ask(name, *effects, verdict="effects"):
        said = judge.TRUTH.score(Said(name=name, verdict=verdict, effects=list(effects)))
        return said.first, said.exact

    assert ask("13", "tangential_restitution", "side_drag") == (True, True)
    assert ask("13", "incidence_dependent_restitution", "side_drag") == (False, False)
    assert ask("47", "contact_patch", "body_dependent_restitution", "body_dependent_friction") == (True, True)
    assert ask("45", "com_offset", "velocity_dependent_restitution", verdict="bad_data") == (True, True)
    assert judge.TRUTH.score(Said(name="64", verdict="bad_data")) == judge.TRUTH.score(Said(name="64", verdict="none"))


def test_scores_of_unknown_physics():
    told = {"coefficient": "eps", "follows": "normal_speed", "trials": 1.0, "share": 0.09, "words": "it depends"}

    def ask(name, **changes):
        said = judge.TRUTH.score(Said(name=name, verdict="unknown", succession=told | changes))
        return said.sentence, said.both

    assert ask("63") == (True, None)  # a floor that swings is no coefficient of the law
    assert ask("63", follows="spin") == (False, None)
    assert ask("56", follows="period", trials=41.03) == (True, True)
    assert ask("56", follows="period", trials=20.5) == (True, False)
    assert ask("22", follows="place") == (True, True)
    assert ask("19", follows="place") == (True, False)
    state = {"coefficient": "mu", "variables": ["rx", "y"], "share": 0.1, "words": "it depends"}
    assert [
        judge.TRUTH.score(Said(name=name, verdict="unknown", modulation=state)).sentence for name in ("02", "25")
    ] == [True, False]


def test_the_tables_tell_false_names_with_those_that_were_left_out():
    beside = {"instead_of": [{"name": "shape_error", "form": None}, {"name": "adhesion", "form": "impulse"}]}
    remainder = {"components": [], "share": {"low": 0.0}, "modulation": beside}
    said = [
        Said(name="02", verdict="unknown", remainder=remainder),
        Said(name="46", verdict="unknown", effects=["contact_patch"], forms=["contact_patch"], confidence=[0.66]),
        Said(name="09", verdict="effects", effects=["spin_damping"], forms=["spin_damping"], confidence=[0.4]),
    ]
    shown = run.tables(said)
    assert "| as said | 1 | 1/2" in shown
    assert "| with those that only stand for something unknown | 3 | 0/2" in shown
    assert "| all with names | 1 |" in shown
