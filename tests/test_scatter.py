"""Scatter of the contact: components, variances, what is seen of what a simulator plants, and structure."""

import math
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from diagnoses import few
from pairings import paired
from spatial import in_space, tossed, velocities

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.law_steps import less_error_of_steps
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis, NoiseSource, Record, RungKind, Verdict
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.contact_scatter import contact_scatter, weighed
from contactlearn.diagnosis.unexplained.deviations import screen_deviations
from contactlearn.effects import State
from contactlearn.effects.surface_tilt import SurfaceTiltSeen
from contactlearn.inference.evaluation.impulse_space import ScatterCloud
from contactlearn.inference.evaluation.metrics import negative_log_density, squared_distance
from contactlearn.inference.identification.joint import FitOptions, fit
from contactlearn.inference.identification.scatter import fit_scatter
from contactlearn.inference.identification.variance_components import MixedModel, Mixture
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.shapes import Disc, Ellipsoid, Polygon
from contactlearn.models.checkpoint import load, save
from contactlearn.models.contact_model import ContactModel, linearised, resolve
from contactlearn.report.figures.diagnosis import drawn
from contactlearn.report.figures.impulse_space import scattered_impulses
from contactlearn.report.text.sentences import grounds, headline
from contactlearn.scatter import (
    COMPONENTS,
    Component,
    ContactPoint,
    Friction,
    Normal,
    NormalWithPoint,
    Orientation,
    Restitution,
    find_component,
)
from contactlearn.simulation import synthetic

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from accuracy.scattered_impacts import World, simulated

EXACT = 1e-12  # of the speeds: the same formulas in another order
SLOPE = 1e-5  # of the largest derivative: central differences with steps of 1e-6
WITHIN = 0.2  # of a planted standard deviation: four standard errors of 250 trials
LAW = laws.find("wang_mason").at(0.2, 0.5)
SQUARE = Polygon(((-0.03, -0.03), (0.03, -0.03), (0.03, 0.03), (-0.03, 0.03)))
ONES = Mixture(
    shares=torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64), factors=torch.tensor((1.0, 2.0, 10.0)).double()
)


def outcome(impacts, component, u, law=LAW):
    return resolve(law, {}, State.of(impacts), *law.coefficients, deviations=[(component, u)]).v_post


@cache
def scattered(space=False, stated=True, trials=250, **planted):
    """Impacts of a world, and their scatter around the law."""
    impacts = simulated(World(space=space, slip=2.5 if space else 1.5, **planted), trials, stated=stated)
    return impacts, fit_scatter(impacts, fit(impacts, "wang_mason").model)


# --- Components --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "impacts", [synthetic.load(60), tossed(60).replace(shape=Ellipsoid((0.1, 0.2, 0.15)))], ids=["plane", "space"]
)
@pytest.mark.parametrize("kind", COMPONENTS)
def test_a_component_changes_nothing_where_nothing_deviates(kind, impacts):
    u = torch.zeros(len(impacts), kind().deviations(impacts.space)).double()
    still = ContactModel(LAW).predict(impacts).v_post
    assert (outcome(impacts, kind(), u) - still).abs().max() < EXACT * still.abs().max()


@pytest.mark.parametrize("kind", COMPONENTS)
def test_derivatives_are_those_of_finite_differences(kind):
    drops, step = synthetic.load(60), 1e-6
    u = torch.full((len(drops), 1), 0.001, dtype=torch.float64)
    _, slopes = linearised(lambda own: outcome(drops, kind(), own[:, None]), [u[:, 0]])
    slope = slopes[..., 0]
    differences = (outcome(drops, kind(), u + step) - outcome(drops, kind(), u - step)) / (2 * step)
    assert (slope - differences).abs().max() < SLOPE * slope.abs().max()


@pytest.mark.parametrize("kind", COMPONENTS)
def test_the_plane_seen_in_space_deviates_alike(kind):
    drops = synthetic.load(60)
    u = torch.linspace(-0.05, 0.05, len(drops), dtype=torch.float64)[:, None] * (0.02 if kind is ContactPoint else 1)
    planar, spatial = outcome(drops, kind(), u), in_space(drops)
    across = torch.zeros(len(drops), kind().deviations(spatial.space) - 1).double()
    seen = outcome(spatial, kind(), torch.cat((u, across), -1), laws.find("whittaker").at(0.2, 0.5))
    planar = outcome(drops, kind(), u, laws.find("whittaker").at(0.2, 0.5))
    assert (seen - velocities(planar)).abs().max() < 1e-9


def test_deviations_are_those_of_laws_and_effects_with_other_parameters():
    drops, u = synthetic.load(60), 0.03
    one = torch.full((len(drops), 1), u, dtype=torch.float64)
    for component, model in (
        (Restitution(), ContactModel(LAW.at(0.2, 0.5 + u))),
        (Friction(), ContactModel(LAW.at(0.2 + u, 0.5))),
        (Normal(), ContactModel(LAW, effects={"tilt": SurfaceTiltSeen(phi=u)})),
    ):
        torch.testing.assert_close(outcome(drops, component, one), model.predict(drops).v_post, rtol=0, atol=1e-12)
    moved = drops.replace(r=drops.r + torch.tensor((1e-4, 0.0), dtype=torch.float64))
    near = outcome(drops, ContactPoint(), 1e-4 * torch.ones_like(one))
    torch.testing.assert_close(near, ContactModel(LAW).predict(moved).v_post, rtol=0, atol=1e-12)


def test_a_component_refuses_what_is_no_standard_deviation():
    with pytest.raises(ContactLearnError, match=r"restitution: sigma must be a standard deviation in –, got -0\.1"):
        Restitution(sigma=-0.1)


# --- Variances of a linear mixed model -----------------------------------------------------------


def mixed(n=200, seed=0):
    """A model with two components of known variances and three parameters."""
    generator = torch.Generator().manual_seed(seed)
    X, g, h = (torch.randn(n, 3, k, generator=generator, dtype=torch.float64) for k in (3, 1, 2))
    u, w, e = (torch.randn(n, k, generator=generator, dtype=torch.float64) for k in (1, 2, 3))
    residual = 0.5 * (g @ u[..., None])[..., 0] + 0.2 * (h @ w[..., None])[..., 0] + 0.1 * e + X.sum(-1)
    known = 0.01 * torch.eye(3, dtype=torch.float64).expand(n, 3, 3)
    return MixedModel(residual=residual, slope=X, known=known, bases=torch.stack((g @ g.mT, h @ h.mT)))


def test_scores_are_the_gradient_of_the_restricted_likelihood():
    model, tau, step = mixed(), torch.tensor((0.2, 0.05), dtype=torch.float64), 1e-5
    gradient, _ = model.scores(model.at(tau, ONES))
    for k, unit in enumerate(torch.eye(2, dtype=torch.float64)):
        up, down = (model.at(tau + sign * step * unit, ONES).log_likelihood for sign in (1, -1))
        assert gradient[k] == pytest.approx((up - down) / (2 * step), rel=1e-4)


def test_variances_are_those_that_made_the_residuals():
    fits = [mixed(seed=seed).fit(torch.ones(2).double(), torch.ones(2).bool(), Mixture.initial()) for seed in range(5)]
    mean = torch.stack([fit.variances for fit in fits]).mean(0).sqrt()
    assert mean.tolist() == pytest.approx([0.5, 0.2], rel=0.06)  # 1000 trials: 2 % and a little for the tails
    assert all(fit.step.tolist() == pytest.approx([1, 1, 1], abs=0.1) for fit in fits)


# --- Weights ------------------------------------------------------------------------------------


def test_trials_of_one_covariance_weigh_alike():
    drops = synthetic.load(120, velocity_noise=0.01, spin_noise=0.3)
    root = torch.tensor([[0.01, 0, 0], [0.004, 0.02, 0], [0.1, -0.1, 0.4]], dtype=torch.float64)
    alike = drops.replace(outcome_cov=(root @ root.mT).expand(120, 3, 3))
    found, plain = fit(alike, LAW), fit(drops, LAW)
    torch.testing.assert_close(found.values, plain.values, rtol=0, atol=1e-3 * plain.standard_errors.min().item())
    torch.testing.assert_close(found.standard_errors, plain.standard_errors, rtol=1e-3, atol=0)
    white = alike[[3, 5]].residual(torch.zeros(2, 3).double())
    torch.testing.assert_close(white @ root.mT, drops[[3, 5]].v_post)


@pytest.mark.nightly
def test_weights_bring_the_law_nearer_to_the_truth():
    """A normal that scatters makes contacts stick: without its shift, friction is three standard errors off."""
    away, errors = [], []
    for seed in range(2):
        impacts = simulated(World(sigma_normal=math.radians(2), seed=seed), 200)
        plain = fit(impacts, "wang_mason")
        found = fit(weighed(impacts, plain.model, FitOptions(), Thresholds()), "wang_mason")
        away.append([(one.values - torch.tensor((0.2, 0.5)).double()).abs().tolist() for one in (plain, found)])
        errors.append([one.standard_errors.tolist() for one in (plain, found)])
    before, after = torch.tensor(away).square().mean(0).sqrt()
    stated = torch.tensor(errors).mean(0)[1]
    assert (after < 0.9 * before).any(), (before, after)
    assert (after < 1.1 * before).all(), (before, after)
    assert (after < 2 * stated).all(), (after, stated)


def test_what_never_varies_has_weights_too():
    """Heights of falls and rebounds: nothing is along the floor, and no spin."""
    rng = np.random.default_rng(5)
    speed = rng.uniform(1.5, 5.0, 60)
    frame = pd.DataFrame({"vy": -speed, "vy_post": speed * (0.6 + 0.03 * rng.standard_normal(60))})
    impacts = table.load(frame, shape={"kind": "disc", "radius": 0.05}, mass=2.0)
    found = weighed(impacts, fit(impacts, "whittaker").model, FitOptions(), Thresholds())
    assert found.whitening.isfinite().all()
    eps = fit(found, "whittaker").model.law.coefficients[1].item()
    assert eps == pytest.approx(0.6, abs=0.02)


@pytest.mark.parametrize("structure", ["pose", "speed"])
def test_deviations_that_mostly_follow_something_are_no_weight(structure):
    impacts = simulated(World(structure=structure), 250)
    model = fit(impacts, "wang_mason").model
    assert weighed(impacts, model, FitOptions(), Thresholds()) is None


# --- What is seen of what is planted --------------------------------------------------------------

PLANTED = {
    "normal": ({"sigma_normal": math.radians(2)}, {"normal": math.radians(2)}),
    "friction and contact point": (
        {"sigma_mu": 0.04, "sigma_point": 0.001},
        {"friction": 0.04, "contact_point": 0.001},
    ),
    "restitution, outliers": ({"sigma_eps": 0.05, "outliers": 0.03}, {"restitution": 0.05}),
}


@pytest.mark.parametrize(("case", "stated"), paired([*PLANTED, "normal"], {"stated": True, "not stated": False}))
def test_planted_components_are_named_with_their_size(case, stated):
    """A linearisation at u = 0 finds friction and restitution beside the normal."""
    world, wanted = PLANTED[case]
    _, scatter = scattered(stated=stated, **world)
    assert {*scatter.names} == {*wanted}, scatter
    for name, sigma in wanted.items():
        assert scatter.model.scatter[name].sigma == pytest.approx(sigma, rel=WITHIN)
    assert scatter.bic < -20


def test_a_normal_scatters_in_space():
    _, scatter = scattered(space=True, trials=130, mu=0.15, sigma_normal=math.radians(1.5))  # two deviations each
    assert scatter.names == ("normal",), scatter
    assert scatter.model.scatter["normal"].sigma == pytest.approx(math.radians(1.5), rel=WITHIN)


def test_a_ball_on_an_uneven_floor_touches_elsewhere():
    """Each drop of a disc is one on a level floor, seen in axes that are turned; it was two components with tails."""
    drops = synthetic.load(250, shape=Disc(0.03), mu=0.15, velocity_noise=0, spin_noise=0, seed=4)
    generator, law = torch.Generator().manual_seed(5), laws.find("wang_mason").at(0.15, 0.55)
    lean = 0.03 * torch.randn(len(drops), generator=generator, dtype=torch.float64)

    def turned(v, by):
        c, s = by.cos(), by.sin()
        return torch.stack((c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]), -1)

    after = turned(ContactModel(law).predict(drops.replace(v_pre=turned(drops.v_pre, -lean))).v_post, lean)
    assert (outcome(drops, NormalWithPoint(), lean[:, None], law) - after).abs().max() < 1e-12
    noise = torch.tensor((0.004, 0.004, 0.1), dtype=torch.float64)
    after = after + noise * torch.randn(len(drops), 3, generator=generator, dtype=torch.float64)
    scatter = fit_scatter(drops.replace(v_post=after), ContactModel(law))
    assert scatter.names == ("normal_with_point",), scatter
    assert scatter.model.scatter["normal_with_point"].sigma == pytest.approx(0.03, rel=WITHIN)
    cornered = simulated(World(), 40)  # a corner stays the same corner, a rounded one nearly
    assert not any(
        NormalWithPoint().suits(cornered.replace(shape=one)) for one in (SQUARE, replace(SQUARE, corner=0.002))
    )


@pytest.mark.parametrize(("world", "stated"), paired(
    {"normal": {}, "t(4)": {"tails": 4}, "outliers": {"outliers": 0.03}, "normal too": {}},
    {"stated": True, "not stated": False},
))  # fmt: skip
def test_noise_of_the_instrument_is_no_scatter(world, stated):
    _, scatter = scattered(stated=stated, trials=200, **world)
    assert scatter.names == (), scatter
    assert "no scatter of the contact is seen" in repr(scatter)


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_errors_of_the_recorded_orientation_are_the_instruments(space):
    trials, sigma = 100 if space else 250, math.radians(0.6)  # three deviations a trial in space
    impacts = simulated(World(space=space, slip=2.5 if space else 1.5), trials, stated=False)
    u = sigma * torch.randn(trials, 3 if space else 1, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    state, _, _ = Orientation().perturb(State.of(impacts), *LAW.coefficients, u)
    recorded = impacts.replace(r=state.r, validate=False)
    scatter = fit_scatter(recorded, fit(recorded, "wang_mason").model)
    assert (scatter.names, [*scatter.recorded]) == ((), ["orientation"])
    assert scatter.recorded["orientation"].sigma == pytest.approx(sigma, rel=WITHIN)
    assert "no scatter of the contact is seen" in repr(scatter)
    only = replace(scatter, recorded={}).instrument(recorded)
    assert (scatter.instrument(recorded) - only).diagonal(dim1=-2, dim2=-1).sum(-1).min() > 0


def test_a_contact_point_that_scatters_as_little_as_poses_err_is_the_instruments():
    impacts, scatter = scattered(stated=True, noise=0.001, sigma_point=1.2e-4)
    assert (scatter.names, [*scatter.recorded]) == ((), ["contact_point"])
    point = scatter.recorded["contact_point"]
    assert point.sigma == pytest.approx(1.2e-4, rel=WITHIN)
    assert not replace(point, sigma=3e-4).of_instrument(impacts)


def test_noise_that_was_stated_too_small_is_the_instruments():
    impacts = simulated(World(), 200)
    stated = {name: getattr(impacts, name) / 1e6 for name in ("v_pre_cov", "v_post_cov")}
    impacts = impacts.replace(**stated)
    scatter = fit_scatter(impacts, fit(impacts, "wang_mason").model)
    assert scatter.names == ()
    assert scatter.deviations[0].value == pytest.approx(World().noise, rel=WITHIN)
    assert "the instrument has noise beside the stated: 0.00" in repr(scatter)


def test_ellipsoids_hold_impacts_that_were_not_fitted():
    _, scatter = scattered(**PLANTED["normal"][0])
    rest = simulated(World(seed=1, **PLANTED["normal"][0]), 250)
    error = rest.v_post - scatter.model.predict(rest).v_post
    distance = (error * torch.linalg.solve(scatter.covariance(rest), error[..., None])[..., 0]).sum(-1)
    assert (distance < 7.815).double().mean() == pytest.approx(0.95, abs=0.045)  # three standard errors of 250
    without = (error * torch.linalg.solve(scatter.instrument(rest), error[..., None])[..., 0]).sum(-1)
    assert (without < 7.815).double().mean() < 0.3


def test_draws_have_the_covariance_of_the_scatter():
    impacts, scatter = scattered(**PLANTED["normal"][0])
    drawn = scatter.model.scattered(impacts[:20], torch.Generator().manual_seed(1), 2000).v_post
    away = drawn - ContactModel(scatter.model.law).predict(impacts[:20]).v_post
    spread, expected = away.square().mean(0), scatter.model.scatter_covariance(impacts[:20])
    assert (spread.sum(0) / expected.diagonal(dim1=-2, dim2=-1).sum(0)).tolist() == pytest.approx([1] * 3, rel=0.1)
    assert torch.equal(scatter.model.predict(impacts[:20]).covariance, expected)
    deviations = scatter.sample(4000, impacts, torch.Generator().manual_seed(0))["normal"]
    assert deviations.std() == pytest.approx(scatter.model.scatter["normal"].sigma, rel=0.05)


def test_fans_of_roll_outs_scatter_at_every_bounce():
    _, scatter = scattered(**PLANTED["normal"][0])
    state = BodyState(pose=(0, 0.5, 0.3), velocity=(1, 0, 5), mass=0.05, inertia=3e-5)
    spread = []
    for model in (scatter.model, replace(scatter.model, scatter={})):
        fan = model.roll_out(state, SQUARE, samples=30, generator=torch.Generator().manual_seed(0))
        assert fan.times[:, 0].std() < 1e-12
        spread.append(fan.times[:, 1].std())
    assert spread[0] > 3 * spread[1]


def test_a_model_says_what_scatters():
    model = ContactModel(LAW, scatter={"normal": Normal(sigma=math.radians(0.65)), "friction": Friction(sigma=0.016)})
    assert str(model) == f"{LAW}\n  + scatter: the normal by 0.65°, friction by 0.016"
    assert model.constants()["scatter"]["normal"] == {
        "symbol": "σ_φ", "value": math.radians(0.65), "unit": "rad", "deviates": "the normal by {sigma}"
    }  # fmt: skip
    assert "scatter" not in ContactModel(LAW).constants()


def test_what_is_learnt_on_top_has_the_scatter_as_its_noise():
    """A planted normal scatters: covariances are those of the scatter at each state, and hold fresh impacts."""
    impacts, scatter = scattered(**PLANTED["normal"][0])
    recipe = Recipe("x1", "wrench", law=scatter.model.law)
    with_it, without = (learn(impacts, recipe, base=one) for one in (scatter.model, replace(scatter.model, scatter={})))
    fresh = simulated(World(seed=7, **PLANTED["normal"][0]), 500)
    assert (squared_distance(fresh, with_it.predict(fresh)) < 7.815).double().mean() == pytest.approx(0.95, abs=0.05)
    density = [negative_log_density(fresh, one.predict(fresh)).mean() for one in (with_it, without)]
    assert density[0] < density[1] - 0.2
    assert torch.equal(with_it.scatter_covariance(fresh), scatter.model.scatter_covariance(fresh))
    drawn, own = (
        one.scattered(fresh, torch.Generator().manual_seed(1), 10).v_post - one.outcome(fresh).v_post
        for one in (with_it, scatter.model)
    )
    assert torch.allclose(drawn, own, atol=1e-9)
    assert own.abs().max() > 0.1


def test_a_checkpoint_keeps_the_scatter(tmp_path):
    model = ContactModel(LAW, scatter={"normal": Normal(sigma=0.01)})
    save(model, tmp_path / "model.pt")
    assert load(tmp_path / "model.pt").scatter["normal"].sigma == 0.01
    with pytest.raises(UnknownNameError, match=r"component of scatter"):
        find_component("normall")


def test_a_component_of_a_users_own_is_five_lines():
    class SlipScatter(Component):
        symbol, unit, highest, in_words = "v", "m/s", 0.1, "the floor's speed by {sigma}"

        def perturb(self, state, mu, eps, u):
            return state.replace(v_pre=state.v_pre - torch.cat((u, 0 * u, 0 * u), -1)), mu, eps

    drops = synthetic.load(200, velocity_noise=0.003, spin_noise=0.1)
    found = fit_scatter(drops, ContactModel(LAW), components=[SlipScatter(), Restitution()])
    assert {*found.names} <= {"slip_scatter", "restitution"}
    with pytest.raises(TypeError, match="Nameless must state its symbol"):
        type("Nameless", (Component,), {"perturb": SlipScatter.perturb})


def test_a_component_that_no_trial_shows_is_none():
    """Vertical drops of a ball have no slip: neither friction nor a contact point can be seen to scatter."""
    generator = torch.Generator().manual_seed(3)
    drops = synthetic.load(size=200, shape=Disc(0.03), velocity_noise=0, spin_noise=0, seed=3)
    speed = 1 + 3 * torch.rand(200, generator=generator, dtype=torch.float64)
    eps = 0.6 + 0.03 * torch.randn(200, generator=generator, dtype=torch.float64)
    still = torch.zeros_like(speed)
    noise = 1e-3 * torch.randn(200, 3, generator=generator, dtype=torch.float64)
    v_pre, v_post = (torch.stack((still, v, still), -1) for v in (-speed, eps * speed))
    drops = drops.replace(v_pre=v_pre, v_post=v_post + noise * torch.tensor((1.0, 1.0, 50.0)))
    model = ContactModel(laws.find("whittaker").at(0.2, 0.6))
    found = fit_scatter(drops, model)
    assert found.names == ("restitution",)
    assert found.deviations[-1].value == pytest.approx(0.03, rel=WITHIN)


def test_what_cannot_be_estimated_is_refused():
    drops = synthetic.load(60)
    with pytest.raises(DataError, match="scatter needs at least 40 impacts, got 30"):
        fit_scatter(drops[:30], ContactModel(LAW))
    with pytest.raises(ContactLearnError, match="not on a law"):
        fit_scatter(drops, ContactModel())


# --- Structure before scatter ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("structure", "variable"),
    [
        ("pose", "pose"),
        ("speed", "vn, periodically"),
        ("memory", "normal_speed of earlier impacts"),
        ("heading", "heading"),
        ("corrugation", "x, periodically"),
    ],
)
def test_structure_is_not_scatter(structure, variable):
    planted = {"slope": math.radians(1.5)} if structure == "corrugation" else {}
    impacts, scatter = scattered(space=structure == "heading", structure=structure, trials=200, **planted)
    first = screen_deviations(scatter, impacts)[0]
    assert (first.component, first.variable) == ("normal" if planted else "restitution", variable)
    assert first.share > 0.5
    if structure == "pose":
        assert first.order == 24  # periods over a turn


def test_scatter_has_no_structure():
    for seed in range(2):
        impacts, scatter = scattered(trials=150, seed=seed, sigma_eps=0.05, sigma_normal=math.radians(1.5))
        assert screen_deviations(scatter, impacts) == ()
    assert screen_deviations(replace(scatter, each={}), impacts) == ()


# --- In a diagnosis -------------------------------------------------------------------------------

FEW = DiagnoseOptions(candidates=few("spin_damping", "surface_tilt"), laws=[laws.find("wang_mason")])


def diagnosed(stated=True, options=FEW, trials=150, **planted):
    return diagnose(simulated(World(**planted), trials, stated=stated), options=options)


def test_pure_scatter_is_no_unknown_effect(tmp_path):
    found = diagnosed(sigma_eps=0.05, trials=250)
    assert found.verdict is Verdict.NONE
    (component,) = found.scatter.components
    assert component.deviation.value == pytest.approx(0.05, rel=WITHIN)
    assert component.relative == pytest.approx(0.1, rel=WITHIN)
    shares, budget = found.budget.shares, found.budget
    assert component.share == pytest.approx(shares.scatter)
    assert shares.scatter > 0.5
    assert budget.noise_source is NoiseSource.SCATTER
    assert budget.instrument.mean < 0.25 * budget.noise.mean
    assert "and contacts scatter" in headline(found)
    assert any("Contacts scatter: restitution by 0.0" in one for one in grounds(found))
    assert [rung.kind for rung in found.ladder[-2:]] == [RungKind.SCATTER, RungKind.INSTRUMENT]
    assert (found.ladder[-2].error, found.ladder[-1].error) == (budget.noise, budget.instrument)
    assert found.model.scatter["restitution"].sigma == component.deviation.value
    assert found.equation.endswith(f"scatter: {found.model.scatter['restitution']}")
    fresh = simulated(World(sigma_eps=0.05, seed=1), 500)
    inside = squared_distance(fresh, found.model.predict(fresh)) < 7.815
    assert inside.double().mean() == pytest.approx(0.95, abs=0.03)  # three standard errors of 500
    assert {"scatter", "budget"} <= set(drawn(found))
    assert Diagnosis.from_json(found.to_json()) == found.without_record()
    found.record.save(tmp_path, {})
    (read,), (evidence,) = Record.load(tmp_path).deviations, found.record.deviations
    assert (read.component, read.variable, read.unit) == ("restitution", evidence.variable, "–")
    assert torch.equal(read.u, evidence.u)
    assert len(read.x) == len(read.order) == len(read.u) == len(read.error) == len(found.record.impacts)


@pytest.mark.nightly
def test_stated_noise_serves_as_covariances():
    noise = replace(FEW, noise=(World().noise, World().noise, World().noise / 0.03))
    found = diagnosed(stated=False, options=noise, trials=250, sigma_normal=math.radians(1.5))
    assert (found.verdict, found.scatter.stated) == (Verdict.NONE, True)
    assert found.scatter.components[0].deviation.name == "normal"
    assert found.scatter.instrument == ()
    (law,) = found.laws  # its error has the weights of the full model's, with which it is compared
    assert law.error == pytest.approx(found.budget.named.mean)


def test_deviations_that_follow_something_stay_unknown():
    found = diagnosed(structure="pose")
    assert found.verdict is Verdict.UNKNOWN
    assert found.scatter.dependences
    assert not found.scatter.random
    assert found.budget.shares.unexplained > 0.7
    assert all(one.follows > 0.9 for one in found.scatter.components)
    assert any("not scatter" in one for one in grounds(found))


@pytest.mark.nightly
def test_what_deviations_follow_is_no_noise_of_an_estimated_floor():
    """Similar trials differ by it as well, where nobody stated the noise."""
    found = diagnosed(structure="memory", stated=False)
    assert found.scatter.dependences
    assert found.budget.noise_source is NoiseSource.SCATTER
    assert found.budget.shares.unexplained > 0.6
    assert found.verdict is Verdict.UNKNOWN


@cache
def with_speed_loss(loss):
    """Impacts whose restitution falls with speed and scatters as well, and their scatter."""
    impacts = simulated(World(sigma_eps=0.05, speed_loss=loss), 300)
    model = fit(impacts, "wang_mason").model
    return impacts, contact_scatter(impacts, model, FitOptions(), Thresholds())


@pytest.mark.nightly
def test_the_rest_of_what_follows_something_is_scatter():
    """A restitution that falls with speed and scatters as well: the share that follows, and the floor of the rest."""
    loss = 0.05  # of restitution for each m/s
    impacts, found = with_speed_loss(loss)
    (component,) = found.result.components
    follows = (loss * impacts.v_c[:, -1].std().item()) ** 2
    assert component.follows == pytest.approx(follows / (follows + 0.05**2), abs=0.1)
    assert component.deviation.value > 0.055
    assert found.floor.mean == pytest.approx(with_speed_loss(0.0)[1].floor.mean, rel=0.05)


@pytest.mark.nightly
def test_the_steps_of_a_law_in_space_are_no_scatter():
    impacts = simulated(World(space=True, slip=2.5, noise=0.001), 150)
    exact = less_error_of_steps(impacts, fit(impacts, "wang_mason").model.law)
    found = contact_scatter(exact, fit(exact, "wang_mason").model, FitOptions(), Thresholds())
    assert found.result.components == ()


def test_nothing_scatters_where_data_are_exact_or_few():
    for drops in (synthetic.load(60, velocity_noise=0, spin_noise=0), synthetic.load(30)):
        assert contact_scatter(drops, fit(drops, LAW).model, FitOptions(), Thresholds()) is None


@pytest.mark.nightly
def test_what_alike_drops_leave_open_has_a_finite_error():
    """Falls of one height whose spin follows from the impulse: nothing scatters but ε, and no error is no number."""
    n, generator, sizes = 100, torch.Generator().manual_seed(2), (0.0036, 0.0058, 0.004, 0.005)
    across, down, slid, risen = (torch.randn(n, dtype=torch.float64, generator=generator) * size for size in sizes)
    still = torch.zeros(n, dtype=torch.float64)
    drops = synthetic.load(size=n, shape=Disc(0.02), seed=3)
    drops = drops.replace(
        v_pre=torch.stack((across, down - 2.8, still), -1),
        v_post=torch.stack((0.7 * across + slid, 0.78 * (2.8 - down) + risen, still), -1),
        r=torch.tensor((0.0, -0.02), dtype=torch.float64).expand(n, 2),
        validate=False,
    )  # fmt: skip
    drops = correct(drops, ["spin_from_moments"])
    scatter = fit_scatter(drops, fit(drops, laws.find("whittaker")).model)
    assert all(math.isfinite(one.error) for one in scatter.deviations)
    assert scatter.correlation.isfinite().all()


def test_a_cloud_of_bounces_along_the_normal():
    """The noise of what is the same in all trials has no variance, and the impulses have no width."""
    n = 60
    fall, still = 1 + torch.linspace(0, 2, n, dtype=torch.float64), torch.zeros(n, dtype=torch.float64)
    drops = synthetic.load(size=n, shape=Disc(0.03), seed=3)
    drops = drops.replace(
        v_pre=torch.stack((still, -fall, still), -1), v_post=torch.stack((still, 0.6 * fall, still), -1),
        r=torch.tensor((0.0, -0.03), dtype=torch.float64).expand(n, 2),
    )  # fmt: skip
    law = laws.find("whittaker").at(0.2, 0.6)
    scatter = {"restitution": Restitution(sigma=0.03)}
    model = ContactModel(law, scatter=scatter, noise=torch.diag(torch.tensor((0.0, 1e-4, 0.0), dtype=torch.float64)))
    clouds = ScatterCloud.along(model, drops)
    assert all(cloud.drawn.isfinite().all() for cloud in clouds)
    assert scattered_impulses(clouds).axes
