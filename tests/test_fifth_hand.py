"""The sets of a fifth hand are what they were, and answers are scored as they should be."""

import ast
import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from contactlearn.diagnosis.result import Coefficient, Past, Remainder, VariableShare, WrenchComponent
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.effects.registry import catalogue
from contactlearn.inference.evaluation.metrics import Interval

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from fifth_hand import judge, meanings, report, sets
from third_hand.judge import Said

MEANS = (
    28.284297, 34.817200, 32.480300, 24.110948, 24.807567, 34.432948, 13.137234, 30.043949,
    27.960891, 27.662470, 29.939286, 33.172930, 22.193514, 28.799841, 31.486917, 33.355954,
    27.903811, 27.979578, 28.506068, 23.081280, 29.547404, 25.549124, 31.580412, 13.840391,
    37.124259, 29.178397, 47.155923, 43.637211, 25.948232, 21.468990, 33.953381, 25.149783,
    28.339903, 26.756931, 28.869535, 27.009206, 28.741555, 31.720889, 36.808847, 24.670539,
    29.627291, 30.502196, 24.129537, 30.894118, 36.519990, 31.100707, 26.799361, 33.908769,
    20.618959, 25.216622, 32.952606, 23.193259, 14.140914, 14.253172, 29.387247, 26.621534,
)  # fmt: skip
"""Of the sum of the sizes of r, x, y, θ and the velocities before and after impact, of the sets in order, from the
files in which the author handed them over."""
TRIALS = (
    600, 260, 1082, 260, 1000, 1100, 180, 110, 820, 360, 600, 900, 600, 500, 668, 693, 650, 388, 520, 182, 450, 320,
    75, 800, 520, 218, 483, 578, 800, 450, 140, 240, 340, 1300, 500, 420, 900, 1500, 467, 667, 501, 600, 420, 1000,
    788, 380, 900, 160, 380, 700, 1192, 644, 240, 360, 640, 300,
)  # fmt: skip
"""Of these files."""
NEEDS_MORE = ("judge.py", "report.py", "run.py")


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("23", "A,1,0.5,0.0008125,0.000000,-0.050000,0.020309,0.050675,2.252694,-0.29590,-1.51472,-31.01672,0.12955,"
         "0.83854,-17.31722"),
        ("53", "B,1,0.075,2.3438e-05,-0.000000,-0.025000,-0.051674,0.025105,-2.201497,-0.25000,-3.86000,4.10000,"
         "-0.19000,3.08000,7.50000"),
    ],
)  # fmt: skip
def test_a_file_is_what_it_was(name, first, tmp_path):
    sets.write(sets.draw(name), tmp_path / "set.csv")
    header, line, *rest = (tmp_path / "set.csv").read_text("utf-8").splitlines()
    assert header == "object,order,mass,inertia,rx,ry,x,y,theta,vx_pre,vy_pre,omega_pre,vx_post,vy_post,omega_post"
    (body, *numbers), (first_body, *expected) = line.split(","), first.split(",")
    assert (body, len(rest) + 1) == (first_body, TRIALS[int(name) - 1])
    assert [len(one) for one in numbers] == [len(one) for one in expected]
    assert [float(x) for x in numbers] == pytest.approx([float(x) for x in expected], rel=1e-5, abs=1e-6)


def test_every_set_is_what_it_was():
    columns = [sets.draw(name).columns for name in sets.SETS]
    assert tuple(len(one["x"]) for one in columns) == TRIALS
    sizes = [sum(np.abs(one[name]) for name in one if name not in ("mass", "inertia")).mean() for one in columns]
    assert sizes == pytest.approx(MEANS, abs=5e-6)


def test_the_generator_needs_numpy_alone():
    files = [one for one in Path(sets.__file__).parent.glob("*.py") if one.name not in NEEDS_MORE]
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text("utf-8")))]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    expected = {"numpy", "third_hand", "fourth_hand", "fifth_hand"}
    assert {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) == expected


def test_every_hidden_effect_has_a_meaning():
    hidden = {name: {one.what for one in scene.hidden} for name, scene in sets.SETS.items()}
    unknown = {name for name, kind in sets.KIND.items() if kind.startswith("unknown")}
    assert set().union(*(hidden[name] for name in unknown)) == set(meanings.UNKNOWN)
    known = set().union(*(hidden[name] for name in set(hidden) - unknown))
    acceptable = {one for name in hidden for one in judge.TRUTH.names(name)}
    assert known | acceptable <= set(catalogue())
    assert all(set(names) <= hidden[name] for name, names in meanings.ACCEPTABLE.items())
    for name in unknown:
        right = meanings.UNKNOWN[next(iter(hidden[name]))]
        assert right.coefficient in (*Coefficient, None)
        assert bool(right.follows) == (sets.KIND[name] == "unknown, along the sequence")
        assert set(right.variables) <= set(SYMBOLS)
        assert set(right.follows) <= set(Past)
    assert list(sets.KIND.values()).count("nothing") == 12
    assert {kind for kind in sets.KINDS if kind not in report.SUMS} == {"nothing"}


def remainder(*symbols, low=0.02):
    """A residual that depends on these, the first the most, as it is read from a file."""
    found = Remainder(
        share=Interval(0.1, low, 0.2),
        large=False,
        components=(WrenchComponent.NORMAL,),
        variables=tuple(VariableShare(symbol=symbol, share=1 / (1 + k)) for k, symbol in enumerate(symbols)),
        tested=(),
    )
    return json.loads(json.dumps(asdict(found)))


def test_scores_of_nothing():
    assert judge.TRUTH.score(Said(name="08", verdict="none")) == judge.Score(silent=True, false_unknown=False)
    assert judge.TRUTH.score(Said(name="08", verdict="unknown")) == judge.Score(silent=False, false_unknown=True)
    assert not judge.TRUTH.score(Said(name="08", verdict="effects", effects=["adhesion"])).silent


def test_scores_of_names():
    def ask(name, *effects, **more):
        said = judge.TRUTH.score(Said(name=name, verdict="effects", effects=list(effects), **more))
        return said.first, said.exact, said.inside

    assert ask("02", "configuration_dependent_restitution") == (True, True, True)
    assert ask("02", "orientation_dependent_restitution") == (True, True, True)
    assert ask("53", "orientation_dependent_restitution") == (False, False, False)
    assert ask("51", "parameter_drift", "sampling_delay", "gravity_impulse") == (True, True, True)
    assert ask("51", "adhesion", "gravity_impulse", "sampling_delay") == (True, False, False)
    pair = ["com_offset", "velocity_dependent_restitution"]
    assert ask("13", *pair, "adhesion", simpler=pair) == (True, False, True)
    assert ask("13") == (False, False, False)
    assert judge.TRUTH.score(Said(name="13", verdict="unknown", effects=pair)).false_unknown


def test_scores_of_unknown_physics_of_the_state():
    right = Said(name="43", verdict="unknown", remainder=remainder("vx", "theta"))
    assert judge.TRUTH.score(right) == judge.Score(unknown=True, accepted=True, sentence=True)
    for wrong in (None, remainder("vx", "x", "theta"), remainder("theta", low=-0.01)):
        assert not judge.TRUTH.score(replace(right, remainder=wrong)).sentence
    named = replace(right, verdict="effects", effects=["orientation_dependent_restitution"])
    assert judge.TRUTH.score(named) == judge.Score(unknown=False, accepted=True, sentence=True)
    assert not judge.TRUTH.score(replace(named, effects=[*named.effects, "adhesion"])).accepted
    assert not judge.TRUTH.score(Said(name="43", verdict="none")).accepted
    told = {"coefficient": "eps", "follows": "order", "trials": 4.0, "share": 0.27, "words": "it changes"}
    assert not judge.TRUTH.score(Said(name="43", verdict="unknown", succession=told)).sentence


def test_scores_of_unknown_physics_along_the_sequence():
    told = {"coefficient": "mu", "follows": "period", "trials": 46.0, "share": 0.27, "words": "it changes"}

    def ask(**changes):
        said = judge.TRUTH.score(Said(name="55", verdict="none", succession=told | changes))
        return said.sentence, said.both

    assert ask() == (True, True)
    assert ask(coefficient="eps") == (True, False)
    assert ask(trials=94.0) == (True, False)
    assert ask(coefficient="eps", follows="spin") == (False, False)
    by_order = judge.TRUTH.score(Said(name="55", verdict="none", remainder=remainder("order")))
    assert by_order == judge.Score(unknown=False, accepted=False, sentence=True, both=False)


def test_the_tables_show_what_is_wrong():
    told = {"coefficient": "eps", "follows": "spin", "trials": 1.0, "share": 0.046, "words": "it follows"}
    said = [
        Said(name="55", verdict="none", succession=told, remainder=remainder("vt", "x")),
        Said(name="08", verdict="none"),
        Said(name="53", verdict="effects", effects=["adhesion"], forms=["adhesion"], confidence=[0.93]),
        Said(name="43", verdict="effects", effects=["adhesion"], forms=["adhesion"], confidence=[0.81]),
    ]
    shown = report.Report(sets, judge.TRUTH).tables(said)
    assert "| nothing | 1 | 1/1" in shown
    assert "| all unknown | 2 |" in shown
    assert "| 0.9–1.0 | 0.930 | 1/1" in shown
    assert "| 0.8–0.9 | 0.810 | 0/1" in shown
    assert "| depends on vt, x; it follows, 4.6 % of the error | unknown said, " in shown
    assert "| 08 |" not in shown
    assert "| 53 |" not in shown
