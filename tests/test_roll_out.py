"""model.roll_out: flights and bounces against closed forms, a fine reference, and the balance of energy."""

import math

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.effects import find_effect
from contactlearn.inference.identification.joint import identify_jointly
from contactlearn.laws import find
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.roll_out import ENDS, Until
from contactlearn.simulation import synthetic

MODEL = ContactModel(find("wang_mason").at(0.2, 0.6))
SQUARE = Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)))
BODY = {"mass": 0.05, "inertia": 1e-5}
EXACT = 1e-9  # s


def thrown(count=200):
    generator = torch.Generator().manual_seed(0)
    pose, velocity = (torch.randn(count, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    pose[:, 1] = 0.1 + pose[:, 1].abs()
    return BodyState(pose=pose, velocity=velocity * torch.tensor((1, 1, 10)), **BODY)


def test_a_ball_bounces_at_the_times_of_the_closed_form():
    found = MODEL.roll_out(BodyState(pose=(0, 1.02, 0), velocity=(0, 0, 0), **BODY), Disc(0.02), until=Until(bounces=6))
    first = math.sqrt(2 / GRAVITY)
    expected = [first * (1 + 2 * sum(0.6**j for j in range(1, k + 1))) for k in range(6)]
    assert found.times.tolist() == pytest.approx(expected, abs=EXACT)
    assert ENDS[found.ended] == "bounces"


@pytest.mark.parametrize("shape", [Ellipse((0.03, 0.015)), SQUARE], ids=["ellipse", "square"])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (4e-3, -2e-3)], ids=["uniform", "off centre"])
def test_contact_times_are_those_of_a_fine_reference(shape, offset):
    effects = {"com_offset": find_effect("com_offset")(*offset)} if any(offset) else {}
    state, outline, (a, b) = thrown(30), shape.outline(20_001).numpy(), offset
    found = ContactModel(MODEL.base, effects=effects).roll_out(state, shape, until=Until(bounces=1))
    for (x, y, theta), (v_x, v_y, omega), time in zip(state.pose, state.velocity, found.times[:, 0], strict=True):
        del x, v_x
        y, theta, v_y, omega = (float(one) for one in (y, theta, v_y, omega))

        def gap(t, y=y, theta=theta, v_y=v_y, omega=omega):
            now = theta + omega * t
            height = lambda angle: a * math.sin(angle) + b * math.cos(angle)  # noqa: E731  (of the mass centre)
            rise = v_y + omega * (a * math.cos(theta) - b * math.sin(theta))
            centre = y + height(theta) + rise * t - GRAVITY * t**2 / 2
            return centre - height(now) + (outline @ (math.sin(now), math.cos(now))).min()

        grid = np.arange(0, time.item() + 2e-3, 1e-3)
        first = next(k for k, t in enumerate(grid) if gap(t) < 0)
        reference = brentq(gap, grid[first - 1], grid[first], xtol=1e-13)
        assert abs(time.item() - reference) < (EXACT if shape is SQUARE else 1e-7)  # an outline of points
        assert abs(gap(time.item())) < 1e-9


@pytest.mark.parametrize("shape", [Disc(0.02), Ellipse((0.03, 0.015)), SQUARE], ids=["disc", "ellipse", "square"])
def test_energy_never_rises(shape):
    state = thrown()
    found = MODEL.roll_out(state, shape)
    M = torch.tensor((0.05, 0.05, 1e-5), dtype=torch.float64)
    energy = lambda q, v: 0.5 * (v.square() * M).sum(-1) + 0.05 * GRAVITY * q[..., 1]  # noqa: E731
    bounces = torch.stack((energy(found.poses, found.before), energy(found.poses, found.after)), -1).flatten(1)
    change = torch.cat((energy(state.pose, state.velocity)[:, None], bounces), 1).diff(dim=1)
    assert change.nan_to_num(0).max() < 1e-12
    assert change.nan_to_num(0).min() < -0.01
    assert (found.contacts[found.ended == 0] == 10).all()


def test_drag_takes_the_speed_of_the_closed_form():
    state = BodyState(pose=(0, 1.0, 0), velocity=(2, 0, 0), **BODY)
    found = MODEL.roll_out(state, Disc(0.02), until=Until(bounces=1), drag=0.5)
    t = found.times[0]
    assert found.before[0, 0].item() == pytest.approx(2 * math.exp(-0.5 * t))
    assert found.poses[0, 0].item() == pytest.approx(4 * (1 - math.exp(-0.5 * t)))
    assert found.before[0, 1].item() == pytest.approx(-GRAVITY / 0.5 * (1 - math.exp(-0.5 * t)))


def test_it_ends_as_asked_and_says_why():
    state = BodyState(pose=(0, 0.1, 0), velocity=(0, 0, 0), **BODY)
    many = MODEL.roll_out(state, Disc(0.02), until=Until(bounces=100))
    assert ENDS[many.ended] == "piled up"
    assert 10 < many.contacts < 30
    short = MODEL.roll_out(state, Disc(0.02), until=Until(time=0.2))
    assert ENDS[short.ended] == "time"
    assert short.times[short.contacts - 1] < 0.2
    poses = many.at(torch.tensor((0.0, 0.05, 5.0)))
    assert poses[0].tolist() == [0, 0.1, 0]
    assert poses[1, 1].item() == pytest.approx(0.1 - GRAVITY * 0.05**2 / 2)
    assert poses[2].isnan().all()


def test_a_fan_spreads_as_the_parameters_are_uncertain():
    drops = synthetic.load(60, seed=2)
    model = identify_jointly("wang_mason", {"gravity_impulse": find_effect("gravity_impulse")()}, drops).model
    state = BodyState(pose=[(0, 0.5, 0.3), (0, 0.4, 0.3)], velocity=(1, 0, 5), mass=0.0364, inertia=1.7e-5)
    fan = model.roll_out(state, drops.shape, samples=50, generator=torch.Generator().manual_seed(1))
    assert fan.times.shape == (50, 2, 10)
    assert fan.times[:, 0, 0].std() < 1e-12
    assert 0 < fan.times[:, 0, 1].std() < fan.times[:, 0, 2].std()
    assert fan.left_out == ("gravity_impulse",)
    with pytest.raises(ContactLearnError, match="no covariance of its parameters"):
        MODEL.roll_out(state, drops.shape, samples=2)


def test_bad_starts_are_refused_in_a_line():
    state = BodyState(pose=[(0, 1.0, 0), (0, 0.015, 0)], velocity=(0, 0, 0), **BODY)
    with pytest.raises(DataError, match=r"state 2 is 0\.005 m inside it"):
        MODEL.roll_out(state, Disc(0.02))
    with pytest.raises(DataError, match="needs the body's shape"):
        MODEL.roll_out(state)
