"""The simulator of tosses in steps of impulse against the laws, the truth of its sets, and the scores of answers."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from blind.judge import Answer
from blind.report import by_group, judged
from contactlearn.effects import catalogue, find_effect
from contactlearn.laws import find
from contactlearn.mechanics.space import SPACE
from contactlearn.models.contact_model import ContactModel
from tosses import impulse
from tosses.facts import ACCEPTED, ACCEPTED_OF_IMPULSE, UNKNOWN, draw, suite, truths


def error(facts, effects=None):
    """Errors of a law with the true coefficients and effects, m/s and rad/s."""
    impacts = impulse.reported(facts, 100, seed=1)
    law = find("mirtich" if facts.energetic else "wang_mason").at(facts.mu[0], facts.eps)
    return (ContactModel(base=law, effects=effects or {}).predict(impacts).v_post - impacts.v_post).abs()


@pytest.fixture
def noiseless(monkeypatch):
    monkeypatch.setattr(impulse, "NOISE", torch.zeros(6, dtype=torch.float64))


@pytest.mark.parametrize("energetic", [False, True])
def test_without_hidden_facts_it_is_routh_path(noiseless, monkeypatch, energetic):
    facts = replace(draw((), 200), energetic=energetic)
    medians = []
    for steps in (100, 200):
        monkeypatch.setattr(impulse, "STEPS", steps)
        medians.append(error(facts)[:, 2].median().item())
    assert medians[0] < 2e-3  # m/s
    assert medians[1] < 0.7 * medians[0]  # of first order


@pytest.mark.parametrize(
    ("fact", "name", "values"),
    [
        ("centre", "com_offset", lambda facts: facts.centre),
        ("inertia", "inertia_error", lambda facts: (facts.inertia,)),
        ("late", "sampling_delay", lambda facts: (facts.late,)),
        ("delay", "gravity_impulse", lambda facts: (facts.delay,)),
        ("size", "shape_error", lambda facts: tuple(one - 1 for one in facts.size)),
        ("drag", "side_drag", lambda facts: (1 - torch.tensor(-facts.drag).exp().item(),)),
    ],
)
def test_an_effect_with_the_true_values_explains_its_fact(noiseless, fact, name, values):
    facts = replace(draw((fact,), 200), energetic=False)
    alone = error(facts)
    explained = error(facts, {name: find_effect(name)().at(torch.tensor(values(facts), dtype=torch.float64))})
    assert explained.median(0).values.max() < 0.3 * alone.median(0).values.max()


def test_every_set_has_its_truth_and_names_that_exist():
    sets = [*suite("look"), *suite("report")]
    assert len({one.seed for one in sets}) == len(sets) >= 60
    in_space = {name for name, forms in catalogue().items() if any(SPACE in form.spaces for form in forms)}
    assert set().union(*(ACCEPTED | ACCEPTED_OF_IMPULSE).values()) <= in_space
    assert UNKNOWN.keys().isdisjoint(ACCEPTED | ACCEPTED_OF_IMPULSE)
    right = Answer(suite="impulse", name="205", verdict="effects", effects=["sampling_delay"], confidence=[0.9])
    wrong = replace(right, effects=["sampling_delay", "com_offset"], confidence=[0.9, 0.6])
    assert [judged([one], truths)[0].score.exact for one in (right, wrong)] == [True, False]
    assert "impulse: one" in by_group(judged([right], truths))
