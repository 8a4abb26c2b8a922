"""The scenes of benchmarks/accuracy/replays_mujoco.py follow the roll-outs of the models that they were made from."""

import pytest
import torch

from benchmarks.accuracy.replays_mujoco import JOINTS, USUAL, Engine
from contactlearn import ContactModel, laws
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.shapes import Cuboid, Polygon
from contactlearn.models.export.mujoco import export
from contactlearn.models.roll_out import Until

pytest.importorskip("mujoco")

HALF, BODY = 0.03, {"mass": 0.05, "inertia": 3e-5}
MODEL = ContactModel(laws.find("wang_mason").at(0.15, 0.5))
AIR = {"gravity": 9.6, "drag": 0.5}
STATES = {
    "plane": BodyState(
        pose=(0, 0.1, 0.4), velocity=(0.4, 0, 2), **BODY,
        shape=Polygon(((-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF))),
    ),
    "space": BodyState(
        pose=(0, 0, 0.1, 0.9, 0.3, 0.3, 0.1), velocity=(0.4, 0.2, 0, 1, 2, 3), shape=Cuboid((HALF,) * 3), **BODY
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STATES)
def test_a_scene_follows_the_roll_out_through_its_first_bounce(name):
    state = STATES[name]
    state = BodyState(
        pose=state.pose[None], velocity=state.velocity[None], mass=state.mass, inertia=state.inertia, shape=state.shape
    )
    path = MODEL.roll_out(state, until=Until(bounces=2), **AIR)
    first, second = path.times[0].tolist()
    engine = Engine(export(MODEL, state.as_impacts(validate=False)).scene.xml(), MODEL)
    times = torch.tensor([[0.9 * first, (first + second) / 2, torch.nan]])
    found = engine.roll_out(state, until=Until(time=second), friction=None, **AIR).at(times)[0]
    expected = path.at(times)[0]
    assert torch.allclose(found[0], expected[0], atol=1e-6)  # in the air
    assert torch.allclose(found[1], expected[1], atol=5e-3)
    assert found[2].isnan().all()
    assert (expected[1] - path.flights.of(torch.tensor([0])).after(times[0, 1:2])[0][0]).abs().max() > 0.02


@pytest.mark.parametrize("d", JOINTS)
def test_the_usual_scene_is_one_box_that_falls(d):
    moments = " ".join(["3e-5"] * 3)
    state = STATES["plane" if d == 2 else "space"]
    scene = USUAL.format(mu=0.2, joints=JOINTS[d], half=HALF, mass=0.05, moments=moments)
    pose, velocity = state.pose[None], state.velocity[None]
    at = Engine(scene, MODEL).roll_out(
        BodyState(pose=pose, velocity=velocity, mass=0.05, inertia=3e-5, shape=state.shape),
        until=Until(time=2), friction=None, **AIR,
    ).at  # fmt: skip
    assert at(torch.tensor([[2.0]]))[0, 0, d - 1].item() == pytest.approx(HALF, abs=2e-3)
