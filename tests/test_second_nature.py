"""The benchmark's own physics is physics, its sets are what they say, and its scores count what they should."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from second_nature import bodies, compliant, engines, judge, nature, noise, path, planted, published, sets, tables
from second_nature.compliant import Compliance
from second_nature.nature import Scene, free, happen
from second_nature.share import law_error
from second_nature.truth import Asked

N = 400


def contacts(seed=0, n=N, r_x=0.02, mu=(0.05, 0.6)) -> path.Contacts:
    """Random contacts that approach."""
    rng = np.random.default_rng(seed)
    mass, r = rng.uniform(0.02, 0.2, n), np.stack((rng.uniform(-r_x, r_x, n), -rng.uniform(0.02, 0.04, n)), -1)
    v = np.stack((rng.normal(0, 1, n), -rng.uniform(1, 3, n), rng.normal(0, 15, n)), -1)
    v[:, 1] -= r[:, 0] * v[:, 2]
    return path.Contacts(mass, mass * 0.03**2, r, v, rng.uniform(*mu, n), rng.uniform(0, 1, n))


def energy(c, v):
    """Kinetic energy [n]."""
    return (c.mass * (v[:, :2] ** 2).sum(1) + c.inertia * v[:, 2] ** 2) / 2


# --- Impact ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [path.NEWTON, path.POISSON, path.STRONGE])
def test_the_path_obeys_mechanics(restitution):
    c = contacts()
    v, P = path.impact(c, restitution)
    change = np.stack((P[:, 0] / c.mass, P[:, 1] / c.mass, (c.r[:, 0] * P[:, 1] - c.r[:, 1] * P[:, 0]) / c.inertia), -1)
    assert np.isfinite(v).all()
    np.testing.assert_allclose(v - c.v, change, atol=1e-9)
    assert (np.abs(P[:, 0]) <= c.mu * P[:, 1] * (1 + 1e-9)).all()
    assert (c.approach(v) >= -1e-3).all()
    if restitution != path.NEWTON:  # Newton's may add energy where the slip reverses (Kane and Levinson)
        assert (energy(c, v) <= energy(c, c.v) * (1 + 1e-3)).all()


@pytest.mark.parametrize("restitution", [path.NEWTON, path.POISSON, path.STRONGE])
def test_without_coupling_the_path_has_a_closed_form(restitution):
    """W_tn = 0: P_n = −(1 + ε) v_n / W_nn, and friction stops the slip or slides all along."""
    c = contacts(1, r_x=0.0)
    _, P = path.impact(c, restitution)
    w_tt, _, w_nn = c.W
    P_n = -(1 + c.eps) * c.approach(c.v) / w_nn
    P_t = np.clip(-c.slip(c.v) / w_tt, -c.mu * P_n, c.mu * P_n)
    np.testing.assert_allclose(P, np.stack((P_t, P_n), -1), rtol=1e-4, atol=1e-7)


def test_the_path_converges():
    """Halving the steps halves the distance to the limit."""
    c = contacts(2)
    v = [path.impact(c, path.STRONGE, steps=k).v for k in (60, 120, 1920)]
    coarse, fine = (np.abs(one - v[2]).mean() for one in v[:2])
    assert fine < 0.6 * coarse
    assert fine < 2e-3


@pytest.mark.parametrize(
    "solve", [lambda c: path.impact(c, path.POISSON).v, lambda c: compliant.impact(c, Compliance()).v]
)
def test_a_mirror_changes_signs_only(solve):
    c = contacts(3, n=60)
    flip = np.array([-1.0, 1.0, -1.0])
    mirrored = replace(c, r=c.r * [-1, 1], v=c.v * flip)
    np.testing.assert_allclose(solve(mirrored), solve(c) * flip, atol=1e-9)


def test_the_compliant_contact_without_coupling_is_rigid_friction():
    c = replace(contacts(4, n=60, r_x=0.0), eps=np.full(60, 0.999))
    v, P = compliant.impact(c, Compliance(), steps=3000)
    np.testing.assert_allclose(v, path.impact(c, path.NEWTON).v, atol=0.01, rtol=0.01)
    assert (np.abs(P[:, 0]) <= c.mu * P[:, 1] * (1 + 1e-9)).all()


@pytest.mark.parametrize("compliance", [Compliance(tangential=1.1), Compliance(hunt=0.4), Compliance(pull=300)])
def test_the_compliant_contact_makes_no_energy(compliance):
    c = contacts(5, n=100)
    v = compliant.impact(c, compliance, steps=2000).v
    parted = np.isfinite(v).all(1)  # adhesion may hold a slow one
    assert parted.mean() > 0.8
    assert (energy(c, v) <= energy(c, c.v) * (1 + 2e-3))[parted].all()


def test_a_tangential_spring_spins_back():
    """A superball: with enough friction and the spring, the slip reverses; Maw, Barber and Fawcett 1976."""
    c = replace(contacts(6, n=50, r_x=0.0), mu=np.full(50, 5.0), eps=np.full(50, 0.9))
    outcomes = compliant.impact(c, Compliance(tangential=1.0)), path.impact(c, path.POISSON, path.Extras(rebound=0.6))
    back = [-c.slip(outcome.v) / c.slip(c.v) for outcome in outcomes]
    assert (back[0] > 0.5).all()
    np.testing.assert_allclose(back[1], 0.6, atol=0.02)


# --- Bodies ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", bodies.KINDS)
def test_contact_points_are_those_of_the_declared_shape(kind):
    from contactlearn.mechanics.shapes import contact_point

    rng = np.random.default_rng(7)
    body, theta = bodies.draw(kind, rng), rng.uniform(-np.pi, np.pi, 200)
    theta = theta[body.margin(theta) > 0.01]
    assert len(theta) > 150
    np.testing.assert_allclose(body.contact(theta), contact_point(body.shape, torch.as_tensor(theta)), atol=1e-9)
    assert kind == "disc" or body.shape.gyration_squared() == pytest.approx(body.rho2)
    round_ = replace(body, corner=0.3 * body.a)
    assert kind in ("disc", "ellipse") or (np.hypot(*round_.contact(theta).T) < np.hypot(*body.contact(theta).T)).all()


# --- Noise and share ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", noise.KINDS + noise.TRACKERS)
def test_noise_has_the_level_that_it_says(kind):
    rng = np.random.default_rng(8)
    velocities, rho = rng.normal(0, 1, (4000, 2, 3)) * [1, 1, 40], np.full(4000, 0.025)
    error = noise.errors(kind, 0.03, velocities, rho, rng)
    rms = np.sqrt((error**2).mean(0))
    np.testing.assert_allclose(
        rms, np.broadcast_to([0.03, 0.03, 1.2], (2, 3)), rtol=0.35 if kind in ("tracker", "heavy") else 0.1
    )
    follows = np.corrcoef(error[1:, 0, 0], error[:-1, 0, 0])[0, 1]
    assert (follows > 0.8) == (kind in noise.TRACKERS)


def test_the_law_finds_its_own_parameters_again():
    scene = Scene(bodies.draw("ellipse", np.random.default_rng(9)), 0.2, 0.6, path.STRONGE)
    drops = free(np.random.default_rng(10), 200, scene.body)
    record = happen(scene, drops, np.zeros((200, 2)))
    error, (mu, eps) = law_error(record.rows(record.valid), path.STRONGE)
    assert error < 0.005
    assert (mu, eps) == (pytest.approx(0.2, abs=0.005), pytest.approx(0.6, abs=0.005))


def test_a_share_is_about_what_was_wanted():
    made = next(one for one in sets.SETS if one.name == "single-1000").draw(150).truth
    assert 0.35 < made.share < 0.65
    assert made.shares == (made.share,)


# --- Sets --------------------------------------------------------------------------------------------


@pytest.fixture
def hasty(monkeypatch):
    """Sets are drawn in few steps, and without measuring what share the effects have."""
    monkeypatch.setattr(nature, "STEPS", 24)
    monkeypatch.setattr(engines, "law_error", lambda *_: (1.0, None))
    monkeypatch.setattr(planted, "level_for", lambda *_: 0.03)
    monkeypatch.setattr(planted, "shares", lambda scene, *_: (0.5, (0.5,) * len(scene.effects)))

    def balanced(names, rng, forms=planted.FORMS):
        return planted.scene_for(planted._chosen(names, rng, forms), rng)

    monkeypatch.setattr(sets, "balanced", balanced)


ENGINES = ("mujoco", "pymunk")
MEASURED = ("published", "table_tennis")


def test_names_are_unique_and_each_group_has_both_halves_but_for_the_other_hands():
    assert len({one.name for one in sets.SETS}) == len({one.seed for one in sets.SETS}) == len(sets.SETS)
    halves = {one.group: set() for one in sets.SETS}
    for one in sets.SETS:
        halves[one.group].add(one.half)
    for group, found in halves.items():
        assert found == ({"report"} if group.startswith("other_") else {"learn", "report"}), group


@pytest.mark.usefixtures("hasty")
def test_every_set_can_be_drawn():
    for one in sets.SETS:
        if one.group in MEASURED or one.group in ENGINES:
            continue
        made = one.draw(24)
        assert len(made.impacts) == 24
        assert made.impacts.source == "measurements"
        assert set(made.impacts.object) <= {"body", "A", "B", "C", "D"}


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("group", ["single", "pair", "none", "by_body", "unknown", "twin"])
def test_a_set_follows_from_its_seed(group):
    one, other = [each for each in sets.SETS if each.group == group][:2]
    prints = [each.draw(20).impacts.fingerprint() for each in (one, one, other)]
    assert prints[0] == prints[1] != prints[2]


@pytest.mark.parametrize("kind", ["disc", "ellipse"])
def test_plain_contacts_of_mujoco_are_nearly_a_law(kind):
    """A third of the noise of the sets, so that the difference of the engine makes a twentieth of the error."""
    from second_nature import mujoco_drops

    body = bodies.draw(kind, np.random.default_rng(11))
    drops = free(np.random.default_rng(12), 60, body)
    record = mujoco_drops.simulate(body, 0.07 if kind == "disc" else 0.02, 0.6, drops)
    assert record.valid.mean() > 0.8
    plain = law_error(record.rows(record.valid), path.STRONGE)[0]
    noisy = nature.measured(record, "gaussian", 0.05, np.random.default_rng(13))
    assert plain < 0.33 * law_error(noisy.rows(noisy.valid), path.STRONGE)[0]


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("group", ENGINES)
def test_engines_can_be_drawn(group):
    pytest.importorskip(group)
    for one in sets.SETS:
        if one.group == group:
            assert len(one.draw(12).impacts) == 12


def test_an_effect_on_measured_drops_changes_their_outcome_alone(ellipse_drops, monkeypatch):
    monkeypatch.setattr(published, "load", lambda **_: ellipse_drops)
    published.mirrored.cache_clear()
    plain, dragged = (
        published.planted_on_drops(effect, np.random.default_rng(3), 60).impacts
        for effect in (None, published.ON_DROPS[0](np.random.default_rng(0)))
    )
    published.mirrored.cache_clear()
    assert torch.equal(plain.v_pre, dragged.v_pre)
    speeds = [one.v_post[:, :2].norm(dim=1).mean() for one in (plain, dragged)]
    assert 0.7 < speeds[1] / speeds[0] < 0.85  # a quarter at speed
    assert plain.wrench[:, 2].abs().mean() < 0.5 * ellipse_drops.wrench[:, 2].abs().mean()  # mirrored: momentum closes


# --- Scores ------------------------------------------------------------------------------------------


def said(effects, asked=Asked.EXACT, **changes) -> judge.Said:
    """An answer with these names, to a truth with changes."""
    truth = {"asked": asked, "effects": (), "share": 0.5} | changes.pop("truth", {})
    blank = {name: value for name, value in judge._NOTHING.items()}
    known = {"name": "x", "group": "g", "half": "learn", "n": 300, "truth": truth, "seconds": 1.0, "error": ""}
    named = {"effects": effects, "forms": effects, "confidence": [0.9] * len(effects)}
    return judge.Said(**(blank | known | named | changes))


def test_scores_of_known_effects():
    truth = {"effects": (("a",), ("b", "c"))}
    points = judge.score(said(["c", "a"], truth=truth))
    assert (points.first, points.exact, points.inside) == (True, True, None)
    assert not judge.score(said(["c", "b"], truth=truth)).exact
    assert not judge.score(said(["d", "a"], truth=truth)).first
    assert judge.score(said(["d"], truth=truth, models=[("law", ["a", "b"], 0.3)])).inside
    assert judge.score(said(["a", "d"], truth=truth)).named == ((0, True), (1, False))


def test_scores_of_nothing_unknown_and_twins():
    assert judge.score(said(["a"])).false_name
    assert not judge.score(said([])).false_name
    hidden = {"variables": ("theta",)}
    found = judge.score(said([], Asked.UNKNOWN, truth=hidden, physics="unknown", remainder=["vn", "theta"]))
    assert (found.unknown, found.variable) == (True, True)
    missed = judge.score(said([], Asked.UNKNOWN, truth=hidden, physics="none", remainder=["theta"]))
    assert (missed.unknown, missed.variable) == (False, False)
    pair = {"effects": (("a",),), "rivals": ("b",)}
    assert judge.score(said(["b"], Asked.TWIN, truth=pair, rivals=[["a"]])).twins
    assert not judge.score(said(["b"], Asked.TWIN, truth=pair)).twins
    assert not judge.score(said(["b", "a"], Asked.ORDERED, truth={"effects": (("a",), ("b",))})).first


def test_wilson_is_that_of_the_textbook():
    low, high = tables.wilson(8, 10)
    assert (low, high) == (pytest.approx(0.4901, abs=1e-3), pytest.approx(0.9433, abs=1e-3))
    assert tables.wilson(10, 10)[1] == pytest.approx(1.0)
