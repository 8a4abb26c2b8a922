"""The sets of a fourth hand are what they were, and answers are scored as they should be."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactlearn.diagnosis.result import Past
from contactlearn.effects.registry import catalogue

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from fourth_hand import judge, meanings, run, sets
from third_hand.judge import Said

MEANS = (
    20.3440, 19.8769, 15.1981, 12.6643, 14.8631, 22.6166, 13.5233, 24.5550,
    22.1416, 26.7565, 10.6619, 13.9986, 11.3464, 12.0014, 23.4820, 25.4491,
    22.4033, 9.8613, 10.6663, 11.7491, 18.2176, 13.9576, 14.3521, 8.0673,
    18.5362, 11.6019, 60.5166, 19.5293, 15.7620, 23.9614,
)  # fmt: skip
"""Of |v_x| + |v_y| + |ω| after impact, of the sets in order, from the files in which the author handed them over."""


@pytest.mark.parametrize(
    ("name", "trials", "first"),
    [
        ("26", 360, "body1,1,0.41,0.000345937,-0.0139742,-0.0427752,-0.0448821,0.0428752,-2.08656,-0.536727,"
         "-1.66431,1.87044,0.122055,0.633315,-2.84634"),
        ("27", 260, "body2,1,0.06,8.16e-05,0,-0.04,0.0327101,0.039967,0.194852,1.23779,-2.04658,89.3582,0.98236,"
         "1.43898,82.1806"),
    ],
)  # fmt: skip
def test_a_file_is_what_it_was(name, trials, first, tmp_path):
    sets.write(sets.draw(name), tmp_path / "set.csv")
    header, line, *rest = (tmp_path / "set.csv").read_text("utf-8").splitlines()
    assert header == "object,order,mass,inertia,rx,ry,x,y,theta,vx_pre,vy_pre,omega_pre,vx_post,vy_post,omega_post"
    body, *numbers = line.split(",")
    expected = first.split(",")
    assert (body, len(rest) + 1) == (expected[0], trials)
    assert [float(x) for x in numbers] == pytest.approx([float(x) for x in expected[1:]], rel=1e-4)


def test_every_set_is_what_it_was():
    columns = [sets.draw(name).columns for name in sets.SETS]
    assert [np.mean(sum(np.abs(one[after]) for after in sets.AFTER)) for one in columns] == pytest.approx(
        MEANS, abs=1e-4
    )


def test_every_hidden_effect_has_a_meaning():
    scenes = sets.SETS.values()
    assert {scene.known.what for scene in scenes if scene.known} == set(meanings.KNOWN)
    assert {name for names in meanings.KNOWN.values() for name in names} <= set(catalogue())
    assert {scene.unknown.what for scene in scenes if judge.along(scene)} == set(meanings.SEQUENCE)
    assert {told for right in meanings.SEQUENCE.values() for told in right.follows} <= set(Past)
    assert {run.kind(scene) for scene in scenes} == set(run.KINDS)


def test_scores_of_unknown_physics():
    told = {"coefficient": "eps", "follows": "period", "trials": 4.0, "share": 0.27, "words": "it changes"}
    right = Said(name="26", verdict="unknown", succession=told)
    assert judge.score(right) == judge.Score(unknown=True, sentence=True)
    for wrong in ({"coefficient": "mu"}, {"follows": "spin"}, {"trials": 8.0}):
        assert judge.score(replace(right, succession=told | wrong)) == judge.Score(unknown=True, sentence=False)
    assert judge.score(Said(name="26", verdict="none")) == judge.Score(unknown=False, sentence=False)
    assert judge.score(Said(name="24", verdict="none")) == judge.Score(unknown=False)


def test_scores_of_names_and_of_nothing():
    named = judge.score(Said(name="29", verdict="effects", effects=["contact_patch"]))
    assert (named.first, named.unknown, named.sentence) == (True, False, False)
    assert judge.score(Said(name="13", verdict="unknown", effects=["adhesion", "surface_tilt"])) == judge.Score(
        first=False, false_unknown=True
    )
    assert judge.score(Said(name="12", verdict="none")) == judge.Score(silent=True, false_unknown=False)
    assert judge.score(Said(name="14", verdict="none")) == judge.Score(first=False, false_unknown=False)


def test_the_tables_show_what_is_wrong():
    told = {
        "coefficient": "mu",
        "follows": "normal_impulse",
        "trials": 1.0,
        "share": 0.046,
        "words": "friction follows",
    }
    shown = run.tables([Said(name="10", verdict="none", succession=told), Said(name="12", verdict="none")])
    assert "| nothing | 1 |" in shown
    assert "friction follows, 4.6 % of the error | unknown said, first name |" in shown
    assert "| 12 |" not in shown
