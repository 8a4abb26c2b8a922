"""One impact in MuJoCo is that of the exported model."""

from dataclasses import replace

import pytest
import torch

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data.audit.corrections import correct
from contactlearn.effects import State, find_effect
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification.joint import identify_jointly
from contactlearn.laws import find
from contactlearn.mechanics.shapes import Polygon, contact_point
from contactlearn.models.contact_model import ContactModel, actual_state
from contactlearn.models.export.mujoco import export
from contactlearn.simulation import mujoco as drops_of_mujoco
from contactlearn.simulation import synthetic

CLOSE = 0.015  # mass norm: the body turns and falls while MuJoCo's contact lasts

mujoco = pytest.importorskip("mujoco")


def simulated(xml, impacts, hook=None, steps=300):
    """Velocity [N, 3] after a contact in MuJoCo that begins at touch."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    q = impacts.q.clone()
    q[:, 1] = -impacts.r[:, 1]
    early = q - impacts.v_pre * model.opt.timestep / 2
    if hook is not None:
        return torch.stack(
            [one_by_one(model, data, hook, *row, steps) for row in zip(early, impacts.v_pre, strict=True)]
        )
    _, rollout = drops_of_mujoco.engine()
    with rollout.Rollout(nthread=0) as runner:
        states, contacts = drops_of_mujoco.simulated(runner, model, data, early, impacts.v_pre, steps)
    last = torch.where(contacts > 0, torch.arange(steps), -1).amax(1)
    assert ((last > 0) & (last < steps - 1)).all()
    return states[torch.arange(len(q)), last][:, 3:]


def one_by_one(model, data, hook, q, v, steps):
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:] = q.numpy(), v.numpy()
    for _ in range(steps):
        hook["set_contact"](model, data)
        mujoco.mj_step(model, data)
    return torch.tensor(data.qvel)


@pytest.fixture(scope="module")
def measured(ellipse_drops):
    """Published drops, about the contact points of the ellipse, as a scene has them: those to fit, and 300 others."""
    drops = correct(ellipse_drops, ["mirrored_x"])
    drops = drops.replace(r=contact_point(drops.shape, drops.q[:, 2]), validate=False)
    pool, test = drops[drops.v_c[:, 1] < -0.05].replace(validate=True).split(0.25, torch.Generator().manual_seed(0))
    return pool[:300], test[:300]


@pytest.mark.parametrize("law", ["spring_dashpot", "wang_mason"])
def test_measured_states_have_the_outcome_of_the_model(measured, law):
    pool, test = measured
    model = identify_jointly(law, {}, pool).model
    scene, hook, lost = export(model, test)
    found, expected = simulated(scene.xml(), test), model.predict(test)
    against = test.replace(v_post=expected.v_post)
    error = mass_error(against, type(expected)(found, expected.wrench)).mean()
    assert hook is None
    assert error < CLOSE
    assert abs(error - lost) < 0.005, "the size that was stated"
    in_engine = mass_error(test, type(expected)(found, expected.wrench)).mean()
    assert in_engine < mass_error(test, expected).mean() + 0.01
    half = simulated(replace(scene, contact_time=scene.contact_time / 2).xml(), test)
    assert mass_error(test.replace(v_post=found), type(expected)(half, expected.wrench)).mean() < 0.003
    usual = (
        scene.xml().replace('solimp="0.005 0.005 1"', "").replace("elliptic", "pyramidal").replace('impratio="1e5"', "")
    )
    control = simulated(usual, test, steps=600)
    assert mass_error(against, type(expected)(control, expected.wrench)).mean() > 0.05


SQUARE = Polygon(((0.03, 0.02), (-0.03, 0.02), (-0.03, -0.02), (0.03, -0.02)))
GEOMETRY = {
    "com_offset": {"delta_a": 3e-3, "delta_b": -2e-3},
    "surface_tilt": {"phi": 0.05},
    "inertia_error": {"kappa": 0.3},
    "orientation_offset": {"delta": 0.1},
    "shape_error": {"s_a": 0.1, "s_b": -0.1},
}


@pytest.mark.parametrize(
    ("name", "shape"), [*((name, None) for name in GEOMETRY), ("com_offset", SQUARE), ("orientation_offset", SQUARE)]
)
def test_geometry_is_that_of_the_effect(name, shape):
    drops = synthetic.load(100, shape=shape, velocity_noise=0, spin_noise=0)
    effect = find_effect(name)(**GEOMETRY[name])
    model = ContactModel(find("spring_dashpot").at(0.15, 0.6), effects={name: effect})
    scene = export(model, drops).scene
    state = actual_state(model.effects, State.of(drops))
    d = torch.zeros(len(drops), 2).double() if state.mass_centre is None else state.mass_centre
    lowest = (
        state.as_measured(torch.nn.functional.pad(state.r, (0, 1)))[:, :2] if name == "surface_tilt" else state.r + d
    )
    q = drops.q.clone()
    q[:, 1] = -lowest[:, 1]
    q[:, 0] = 0
    if name == "surface_tilt":
        q[:, 1] += lowest[:, 0] * torch.tensor(0.05).double().tan()
    clear = (state.v_n < -0.3) & (state.r[:, 0].abs() > 2e-3)
    started = drops.replace(q=q, r=torch.stack((drops.r[:, 0], -q[:, 1]), -1), validate=False)[clear]
    found, expected = simulated(scene.xml(), started), model.predict(drops[clear])
    error = mass_error(drops[clear].replace(v_post=expected.v_post), type(expected)(found, expected.wrench))
    assert error.median() < CLOSE
    alone = mass_error(drops[clear].replace(v_post=expected.v_post), ContactModel(model.base).predict(drops[clear]))
    assert alone.median() > 2 * error.median(), "without the effect the outcome is another"


def test_the_hook_sets_coefficients_that_depend_on_the_state():
    drops = synthetic.load(12, velocity_noise=0, spin_noise=0)
    effect = find_effect("velocity_dependent_restitution", "linear")().prepare(drops)
    model = ContactModel(
        find("spring_dashpot").at(0.15, 0.6),
        effects={
            effect.name: effect.at([0.3]),
            "directional": find_effect("load_dependent_friction")(p=0.5, v_ref=2.0),
        },
    )
    scene, text, _ = export(model, drops)
    hook = {}
    exec(text, hook)
    found, expected = simulated(scene.xml(), drops, hook, steps=250), model.predict(drops)
    error = mass_error(drops.replace(v_post=expected.v_post), type(expected)(found, expected.wrench))
    assert error.max() < CLOSE
    engine = mujoco.MjModel.from_xml_string(scene.xml())
    engine.opt.timestep *= 2
    with pytest.raises(ValueError, match="must be at most"):
        hook["set_contact"](engine, mujoco.MjData(engine))


def test_a_body_at_rest_stays():
    drops = synthetic.load(5, shape=SQUARE)
    model = mujoco.MjModel.from_xml_string(
        export(ContactModel(find("spring_dashpot").at(0.15, 0.6)), drops).scene.xml()
    )
    data = mujoco.MjData(model)
    data.qpos[:] = 0, 0.02, 0
    for _ in range(20_000):
        mujoco.mj_step(model, data)
    assert abs(data.qvel).max() < 1e-3
    assert abs(data.qpos - (0, 0.02, 0)).max() < 1e-4


def test_what_mujoco_lacks_is_refused_by_name_and_size():
    drops = synthetic.load(50)
    rebound = find_effect("tangential_restitution", "slip")(beta=0.5)
    model = ContactModel(find("mirtich").at(0.2, 0.6), effects={"tangential_restitution": rebound})
    with pytest.raises(ContactLearnError, match=r"tangential_restitution has no form in MuJoCo, .* by \d+\.\d%"):
        export(model, drops)
    with pytest.raises(ContactLearnError, match=r"ε above 0\.135, and this law has 0\.100"):
        export(ContactModel(find("mirtich").at(0.2, 0.1)), drops)
    with pytest.raises(DataError, match="needs the one shape"):
        export(ContactModel(find("mirtich").at(0.2, 0.5)), drops.replace(shape=None))
