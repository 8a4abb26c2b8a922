"""Joint identification of a law with effects: accuracy, robustness, bounds, honesty about what is open."""

import itertools
import math
from dataclasses import replace

import pytest
import torch

from contactlearn import effects
from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.effects import find_effect
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions, FitThresholds, assemble
from contactlearn.inference.identification.shared import Box, fit_subsets
from contactlearn.laws import find
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)
ROUNDING = 1e-9  # relative: a search that ends at the same optimum on another way
TRUE = {"surface_tilt": (0.02,), "spin_damping": (0.1,), "contact_patch": (0.03, -2e-4)}


def planted(names, n=400, seed=0, law="wang_mason", noise=NOISE):
    """Drops under a law (μ = 0.15, ε = 0.6) and effects, with noise before and after."""
    exact = synthetic.load(size=n, velocity_noise=0, spin_noise=0, seed=seed)
    generator = torch.Generator().manual_seed(seed)
    v = exact.v_pre.clone()
    v[::2, 0] *= -1
    exact = exact.replace(v_pre=v)
    chosen = {name: find_effect(name)() for name in names}
    theta = torch.tensor((0.15, 0.6, *(value for name in names for value in TRUE[name])), dtype=torch.float64)
    truth = assemble(find(law), chosen, theta).predict(exact).v_post
    before, after = (noise * torch.randn(n, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    return exact.replace(v_pre=exact.v_pre + before, v_post=truth + after), chosen, theta


def assert_recovered(fit, theta, sigmas=4.0):
    assert ((fit.values - theta).abs() <= sigmas * fit.standard_errors).all(), (fit.values, theta, fit.standard_errors)


@pytest.mark.parametrize("law", ["wang_mason", "mirtich", "anitescu_potra_newton", "drumwright_shell"])
@pytest.mark.parametrize("target", ["velocity", "wrench"])
def test_planted_effects_are_found(law, target):
    drops, chosen, theta = planted(TRUE, law=law)
    fit = joint.fit(drops, find(law), chosen, options=FitOptions(target=target))
    assert_recovered(fit, theta)
    assert fit.converged
    assert not fit.undetermined()
    assert [p.name for p in fit.parameters][:3] == ["mu", "eps", "surface_tilt.phi"]


def test_planted_parameters_are_exact_without_noise_and_kept_within_their_bounds():
    drops, chosen, theta = planted(TRUE, noise=0 * NOISE)
    fit = joint.fit(drops, find("wang_mason"), chosen)
    torch.testing.assert_close(fit.values, theta, rtol=1e-6, atol=1e-8)
    drops, chosen, _ = planted(TRUE)
    fit = joint.fit(drops, find("wang_mason"), chosen, options=FitOptions(box=Box(mu=(0.0, 0.1), eps=(0.0, 1.0))))
    assert fit.values[0] == pytest.approx(0.1)
    assert "bound" in fit.at_bounds()["mu"]
    assert fit.at_ends() == {"mu"}
    low, high = torch.tensor([(p.low, p.high) for p in fit.parameters], dtype=torch.float64).T
    assert ((fit.values >= low) & (fit.values <= high)).all()
    # Two tilts: only their sum is determined.
    twice = {"one": chosen["surface_tilt"], "other": chosen["surface_tilt"]}
    fit = joint.fit(drops, find("wang_mason"), twice)
    assert {"one.phi", "other.phi"} <= fit.undetermined().keys()
    text = str(joint.fit(drops, find("wang_mason"), chosen).model).splitlines()
    assert text[0].startswith("wang_mason (textbook): μ = 0.1")
    assert text[2].startswith("  + spin_damping: τ ← τ − c I ω⁺, c = 0.0983 ± 0.00")
    assert all("±" in line for line in text)
    assert text[1].endswith(" rad")


def test_gross_outliers_have_little_influence():
    drops, chosen, theta = planted(TRUE, n=500)
    clean = joint.fit(drops, find("wang_mason"), chosen)
    v_post = drops.v_post.clone()
    v_post[::25] = v_post[::25].flip(0) * -3  # 4 %: another trial's outcome, reversed and thrice as fast
    fit = joint.fit(drops.replace(v_post=v_post), find("wang_mason"), chosen)
    assert_recovered(fit, theta)
    assert ((fit.values - clean.values).abs() <= 1.5 * clean.standard_errors).all()
    assert fit.outliers == 20
    assert (fit.weight[::25] < 0.05).all()


@pytest.mark.nightly
def test_standard_errors_are_those_of_many_repetitions():
    drops, chosen, _ = planted(TRUE, 6000)
    fits = joint.fit(
        drops, find("wang_mason"), chosen, rows=torch.arange(6000).view(30, 200), options=FitOptions(starts=2)
    )
    spread, stated = fits.values.std(0), fits.standard_errors.mean(0)
    assert ((spread / stated).log().abs() < math.log(1.5)).all(), spread / stated


def test_intervals_hold_beside_an_unknown_dependence_of_the_outcome_on_the_state():
    """Of the values that very many trials would give: the dependence is largest where the tilt and the spin show."""
    drops, chosen, theta = planted({name: TRUE[name] for name in ("surface_tilt", "spin_damping")}, 24_000)
    spin, turn = drops.v_pre[:, 2:] / drops.v_pre[:, 2].std(), (2 * drops.q[:, 2:]).cos()
    drops = drops.replace(v_post=drops.v_post + spin.square() * turn * torch.tensor((0.05, 0.08, 5.0)))
    quick = FitOptions(starts=1, tolerance=1e-5)
    limit = joint.fit(drops, find("wang_mason"), chosen, options=quick, start=theta).values
    fits = joint.fit(
        drops, find("wang_mason"), chosen, rows=torch.arange(24_000).view(240, 100), options=quick, start=limit
    )
    held = ((fits.values - limit).abs() <= 1.96 * fits.standard_errors).double().mean(0)
    assert (held > 0.9).all(), held
    assert 0.93 < held.mean() < 0.975


def test_subsets_are_a_batch():
    drops, chosen, _ = planted(TRUE)
    rows = torch.stack([torch.randperm(400, generator=torch.Generator().manual_seed(k))[:60] for k in range(3)])
    batch = joint.fit(drops, find("wang_mason"), chosen, rows=rows)
    assert batch.values.shape == (3, 6)
    for k in range(3):
        one = joint.fit(drops, find("wang_mason"), chosen, rows=rows[k])
        torch.testing.assert_close(batch.values[k], one.values, rtol=1e-5, atol=1e-6)
    predicted = batch.model.predict(drops).v_post
    assert predicted.shape == (3, 400, 3)
    alone = assemble(find("wang_mason"), batch.model.effects, batch.values[1]).predict(drops).v_post
    torch.testing.assert_close(predicted[1], alone, rtol=ROUNDING, atol=ROUNDING)


def test_known_noise_weighs_the_components():
    """Spins that are nearly worthless: with their noise known, the velocities alone decide."""
    noise = torch.tensor((0.005, 0.005, 20.0), dtype=torch.float64)
    drops, chosen, _ = planted({"surface_tilt": TRUE["surface_tilt"]}, noise=noise)
    for target in ("velocity", "wrench"):
        fit = joint.fit(
            drops, find("wang_mason"), chosen, options=FitOptions(noise=(0.005, 0.005, 20.0), target=target)
        )
        assert fit.standard_errors[2] < 0.02
    velocity, wrench = (
        joint.fit(drops, find("wang_mason"), chosen, options=FitOptions(noise=noise.tolist(), target=target)).values
        for target in ("velocity", "wrench")
    )
    torch.testing.assert_close(velocity, wrench, rtol=1e-4, atol=1e-5)  # the same errors in other units


def test_a_correlation_is_no_undetermined_parameter():
    """A late frame lowers v_y after impact as ε does, at nearly one speed, but both are known to a few percent."""
    drops, _, _ = planted({})
    even = 1 / drops.v_pre[:, :2].norm(dim=-1, keepdim=True)
    drops = drops.replace(v_pre=even * drops.v_pre, v_post=even * drops.v_post)
    late = find_effect("gravity_impulse")()
    fit = joint.fit(drops, find("wang_mason"), {"late": late})
    strong = replace(fit, thresholds=FitThresholds(collinearity=fit.correlation[1, 2].abs().item() - 0.01))
    assert not strong.undetermined().keys() & {"eps"}
    (said,) = [pair for pair in strong.trade_offs() if pair.startswith("eps and late.")]
    assert said.endswith(f"trade off: correlation {fit.correlation[1, 2]:+.2f}")
    assert replace(fit, thresholds=FitThresholds(collinearity=0.9999)).trade_offs() == ()


def test_an_effect_is_undetermined_where_no_trial_or_few_tell_it():
    """Drops that all start at one place say nothing of the floor elsewhere."""
    drops, _, _ = planted({})
    q = drops.q.clone()
    q[:, 0] = 0.1
    effect = effects.find_effect("location_dependent_friction")(span=(0.0, 0.2))
    found = joint.fit(drops.replace(q=q), find("wang_mason"), {"floor": effect}).undetermined()
    assert any(name.startswith("floor.") for name in found)
    # Three trials in a rough corner of the floor, and none elsewhere says anything of it.
    q = drops.q.clone()
    q[:, 0] = 0.0
    q[:3, 0] = 1.0
    corner = formula(tau="c*x*Pn", parameters={"c": {"low": -0.01, "high": 0.01, "unit": "–"}})
    found = joint.fit(drops.replace(q=q), find("wang_mason"), {"corner": corner}).undetermined()
    assert "about 3 trials constrain it" in found["corner.c"] or "about 2 trials" in found["corner.c"]
    # One trial tells of the parameter, so nothing is left of it: its error is that of the others' scatter.
    q = drops.q.clone()
    q[:, 0] = 0.0
    q[7, 0] = 1.0
    alone = formula(tau="c*x*Pn", parameters={"c": {"low": -0.1, "high": 0.1, "unit": "m"}})
    fit = joint.fit(drops.replace(q=q), find("wang_mason"), {"alone": alone})
    # Of ω, given the two other components, which say nothing of a moment.
    spread = (1 / torch.linalg.inv(fit.scatter)[2, 2]).sqrt()
    expected = spread * drops.inertia[7] / fit.model.predict(drops).wrench[7, 1]
    assert 0.7 < fit.standard_errors[2] / expected < 1.6
    # A parameter of one sign that would rather have the other.
    effect = formula(tau="c*I*omega", parameters={"c": {"low": 0, "high": 1, "unit": "–"}})
    drops = drops.replace(v_post=drops.v_post - 0.01 * drops.v_pre * torch.tensor((0.0, 0.0, 1.0)))
    fit = joint.fit(drops, find("wang_mason"), {"push": effect})
    assert fit.values[2] == 0
    assert "is not seen: |c| < " in fit.at_bounds()["push.c"]
    assert "push.c" not in fit.undetermined()


def test_the_effect_takes_the_error_to_the_floor():
    drops, chosen, theta = planted(TRUE, n=900)
    pool, test = drops[:500], drops[500:]
    alone, with_ = (joint.fit(pool, find("wang_mason"), e).model for e in ({}, chosen))
    true = assemble(find("wang_mason"), chosen, theta)
    base, found, floor = (mass_error(test, model.predict(test)).mean() for model in (alone, with_, true))
    assert base > 1.3 * floor
    assert found < 1.03 * floor


REFUSED = {
    "target": (lambda: {"options": FitOptions(target="impulse")}, UnknownNameError, "target of a joint fit"),
    "noise": (lambda: {"options": FitOptions(noise=(0.1, 0.1))}, DataError, "three positive standard deviations"),
    "trials": (lambda: {"rows": torch.arange(2)}, DataError, "6 parameters need at least 7 trials, got 2"),
}


@pytest.mark.parametrize(("changes", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_unfittable_effects_are_refused(changes, error, message):
    drops, chosen, _ = planted(TRUE, 50)
    with pytest.raises(error, match=message):
        joint.fit(**{"law": find("wang_mason"), "effects": chosen, "impacts": drops} | changes())


def test_an_effect_that_needs_a_shape_is_refused_without():
    drops = synthetic.load(size=50).replace(shape=None)
    with pytest.raises(DataError, match="needs the body's shape"):
        joint.fit(drops, find("wang_mason"), {"late": effects.find_effect("sampling_delay")()})


def test_few_trials_do_not_look_certain():
    drops, chosen, theta = planted(TRUE, 300)
    rows = torch.stack([torch.randperm(300, generator=torch.Generator().manual_seed(k))[:12] for k in range(60)])
    fit = joint.fit(drops, find("wang_mason"), chosen, rows=rows)
    covered = ((fit.values - theta).abs() <= 2 * fit.standard_errors).double().mean(0)
    assert (covered > 0.8).all(), covered


@pytest.mark.parametrize("names", list(itertools.combinations(
    ("surface_tilt", "orientation_offset", "sampling_delay", "shape_error", "com_offset"), 2)))  # fmt: skip
def test_the_order_of_contact_point_shifts_has_little_influence(names):
    """To second order in the parameters, which do not commute exactly where they turn one thing twice."""
    drops = planted({})[0]
    chosen = {name: effects.find_effect(name)() for name in names}
    small = [0.02 * (p.high - p.low) for effect in chosen.values() for p in effect.parameters]
    one = assemble(find("wang_mason"), chosen, torch.tensor((0.15, 0.6, *small), dtype=torch.float64))
    other = ContactModel(one.base, effects=dict(reversed(one.effects.items())))
    alone = assemble(find("wang_mason"), {}, torch.tensor((0.15, 0.6), dtype=torch.float64)).predict(drops).v_post
    difference = (one.predict(drops).v_post - other.predict(drops).v_post).abs().median(0).values
    change = (one.predict(drops).v_post - alone).abs().median(0).values
    assert (difference <= 0.02 * change).all(), (difference, change)


@pytest.mark.parametrize("law", ["wang_mason", "mirtich", "whittaker", "drumwright_shell"])
@pytest.mark.parametrize("name", ["contact_patch", "rolling_resistance", "directional_friction"])
def test_effects_during_the_contact_are_continuous(name, law):
    """Where friction crosses the edge of sticking the effect changes as little as the law itself does."""
    drops = planted({}, 60)[0]
    effect = effects.find_effect(name)()
    values = [0.2 * p.high for p in effect.parameters]
    mu = torch.linspace(0.05, 0.4, 3001, dtype=torch.float64)
    theta = torch.stack((mu, torch.full_like(mu, 0.6), *(torch.full_like(mu, v) for v in values)), -1)
    with_ = assemble(find(law), {name: effect}, theta).predict(drops).v_post
    alone = assemble(find(law), {}, theta[:, :2]).predict(drops).v_post
    added = (with_ - alone).diff(dim=0).abs().amax(0)
    own = alone.diff(dim=0).abs().amax(0)
    size = (with_ - alone).abs().amax(0)
    jumps = (added > 0.1 * size + 3 * own + 1e-9).double().mean()
    assert jumps < 0.05, jumps


def test_partial_residuals_include_the_other_effects():
    """Without noise, what is measured beyond the model without an effect is what the effect explains."""
    drops, chosen, theta = planted(("surface_tilt", "contact_patch"), noise=0 * NOISE)
    model = assemble(find("wang_mason"), chosen, theta)
    for name in chosen:
        partial = partial_residuals(model, drops, name)
        torch.testing.assert_close(partial.measured, partial.explained, rtol=1e-6, atol=1e-9)
        assert partial.explained.abs().max() > 1e-6


def test_copies_of_a_trial_show_no_standard_error():
    drops = synthetic.load(size=9).replace(validate=False)[torch.zeros(9, dtype=torch.long)]
    fit = joint.fit(drops, "wang_mason")
    assert fit.standard_errors.isnan().all()
    assert "no standard errors: all trials are copies of one" in fit.summary()
    assert "±" not in fit.summary()
    assert all(map(math.isnan, fit_subsets(drops, "wang_mason", repetitions=3).std()))
