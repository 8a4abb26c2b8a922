"""Curves: that they are natural cubic splines, take sensible knots, and are found where they are planted."""

import itertools
import math

import pytest
import torch
from scipy.interpolate import CubicSpline

from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import TrainSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import State, catalogue, columns, find_effect
from contactlearn.effects.functions import Spline
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import assemble
from contactlearn.laws import find
from contactlearn.mechanics.space import PLANE
from contactlearn.models import checkpoint
from contactlearn.simulation import synthetic

ROUNDING = 1e-12  # relative to a rise of 1
NOISE = torch.tensor((0.005, 0.005, 0.2), dtype=torch.float64)  # m/s and rad/s
SIGMAS = 4.0

CURVES = [kind for forms in catalogue().values() for kind in forms if issubclass(kind, Spline) and PLANE in kind.spaces]
FAMILIES = {  # what has a curve, by the variable
    *("velocity_dependent_restitution", "slip_dependent_restitution", "configuration_dependent_restitution"),
    *("incidence_dependent_restitution", "incidence_dependent_friction", "parameter_drift"),
    *("velocity_dependent_friction", "load_dependent_friction", "contact_patch", "rolling_resistance"),
}
KNOTS = (0.5, 1.2, 1.9, 3.4)


def speed_curve(*rises, knots=KNOTS):
    return find_effect("velocity_dependent_restitution", "curve")(*rises, knots)


def drops(effect, values, size=600, seed=3):
    """Drops from both sides and different heights under μ = 0.25, ε = 0.55 and an effect, with noise afterwards."""
    exact = _wide(size, seed)
    theta = torch.tensor((0.25, 0.55, *values), dtype=torch.float64)
    model = assemble(find("wang_mason"), {"it": effect.prepare(exact)}, theta)
    noise = NOISE * torch.randn(len(exact), 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return exact.replace(v_post=model.predict(exact).v_post + noise), model, theta


def _wide(size, seed):
    states = synthetic.load(size=2 * size, velocity_noise=0, spin_noise=0, seed=seed)
    generator = torch.Generator().manual_seed(seed)
    v = states.v_pre * (0.4 + 1.2 * torch.rand(2 * size, 1, generator=generator, dtype=torch.float64))
    v[:, 0] *= 3  # so that many slide throughout
    v[::2, 0] *= -1
    steep = (v[:, 1] + states.r[:, 0] * v[:, 2] < -0.2).nonzero()[:size, 0]
    return states[steep].replace(v_pre=v[steep], order=torch.arange(1, size + 1))


def test_every_dependence_on_one_variable_has_a_curve():
    assert {kind.name for kind in CURVES} == FAMILIES


def test_a_curve_is_a_natural_cubic_spline():
    """SciPy's, between the knots and in a straight line beyond them."""
    rises = (0.2, -0.3, 0.1)
    heights = list(itertools.accumulate((0.0, *rises)))
    spline = CubicSpline(KNOTS, heights, bc_type="natural")
    u = torch.linspace(-1.0, 6.0, 701, dtype=torch.float64)
    inside = u.clamp(KNOTS[0], KNOTS[-1])
    expected = (
        torch.from_numpy(spline(inside) + spline(inside, 1) * (u - inside).numpy())
        - spline((KNOTS[1] + KNOTS[2]) / 2).item()
    )
    torch.testing.assert_close(speed_curve(*rises).change(u), expected, rtol=ROUNDING, atol=ROUNDING)
    # A curve holds the linear form.
    line = speed_curve(*(0.1 * (b - a) for a, b in itertools.pairwise(KNOTS)))
    u = torch.linspace(0, 5, 50, dtype=torch.float64)
    torch.testing.assert_close(line.change(u), 0.1 * (u - 1.55), rtol=ROUNDING, atol=ROUNDING)
    knots = find_effect("rolling_resistance", "curve")().prepare(_wide(200, 1)).knots
    assert knots[0] == 0.0
    spin = find_effect("rolling_resistance", "curve")(0.001, 0.001, 0.0, knots)
    zero = torch.zeros(1, dtype=torch.float64)
    assert spin.change(zero).item() == 0.0
    assert spin.change(torch.tensor(knots, dtype=torch.float64)).tolist() == pytest.approx([0, 0.001, 0.002, 0.002])


@pytest.mark.parametrize("kind", CURVES, ids=lambda kind: str(kind.id))
def test_knots_are_quantiles_of_the_state_before_impact(kind):
    impacts = _wide(400, 2)
    effect = kind().prepare(impacts)
    values = effect.argument.values(State.of(impacts))
    below = [(values < knot).double().mean().item() for knot in effect.knots]
    assert below == pytest.approx((0.0, 1 / 3, 2 / 3, 0.95) if kind.at_rest else (0.05, 0.35, 0.65, 0.95), abs=0.02)
    assert effect.prepare(impacts[:40]).knots == effect.knots
    assert ", ".join(f"{knot:g}" for knot in effect.knots) in effect.equation


FEW = {
    "two heights": [1.0] * 30 + [2.0] * 30,
    "one height": [1.5] * 60,
    "nearly all of one height": [1.0] * 50 + [1.1, 1.2, 1.4, 1.7, 2.0, 2.2, 2.4, 2.6, 2.8, 3.0],
}


@pytest.mark.parametrize("speeds", FEW.values(), ids=FEW)
def test_few_distinct_values_still_have_knots(speeds):
    impacts = synthetic.load(size=60, shape={"kind": "disc", "radius": 0.03}, velocity_noise=0, spin_noise=0)
    v = impacts.v_pre.clone()
    v[:, 1] = -torch.tensor(speeds, dtype=torch.float64)
    impacts = impacts.replace(v_pre=v)
    names = ("velocity_dependent_restitution", "configuration_dependent_restitution")
    curves = [find_effect(name, "curve")().prepare(impacts) for name in names]
    for effect in curves:
        gaps = torch.tensor(effect.knots).diff()
        assert gaps.min() > 0.02 * gaps.sum()
    model = assemble(find("mirtich"), {"it": curves[0]}, torch.tensor((0.2, 0.5, 0.1, 0.1, 0.1), dtype=torch.float64))
    assert model.predict(impacts).v_post.isfinite().all()


@pytest.mark.parametrize("knots", [None, (1.0, 2.0, 3.0), (1.0, 2.0, 2.0, 3.0), (3.0, 2.0, 1.0, 0.0)])
def test_knots_that_are_none_are_refused(knots):
    with pytest.raises(ContactLearnError, match=r"knots of a curve are four increasing values of \|v_n\|"):
        speed_curve(0.1, 0.1, 0.1, knots=knots).change(torch.ones(3, dtype=torch.float64))


@pytest.mark.parametrize("kind", CURVES, ids=lambda kind: str(kind.id))
def test_planted_curves_are_found(kind):
    """Each as a rise that levels off: a fifth, a tenth and none of the half-range."""
    effect = kind()
    shares = {"c1": 0.2, "c2": 0.1, "c3": 0.0, "c": -0.1}
    impacts, model, theta = drops(effect, [shares[p.name] * p.high for p in effect.parameters])
    fit = joint.fit(impacts, find("wang_mason"), {"it": effect})
    assert ((fit.values - theta).abs() <= SIGMAS * fit.standard_errors).all(), (fit.values, fit.standard_errors)
    assert not fit.undetermined()
    left = (fit.model.predict(impacts).v_post - model.predict(impacts).v_post).abs().mean(0)
    assert (left < NOISE).all(), left


def test_a_curve_follows_restitution_that_saturates():
    """The slow form with v_s = 1 m/s, and a curve within 0.01 of it over nine tenths of the drops."""
    slow = find_effect("velocity_dependent_restitution", "slow")()
    impacts, _, _ = drops(slow, (0.4, 1.0))
    effect = {"it": find_effect("velocity_dependent_restitution", "curve")()}
    fit = joint.fit(impacts, find("wang_mason"), effect)
    found = fit.model.effects["it"]
    u = torch.linspace(found.knots[0], found.knots[-1], 50, dtype=torch.float64)
    true = 0.55 + 0.4 * (-u).exp()
    assert (fit.values[1] + found.change(u) - true).abs().max() < 0.01


def test_settling_is_a_share_of_all_trials():
    """Half of the change is over after N log 2/λ trials."""
    effect = find_effect("parameter_drift", "settling_restitution")(0.2, 4.0, trials=1000.0)
    state = State.of(_wide(4, 1)).replace(order=torch.tensor((1.0, 1 + 250 * math.log(2), 1e9), dtype=torch.float64))
    mu, eps = torch.tensor(0.1), torch.tensor(0.5)
    assert effect.law(state, mu, eps)[1].tolist() == pytest.approx([0.5, 0.6, 0.7])


def test_a_checkpoint_and_the_command_line_know_curves(tmp_path):
    impacts = _wide(60, 4)
    name = "velocity_dependent_restitution"
    words = [f"effect=[{name}]", f"effect.{name}.form=curve"]
    (effect,) = TrainSettings.from_config(compose("train", words)).effects.values()
    assert effect.id == find_effect(name, "curve").id
    model = joint.fit(impacts, find("mirtich"), {name: effect}).model
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    again = checkpoint.load(tmp_path / "model.pt")
    assert torch.equal(again.predict(impacts).v_post, model.predict(impacts).v_post)
    assert again.effects[name].knots == model.effects[name].knots
    words.append(f"+effect.{name}.knots=[1,2,3,4]")
    (given,) = TrainSettings.from_config(compose("train", words)).effects.values()
    assert given.knots == (1, 2, 3, 4)
    assert columns(*given.values).tolist() == [0, 0, 0]
