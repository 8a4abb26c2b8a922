"""What remains and follows the sequence, or depends on the state: false statements, power, names and words."""

import math
from dataclasses import replace

import pytest
import torch
from diagnoses import few, made_up, remainder
from drops import LAW, NOISE, fitted, normal, rough, seeded, thrown
from spatial import tossed

from contactlearn import diagnose, laws
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.result import (
    Coefficient,
    Diagnosis,
    LaggedVariable,
    SerialDependence,
    StateDependence,
    VariableShare,
    Verdict,
)
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.serial_dependence import (
    Memory,
    find_serial_dependence,
    histories,
    screen_associations,
)
from contactlearn.diagnosis.unexplained.state_dependence import (
    find_state_dependence,
    screen_state_associations,
    state_variables,
)
from contactlearn.effects import State, find_effect
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.models.contact_model import ContactModel, predict_with
from contactlearn.report.events import show_verdict
from contactlearn.report.page.effects import residual_content
from contactlearn.report.text.sentences import grounds, headline, phrase, phrases

OPTIONS = FitOptions()


def dependence_of(drops, fit, best=None, thresholds=None):
    return find_state_dependence(drops, fit, fit if best is None else best, OPTIONS, thresholds or Thresholds())


def by_direction_and_angle(drops):
    state = State.of(drops)
    return 0.1 * state.v_t.sign() * (2 * state.theta).sin()


def by_spin_with_slip(drops):
    state = State.of(drops)
    return 0.05 * (state.v_t * state.omega).sign()


def sawtooth(drops):
    return -0.12 * (drops.order.remainder(17) / 17 - 0.5)


def after_fast(drops):
    v_n = State.of(drops).v_n.abs()
    return -0.06 * torch.cat((v_n.new_zeros(1), v_n[:-1] - v_n.mean()))


def along_the_last(drops):
    way = State.of(drops).v_t.sign()
    return 0.05 * torch.cat((way.new_zeros(1), way[1:] * way[:-1]))


def symbols(found):
    return {one.symbol for one in found.variables}


def by_sequence(drops, fit):
    return Scores.of_sequence(drops, fit, OPTIONS), histories(drops, fit.model.predict(drops)), screen_associations


def by_state(drops, fit):
    scores = Scores.of_state(drops, fit, OPTIONS)
    return scores, state_variables(drops[scores.rows]), screen_state_associations


def test_terms_are_residuals_times_what_least_squares_leaves_of_the_functions():
    drops, fit = fitted(150, 4)
    scores, functions = Scores.of_state(drops, fit, OPTIONS), normal(150, 3, seed=1)
    change, reach = scores.slope[..., 1], scores.reach.flatten(0, 1)
    columns = (change[..., None] * functions[:, None]).flatten(0, 1)
    left = columns - reach @ torch.linalg.lstsq(reach, columns).solution
    expected = (left.unflatten(0, (150, -1)) * scores.residual[..., None]).sum(1)
    torch.testing.assert_close(scores.terms(change, functions), expected)


@pytest.mark.parametrize(("tested", "trials"), [(by_sequence, 140), (by_state, 120)])
def test_false_statements_are_as_rare_as_the_level(tested, trials):
    """Heavy tails and a scatter that differs from trial to trial; three standard deviations of a count."""
    level, chances = 0.1, []
    for seed in range(25):
        scores, variables, screen = tested(*fitted(trials, 100 * seed, errors=rough))
        chances.append(screen(scores, variables, level)[0])
    assert sum(p <= level for p in chances) <= 25 * level + 3 * math.sqrt(25 * level * (1 - level))
    assert sum(chances) / 25 > 0.35


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
    found = dependence_of(pushed, joint.fit(pushed, LAW))
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
    alone = joint.fit(drops, LAW)
    assert dependence_of(drops, alone) is not None
    assert dependence_of(drops, alone, joint.fit(drops, LAW, {"surface_tilt": find_effect("surface_tilt")()})) is None


@pytest.fixture(scope="module")
def striped():
    """Drops whose restitution has stripes in x."""

    def stripes(drops):
        x = drops.q[:, 0]
        return 0.12 * (12 * math.pi * (x - x.min()) / (x.max() - x.min())).sin().sign()

    return fitted(400, 6, restitution=stripes)


def test_another_form_of_an_effect_of_the_model_is_not_unknown(striped):
    """Stripes in x are no polynomial of x, but the same dependence; they are unknown to a model without it."""
    name = "location_dependent_restitution"
    found = dependence_of(striped[0], joint.fit(striped[0], LAW, {name: find_effect(name)()}))
    assert found is not None
    assert (found.coefficient, symbols(found), found.form_of) == (Coefficient.RESTITUTION, {"x"}, name)
    assert not found.large
    assert "as in location-dependent restitution but with another functional form" in phrase("state_dependence", found)


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
    found = dependence_of(drops, joint.fit(drops, LAW))
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
        scores = Scores.of_state(drops, joint.fit(drops, LAW), OPTIONS)
        assert screen_state_associations(scores, state_variables(drops[scores.rows]), 0.005)[1] == ()


def test_neighbours_that_resemble_each_other_have_one_sign():
    """Errors and a place that are the same for eight trials in turn: chance alone, seen as such by signs of blocks."""
    found = {1: 0, 8: 0}
    for seed in range(5):
        drops, _ = fitted(320, seed, errors=lambda n, seed: normal(n, 3, seed=seed)[torch.arange(n) // 8])
        state = normal(len(drops), 1, seed=seed + 50)[torch.arange(len(drops)) // 8]
        fit = joint.fit(drops, LAW)
        for block in found:
            scores = Scores.of_state(drops, fit, OPTIONS, block)
            found[block] += bool(screen_state_associations(scores, {"x": state}, 0.005, block)[1])
    assert found[1] >= 4
    assert found[8] == 0


@pytest.mark.parametrize(("of", "change", "message"), [
    ("serial_dependence", sawtooth, "friction changes periodically along the sequence"),
    ("state_dependence", by_direction_and_angle, "behaves like friction that depends"),
    ("state_dependence", None, "depends on"),
])  # fmt: skip
def test_a_diagnosis_reports_an_unknown_dependence(of, change, message, capsys):
    drops, _ = fitted(200, 1, friction=change)
    among = few("spin_damping", "side_drag", "parameter_drift")
    found = diagnose(drops, "wang_mason", options=DiagnoseOptions(candidates=among, laws=[laws.find("wang_mason")]))
    show_verdict(found, verbose=True)
    assert found.remainder is not None
    assert found.verdict is (Verdict.UNKNOWN if change else Verdict.NONE)
    assert (getattr(found.remainder, of) is not None) == bool(change)
    assert (message in headline(found)) == bool(change)
    assert (message in capsys.readouterr().out) == bool(change)
    assert (message in residual_content(found.remainder, ())["text"].lower()) == bool(change)
    assert Diagnosis.from_json(found.to_json()) == found


def test_a_state_dependence_in_words():
    found = StateDependence(
        coefficient=Coefficient.FRICTION,
        variables=(VariableShare(symbol="vt", share=0.6), VariableShare(symbol="theta", share=0.4)), p_value=0.002,
        share=Interval(0.12, 0.08, 0.16), large=True,
    )  # fmt: skip
    assert phrase("state_dependence", found) == "the residual behaves like friction that depends jointly on v_t and θ"
    outcome = replace(found, coefficient=None, variables=found.variables[:1])
    assert phrase("state_dependence", outcome) == "the outcome depends on v_t, in an unknown form"
    left = replace(remainder(Interval(0.01, -0.01, 0.03)), state_dependence=found)
    assert left.found
    assert left.unknown
    assert not left.predictable
    assert "reduces the held-out residual by 12\u00a0%" in phrases("residual", left)[-1]
    besides = replace(
        made_up(20, next(iter(all_candidates()))), verdict=Verdict.UNKNOWN, physics=Verdict.UNKNOWN, remainder=left
    )
    assert "missing as well" in headline(besides)
    assert any("behaves like friction" in one for one in grounds(besides))


@pytest.mark.parametrize(("change", "coefficient", "followed"), [
    ({"friction": sawtooth}, Coefficient.FRICTION, {LaggedVariable.PERIOD, LaggedVariable.ORDER}),
    ({"restitution": after_fast}, Coefficient.RESTITUTION,
        {LaggedVariable.NORMAL_SPEED, LaggedVariable.NORMAL_IMPULSE}),
    ({"friction": along_the_last}, Coefficient.FRICTION, {LaggedVariable.SLIP_ALONG}),
], ids=["friction that is wiped", "restitution that remembers", "friction against the nap"])  # fmt: skip
def test_a_serially_dependent_coefficient_is_found(change, coefficient, followed):
    drops, fit = fitted(300, 1, **change)
    found = find_serial_dependence(drops, fit, OPTIONS)
    assert found is not None
    assert found.coefficient is coefficient
    assert found.variable in followed
    assert found.large
    if found.variable is LaggedVariable.PERIOD:
        assert found.trials == pytest.approx(17, abs=0.5)
    mixed = torch.randperm(len(drops), generator=torch.Generator().manual_seed(0))
    shuffled = drops[mixed]
    again = find_serial_dependence(shuffled, joint.fit(shuffled, LAW), OPTIONS)
    assert again is not None  # the order counts, and not the rows
    assert (again.coefficient, again.variable) == (found.coefficient, found.variable)
    lost = drops.replace(order=drops.order[mixed])
    assert find_serial_dependence(lost, joint.fit(lost, LAW), OPTIONS) is None


def test_a_measurement_that_wanders_is_no_coefficient():
    """Added to the velocities alike, whatever the impact."""

    def wandering(n, seed):
        rows = [normal(3, seed=seed)]
        for step in normal(n - 1, 3, seed=seed + 9):
            rows.append(0.9 * rows[-1] + math.sqrt(1 - 0.81) * step)
        return torch.stack(rows)

    for seed in range(2):
        drops, fit = fitted(160, 10 * seed, errors=wandering)
        found = find_serial_dependence(drops, fit, OPTIONS)
        assert found is None or not found.large
    drops = thrown(200, 3)
    slow = drops.replace(v_pre=drops.v_pre * torch.tensor([0.01, 1.0, 0.01]), validate=False)
    slow = slow[slow.v_c[:, 1] < -0.2].replace(validate=True)
    grip = laws.find("wang_mason").at(5.0, 0.5)
    slow = slow.replace(v_post=ContactModel(grip).predict(slow).v_post + NOISE * normal(len(slow), 3, seed=0))
    scores = Scores.of_sequence(slow, joint.fit(slow, grip), OPTIONS)
    assert (scores.slope[..., 0] == 0).all()
    chance, found = screen_associations(scores, {}, 0.01)
    assert chance > 0.01
    assert not found
    drops, fit = fitted(60, 4)
    assert find_serial_dependence(drops[:30], fit, OPTIONS) is None


def test_a_gap_in_the_sequence_hides_the_trial_before():
    drops = thrown(60, 5)
    order = drops.order + (drops.order > 30) * 50
    gone = drops.replace(order=order)
    known = histories(drops, ContactModel(LAW).predict(drops))[Memory(LaggedVariable.NORMAL_SPEED, 1.0)]
    hidden = histories(gone, ContactModel(LAW).predict(gone))[Memory(LaggedVariable.NORMAL_SPEED, 1.0)]
    after = int((drops.order <= 30).sum())
    assert hidden[after] == 0 != known[after]
    assert torch.equal(hidden[after + 1 :], known[after + 1 :])
    drops = thrown(80, 8)
    counted = histories(drops, ContactModel(LAW).predict(drops))
    widest = max(
        (one for one in counted if one.variable is LaggedVariable.PLACE), key=lambda one: (one.width, one.trials)
    )
    place = drops.q[:, 0] + drops.r[:, 0]
    exact = (-0.5 * ((place[:, None] - place) / widest.width).square()).exp().tril(-1).sum(-1)
    assert torch.corrcoef(torch.stack((exact, counted[widest])))[0, 1] > 0.999
    alone = drops.replace(q=torch.zeros_like(drops.q), r=drops.r * torch.tensor([0.0, 1.0]))
    assert not any(one.variable is LaggedVariable.PLACE for one in histories(alone, ContactModel(LAW).predict(alone)))
    drops, fit = fitted(150, 6)
    thresholds = Thresholds()
    always = replace(thresholds, dependence_level=1.0)
    scores = Scores.of_sequence(drops, fit, OPTIONS)
    history = histories(drops, fit.model.predict(drops))
    assert screen_associations(scores, history, thresholds.dependence_level)[1] == ()
    assert screen_associations(scores, history, always.dependence_level)[1]


def test_a_serial_dependence_in_words():
    found = SerialDependence(
        coefficient=Coefficient.RESTITUTION, variable=LaggedVariable.NORMAL_SPEED, trials=1.0, p_value=0.002,
        share=Interval(0.2, 0.15, 0.25), large=True,
    )  # fmt: skip
    assert phrase("serial_dependence", found) == "restitution depends on the previous impact's normal speed"
    period = replace(found, coefficient=Coefficient.FRICTION, variable=LaggedVariable.PERIOD, trials=23.04)
    assert phrase("serial_dependence", period) == "friction changes periodically along the sequence, every 23 trials"
    left = replace(remainder(Interval(0.01, -0.01, 0.03)), serial_dependence=found)
    assert left.found
    assert left.unknown
    assert not left.predictable
    message = phrases("residual", left)
    assert message[0] == phrase("not_predictable")
    assert "none of the known effects explains it" in message[-1]


def test_a_floor_that_is_dented_where_it_was_hit():
    """By the last few impacts near the same contact place."""

    def dented(drops):
        place = drops.q[:, 0] + drops.r[:, 0]
        near = (-0.5 * ((place[:, None] - place) / 0.013).square()).exp()
        ago = (drops.order[:, None] - drops.order - 1).clamp_min(0)
        return -0.15 * (near * 0.9**ago).tril(-1).sum(-1)

    drops, fit = fitted(400, 7, restitution=dented)
    found = find_serial_dependence(drops, fit, OPTIONS)
    assert found is not None
    assert found.coefficient is Coefficient.RESTITUTION
    assert found.variable is LaggedVariable.PLACE
    assert found.width == pytest.approx(0.013, abs=0.003)
    assert found.trials == pytest.approx(10)
    assert phrase("serial_dependence", replace(found, width=0.0132)) == (
        "restitution depends on how many of the last 10 impacts were within 13 mm of the same place"
    )


@pytest.mark.parametrize(
    ("hidden", "coefficient", "variable"),
    [("nothing", None, None), ("a field", None, "orientation"), ("stripes", Coefficient.FRICTION, "x")],
)
def test_a_direction_or_a_place_of_its_own_is_seen_in_space(hidden, coefficient, variable):
    """A field turns the first axis of each body towards x; stripes of friction are narrower than a body."""
    tosses, law, n = tossed(400, 1), laws.find("wang_mason").at(0.3, 0.5), 400
    place = torch.rand(n, generator=seeded(3), dtype=torch.float64)[:, None] * 0.5  # of the contact, m
    q = torch.cat((place - tosses.r[:, :1], tosses.q[:, 1:]), 1)
    tosses = tosses.replace(q=q, order=torch.arange(1, n + 1))
    values = torch.tensor((0.3, 0.5), dtype=torch.float64).repeat(n, 1)
    if hidden == "stripes":
        values[:, 0] += 0.12 * (100 * place[:, 0]).sin().sign()
    v_post = predict_with(law, tosses, values).v_post
    if hidden == "a field":
        axis = rotation(q[:, 3:])[..., 0]
        v_post[:, 3:] += 0.3 * torch.linalg.cross(axis, axis.new_tensor((1.0, 0.0, 0.0)).expand_as(axis))
    noise = normal(n, 6, seed=2) * v_post.new_tensor((0.01,) * 3 + (0.2,) * 3)
    tosses = tosses.replace(v_post=v_post + noise, validate=False)
    found = dependence_of(tosses, joint.fit(tosses, law))
    if variable is None:
        assert found is None
    else:
        assert found.coefficient is coefficient
        assert found.variables[0].symbol == variable
        assert found.share.low > 0


def test_drops_of_one_state_depend_on_no_state():
    drops = thrown(60, seed=0).replace(validate=False)[torch.zeros(60, dtype=torch.long)]
    drops = drops.replace(v_post=drops.v_post + 0.01 * torch.randn(60, 3, generator=seeded(0)).double())
    assert dependence_of(drops, joint.fit(drops, "wang_mason", options=OPTIONS)) is None
