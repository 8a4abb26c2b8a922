"""Drops that all begin alike: scatter of the velocities before impact is noise, and no effect."""

import math

import pytest
import torch
from diagnoses import few

from contactlearn.core.errors import DataError
from contactlearn.core.events import TaskProgress
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.model_checks import noise_notes, one_state_notes
from contactlearn.diagnosis.events import AuditFindings, MeasurementsReplaced
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import hidden_effects

LAW = find("wang_mason")
NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)


def alike(seed, size=100, spread=0.0):
    """Drops of the published ellipse from one height at any orientation, by Wang and Mason's law."""
    generator = torch.Generator().manual_seed(seed)
    shape = Ellipse((0.035, 0.025))
    theta = 2 * math.pi * torch.rand(size, dtype=torch.float64, generator=generator)
    r = contact_point(shape, theta)
    draws = torch.randn(3, size, 3, dtype=torch.float64, generator=generator)
    v_pre = torch.tensor((0.5, -2.5, 0.0), dtype=torch.float64) + spread * NOISE * draws[0]
    mass = torch.full((size,), 0.036, dtype=torch.float64)
    q = torch.stack((torch.zeros(size, dtype=torch.float64), -r[:, 1], theta), -1)
    true = Impacts(
        mass=mass, inertia=mass * (0.035**2 + 0.025**2) / 4, r=r, q=q, v_pre=v_pre, v_post=v_pre, shape=shape
    )
    v_post = ContactModel(LAW.at(0.12, 0.55)).predict(true).v_post
    return true.replace(v_pre=v_pre + NOISE * draws[1], v_post=v_post + NOISE * draws[2])


def corrections(impacts):
    """Corrections of a diagnosis, which ends once they are made: where it begins to search effects."""

    class Searching(Exception):
        pass

    made = []

    def on_event(event):
        if isinstance(event, AuditFindings | MeasurementsReplaced):
            made.extend(one.correction for one in event.findings if one.correction is not None)
        if isinstance(event, TaskProgress) and event.task == "effects":
            raise Searching

    with pytest.raises(Searching):
        diagnose(impacts, LAW, options=DiagnoseOptions(candidates=few("surface_tilt"), laws=[LAW]), on_event=on_event)
    return tuple(made)


@pytest.mark.nightly
def test_scatter_is_no_effect():
    found = diagnose(alike(0, 100), LAW, options=DiagnoseOptions(laws=[LAW]))
    assert found.effects == ()
    assert found.verdict == "none"
    assert "averaged_vy" in [finding.correction for finding in found.findings]
    assert found.record.impacts.v_pre[:, 1].std() < 1e-12


@pytest.mark.nightly
def test_what_varies_is_measured():
    """Five times the noise is variation, and mystery drops vary."""
    for drops in (alike(0, spread=5.0), hidden_effects.draw(3, effects=[], size=120)[0]):
        assert corrections(drops) == ()
    drops = alike(0)
    mended = correct(drops, ["averaged_vy"])
    torch.testing.assert_close(mended.v_pre[:, 1], drops.v_pre[:, 1].mean().expand(100))
    torch.testing.assert_close(mended.v_pre[:, [0, 2]], drops.v_pre[:, [0, 2]])


def test_contact_points_come_from_the_shape_where_they_are_known_better():
    """Measured points that scatter are replaced by those of the shape, but not where the contact itself scatters."""
    drops = alike(0, spread=5.0)
    off = 0.001 * torch.randn(drops.r.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = drops.replace(r=drops.r + off)
    assert corrections(seen) == ("contact_from_shape",)
    torch.testing.assert_close(correct(seen, ["contact_from_shape"]).r, drops.r)
    moved = ContactModel(LAW.at(0.12, 0.55)).predict(seen).v_post
    assert corrections(seen.replace(v_post=moved)) == ()
    with pytest.raises(DataError, match="no shape is stated"):
        correct(drops.replace(shape=None), ["contact_from_shape"])


@pytest.mark.parametrize("turned", [False, True])
def test_one_state_shows_one_outcome(turned):
    """Of discs the orientation is no state; an ellipse that falls as it likes has many."""
    drops = alike(1)
    if not turned:
        drops = drops.replace(q=torch.zeros_like(drops.q), r=torch.tensor((0.0, -0.025)).expand(100, 2), shape=None)
    assert one_state_notes(drops) == ()  # by its noise
    notes = noise_notes(drops, drops.v_post + NOISE, lambda impacts: impacts.v_pre.std(0).sum().item())
    averaged = correct(drops, [one.correction for one in notes])
    assert [one.name for one in one_state_notes(averaged)] == ([] if turned else ["one_state"])
