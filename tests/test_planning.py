"""Plans: criteria against brute force, limits of rigs, batches against random drops, the rule for stopping."""

import math
import re
import shlex
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
import torch
from commands import run
from spatial import box_tosses

import contactlearn as cl
from contactlearn.cli.commands.plan import _measured_already, _next_command, _other_body
from contactlearn.core.errors import DataError
from contactlearn.core.serialisation import from_json, to_json
from contactlearn.diagnosis.discrimination.experiment import ModelDiscrimination, discriminations
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.planning.criteria import EffectSeparation, NameInformation, ParameterInformation, SpaceFilling
from contactlearn.planning.hypotheses import Candidates, visible
from contactlearn.planning.measurement import carry_out
from contactlearn.planning.result import Goal, Look, Plan, Purpose, Stop
from contactlearn.planning.rig import Limits, Rig, Specimen, settings_of, states
from contactlearn.planning.stopping import decide
from contactlearn.simulation.hidden_effects import draw
from contactlearn.simulation.hidden_effects.drops import Laboratory

ROUNDING = {"rtol": 1e-9, "atol": 1e-12}
MONTE_CARLO = 0.02  # of a mean over 256 draws of a probability
ELLIPSE = Specimen(mass=0.05, inertia=2.3e-5, shape=cl.shapes.Ellipse((0.035, 0.025)))
CUBE = Specimen(mass=0.05, inertia=(2e-5, 2e-5, 2e-5), shape=cl.shapes.Cuboid((0.025, 0.025, 0.025)))
HEIGHT, SPIN = Limits(low=0.05, high=0.5, precision=0.002), Limits(low=-30.0, high=30.0, share=0.1)
ANGLE = Limits(low=-math.pi, high=math.pi, precision=0.035)
RIG = Rig(limits={"height": HEIGHT, "theta": ANGLE, "omega": SPIN})


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def numbers(*shape, seed=0):
    return torch.randn(*shape, generator=seeded(seed), dtype=torch.float64)


def covariances(*shape, seed=0):
    root = numbers(*shape, shape[-1], seed=seed)
    return root @ root.mT + 0.1 * torch.eye(shape[-1], dtype=torch.float64)


def names_of(models=3, settings=6, repeats=2, seed=0, names="abc"):
    n = settings * repeats
    return NameInformation.of(
        numbers(models, n, 3, seed=seed),
        [numbers(n, 3, 2 + k, seed=k) for k in range(models)],
        [0.1 * covariances(2 + k, seed=k) for k in range(models)],
        covariances(n, 3, seed=9),
        names=names,
        probability=torch.tensor([0.5, 0.3, 0.2], dtype=torch.float64),
        repeats=repeats,
    )


# --- Criteria ----------------------------------------------------------------------------------


def test_pairs_side_by_side_are_each_pair_by_itself():
    every = names_of().pairs
    for k in range(3):
        alone = ModelDiscrimination(
            difference=every.difference[k], slope=every.slope[k], covariance=every.covariance[k], noise=every.noise
        )
        torch.testing.assert_close(every.squared()[k], alone.squared(), **ROUNDING)
        torch.testing.assert_close(every.after(4).squared()[k], alone.after(4).squared(), **ROUNDING)
        torch.testing.assert_close(every.at([3, 1]).squared()[k], alone.at([3, 1]).squared(), **ROUNDING)


def test_information_about_names_lies_between_nothing_and_all():
    """Without evidence it is 0, with all evidence the entropy of the names; models of one name count as one."""
    for names, p in (("abc", (0.5, 0.3, 0.2)), ("aab", (0.8, 0.2)), ("aaa", (1.0,))):
        one = names_of(names=names)
        entropy = -sum(x * math.log(x) for x in p)
        none, some, all_ = (one.information(torch.full((3, 1), x, dtype=torch.float64)).item() for x in (0.0, 4.0, 1e4))
        assert none == pytest.approx(0.0, abs=1e-12)
        assert all_ == pytest.approx(entropy, abs=1e-12)
        assert (none < some < all_) == (len(p) > 1)
        assert (one.gain() >= -1e-12).all()


def test_the_information_of_two_names_is_below_the_exact_one():
    """Of two normal outcomes d apart, by quadrature: the bound holds, and is not far."""
    y = torch.linspace(-12, 16, 20001, dtype=torch.float64)
    for d in (0.5, 1.0, 2.0, 4.0):
        density = torch.stack([(-((y - x) ** 2) / 2).exp() / math.sqrt(2 * math.pi) for x in (0.0, d)])
        mean = density.mean(0)
        exact = torch.trapezoid((density * (density / mean).clamp_min(1e-300).log()).mean(0), y).item()
        two = names_of(names="aab")
        two = replace(two, probability=torch.tensor([0.25, 0.25, 0.5], dtype=torch.float64))
        bound = two.information(torch.full((3, 1), d**2, dtype=torch.float64)).item()
        assert 0.4 * exact < bound < exact


def test_the_expected_probability_of_a_name_is_that_of_two_normal_outcomes():
    """With one datum that is N(0, 1) under the one name and N(d, 1) under the other."""
    pair = names_of(names="aab")
    pair = replace(pair, probability=torch.tensor([0.35, 0.35, 0.3], dtype=torch.float64))
    assert pair.right() == pytest.approx(0.7, abs=1e-9)
    assert replace(pair, evidence=torch.full((3,), 400.0, dtype=torch.float64)).right() == pytest.approx(1.0, abs=1e-6)
    far = [replace(pair, evidence=torch.full((3,), x, dtype=torch.float64)).right() for x in (0.0, 1.0, 4.0, 16.0)]
    assert all(b > a - MONTE_CARLO for a, b in pairwise(far))


def test_parameters_are_updated_as_by_all_data_together():
    slope, prior = numbers(1, 8, 3, 4), covariances(1, 4)
    one = ParameterInformation(slope=slope, covariance=prior, probability=torch.ones(1, dtype=torch.float64), repeats=1)
    both, J = one.after(5).after(2), slope[0, [5, 2]].flatten(0, 1)
    torch.testing.assert_close(both.covariance[0], torch.linalg.inv(torch.linalg.inv(prior[0]) + J.T @ J), **ROUNDING)
    nats = (torch.logdet(prior[0]) - torch.logdet(both.covariance[0])) / 2
    torch.testing.assert_close(one.gain()[5] + one.after(5).gain()[2], nats, **ROUNDING)
    before = one.error() ** 2 * 3
    assert one.fall()[5].item() == pytest.approx(before - one.after(5).error() ** 2 * 3)


def candidates(settings=6):
    """Made-up effects a, b, b, c about a law with two coefficients."""
    return Candidates(
        names=("mu", "eps", "a", "b", "b", "c"),
        slope=numbers(2 * settings, 3, 6),
        model_parameters=2,
        prior=torch.linspace(0.5, 1.0, 6, dtype=torch.float64),
        information=covariances(6),
    )


def test_effects_are_apart_by_what_a_refit_of_the_others_leaves():
    """By least squares with the prior as data; the gain is the growth of the harmonic mean over rivals."""
    made = candidates()
    one = EffectSeparation.of(made, repeats=2)
    after, slope = one.after(4), made.slope[8]
    root = torch.linalg.cholesky(made.information).mT
    rows = torch.cat((root, slope))
    for r, columns in enumerate(([0, 1], [0, 1, 2], [0, 1, 3, 4], [0, 1, 5])):
        prior = made.prior[columns].reciprocal().diag()
        left = torch.cat((rows[:, columns], prior))
        for s in range(4):
            change = torch.cat((one.size[s] * rows[:, 2 + s], torch.zeros(len(columns), dtype=torch.float64)))
            residual = change - left @ torch.linalg.lstsq(left, change[:, None]).solution[:, 0]
            if 2 + s not in columns:
                assert after.squared()[r, s].item() == pytest.approx(residual.square().sum().item(), rel=1e-9)

    def separation(squared):
        near = [(1 / (1 + squared[one.rival[:, s], s])).mean().log() for s in range(4)]
        return -(near[0] + (near[1] + near[2]) / 2 + near[3]) / 3

    gain = separation(after.squared()) - separation(one.squared())
    torch.testing.assert_close(one.gain()[4], gain, **ROUNDING)
    assert (one.gain() > 0).all()


def test_effects_are_of_a_visible_and_plausible_size():
    """Three times the noise over all settings, or twice the prior; the others of one name are no rivals."""
    made = candidates()
    made = replace(made, prior=made.prior * torch.tensor((1, 1, 0.1, 9, 0.1, 9)))
    one = EffectSeparation.of(made, repeats=2)
    change = one.size * made.slope[..., 2:].square().sum(-2).mean(0).sqrt()
    torch.testing.assert_close(change[[1, 3]], torch.full((2,), 3.0, dtype=torch.float64), **ROUNDING)
    torch.testing.assert_close(one.size[[0, 2]], 2 * made.prior[[2, 4]], **ROUNDING)
    assert one.rival.tolist() == [[True] * 4, [False, *[True] * 3], [True, False, False, True], [*[True] * 3, False]]


def test_space_is_filled_away_from_what_is_there():
    places, measured = torch.linspace(0, 1, 21, dtype=torch.float64)[:, None], torch.zeros(3, 1, dtype=torch.float64)
    space = SpaceFilling.of(places, measured)
    picked = []
    for _ in range(3):
        picked.append(places[int(space.gain().argmax())].item())
        space = space.after(int(space.gain().argmax()))
    assert min(picked) > 0.3
    assert min(abs(a - b) for a, b in combinations(picked, 2)) > 0.2


# --- Rigs --------------------------------------------------------------------------------------


def test_a_height_is_the_speed_at_contact():
    rig = RIG.completed([ELLIPSE])
    values = rig.draw(64, 0)
    drops, good = states([ELLIPSE], torch.zeros(64, dtype=torch.long), values, seeded())
    torch.testing.assert_close(settings_of(drops)["height"], values["height"][good], **ROUNDING)
    torch.testing.assert_close(drops.q[:, 2], values["theta"][good], **ROUNDING)
    torch.testing.assert_close(drops.q[:, 1], -drops.r[:, 1], **ROUNDING)


def test_tilt_and_turns_are_a_pose_in_space():
    angles = {"theta": ANGLE, "heading": ANGLE, "turn": ANGLE}
    rig = Rig(limits={"height": HEIGHT, **angles, "w_x": SPIN}).completed([CUBE])
    values = rig.draw(64, 0)
    drops, good = states([CUBE], torch.zeros(64, dtype=torch.long), values, seeded())
    R, tilt, heading = rotation(drops.q[:, 3:]), values["theta"][good], values["heading"][good]
    torch.testing.assert_close(R[:, 2, 2], tilt.cos(), **ROUNDING)  # of the body's z axis
    expected = torch.stack((heading.cos() * tilt.sin(), heading.sin() * tilt.sin()), -1)
    torch.testing.assert_close(R[:, :2, 2], expected, **ROUNDING)
    assert (drops.v_c[:, 2] < 0).all()


def test_settings_are_reached_with_their_spread():
    rig = Rig(limits={"height": HEIGHT, "omega": SPIN, "x": Limits(low=0.1, high=0.3, settable=False)})
    values = {name: torch.full((4000,), x, dtype=torch.float64) for name, x in (("height", 0.3), ("omega", 20.0))}
    found = rig.reached(values, seeded())
    assert found["height"].std().item() == pytest.approx(0.002, rel=0.05)
    assert found["omega"].std().item() == pytest.approx(2.0, rel=0.05)
    assert found["x"].min() >= 0.1
    assert found["x"].max() <= 0.3
    assert found["x"].mean().item() == pytest.approx(0.2, abs=0.005)


DISC = Specimen(mass=0.05, inertia=1e-5, shape=cl.shapes.Disc(0.02))
REFUSED = {
    "nothing to set": (ELLIPSE, {"x": Limits(low=0, high=1, settable=False)}, "the rig can set nothing"),
    "one value": (ELLIPSE, {"height": Limits(low=0.2, high=0.2)}, "the rig can set nothing"),
    "all alike": (DISC, {"height": Limits(low=0.2, high=0.2), "theta": ANGLE}, "every contact within the limits is"),
    "upwards": (ELLIPSE, {"v_y": Limits(low=1.0, high=2.0)}, "the limits contradict the body"),
    "lifting": (ELLIPSE, {"height": Limits(low=0, high=1e-4), "omega": Limits(low=900, high=999)}, "contradict"),
    "two speeds": (ELLIPSE, {"height": HEIGHT, "v_y": Limits(low=-2, high=-1)}, "height and v_y say the same"),
    "no speed": (ELLIPSE, {"omega": SPIN}, "must state its height"),
    "below": (ELLIPSE, {"height": Limits(low=-0.1, high=0.1)}, "height must be at least 0 m"),
    "misspelt": (ELLIPSE, {"hight": HEIGHT}, "did you mean 'height'"),
    "of space": (ELLIPSE, {"height": HEIGHT, "w_x": SPIN}, "unknown setting of a rig 'w_x'"),
    "noise": (CUBE, {"height": HEIGHT}, "noise must have 6 numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_rig_is_refused_in_one_line(case):
    body, settings, message = REFUSED[case]
    with pytest.raises(cl.ContactLearnError, match=message) as caught:
        cl.plan(body, Rig(limits=settings, noise=(0.01, 0.01, 0.3) if case == "noise" else ()))
    assert "\n" not in str(caught.value)


def test_limits_that_are_none():
    for values in ({"low": 2.0, "high": 1.0}, {"low": math.nan, "high": 1.0}, {"low": 0.0, "high": 1.0, "cost": -1.0}):
        with pytest.raises(DataError, match="must be"):
            Limits(**values)
    with pytest.raises(DataError, match="shape of body must be known"):
        Specimen(mass=0.1, inertia=1e-5, shape=None)
    with pytest.raises(cl.ContactLearnError, match="goal must be one of names, parameters, prediction"):
        cl.plan(ELLIPSE, RIG, goal="nams")


# --- Batches -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def first():
    return cl.plan(ELLIPSE, RIG, count=12)


def test_a_first_design_keeps_the_limits_and_is_its_seed_s(first):
    assert len(first.drops) == 12
    for drop in first.drops:
        assert {*drop.settings} == {"height", "theta", "omega"}
        assert all(RIG.limits[name].low <= x <= RIG.limits[name].high for name, x in drop.settings.items())
    assert {drop.purpose for drop in first.drops} == {Purpose.EFFECTS, Purpose.SPACE}
    assert first.drops == cl.plan(ELLIPSE, RIG, count=12).drops
    assert first.budget == 400
    assert (first.stop, first.looks, first.possibilities) == (None, (), ())
    assert from_json(Plan, to_json(first)) == first


@pytest.mark.nightly
def test_a_first_design_separates_effects_better_than_random_drops():
    """About a law at (μ, ε) of which the design knows nothing: each effect from the rival that is nearest to it."""
    placed = replace(RIG, limits=RIG.limits | {"x": Limits(low=0.08, high=0.5, settable=False)})
    rig, law = placed.completed([ELLIPSE]), cl.ContactModel(cl.laws.find("wang_mason").at(0.25, 0.55))
    unit = torch.rand(80, len(rig.limits), generator=seeded(5), dtype=torch.float64)
    values = {n: one.low + (one.high - one.low) * unit[:, k] for k, (n, one) in enumerate(rig.limits.items())}
    cloud, _ = states([ELLIPSE], torch.zeros(80, dtype=torch.long), values, seeded())
    planned = cl.plan(ELLIPSE, placed, count=20).drops
    values = {n: torch.tensor([drop.settings[n] for drop in planned], dtype=torch.float64) for n in planned[0].settings}
    made, _ = states([ELLIPSE], torch.zeros(20, dtype=torch.long), rig.reached(values, seeded()), seeded())
    noise = torch.tensor((0.01, 0.01, 0.3), dtype=torch.float64).square().diag()
    effects = {name: effect.prepare(cloud) for name, effect in visible(cloud)[0].items()}

    def nearest(drops):
        about = Candidates.about(law, effects, cloud, noise.expand(80, -1, -1), drops, noise)
        one = EffectSeparation.of(about, repeats=1)
        return torch.where(one.rival, one.squared(), torch.inf).amin(0)[one.weight > 0]

    random = torch.stack([nearest(cloud[20 * k : 20 * k + 20]) for k in range(3)]).mean(0)
    ratio = nearest(made) / random
    assert ratio.median().item() > 2.1  # 2.4; 1.9 of a design that is D-optimal for all effects together
    assert ratio.quantile(0.25).item() > 1.4  # 1.5 and 1.25


def test_what_is_costly_to_change_is_changed_less(first):
    def levels(plan):
        heights = [drop.settings["height"] for drop in plan.drops]
        return len({*heights}), sum(a != b for a, b in pairwise(heights))

    costly = cl.plan(ELLIPSE, replace(RIG, limits=RIG.limits | {"height": replace(HEIGHT, cost=10.0)}), count=12)
    assert levels(costly)[0] <= 3 < levels(first)[0]
    assert levels(costly)[1] == levels(costly)[0] - 1


def test_effects_that_no_drop_shows_are_named():
    """Without spin and sideways speed a disc never slips, and at one place none of the floor is the other."""
    still = cl.plan(DISC, Rig(limits={"height": HEIGHT}), count=4).hidden
    moving = cl.plan(
        DISC, Rig(limits={"height": HEIGHT, "omega": SPIN, "x": Limits(low=0.0, high=0.5)}), count=4
    ).hidden
    effects = {"directional_friction", "rolling_resistance", "spin_damping", "location_dependent_restitution"}
    assert effects <= {*still}
    assert not effects & {*moving}
    assert {"velocity_dependent_restitution", "parameter_drift"}.isdisjoint(still)


@pytest.mark.nightly
def test_in_space_a_plan_turns_the_body():
    settings = {"height": HEIGHT, "theta": Limits(low=0.0, high=1.5), "turn": ANGLE, "w_x": SPIN}
    plan = cl.plan(CUBE, Rig(limits=settings), count=8)
    assert plan.space == "space"
    assert {*plan.drops[0].settings} == {*settings}
    measured = cl.simulation.synthetic.load(30)
    with pytest.raises(cl.ContactLearnError, match="unknown setting of a rig"):
        cl.plan(measured, Rig(limits=settings))


@pytest.fixture(scope="module")
def diagnosed():
    """A laboratory with a known effect, 60 random drops in it, and their diagnosis."""
    laboratory = Laboratory.of(11, effects=("side_drag",))
    body = Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape)
    rig = RIG.completed([body])
    values = rig.draw(60, 1)
    drops, _ = states([body], torch.zeros(60, dtype=torch.long), rig.reached(values, seeded()), seeded())
    impacts, _ = laboratory.measured(drops.replace(order=torch.arange(1.0, len(drops) + 1)), seeded())
    candidates = {kind.id: kind() for name in ("side_drag", "gravity_impulse") for kind in cl.effects.catalogue()[name]}
    options = cl.DiagnoseOptions(candidates=candidates, laws=[cl.laws.find("wang_mason")])
    return cl.diagnose(impacts, options=options)


def test_a_plan_from_a_diagnosis_has_a_forecast(diagnosed):
    plan = cl.plan(diagnosed, RIG, count=8)
    forecast = plan.forecast
    assert plan.looks[-1].trials == len(diagnosed.record.impacts)
    assert 1 - sum(one.probability for one in plan.possibilities if one.effects == ("side_drag",)) > 0.05
    assert plan.possibilities[0].effects == diagnosed.effects == ("side_drag",)
    assert sum(one.probability for one in plan.possibilities) == pytest.approx(1)
    assert forecast.drops[:2] == (0, 8)
    assert forecast.right_name[0] == pytest.approx(plan.possibilities[0].probability)
    assert all(b > a - MONTE_CARLO for a, b in pairwise(forecast.right_name))
    assert all(one.error_after < one.error for one in forecast.parameters)
    assert [one.name for one in forecast.parameters][:2] == ["mu", "eps"]


@pytest.mark.nightly
def test_a_plan_from_a_diagnosis_in_space():
    """Of tosses of a box without any effect: what is in question is whether one is missing."""
    candidates = {kind.id: kind() for kind in (cl.effects.find_effect(name) for name in ("inertia_error", "adhesion"))}
    options = cl.DiagnoseOptions(candidates=candidates, laws=[cl.laws.find("wang_mason")])
    found = cl.diagnose(box_tosses(0.25, 0.6, noise=0.01, count=40), options=options)
    plan = cl.plan(found, Rig(limits={"height": HEIGHT, "theta": Limits(low=0.0, high=1.5), "turn": ANGLE}), count=6)
    assert {*plan.drops[0].settings} == {"height", "theta", "turn"}
    assert [one.name for one in plan.forecast.parameters] == ["mu", "eps"]
    assert plan.possibilities[0].effects == found.effects == ()


def test_settings_are_at_the_limits_of_all_but_angles():
    values = RIG.draw(600, 0, beyond=0.25)
    for name, one in RIG.limits.items():
        if one.settable:
            for limit in (one.low, one.high):
                share = (values[name] == limit).double().mean().item()
                assert share == pytest.approx(1 / 6, abs=0.02) if name != "theta" else share < 0.02


@pytest.mark.parametrize("goal", ["parameters", "prediction"])
def test_planned_drops_tell_more_than_random_ones(diagnosed, goal):
    """Of the parameters by the standard errors of a fit to drops that are really made, and of predictions."""
    planned = cl.plan(diagnosed, RIG, count=20, goal=goal)
    assert {drop.purpose for drop in planned.drops} == {Purpose(goal), Purpose.SPACE}
    laboratory = Laboratory.of(11, effects=("side_drag",))
    body = Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape, name="ellipse")
    rig, model = RIG.completed([body]), diagnosed.model

    def nats(drops):
        made = carry_out(rig, drops, [body], laboratory, generator=seeded(3))
        fit = cl.fit(made, model.law, model.effects)
        return -torch.logdet(fit.covariance).item() / 2

    random = []
    for seed in range(3):
        values = rig.draw(20, 100 + seed)
        rows = [{name: values[name][k].item() for name in RIG.limits} for k in range(20)]
        random.append(nats([replace(planned.drops[0], settings=row) for row in rows]))
    if goal == "parameters":
        assert nats(planned.drops) > max(random)
    assert planned.forecast.error[1] < planned.forecast.error[0]


def test_twins_are_separated_by_fewer_drops():
    """Rolling resistance and spin damping differ where the spin is high and the drop low, or the reverse."""
    law, drops = cl.laws.find("wang_mason").at(0.12, 0.55), cl.simulation.synthetic.load(200, seed=3)
    noise = torch.tensor([0.01, 0.01, 0.5], dtype=torch.float64)
    damped = cl.ContactModel(law, effects={"spin_damping": cl.effects.find_effect("spin_damping")().at([0.015])})
    drops = drops.replace(v_post=damped.predict(drops).v_post + noise * numbers(200, 3))
    twins = [cl.fit(drops, law, [name]).model for name in ("spin_damping", "rolling_resistance")]
    rig = Rig(limits={"height": HEIGHT, "omega": SPIN, "theta": ANGLE}).completed(Specimen.of(drops))
    values = rig.draw(256, 0)
    after, _ = states(Specimen.of(drops), torch.zeros(256, dtype=torch.long), values, seeded())
    one = discriminations(drops, twins[0], {"rival": twins[1]}, after)["rival"]
    batch = replace(
        names_of(),
        pairs=replace(one, difference=one.difference[None], slope=one.slope[None], covariance=one.covariance[None]),
        same=torch.tensor([False]),
        probability=torch.tensor([0.5, 0.5], dtype=torch.float64),
        evidence=torch.zeros(1, dtype=torch.float64),
        repeats=1,
    )
    random = batch
    for _ in range(10):
        batch = batch.after(int(batch.gain().argmax()))
    for k in torch.randperm(len(after), generator=seeded())[:10].tolist():
        random = random.after(k)
    assert batch.evidence.item() > 2 * random.evidence.item()


# --- Laboratories and looks --------------------------------------------------------------------


def test_the_laboratory_of_a_seed_hides_what_its_drops_hide():
    for names in (("surface_tilt",), ("parameter_drift", "side_drag")):
        drops, truth = draw(5, effects=names, noise=0.0)
        found, good = Laboratory.of(5, effects=names, noise=0.0).measured(drops, seeded())
        assert good.all()
        torch.testing.assert_close(found.v_post, torch.tensor(truth["v_post"], dtype=torch.float64), **ROUNDING)


def test_planned_drops_are_made_in_their_order(first):
    laboratory = Laboratory.of(7)
    body = Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape)  # named as of the plan
    rig = RIG.completed([body])
    made = carry_out(rig, first.drops, [body], laboratory, generator=seeded(), first=21)
    assert made.trial == tuple(str(k) for k in range(21, 33))
    wanted = torch.tensor([drop.settings["theta"] for drop in first.drops], dtype=torch.float64)
    assert ((made.q[:, 2] - wanted).abs() < 5 * ANGLE.precision).all()
    assert (made.q[:, 2] != wanted).all()
    with pytest.raises(DataError, match="drop 1: no body is called 'cube'"):
        carry_out(rig, [replace(first.drops[0], body="cube")], [body], laboratory, generator=seeded())
    bare = replace(first.drops[0], settings={"height": 0.2, "theta": 0.0})
    with pytest.raises(DataError, match="drop 1: the plan must state omega"):
        carry_out(rig, [bare], [body], laboratory, generator=seeded())


def test_the_engine_is_a_laboratory_too():
    """A drop without noise and damping has the restitution of its contact."""
    engine = pytest.importorskip("mujoco") and cl.simulation.mujoco
    bench = engine.Bench(
        kind="ellipse", semi_axes=(0.035, 0.025), mass=0.05, mu=0.1, eps=0.6, contact_time=2e-4, hidden=engine.Hidden()
    )
    laboratory = engine.EngineLaboratory(bench=bench, sigma=torch.zeros(3, dtype=torch.float64))
    body = Specimen(mass=bench.mass, inertia=bench.nominal_inertia, shape=bench.body, name="ellipse")
    rig = RIG.completed([body])
    plan = cl.plan(body, RIG, count=8)
    made = carry_out(rig, plan.drops, [body], laboratory, generator=seeded())
    assert len(made) == 8
    after = made.v_post[:, 1] + made.r[:, 0] * made.v_post[:, 2]  # v_n of the contact point
    assert (after / -made.v_c[:, 1]).median().item() == pytest.approx(0.6, abs=0.05)


def look(found="", probable="", gain=0.5, trials=40):
    return Look(trials=trials, found=tuple(found.split()), probable=tuple(probable.split()), gain=gain)


STOPS = {
    "first look": ([look("a")], None),
    "the same twice": ([look("a"), look("a")], Stop.SETTLED),
    "another one": ([look("a"), look("b")], None),
    "one more": ([look("a"), look("a b")], None),
    "a probable one": ([look("a"), look("a", "b")], None),
    "nothing, and little to gain": ([look(gain=0.0), look(gain=0.0)], Stop.NO_GAIN),
    "nothing yet": ([look(gain=0.1), look(gain=0.0)], None),
    "used up": ([look("a", trials=395)], Stop.BUDGET),
}


@pytest.mark.parametrize("case", STOPS)
def test_a_sequence_ends_by_the_rule(case):
    looks, stop = STOPS[case]
    assert decide(Goal.NAMES, looks, 400, 20) is stop


def test_a_plan_goes_on_from_many_impacts():
    """By default beyond what was measured before the first plan, and no further than that."""
    for trials, stop in (([500], None), ([500, 597], Stop.BUDGET)):
        plan = cl.plan(ELLIPSE, RIG, count=4, looks=[look("a", "b", trials=n) for n in trials])
        assert (plan.budget, plan.stop) == (600, stop)


# --- The commands ------------------------------------------------------------------------------

MYSTERY = ("data=mystery", "data.seed=7", "data.size=40")
LIMITS = (
    "rig.height=[0.05,0.5]",
    "rig.theta={low: -3.14, high: 3.14, precision: 0.035}",
    "rig.omega={low: -30, high: 30, share: 0.1}",
)


def test_a_loop_of_commands(tmp_path):
    """Plan, measure, change a drop by hand, diagnose, plan from it: the looks and the rig go on."""
    said = run("contactlearn", "plan", *MYSTERY, *LIMITS, "count=22", "-o", "one", cwd=tmp_path, figures=True)
    assert "22 drops for a first design" in said
    assert said.endswith(f"\nnext: contactlearn measure one {' '.join(MYSTERY)} -o drops.csv\n")
    assert {path.name for path in (tmp_path / "one").iterdir()} == {
        "plan.csv", "plan.json", "plan.png", "plan.pdf", "plan.html"
    }  # fmt: skip
    table = pd.read_csv(tmp_path / "one" / "plan.csv")
    assert [*table] == ["drop", "body", "height [mm]", "theta [°]", "omega [rad/s]", "for"]
    table.loc[0, "theta [°]"] = 12.5
    table.to_csv(tmp_path / "one" / "plan.csv", index=False)
    said = run("contactlearn", "measure", "one", *MYSTERY, "-o", "drops.csv", cwd=tmp_path)
    assert "22 drops measured, 22 impacts in drops.csv" in said
    drops = cl.read_table(tmp_path / "drops.csv")
    assert drops.q[0, 2].item() == pytest.approx(math.radians(12.5), abs=5 * 0.035)
    shape = re.search(r"'(data.shape=.*)'", said)[1]
    words = ("data=table", "data.path=drops.csv", shape, "hydra.run.dir=run")
    run("diagnose.py", *words, cwd=tmp_path)
    said = run("contactlearn", "plan", "run", "after=one", "count=6", "budget=27", "-o", "two", cwd=tmp_path)
    used = "the budget is used up: 6 drops beyond the 22 impacts measured exceed its 27"
    assert said.startswith(f"stop: {used}\n")  # and nothing is forecast of drops that are not to be made
    assert "two/plan.csv, if you want to go on all the same\n" in said
    assert not re.search("drops for|expected|pay|next:", said)
    page = (tmp_path / "two" / "plan.html").read_text("utf-8")
    assert f"Stop: {used}" in page
    assert "If you want to go on all the same" in page
    assert "expected to tell" not in page
    assert page.count('<tr><th scope="row">') >= 6
    two = from_json(Plan, (tmp_path / "two" / "plan.json").read_bytes())
    assert two.rig.keys() >= {"height", "theta", "omega"}
    assert [one.trials for one in two.looks] == [22]
    said = run("contactlearn", "measure", "two", *MYSTERY, "-o", "drops.csv", cwd=tmp_path)
    assert "note" not in said
    assert "6 drops measured, 28 impacts in drops.csv" in said
    assert cl.read_table(tmp_path / "drops.csv").trial == tuple(str(k) for k in range(1, 29))
    for name, trials in (("one", "1 to 22"), ("two", "23 to 28")):
        said = run("contactlearn", "measure", name, *MYSTERY, "-o", "drops.csv", cwd=tmp_path, status=2)
        assert f"drops.csv holds the drops of {name} already, as trials {trials};" in said


@pytest.mark.nightly
def test_a_plan_from_a_run_in_a_laboratory_is_measured_there(tmp_path):
    run("diagnose.py", *MYSTERY, "law=mirtich", "seconds=3", "hydra.run.dir=run", cwd=tmp_path)
    said = run("contactlearn", "plan", "run", *LIMITS, "count=4", "-o", "two", cwd=tmp_path)
    assert said.endswith(f"\nnext: contactlearn measure two {' '.join(MYSTERY)} -o drops.csv\n")


def test_a_plan_for_measured_impacts_of_a_table(tmp_path):
    cl.data.table.save(cl.simulation.synthetic.load(40), tmp_path / "drops.csv")
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    words = ("data=table", "data.path=drops.csv", shape, "rig.v_y=[-3,-1]", "count=4")
    said = run("contactlearn", "plan", *words, cwd=tmp_path)
    assert "by chance" in said  # what is not named is drawn as it was measured
    assert "v_x" in said
    assert said.endswith(f"\nnext: contactlearn diagnose {shlex.join(words[:3])}\n")


BODY = "body={mass: 0.05, shape: {kind: disc, radius: 0.02}}"
WRONG = {
    "no body": (("rig.height=[0.1,0.2]",), "got none of them"),
    "two": ((BODY, *MYSTERY), "got body and data"),
    "no run": (("nowhere",), "nowhere: holds no diagnosis"),
    "no limits": ((BODY,), "the rig can set nothing"),
    "alike": ((BODY, "rig.theta=[-1,1]", "rig.height=[0.2,0.2]"), "every contact within the limits is alike"),
    "order": ((BODY, "rig.height=[0.5,0.1]"), "rig.height must be [low, high] in order"),
    "entries": ((BODY, "rig.height={low: 0.1, hihg: 0.5}"), "rig.height must be [low, high], or {low:"),
    "misspelt entry": ((BODY, "rig.height={low: 0.1, high: 0.5, presicion: 0.1}"), "did you mean 'precision'"),
    "misspelt": ((BODY, "rig.hight=[0.1,0.5]"), "did you mean 'height'"),
    "setting": ((BODY, "rigg.height=[0.1,0.5]"), "unknown setting 'rigg', did you mean 'rig'"),
    "goal": ((BODY, "goal=name"), "did you mean 'names'"),
    "mass": (("body={shape: {kind: disc, radius: 0.02}}",), "body.mass"),
    "shape": (("body={mass: 0.1}",), "body.shape must be given"),
    "entry": (("body={mass: 0.1, shpae: 3}",), "did you mean 'shape'"),
    "after": ((BODY, "after=nowhere"), "nowhere: holds no plan.json"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_plan_is_one_line(case, tmp_path):
    words, message = WRONG[case]
    said = run("contactlearn", "plan", *words, cwd=tmp_path, status=2)
    assert message in said
    assert len(said.strip().splitlines()) == 1
    assert not [*tmp_path.iterdir()]


def test_a_body_is_another_by_its_mass_alone():
    mine, other = (SimpleNamespace(moments=(mass, 3e-5)) for mass in (0.05, 0.06))
    assert not [*_other_body({"the plan": mine.moments, "a table": None}, mine)]
    (said,) = _other_body({"the plan": other.moments}, mine)
    assert said == "the plan is for another body, of 0.06 kg, 3e-05 kg m²: the laboratory's has 0.05 kg, 3e-05 kg m²"


def test_drops_at_half_a_turn_are_there_already():
    """−π and π are one angle."""
    drops = cl.simulation.synthetic.load(6)
    sign = torch.tensor((1, -1, 1, -1, 1, -1), dtype=torch.float64)
    drops = drops.replace(q=torch.cat((drops.q[:, :2], 3.141 * sign[:, None]), 1), validate=False)
    planned = [SimpleNamespace(settings={"theta": 3.141}) for _ in drops.trial[:4]]
    plan = SimpleNamespace(rig={"theta": Limits(low=-3.14, high=3.14, precision=0.01)})
    assert _measured_already(planned, plan, drops) == ("1", "4")


def test_a_wrong_measurement_is_one_line(tmp_path):
    run("contactlearn", "plan", *MYSTERY, *LIMITS, "count=4", "-o", "one", cwd=tmp_path)
    path, table = tmp_path / "one" / "plan.csv", pd.read_csv(tmp_path / "one" / "plan.csv")
    said = run("contactlearn", "measure", "one", "data=mujoco", "-o", "other.csv", cwd=tmp_path)
    assert "4 drops measured, 4 impacts in other.csv" in said
    assert "the plan is for another body, of" in said
    said = run("contactlearn", "measure", "one", "data=mujoco", "-o", "other.csv", "--again", cwd=tmp_path)
    assert "4 drops measured, 8 impacts in other.csv" in said
    assert "other.csv is for another body" not in said
    run("contactlearn", "measure", "one", "data=mystery", "data.seed=8", "-o", "eight.csv", cwd=tmp_path)
    said = run("contactlearn", "measure", "one", *MYSTERY, "-o", "eight.csv", "--again", cwd=tmp_path)
    assert "eight.csv is for another body, of" in said
    assert "the plan is for another body" not in said
    for words, message in (
        (
            ("one", *MYSTERY, "--again", "-o", "other.csv"),
            "other.csv is of another laboratory: only one of the two has",
        ),
        (("one", "data=synthetic"), "in the laboratory of data=mystery"),
        (("none", *MYSTERY), "none: holds no plan.json"),
        (("one", "data=mystery"), "data=mystery needs a seed, such as data.seed=7"),
    ):
        out = () if "-o" in words else ("-o", "drops.csv")
        assert message in run("contactlearn", "measure", *words, *out, cwd=tmp_path, status=2)
    table.astype({"theta [°]": str}).replace({"theta [°]": {str(table.loc[1, "theta [°]"]): "up"}}).to_csv(
        path, index=False
    )
    said = run("contactlearn", "measure", "one", *MYSTERY, "-o", "drops.csv", cwd=tmp_path, status=2)
    assert "row 2, column theta [°]: must be a number" in said
    table.drop(columns="omega [rad/s]").to_csv(path, index=False)
    said = run("contactlearn", "measure", "one", *MYSTERY, "-o", "drops.csv", cwd=tmp_path, status=2)
    assert "omega [rad/s]" in said


def test_means_of_what_further_drops_vary_are_no_part_of_the_next_command():
    data = ["data=oak", "data.correct=[averaged_omega]"], ["data=oak", "data.correct=[mirrored_x,averaged_vx]"]
    said = [_next_command("contactlearn.data.table.load", Path("plans"), words) for words in data]
    assert said == ["contactlearn diagnose data=oak", "contactlearn diagnose data=oak 'data.correct=[mirrored_x]'"]
