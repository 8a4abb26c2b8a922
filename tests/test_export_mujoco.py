"""One impact in MuJoCo is that of the exported model."""

import json
import math
from dataclasses import replace

import pytest
import torch
from spatial import tossed

from contactlearn.cli.commands.export import export_model
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data.audit.corrections import correct
from contactlearn.effects import State, find_effect
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.rigid_body import GRAVITY, in_world, rotation
from contactlearn.mechanics.shapes import Cuboid, Cylinder, Ellipsoid, Polygon, Polyhedron, Solid, Sphere, contact_point
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel, actual_coefficients, actual_state
from contactlearn.models.export.mujoco import difference, export, ranges, solref
from contactlearn.scatter import ContactPoint, Friction, Normal, Restitution
from contactlearn.simulation import synthetic
from contactlearn.simulation.mujoco import outcomes

CLOSE = 0.015  # mass norm: the body turns and falls while MuJoCo's contact lasts

mujoco = pytest.importorskip("mujoco")


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
    model = joint.fit(pool, law).model
    (scene, hook), expected = export(model, test), model.predict(test).v_post
    assert hook is None
    found = outcomes(scene, test)
    assert found.isfinite().all()
    assert difference(expected, found, test) < CLOSE
    assert difference(test.v_post, found, test) < difference(test.v_post, expected, test) + 0.01
    half = outcomes(replace(scene, contact_time=scene.contact_time / 2), test)
    assert difference(found, half, test) < 0.003
    usual = scene.xml().replace('solimp="0.005 0.005 1"', "").replace("elliptic", "pyramidal").replace("1e5", "1")
    usual = outcomes(scene, test, xml=usual)
    ended = usual.isfinite().all(-1)
    assert ended.double().mean() > 0.9
    assert difference(expected[ended], usual[ended], test[ended]) > 0.05


SQUARE = Polygon(((0.03, 0.02), (-0.03, 0.02), (-0.03, -0.02), (0.03, -0.02)))
BOX, EGG = Cuboid((0.05, 0.035, 0.025)), Ellipsoid((0.05, 0.035, 0.025))
GEOMETRY = {
    "com_offset": {"delta_a": 3e-3, "delta_b": -2e-3, "delta_c": 2e-3},
    "surface_tilt": {"phi": 0.05, "psi": -0.08},
    "inertia_error": {"kappa": 0.3},
    "orientation_offset": {"delta": 0.1, "delta_a": -0.05, "delta_c": 0.08},
    "shape_error": {"s_a": 0.1, "s_b": -0.1, "s_c": 0.1},
    "corner_radius": {"rho_c": 5e-3},
    "torsional_friction:sliding": {"c": 0.01},
}
CARD = {"gravity": 9.81, "delay": 0.0, "centre_a": 4e-3, "middle_b": 2e-3}
ON = {None: [*GEOMETRY][:5], SQUARE: ["com_offset", "orientation_offset", "corner_radius"], EGG: [*GEOMETRY][:5]}
ON |= {BOX: ["com_offset", "orientation_offset", "corner_radius"], Sphere(0.025): ["torsional_friction:sliding"]}
PYRAMID = Polyhedron(
    ((0.05, 0.0, -0.02), (-0.05, 0.0, -0.02), (0.0, 0.04, -0.02), (0.0, -0.04, -0.02), (0.0, 0.0, 0.06))
)
ON |= {PYRAMID: ["com_offset", "orientation_offset", "corner_radius"]}
CAN = Cylinder(0.04, 0.05, "y")
ON |= {CAN: ["com_offset", "surface_tilt", "inertia_error", "orientation_offset"]}


def tosses(shape, count=100):
    """Random impacts of a body in space that is about to touch the floor at the origin."""
    drops = tossed(count)
    mass, q = torch.full_like(drops.mass, 0.2), drops.q.clone()
    q[:, :2] = 0
    drops = drops.replace(
        mass=mass, inertia=mass[:, None] * shape.gyration_squared(), q=q, shape=shape,
        r=contact_point(shape, q[:, 3:]), validate=False,
    )  # fmt: skip
    return drops[drops.v_c[:, 2] < -0.3].replace(validate=True)


@pytest.mark.parametrize(("name", "shape"), [(name, shape) for shape, names in ON.items() for name in names], ids=str)
def test_geometry_is_that_of_the_effect(name, shape):
    drops = (
        tosses(shape) if isinstance(shape, Solid) else synthetic.load(100, shape=shape, velocity_noise=0, spin_noise=0)
    )
    effect = find_effect(*name.split(":"))().prepare(drops)
    effect = effect.at([GEOMETRY[name][p.name] for p in effect.parameters])
    law = find("spring_dashpot" if drops.space is PLANE else "wang_mason_newton").at(0.15, 0.6)
    model = ContactModel(law, effects={effect.name: effect})
    state = actual_state(model.effects, State.of(drops))
    clear = (state.v_n < -0.3) & ((state.lever > 0.1) | isinstance(shape, Sphere))
    drops = drops[clear].replace(validate=False)
    found, expected = outcomes(export(model, drops).scene, drops), model.predict(drops)
    against = drops.replace(v_post=expected.v_post)
    ended = found.isfinite().all(-1)
    assert ended.double().mean() > 0.9
    error = mass_error(against, replace(expected, v_post=found))[ended]
    assert error.median() < CLOSE
    alone = mass_error(against, ContactModel(law).predict(drops))[ended]
    assert alone.median() > 2 * error.median(), "without the effect the outcome is another"


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=str)
def test_a_mass_centre_that_the_rig_card_has_moved_is_in_the_scene(shape):
    drops = synthetic.load(100, shape=shape, velocity_noise=0, spin_noise=0) if shape is SQUARE else tosses(shape)
    card = Apparatus(**{name: Estimate(value=at, error=1e-5) for name, at in CARD.items()})
    drops = correct(drops.replace(apparatus=card, validate=False), ["rig"])
    state = State.of(drops)
    drops = drops[(state.v_n < -0.3) & (state.lever > 0.1)].replace(validate=False)
    model = ContactModel(find("spring_dashpot" if shape is SQUARE else "wang_mason_newton").at(0.15, 0.6))
    scene, expected = export(model, drops).scene, model.predict(drops)
    against = drops.replace(v_post=expected.v_post)
    right, wrong = (
        mass_error(against, replace(expected, v_post=outcomes(one, drops))).nanmedian()
        for one in (scene, replace(scene, centre=(0.0, 0.0, 0.0)))
    )
    assert right < CLOSE
    assert wrong > 3 * right


@pytest.mark.parametrize(("shape", "eps_0"), [(None, 0.6), (EGG, 0.6), (EGG, 0.12)], ids=str)
def test_the_hook_sets_coefficients_that_depend_on_the_state(shape, eps_0):
    drops = synthetic.load(12, velocity_noise=0, spin_noise=0) if shape is None else tosses(shape, 12)
    effect = find_effect("velocity_dependent_restitution", "linear")().prepare(drops)
    load = find_effect("load_dependent_friction")(p=0.5, v_ref=2.0)
    law = find("spring_dashpot" if shape is None else "wang_mason_newton").at(0.15, eps_0)
    model = ContactModel(law, effects={effect.name: effect.at([0.3 * eps_0]), load.name: load})
    scene, text = export(model, drops)
    hook = {}
    exec(text, hook)
    mu, eps = actual_coefficients(model.effects, State.of(drops), *law.coefficients)
    engine = mujoco.MjModel.from_xml_string(scene.xml())
    data = mujoco.MjData(engine)
    for q, v, *one in zip(drops.q, drops.v_pre, mu, eps, strict=True):
        mujoco.mj_resetData(engine, data)
        data.qpos[:], data.qvel[:] = q, v
        data.qpos[scene.space.d - 1] += 1  # in flight
        if scene.space is SPACE:
            data.qvel[3:] = rotation(q[3:]).T @ v[3:]
        hook["set_contact"](engine, data)
        set_values = (engine.pair_friction[0, 0], *engine.pair_solref[0])
        k, c = solref(one[1].item(), scene.contact_time)
        assert set_values == pytest.approx((one[0].item(), -k, -c), rel=1e-9)
    assert difference(model.predict(drops).v_post, outcomes(scene, drops, (mu, eps)), drops) < CLOSE
    engine.opt.timestep *= 2
    with pytest.raises(ValueError, match="must be at most"):
        hook["set_contact"](engine, mujoco.MjData(engine))


@pytest.mark.parametrize("load", [False, True], ids=["law", "load_dependent"])
@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=str)
def test_the_friction_of_slides_is_that_of_slides_and_impacts_have_the_laws(shape, load):
    """Momentum: friction takes μ g t from a slide, and in an impact μ times the change of the normal velocity."""
    drops = synthetic.load(1, shape=shape) if shape is SQUARE else tosses(shape)
    card = Apparatus(**{name: Estimate(value=at, error=0.01) for name, at in (CARD | {"friction": 0.3}).items()})
    effects = {"load_dependent_friction": find_effect("load_dependent_friction")(p=0.5, v_ref=2.0)} if load else {}
    model = ContactModel(find("wang_mason").at(0.15, 0.5), effects=effects)
    scene, text = export(model, drops.replace(apparatus=card, validate=False), contact_time=1e-3)
    assert "SLIDES = 0.3  # ± 0.01" in text
    exec(text, hook := {})
    engine = mujoco.MjModel.from_xml_string(scene.xml())
    data, up = mujoco.MjData(engine), scene.space.d - 1

    def step():
        hook["set_contact"](engine, data)
        mujoco.mj_step(engine, data)

    data.qpos[up], data.qvel[0] = (0.02 if shape is SQUARE else 0.025), 0.6
    while data.time < 0.05:
        step()
    assert (0.6 - data.qvel[0]) / (GRAVITY * data.time) == pytest.approx(0.3, rel=CLOSE)
    mujoco.mj_resetData(engine, data)
    data.qpos[:] = (0, 0.1, 0.4) if shape is SQUARE else (0, 0, 0.1, 0.9, 0.3, 0.3, 0.1)
    data.qvel[[0, up]] = 2, -1
    while not data.ncon:
        before, begun = data.qvel.copy(), data.time
        step()
    mu = hook["coefficients"](data.qpos, before)[0] if load else 0.15
    while data.ncon:
        step()
    normal = data.qvel[up] - before[up] + GRAVITY * (data.time - begun)
    assert (before[0] - data.qvel[0]) / normal == pytest.approx(mu, abs=CLOSE)  # one step in a hundred is a slide's
    assert mu < 0.2, "slides have another friction"


@pytest.mark.parametrize(
    "shape", [SQUARE, BOX, Cuboid(BOX.half, corner=5e-3), Sphere(0.025), PYRAMID, Cylinder(0.03, 0.025)], ids=str
)
def test_a_body_at_rest_stays(shape):
    drops = synthetic.load(5, shape=shape) if shape is SQUARE else tosses(shape)
    scene = export(ContactModel(find("mirtich").at(0.15, 0.6)), drops).scene
    model = mujoco.MjModel.from_xml_string(scene.xml())
    data = mujoco.MjData(model)
    data.qpos[: scene.space.d] = [0.0] * (scene.space.d - 1) + [0.02 if shape in (SQUARE, PYRAMID) else 0.025]
    start = data.qpos.copy()
    for _ in range(20_000):
        mujoco.mj_step(model, data)
    assert abs(data.qvel).max() < 1e-3
    assert abs(data.qpos - start).max() < 1e-4


def test_what_mujoco_lacks_is_refused_by_name_and_size():
    drops = synthetic.load(50)
    rebound = find_effect("tangential_restitution", "slip")(beta=0.5)
    model = ContactModel(find("mirtich").at(0.2, 0.6), effects={"tangential_restitution": rebound})
    with pytest.raises(ContactLearnError, match=r"tangential_restitution has no form in MuJoCo, .* by \d+\.\d%"):
        export(model, drops)
    with pytest.raises(ContactLearnError, match=r"ε of at least 0\.05, and this law has 0\.040"):
        export(ContactModel(find("mirtich").at(0.2, 0.04)), drops)
    cans = tosses(CAN, 20)
    stretched = find_effect("shape_error")().prepare(cans).at([0.1, 0.0, 0.1])
    with pytest.raises(ContactLearnError, match="ends of a cylinder ellipses, which MuJoCo's cylinder has not"):
        export(ContactModel(find("mirtich").at(0.2, 0.6), effects={"shape_error": stretched}), cans)
    with pytest.raises(DataError, match="needs the one shape"):
        export(ContactModel(find("mirtich").at(0.2, 0.5)), drops.replace(shape=None))


def test_effects_of_the_recording_are_left_out():
    """A late frame is no physics: the scene is that of the model without it."""
    drops = synthetic.load(20, seed=1)
    law, late = find("spring_dashpot").at(0.2, 0.5), find_effect("sampling_delay")(dt=2e-3)
    body = {"inertia_error": find_effect("inertia_error")(kappa=0.1)}
    model = ContactModel(law, effects=body | {"sampling_delay": late})
    assert export(model, drops) == export(ContactModel(law, effects=body), drops)
    assert model.recorded == ("sampling_delay",)
    assert list(model.physical.effects) == ["inertia_error"]
    fitted = joint.fit(drops, "mirtich", ["gravity_impulse", "side_drag"]).model
    kept = torch.tensor([0, 1, 3])
    assert torch.equal(fitted.physical.parameter_covariance, fitted.parameter_covariance[kept][:, kept])
    on_top = ContactModel(fitted).physical.law_model
    assert list(on_top.effects) == ["side_drag"]


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=str)
@pytest.mark.parametrize(
    "component", [Restitution(sigma=0.05), Friction(sigma=0.03), Normal(sigma=0.03), ContactPoint(sigma=1e-3)]
)
def test_the_hook_draws_the_scatter_anew_at_each_impact(shape, component):
    """One body falls again and again: outcomes have the standard deviations of the model's draws."""
    drops = synthetic.load(60, shape=shape, velocity_noise=0, spin_noise=0) if shape is SQUARE else tosses(shape)
    law = find("spring_dashpot" if shape is SQUARE else "wang_mason_newton").at(0.15, 0.6)
    alone = ContactModel(law)
    found, expected = outcomes(export(alone, drops).scene, drops), alone.predict(drops)
    error = mass_error(drops.replace(v_post=expected.v_post), replace(expected, v_post=found)).nan_to_num(1.0)
    low = in_world(shape.corners()[:, None], drops.q)[..., -1].sort(0).values
    clear = (error < CLOSE) & (drops.v_c[:, -1] < -1) & (low[1] - low[0] > 0.01)
    drop = drops[clear.nonzero()[0]].replace(validate=False)
    model = ContactModel(law, scatter={component.name: component})
    (scene, hook), d = export(model, drop), drop.space.d
    own, engine = {}, mujoco.MjModel.from_xml_string(scene.xml())
    exec(hook, own)
    data, found = mujoco.MjData(engine), []
    level, pose, velocity = (engine.geom_pos.copy(), engine.geom_quat.copy()), drop.q[0].clone(), drop.v_pre[0].clone()
    if d == 3:
        velocity[3:] = rotation(pose[3:]).T @ velocity[3:]
    for _ in range(120):
        mujoco.mj_resetData(engine, data)
        data.qpos[:], data.qvel[:] = pose, velocity
        engine.geom_pos[:], engine.geom_quat[:] = level
        data.qpos[d - 1] += 1e-5 - own["gap"](engine, data)
        touched = False
        for _ in range(600):
            own["set_contact"](engine, data)
            mujoco.mj_step(engine, data)
            touched |= data.ncon > 0
            if touched and data.ncon == 0:
                break
        found.append(torch.tensor(data.qvel.copy()))
    drawn = torch.stack(found)
    if d == 3:
        drawn = torch.cat((drawn[:, :3], drawn[:, 3:] @ rotation(pose[3:]).T), 1)
    expected = model.scattered(drop, torch.Generator().manual_seed(0), 4000).v_post[:, 0]
    size = expected.std(0)
    seen = size > 0.3 * size.max()  # the law is another one
    assert (drawn.std(0)[seen] / size[seen]).tolist() == pytest.approx([1] * int(seen.sum()), rel=0.25)
    unit = (expected.square().sum(-1).mean() * CLOSE**2).sqrt() + size
    assert ((drawn.mean(0) - expected.mean(0)).abs() < unit).all()


def test_a_table_of_ranges_has_scatter_errors_and_their_correlation(tmp_path):
    drops = synthetic.load(60, shape=SQUARE, velocity_noise=0, spin_noise=0)
    law, errors = find("spring_dashpot").at(0.3, 0.6), torch.tensor([[4e-4, 3e-4], [3e-4, 9e-4]], dtype=torch.float64)
    components = Restitution(sigma=0.02), Friction(sigma=0.03), Normal(sigma=0.02)
    model = ContactModel(law, parameter_covariance=errors, scatter={one.name: one for one in components})
    table = ranges(model, drops)
    found, names = table["quantities"], [*table["quantities"]]
    assert names == ["friction", "restitution", "damping", "normal"]
    sizes = {"friction": math.hypot(0.02, 0.03), "restitution": math.hypot(0.03, 0.02), "normal": 0.02}
    for name, size in sizes.items():
        assert found[name]["standard_deviation"] == pytest.approx(size, rel=0.1)
        assert found[name]["high"] - found[name]["low"] == pytest.approx(2 * 1.645 * size, rel=0.1)
    assert [found[name]["scatter"] for name in names] == [0.03, 0.02, None, 0.02]
    correlation = torch.tensor(table["correlation"])
    expected = 3e-4 / (sizes["friction"] * sizes["restitution"])
    assert correlation[0, 1].item() == pytest.approx(expected, abs=0.15)  # of 256 parameters
    assert correlation[1, 2] < -0.9
    assert correlation[3, :3].abs().max() < 0.05
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    out = tmp_path / "impact.xml"
    said = export_model(str(tmp_path / "model.pt"), "mujoco", str(out), drops, without_residual=False, force=False)
    assert "the contact scatters: call set_contact(model, data) of the hook before each step" in said
    assert "ranges of 90 % for randomisation: friction 0.2" in said
    assert json.loads((tmp_path / "impact_ranges.json").read_text()) == table
    assert '"normal": 0.02' in (tmp_path / "impact_hook.py").read_text()
    with pytest.raises(ContactLearnError, match="scatter of other has no form in MuJoCo"):
        export(replace(model, scatter={"other": components[0]}), drops)
