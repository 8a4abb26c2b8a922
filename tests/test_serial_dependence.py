"""What remains and follows the sequence: false statements, power, what is followed, and what is said."""

import math
from dataclasses import replace

import pytest
import torch
from diagnoses import few, remainder
from drops import LAW, NOISE, fitted, normal, rough, thrown
from repetitions import repeated

from contactlearn import diagnose, laws
from contactlearn.diagnosis.result import Coefficient, Diagnosis, LaggedVariable, SerialDependence, Verdict
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.serial_dependence import (
    Memory,
    find_serial_dependence,
    histories,
    screen_associations,
)
from contactlearn.effects import State
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text import headline, phrase, phrases


def sawtooth(drops):
    return -0.12 * (drops.order.remainder(17) / 17 - 0.5)


def after_fast(drops):
    v_n = State.of(drops).v_n.abs()
    return -0.06 * torch.cat((v_n.new_zeros(1), v_n[:-1] - v_n.mean()))


@pytest.mark.parametrize("runs", repeated(25, 60))
def test_false_statements_are_as_rare_as_the_level(runs):
    """Heavy tails and a scatter that differs from trial to trial; three standard deviations of a count."""
    level, chances = 0.1, []
    for seed in range(runs):
        drops, fit = fitted(140, 100 * seed, errors=rough)
        scores = Scores.of_sequence(drops, fit, FitOptions())
        chances.append(screen_associations(scores, histories(drops, fit.model.predict(drops)), level)[0])
    assert sum(p <= level for p in chances) <= runs * level + 3 * math.sqrt(runs * level * (1 - level))
    assert sum(chances) / runs > 0.35


@pytest.mark.parametrize(("change", "coefficient", "followed"), [
    ({"friction": sawtooth}, Coefficient.FRICTION, {LaggedVariable.PERIOD, LaggedVariable.ORDER}),
    ({"restitution": after_fast}, Coefficient.RESTITUTION,
        {LaggedVariable.NORMAL_SPEED, LaggedVariable.NORMAL_IMPULSE}),
], ids=["friction that is wiped", "restitution that remembers"])  # fmt: skip
def test_a_serially_dependent_coefficient_is_found(change, coefficient, followed):
    drops, fit = fitted(300, 1, **change)
    found = find_serial_dependence(drops, fit, FitOptions())
    assert found is not None
    assert found.coefficient is coefficient
    assert found.variable in followed
    assert found.large
    if found.variable is LaggedVariable.PERIOD:
        assert found.trials == pytest.approx(17, abs=0.5)
    mixed = torch.randperm(len(drops), generator=torch.Generator().manual_seed(0))
    shuffled = drops[mixed]
    again = find_serial_dependence(shuffled, identify_jointly(LAW, {}, shuffled), FitOptions())
    assert again is not None  # the order counts, and not the rows
    assert (again.coefficient, again.variable) == (found.coefficient, found.variable)
    lost = drops.replace(order=drops.order[mixed])
    assert find_serial_dependence(lost, identify_jointly(LAW, {}, lost), FitOptions()) is None


def test_a_measurement_that_wanders_is_no_coefficient():
    """Added to the velocities alike, whatever the impact."""

    def wandering(n, seed):
        rows = [normal(3, seed=seed)]
        for step in normal(n - 1, 3, seed=seed + 9):
            rows.append(0.9 * rows[-1] + math.sqrt(1 - 0.81) * step)
        return torch.stack(rows)

    for seed in range(2):
        drops, fit = fitted(160, 10 * seed, errors=wandering)
        found = find_serial_dependence(drops, fit, FitOptions())
        assert found is None or not found.large
    drops = thrown(200, 3)
    slow = drops.replace(v_pre=drops.v_pre * torch.tensor([0.01, 1.0, 0.01]), validate=False)
    slow = slow[slow.v_c[:, 1] < -0.2].replace(validate=True)
    grip = laws.find("wang_mason").at(5.0, 0.5)
    slow = slow.replace(v_post=ContactModel(grip).predict(slow).v_post + NOISE * normal(len(slow), 3, seed=0))
    scores = Scores.of_sequence(slow, identify_jointly(grip, {}, slow), FitOptions())
    assert (scores.slope[..., 0] == 0).all()
    chance, found = screen_associations(scores, {}, 0.01)
    assert chance > 0.01
    assert not found
    drops, fit = fitted(60, 4)
    assert find_serial_dependence(drops[:30], fit, FitOptions()) is None


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
    scores = Scores.of_sequence(drops, fit, FitOptions())
    history = histories(drops, fit.model.predict(drops))
    assert screen_associations(scores, history, thresholds.dependence_level)[1] == ()
    assert screen_associations(scores, history, always.dependence_level)[1]


@pytest.mark.parametrize("sets", repeated({"friction": sawtooth}, {}), ids=["friction that is wiped", "nothing"])
def test_a_diagnosis_reports_unknown_serial_dependence(sets):
    drops, _ = fitted(200, 1, **sets)
    found = diagnose(
        drops, "wang_mason", candidates=few("spin_damping", "parameter_drift"), laws=[laws.find("wang_mason")]
    )
    assert found.remainder is not None
    assert found.verdict is (Verdict.UNKNOWN if sets else Verdict.NONE)
    assert (found.remainder.serial_dependence is not None) == bool(sets)
    assert ("friction changes periodically along the sequence" in headline(found)) == bool(sets)
    assert Diagnosis.from_json(found.to_json()) == found


def test_the_dependence_in_words():
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
    found = find_serial_dependence(drops, fit, FitOptions())
    assert found is not None
    assert found.coefficient is Coefficient.RESTITUTION
    assert found.variable is LaggedVariable.PLACE
    assert found.width == pytest.approx(0.013, abs=0.003)
    assert found.trials == pytest.approx(10)
    assert phrase("serial_dependence", replace(found, width=0.0132)) == (
        "restitution depends on how many of the last 10 impacts were within 13 mm of the same place"
    )
