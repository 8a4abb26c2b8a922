"""The diagnosis of bodies in space: planted effects are found with their probability, and no others are."""

import pytest
import torch
from diagnoses import few
from spatial import tossed

from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.record import Record
from contactlearn.diagnosis.result import Level, Verdict
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.laws import find as find_law
from contactlearn.laws.hodograph import followed_in
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

LAW = find_law("wang_mason").at(0.25, 0.6)
CANDIDATES = (
    "com_offset",
    "inertia_error",
    "velocity_dependent_restitution",
    "load_dependent_friction",
    "spin_damping",
)


def measured(seed: int, **planted: tuple[float, ...]) -> Impacts:
    """Tosses of random bodies that a law with effects resolves, with noise of 1 cm/s and 0.2 rad/s."""
    impacts = tossed(160, seed)
    effects = {name: few(name)[next(iter(few(name)))].at(torch.tensor(values)) for name, values in planted.items()}
    v_post = ContactModel(base=LAW, effects=effects).predict(impacts).v_post
    noise = torch.randn(v_post.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return impacts.replace(v_post=v_post + noise * torch.tensor((0.01,) * 3 + (0.2,) * 3), validate=False)


@pytest.fixture(scope="module")
def found():
    impacts = measured(1, inertia_error=(0.3,))
    return diagnose(impacts, options=DiagnoseOptions(laws=[LAW, find_law("whittaker")], candidates=few(*CANDIDATES)))


def test_a_planted_effect_is_found(found):
    assert found.verdict is Verdict.EFFECTS
    assert (found.law, found.effects) == ("wang_mason", ("inertia_error",))
    (kappa,) = found.missing[0].parameters
    assert abs(kappa.value - 0.3) < 4 * kappa.standard_error < 0.05
    assert found.budget.named.mean < 0.5 * found.budget.base.mean


def test_its_probability_is_stated(found):
    (one,) = found.missing
    assert one.level is Level.FOUND
    assert 0.9 < one.confidence < 1
    assert repr(found).startswith("Diagnosis(verdict='effects', law='wang_mason', inertia_error:uniform (99 %), error")
    assert [(one.name, one.mistake) for one in found.findings] == [("moment_balance_open", False)]  # by the inertia
    assert not found.formulas


@pytest.mark.nightly
def test_the_few_steps_of_a_law_are_no_unknown_effect():
    """Outcomes without noise of a simulator that follows the slip in fine steps: nothing is missing or scatters."""
    law = find_law("wang_mason").at(0.35, 0.45)
    impacts = tossed(80, 5)
    with followed_in(2000):
        exact = impacts.replace(v_post=ContactModel(law).predict(impacts).v_post, validate=False)
    left_out = mass_error(exact, ContactModel(law).predict(impacts))
    found = diagnose(exact, options=DiagnoseOptions(laws=[LAW, find_law("mirtich")], candidates=few(*CANDIDATES)))
    assert (found.verdict, found.law, found.effects, found.scatter) == (Verdict.NONE, "wang_mason", (), None)
    assert found.budget.named.mean < 0.2 * left_out.mean() < 0.2 * 0.01
    assert found.record.model.law.mu.item() == pytest.approx(0.35, abs=1e-3)


def test_a_record_in_space_is_read_back(found, tmp_path):
    found.record.save(tmp_path, {})
    read = Record.load(tmp_path)
    assert torch.equal(read.outcomes, found.record.outcomes)
    assert read.outcomes.shape[1:] == (160, 6)


@pytest.mark.nightly
def test_nothing_is_named_where_nothing_is_hidden():
    found = diagnose(
        measured(2), options=DiagnoseOptions(laws=[LAW, find_law("whittaker")], candidates=few(*CANDIDATES))
    )
    assert (found.verdict, found.missing) == (Verdict.NONE, ())


@pytest.mark.nightly
def test_a_turned_world_changes_no_name_and_no_error(found):
    """A quarter turn about the normal."""
    turn = torch.tensor(((0.0, -1, 0), (1, 0, 0), (0, 0, 1)), dtype=torch.float64)
    half = torch.tensor(0.5, dtype=torch.float64).sqrt()
    impacts = measured(1, inertia_error=(0.3,))
    w, x, y, z = impacts.q[:, 3:].unbind(-1)
    q = torch.stack((half * (w - z), half * (x - y), half * (x + y), half * (w + z)), -1)  # (√½, 0, 0, √½) q
    both = torch.block_diag(turn, turn)
    turned = impacts.replace(
        r=impacts.r @ turn.T, q=torch.cat((impacts.q[:, :3] @ turn.T, q), -1), v_pre=impacts.v_pre @ both.T,
        v_post=impacts.v_post @ both.T, validate=False,
    )  # fmt: skip
    again = diagnose(turned, options=DiagnoseOptions(laws=[LAW, find_law("whittaker")], candidates=few(*CANDIDATES)))
    assert again.effects == found.effects
    assert abs(again.budget.named.mean / found.budget.named.mean - 1) < 1e-3
