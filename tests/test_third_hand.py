"""The sets of a third hand are what they were, from physics of their own, and answers are scored as they should be."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from contactlearn.effects.registry import catalogue

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from second_nature import path
from third_hand import judge, laws, meanings, nature, sets

MEANS = (
    27.9021, 27.9285, 19.5938, 37.1879, 21.8505, 33.3434, 39.1261, 35.0005,
    18.7306, 24.8766, 38.9685, 9.2999, 34.8554, 31.8947, 11.1796, 45.5192,
    19.6765, 32.0936, 35.8653, 23.5079, 21.8678, 12.9605, 9.7948, 37.4446,
    9.5194, 55.4710, 27.1316, 31.9117, 28.2300, 32.4083, 6.1757, 8.7142,
    36.3934, 37.2962, 33.7214, 29.7182, 61.6371, 54.3102, 31.4795, 35.6485,
    21.8665, 25.4422, 34.5314, 12.8112, 29.8169, 31.5218, 34.9827, 43.8864,
)  # fmt: skip
"""Of |v_x| + |v_y| + |ω| after impact, of the sets in order, from the files in which the author handed them over."""

NEEDS_MORE = ("judge.py", "run.py")


def test_the_generator_needs_numpy_alone():
    files = [one for one in Path(nature.__file__).parent.glob("*.py") if one.name not in NEEDS_MORE]
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text("utf-8")))]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) == {"numpy", "third_hand"}


def test_a_set_is_what_it_was(tmp_path):
    sets.write(sets.draw("06"), tmp_path / "06.csv")
    lines = (tmp_path / "06.csv").read_text("utf-8").splitlines()
    assert lines[0] == "object,vx,vy,omega,vx_post,vy_post,omega_post,x,y,theta,rx,ry,mass,inertia"
    name, *first = lines[1].split(",")
    assert (len(lines), name) == (61, "square")
    expected = [
        -0.051432,
        -1.77584,
        -0.565614,
        -0.58409,
        0.0762809,
        33.6756,
        -0.296359,
        0.0364935,
        -1.82017,
        0.0216682,
        -0.0364759,
        0.08,
        4.8e-05,
    ]
    assert [float(number) for number in first] == pytest.approx(expected, rel=1e-4)
    sets.write(sets.draw("06"), tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_text("utf-8").splitlines() == lines


@pytest.mark.parametrize(("name", "mean"), list(zip(sets.SETS, MEANS, strict=True)))
def test_every_set_is_what_it_was(name, mean):
    columns = sets.draw(name).columns
    speeds = sum(np.abs(columns[after]) for after in nature.AFTER)
    assert speeds.mean() == pytest.approx(mean, abs=1e-4)


@pytest.mark.parametrize("name", sets.SETS)
def test_no_set_breaks_physics(name):
    scene = sets.SETS[name]
    drops = nature.drawn(scene, scene.n, np.random.default_rng(1))
    record, state = nature.simulate(scene, nature.unbroken(scene, drops, scene.n), scene.effects)
    assert not nature.broken(state).any()
    assert np.isfinite([record[column] for column in nature.COLUMNS]).all()


@pytest.mark.parametrize(("law", "restitution"), [("wang-mason", path.POISSON), ("mirtich", path.STRONGE)])
def test_closed_laws_are_the_limit_of_fine_steps(law, restitution):
    """Two routes to one path, by two hands."""
    rng = np.random.default_rng(2)
    mass, r = rng.uniform(0.02, 0.2, 100), np.stack((rng.uniform(-0.02, 0.02, 100), -rng.uniform(0.02, 0.04, 100)), -1)
    v = np.stack((rng.normal(0, 1, 100), -rng.uniform(1, 3, 100), rng.normal(0, 15, 100)), -1)
    v[:, 1] -= r[:, 0] * v[:, 2]
    c = path.Contacts(mass, mass * 0.03**2, r, v, rng.uniform(0.05, 0.6, 100), rng.uniform(0, 1, 100))
    closed = laws.impulse(law, laws.inverse_mass(c.mass, c.inertia, *r.T), c.slip(v), c.approach(v), c.mu, c.eps)
    _, stepped = path.impact(c, restitution, steps=2000)
    assert np.abs(np.stack(closed, -1) - stepped).max() < 5e-3 * np.abs(stepped).max()


def test_every_hidden_effect_has_a_meaning():
    for scene in sets.SETS.values():
        table = meanings.CORRECTIONS if scene.kind == "measurement" else meanings.MEANINGS
        assert all((effect.what in table) == (scene.kind != "unknown") for effect in scene.effects)
    names = {name for accepted in (*meanings.MEANINGS.values(), *meanings.TWINS.values()) for name in accepted}
    assert names <= set(catalogue())
    assert {sets.SETS[name].kind for name in meanings.TWINS} == {"confounded"}


def said(name, effects=(), verdict="effects", rivals=(), **more):
    """An answer about the set of this number."""
    return judge.Said(name=name, verdict=verdict, effects=list(effects), rivals=list(rivals), **more)


def test_scores():
    pair = ["location_dependent_restitution", "com_offset"]
    right = judge.score(said("04", pair))
    assert (right.first, right.exact, right.inside, right.fault) == (True, True, True, True)
    many = judge.score(said("04", [*pair, "adhesion"], simpler=pair))
    assert (many.first, many.exact, many.inside) == (True, False, True)
    wrong = judge.score(said("04", ["adhesion"]))
    assert (wrong.first, wrong.exact, wrong.inside) == (False, False, False)
    assert not judge.score(said("04", verdict="none")).first


def test_scores_of_nothing_unknown_twins_and_faults():
    assert judge.score(said("06", verdict="none")).silent
    assert not judge.score(said("06", ["adhesion"])).silent
    assert judge.score(said("10", verdict="unknown")).unknown
    assert not judge.score(said("10", ["adhesion"])).unknown
    drift = judge.score(said("15", ["parameter_drift"], rivals=[["velocity_dependent_restitution"]]))
    assert (drift.first, drift.exact, drift.twins) == (True, True, True)
    assert not judge.score(said("15", ["parameter_drift"], rivals=[[]])).twins
    mirrored = judge.score(said("08", verdict="bad_data", corrections=["mirrored_omega"]))
    assert (mirrored.fault, mirrored.correction) == (True, True)
    assert not judge.score(said("31", verdict="bad_data", corrections=["inertia_scaled"])).correction
    assert not judge.score(said("33", ["adhesion"])).fault
