"""What remains and depends on the state of each trial: false statements, power, what is named, and what is said."""

import math
from dataclasses import replace

import pytest
import torch
from diagnoses import few, made_up, remainder
from drops import LAW, NOISE, fitted, normal, rough, thrown
from repetitions import repeated

from contactlearn import diagnose, laws
from contactlearn.diagnosis.result import Coefficient, Diagnosis, StateDependence, VariableShare, Verdict
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.state_dependence import (
    find_state_dependence,
    screen_state_associations,
    state_variables,
)
from contactlearn.effects import State, find_effect
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.models.contact_model import predict_with
from contactlearn.report.events import show_verdict
from contactlearn.report.page.effects import residual_content
from contactlearn.report.text import headline, phrase, phrases

OPTIONS = FitOptions()


def dependence_of(drops, fit, best=None, thresholds=None):
    return find_state_dependence(drops, fit, fit if best is None else best, OPTIONS, thresholds or Thresholds())


def by_direction_and_angle(drops):
    state = State.of(drops)
    return 0.1 * state.v_t.sign() * (2 * state.theta).sin()


def by_spin_with_slip(drops):
    state = State.of(drops)
    return 0.05 * (state.v_t * state.omega).sign()


def symbols(found):
    return {one.symbol for one in found.variables}


def test_terms_are_residuals_times_what_least_squares_leaves_of_the_functions():
    drops, fit = fitted(150, 4)
    scores, functions = Scores.of_state(drops, fit, OPTIONS), normal(150, 3, seed=1)
    change, reach = scores.slope[..., 1], scores.reach.flatten(0, 1)
    columns = (change[..., None] * functions[:, None]).flatten(0, 1)
    left = columns - reach @ torch.linalg.lstsq(reach, columns).solution
    expected = (left.unflatten(0, (150, -1)) * scores.residual[..., None]).sum(1)
    torch.testing.assert_close(scores.terms(change, functions), expected)


@pytest.mark.parametrize("runs", repeated(25, 60))
def test_false_statements_are_as_rare_as_the_level(runs):
    """Heavy tails and a scatter that differs from trial to trial; three standard deviations of a count."""
    level, chances = 0.1, []
    for seed in range(runs):
        drops, fit = fitted(120, 100 * seed, errors=rough)
        scores = Scores.of_state(drops, fit, OPTIONS)
        chances.append(screen_state_associations(scores, state_variables(drops[scores.rows]), level)[0])
    assert sum(p <= level for p in chances) <= runs * level + 3 * math.sqrt(runs * level * (1 - level))
    assert sum(chances) / runs > 0.35


@pytest.mark.parametrize(("change", "coefficient", "named"), [
    ({"friction": by_direction_and_angle}, Coefficient.FRICTION, {"vt", "theta"}),
    ({"restitution": by_spin_with_slip}, Coefficient.RESTITUTION, {"vt", "omega"}),
], ids=["direction and angle", "spin with slip"])  # fmt: skip
def test_a_product_of_two_inputs_is_found(change, coefficient, named):
    drops, fit = fitted(300, 1, **change)
    found = dependence_of(drops, fit)
    assert found is not None
    assert found.coefficient is coefficient
    assert symbols(found) == named
    assert found.large
    mixed = torch.randperm(len(drops), generator=torch.Generator().manual_seed(0))
    lost = drops.replace(q=drops.q[mixed], r=drops.r, v_pre=drops.v_pre, validate=False)
    if "theta" in named:  # the angles of other trials tell nothing
        assert (again := dependence_of(lost, fit)) is None or "theta" not in symbols(again)


def test_no_dependence_is_found_in_noise():
    drops, fit = fitted(300, 3)
    assert dependence_of(drops, fit) is None
    assert dependence_of(drops[:30], fit) is None
    drops, _ = fitted(300, 2)
    curtain = 0.3 * (drops.q[:, :1] - drops.q[:, 0].median()).clamp_min(0)
    pushed = drops.replace(v_post=drops.v_post - curtain * torch.tensor((1.0, 0.0, 20.0)))
    found = dependence_of(pushed, identify_jointly(LAW, {}, pushed))
    assert found is not None
    assert found.coefficient is None
    assert symbols(found) == {"x"}
    drops, fit = fitted(300, 1, restitution=by_spin_with_slip)
    thresholds = Thresholds()
    more = replace(thresholds, least_gain=0.9)
    found = dependence_of(drops, fit, thresholds=more)
    assert found is not None
    assert not found.large
    never = replace(thresholds, dependence_level=0.0)
    assert dependence_of(drops, fit, thresholds=never) is None


def test_a_better_model_of_known_effects_explains_it():
    """An effect that is too small for a name is no unknown physics."""
    drops = thrown(250, 4)
    tilted = {"surface_tilt": find_effect("surface_tilt")().prepare(drops).at(torch.tensor([0.03]))}
    values = torch.stack([x.expand(len(drops)) for x in LAW.coefficients], -1)
    outcome = predict_with(LAW, drops, values, tilted).v_post
    drops = drops.replace(v_post=outcome + NOISE * normal(len(drops), 3, seed=4))
    alone = identify_jointly(LAW, {}, drops)
    assert dependence_of(drops, alone) is not None
    assert (
        dependence_of(drops, alone, identify_jointly(LAW, {"surface_tilt": find_effect("surface_tilt")()}, drops))
        is None
    )


@pytest.fixture(scope="module")
def striped():
    """Drops whose restitution has stripes in x."""

    def stripes(drops):
        x = drops.q[:, 0]
        return 0.12 * (12 * math.pi * (x - x.min()) / (x.max() - x.min())).sin().sign()

    return fitted(400, 6, restitution=stripes)


@pytest.mark.parametrize(
    "name",
    repeated("location_dependent_restitution", "location_dependent_friction", "orientation_dependent_restitution"),
)
def test_another_form_of_an_effect_of_the_model_is_not_unknown(name, striped):
    """Stripes in x are no polynomial of x, but the same dependence; they are unknown to a model without it."""
    drops, form_of = striped[0], "location_dependent_restitution" if name == "location_dependent_restitution" else None
    found = dependence_of(drops, identify_jointly(LAW, {name: find_effect(name)()}, drops))
    assert found is not None
    assert (found.coefficient, symbols(found), found.form_of) == (Coefficient.RESTITUTION, {"x"}, form_of)
    assert found.large == (form_of is None)
    known = "as in location-dependent restitution but with another functional form"
    assert (known in phrase("state_dependence", found)) == (form_of is not None)


def test_another_form_of_no_effect_is_unknown(striped):
    found = dependence_of(*striped)
    assert found is not None
    assert (found.coefficient, symbols(found), found.form_of) == (Coefficient.RESTITUTION, {"x"}, None)
    assert found.large


def test_one_of_two_bodies_is_named():
    drops = thrown(400, 5)
    second = torch.arange(len(drops)) % 2 == 1
    names = tuple("egg" if one else "pebble" for one in second.tolist())
    drops = drops.replace(object=names, mass=torch.where(second, 2.0, 1.0) * drops.mass)
    values = torch.stack([x.expand(len(drops)) for x in LAW.coefficients], -1).clone()
    values[:, 1] += 0.08 * second * State.of(drops).theta.cos()
    drops = drops.replace(v_post=predict_with(LAW, drops, values).v_post + NOISE * normal(len(drops), 3, seed=5))
    found = dependence_of(drops, identify_jointly(LAW, {}, drops))
    assert found is not None
    assert found.coefficient is Coefficient.RESTITUTION
    assert symbols(found) == {"theta", "object"}
    assert "θ" in phrase("state_dependence", found)
    assert "the body" in phrase("state_dependence", found)


def test_errors_of_v_pre_are_no_physics():
    """Trials that begin alike but for the errors of their measurement."""
    for seed in range(4):
        drops = thrown(300, seed)
        drops = drops.replace(v_pre=torch.tensor((0.8, -2.0, 3.0)).expand(len(drops), 3), validate=False)
        values = torch.stack([x.expand(len(drops)) for x in LAW.coefficients], -1)
        exact = predict_with(LAW, drops, values).v_post
        measured = drops.v_pre + NOISE * normal(len(drops), 3, seed=10 + seed)
        drops = drops.replace(v_pre=measured, v_post=exact + NOISE * normal(len(drops), 3, seed=20 + seed))
        scores = Scores.of_state(drops, identify_jointly(LAW, {}, drops), OPTIONS)
        assert screen_state_associations(scores, state_variables(drops[scores.rows]), 0.005)[1] == ()


def test_neighbours_that_resemble_each_other_have_one_sign():
    """Errors and a place that are the same for eight trials in turn: chance alone, seen as such by signs of blocks."""
    found = {1: 0, 8: 0}
    for seed in range(5):
        drops, _ = fitted(320, seed, errors=lambda n, seed: normal(n, 3, seed=seed)[torch.arange(n) // 8])
        state = normal(len(drops), 1, seed=seed + 50)[torch.arange(len(drops)) // 8]
        fit = identify_jointly(LAW, {}, drops)
        for block in found:
            scores = Scores.of_state(drops, fit, OPTIONS, block)
            found[block] += bool(screen_state_associations(scores, {"x": state}, 0.005, block)[1])
    assert found[1] >= 4
    assert found[8] == 0


@pytest.mark.parametrize(
    "sets", repeated({"friction": by_direction_and_angle}, {}), ids=["direction and angle", "nothing"]
)
def test_a_diagnosis_reports_unknown_state_dependence(sets, capsys):
    drops, _ = fitted(200, 1, **sets)
    found = diagnose(drops, "wang_mason", candidates=few("spin_damping", "side_drag"), laws=[laws.find("wang_mason")])
    show_verdict(found, "", verbose=True)
    assert found.remainder is not None
    assert found.verdict is (Verdict.UNKNOWN if sets else Verdict.NONE)
    assert (found.remainder.state_dependence is not None) == bool(sets)
    message = "behaves like friction that depends on"
    assert (message in headline(found)) == bool(sets)
    assert (message in capsys.readouterr().out) == bool(sets)
    assert (message in residual_content(found.remainder, ())["text"]) == bool(sets)
    assert Diagnosis.from_json(found.to_json()) == found


def test_the_dependence_in_words():
    found = StateDependence(
        coefficient=Coefficient.FRICTION,
        variables=(VariableShare(symbol="vt", share=0.6), VariableShare(symbol="theta", share=0.4)), p_value=0.002,
        share=Interval(0.12, 0.08, 0.16), large=True,
    )  # fmt: skip
    assert phrase("state_dependence", found) == "the residual behaves like friction that depends on v_t together with θ"
    outcome = replace(found, coefficient=None, variables=found.variables[:1])
    assert phrase("state_dependence", outcome) == "the outcome depends on v_t in an unknown way"
    left = replace(remainder(Interval(0.01, -0.01, 0.03)), state_dependence=found)
    assert left.found
    assert left.unknown
    assert not left.predictable
    assert "reduces the held-out residual by 12\u00a0%" in phrases("residual", left)[-1]
    besides = replace(
        made_up(20, next(iter(all_candidates()))), verdict=Verdict.UNKNOWN, physics=Verdict.UNKNOWN, remainder=left
    )
    assert "missing as well" in headline(besides)
    assert "behaves like friction" in headline(besides)
