"""model.step: one impact from plain numbers, what it is and how sure the model is."""

import json
import math

import numpy as np
import pytest
import torch

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.effects import find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.shapes import Cuboid, Disc, Ellipse, Sphere
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

LAW = ContactModel(find("wang_mason").at(0.2, 0.6))
BODY = {"mass": 0.05, "inertia": 1e-5, "shape": Disc(0.02)}
TRACKED = find_effect("com_offset", "tracked")(delta_a=2e-3, delta_b=-1e-3)


def test_numbers_arrays_and_tensors_give_the_same():
    plain = LAW.step(BodyState(pose=(0, 0.02, 0.3), velocity=[0, -2, 0], **BODY))
    assert plain.velocity.tolist() == pytest.approx([0, 1.2, 0])
    assert plain.wrench.tolist() == pytest.approx([0, 0.05 * 3.2, 0])
    arrays = BodyState(pose=np.zeros((2, 4, 3)), velocity=np.array((0.0, -2, 0)), **BODY)
    many = LAW.step(arrays).velocity
    assert many.shape == (2, 4, 3)
    assert torch.allclose(many, plain.velocity, atol=1e-12)


def test_a_batch_is_what_predict_says():
    drops = synthetic.load(20, seed=2)
    state = BodyState(pose=drops.q, velocity=drops.v_pre, mass=drops.mass, inertia=drops.inertia, r=drops.r)
    assert torch.equal(LAW.step(state).velocity, LAW.predict(drops).v_post)


def test_the_mass_centre_flies_where_the_tracked_point_does_not():
    model = ContactModel(LAW.base, effects={"com_offset": TRACKED, "tilt": find_effect("surface_tilt")(phi=0.05)})
    state = BodyState(pose=(0, 0.02, 0.4), velocity=(0.5, -2, 8), mass=0.05, inertia=1e-5, shape=Disc(0.02))
    found = model.step(state)
    turn = torch.tensor(0.4, dtype=torch.float64)
    d = torch.stack((2e-3 * turn.cos() + 1e-3 * turn.sin(), 2e-3 * turn.sin() - 1e-3 * turn.cos()))
    assert found.flies == "mass centre"
    assert torch.allclose(found.mass_centre, d, rtol=1e-12)
    spin = found.velocity[2]
    expected = found.velocity[:2] + spin * torch.stack((-d[1], d[0]))
    assert torch.allclose(found.flying_velocity, expected, rtol=1e-12)
    assert LAW.step(state).flies == "tracked point"


def test_the_covariance_is_that_of_samples_of_the_parameters():
    drops = synthetic.load(60, seed=2)
    model = joint.fit(drops, "wang_mason", ["side_drag"]).model
    state = BodyState(pose=(0, 0.02, 0.4), velocity=(0.5, -2, 8), mass=0.05, inertia=1e-5, shape=Ellipse((0.03, 0.02)))
    found = model.step(state, uncertainty=True)
    small = 1e-4 * model.parameter_covariance
    draws = torch.distributions.MultivariateNormal(torch.stack(model.values), small)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        sampled = model.at(draws.sample((4000, 1)).unbind(-1)).step(state).velocity
    assert torch.allclose(1e4 * sampled.T.cov(), found.covariance, rtol=0.1, atol=0.1 * found.covariance.max())
    with pytest.raises(ContactLearnError, match="states no uncertainty"):
        LAW.step(state, uncertainty=True)


def test_every_constant_is_in_full():
    value = 0.123456789012345
    effect = find_effect("velocity_dependent_restitution")(v_ref=1.2345678901)
    model = ContactModel(find("chatterjee_ruina", e_t=1 / 3).at(value, 0.5), effects={effect.name: effect})
    found = json.loads(json.dumps(model.constants()))
    assert found["law"]["mu"]["value"] == value
    assert found["law"]["options"]["e_t"] == 1 / 3
    assert found["effects"][effect.name]["options"]["v_ref"] == 1.2345678901
    assert all(str(x) in repr(model) for x in (value, 1 / 3, 1.2345678901))


def test_a_planar_body_in_space_steps_as_in_the_plane():
    flat = BodyState(pose=(0.1, 0.02, 0.4), velocity=(0.5, -2, 8), **BODY)
    turn = (math.cos(0.2), 0, -math.sin(0.2), 0)
    ball = BODY | {"shape": Sphere(0.02)}
    deep = BodyState(pose=(0.1, 0, 0.02, *turn), velocity=(0.5, 0, -2, 0, -8, 0), **ball)
    plane, space = LAW.step(flat).velocity.tolist(), LAW.step(deep).velocity.tolist()
    assert space == pytest.approx([plane[0], 0, plane[1], 0, -plane[2], 0], abs=1e-12)


def test_in_space_the_mass_centre_flies_with_v_and_omega_cross_d():
    model = ContactModel(LAW.base, effects={"com_offset": find_effect("com_offset", "tracked")(2e-3, -1e-3, 3e-3)})
    pose, moments = torch.tensor((0, 0, 0.05, 0.8, 0.36, 0.48, 0.0), dtype=torch.float64), (2e-5, 3e-5, 4e-5)
    velocity, solid = (0.3, -0.2, -2, 4, 5, -6), Cuboid((0.03, 0.02, 0.02), corner=2e-3)
    found = model.step(BodyState(pose=pose, velocity=velocity, mass=0.05, inertia=moments, shape=solid))
    d = rotation(pose[3:]) @ torch.tensor((2e-3, -1e-3, 3e-3), dtype=torch.float64)
    assert found.flies == "mass centre"
    assert torch.allclose(found.mass_centre, d, rtol=1e-12)
    expected = found.velocity[:3] + torch.linalg.cross(found.velocity[3:], d)
    assert torch.allclose(found.flying_velocity, expected, rtol=1e-12)
    many = model.step(BodyState(pose=pose.expand(2, 4, 7), velocity=velocity, mass=0.05, inertia=moments, shape=solid))
    assert torch.allclose(many.velocity, found.velocity.expand(2, 4, 6), rtol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "rule"),
    [
        ({"shape": None}, "needs its contact point r, or its shape"),
        ({"velocity": (0, 1, 0)}, "must approach the floor"),
        ({"pose": (0, 1)}, "must have 3 components"),
        ({"velocity": "fast"}, "must be numbers"),
        ({"mass": 0.0}, "must be positive"),
        ({"pose": np.zeros((2, 3)), "velocity": np.zeros((3, 3))}, "must broadcast"),
        ({"pose": (0, 0, 0.02, 1, 0.1, 0, 0), "velocity": (0, 0, -1, 0, 0, 0)}, r"must be of length 1, got 1\.00499"),
        ({"pose": (0, 0, 0.02, 1, 0, 0, 0)}, "velocity of a body's state must have 6 components"),
        ({"pose": (0, 0, 0.02, 1, 0, 0, 0), "velocity": (0, 0, -1, 0, 0, 0)}, "has the shape of one, got Disc"),
        ({"shape": Sphere(0.02)}, "a sphere is a body in space"),
    ],
)
def test_an_impossible_state_is_refused_in_a_line(wrong, rule):
    with pytest.raises(DataError, match=rule) as seen:
        LAW.step(BodyState(**({"pose": (0, 0.02, 0), "velocity": (0, -1, 0)} | BODY | wrong)))
    assert "\n" not in str(seen.value)
