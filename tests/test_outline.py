"""The shape that is not stated: found where contact points trace it, and only there."""

import pytest
import torch
from test_audit import BODIES, drops, mistakes

from contactlearn.core.errors import DataError
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Disc, Ellipse, contact_point

ROUNDED = 1e-6  # m, as the contact points


def forgotten(body: str = "ellipse", **options) -> Impacts:
    impacts = drops(body, **options)
    return impacts.replace(r=(impacts.r / ROUNDED).round() * ROUNDED, shape=None)


def shape_of(impacts: Impacts):
    return correct(impacts, [one.correction for one in audit(impacts) if one.correction]).shape


def moved(impacts: Impacts, theta: float | torch.Tensor = 0.0, lean: float = 0.0) -> Impacts:
    """The contact points that a camera sees where θ is off, and where the floor leans."""
    shape = drops(size=len(impacts)).shape
    seen = contact_points(shape, impacts.body, impacts.q[:, 2] + theta - lean)
    return impacts.replace(r=rotate(seen, torch.as_tensor(lean)), validate=False)


@pytest.mark.parametrize("body", BODIES)
def test_a_shape_that_the_contact_points_trace_is_taken(body):
    stated, impacts = drops(body).shape, forgotten(body)
    consistent, note = audit(impacts)
    assert consistent.name == "consistent"
    assert (note.name, note.correction, note.mistake) == ("traced_shape", "traced_shape", False)
    shape = correct(impacts, ["traced_shape"]).shape
    assert type(shape) is type(stated)
    theta = impacts.q[:, 2]
    assert torch.allclose(contact_point(shape, theta), contact_point(stated, theta), atol=ROUNDED)


def test_units_and_axes_come_first():
    impacts = correct(forgotten().replace(validate=False), ["mirrored_x"])
    found = audit(impacts)
    assert [one.correction for one in found] == ["mirrored_x", "traced_shape"]
    assert found[1].sentence.startswith(
        "data.shape is not stated; the contact points trace an ellipse with semi-axes of 35 × 25 mm to within 0."
    )


def test_bodies_are_all_traced_or_none():
    impacts = forgotten(size=300)
    ball = contact_points(Disc(0.02), None, impacts.q[:, 2])
    second = torch.arange(300) % 3 == 0
    both = impacts.replace(
        r=torch.where(second[:, None], ball, impacts.r),
        object=tuple("oak" if one else "beech" for one in second),
        validate=False,
    )
    assert {name: type(one) for name, one in shape_of(both).items()} == {"beech": Ellipse, "oak": Disc}
    noise = 1e-3 * torch.randn(300, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert shape_of(both.replace(r=both.r + second[:, None] * noise)) is None


def test_a_leaning_floor_under_a_seen_contact_point_shows():
    (note,) = [one for one in audit(moved(forgotten(), lean=0.04)) if one.correction]
    assert "semi-axes of 35 × 25 mm" in note.sentence
    assert "on a floor that leans by about 2.3°" in note.sentence


SPREAD = torch.randn(150, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
UNTRACED = {
    "much noise": lambda one: noisy(one, 7e-4),
    "few with noise": lambda one: noisy(one, 2e-4)[:30],
    "late frame": lambda one: moved(one, theta=0.03 * SPREAD),
    "centre of mass": lambda one: one.replace(r=one.r + rotate(torch.tensor([5e-4, 0]).double(), one.q[:, 2])),
    "turned axes of the body": lambda one: moved(one, theta=0.05),
    "one orientation": lambda one: moved(one, theta=0.3 - one.q[:, 2]).replace(q=0 * one.q + 0.3, validate=False),
    "a lobed disc": lambda one: one.replace(r=lobed(one.q[:, 2]), validate=False),
}


def noisy(impacts: Impacts, size: float) -> Impacts:
    return impacts.replace(r=impacts.r + size * torch.stack((SPREAD, SPREAD.flip(0)), -1), validate=False)


def test_noise_of_contact_points_does_not_hide_an_ellipse():
    found = shape_of(noisy(forgotten(), 2e-4))
    assert isinstance(found, Ellipse)
    assert found.semi_axes == pytest.approx((0.035, 0.025), rel=0.005)


def lobed(theta: torch.Tensor) -> torch.Tensor:
    """Lowest points of the body of support 0.03 (1 + 0.004 cos 6θ): within 0.4 % of a disc, with r_x up to 2.4 %."""
    return -0.03 * torch.stack((0.024 * (6 * theta).sin(), 1 + 0.004 * (6 * theta).cos()), -1)


@pytest.mark.parametrize("change", UNTRACED)
def test_no_shape_is_guessed(change):
    impacts = UNTRACED[change](forgotten())
    assert "traced_shape" not in [one.name for one in audit(impacts)]
    with pytest.raises(DataError, match="trace no disc, ellipse or polygon"):
        correct(impacts, ["traced_shape"])


def test_a_stated_shape_stays():
    stated = drops().replace(shape=Ellipse((0.0355, 0.025)))
    assert mistakes(audit(stated)) == []
    assert correct(stated, ["traced_shape"]).shape == stated.shape
