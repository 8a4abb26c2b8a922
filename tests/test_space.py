"""Bodies in space: the same core, which must agree with the plane where both exist."""

import clarabel
import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.integrate import solve_ivp
from spatial import in_space, tossed, vectors, velocities

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import table
from contactlearn.effects import State, catalogue as effect_catalogue, find_effect
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import METRICS, NORMS, back_spin, outside_admissible
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.shared import Box, fit_subsets
from contactlearn.laws import find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.features import Features
from contactlearn.mechanics.impacts import IMPULSE_TARGETS, Impacts, Prediction, measured_impulse
from contactlearn.mechanics.shapes import Cuboid, Disc, Ellipsoid, Sphere, contact_point
from contactlearn.mechanics.space import BOTH
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

EXACT = {"rtol": 1e-12, "atol": 1e-12}
PLANAR = synthetic.load(300, seed=3)
SPATIAL = in_space(PLANAR)
TOSSED = tossed(300)


def test_a_planar_body_is_the_same_in_space():
    torch.testing.assert_close(SPATIAL.v_c, vectors(PLANAR.v_c), **EXACT)
    torch.testing.assert_close(SPATIAL.W[:, ::2, ::2], PLANAR.W, **EXACT)
    assert (SPATIAL.W[:, 1, ::2].abs() < 1e-12).all()
    torch.testing.assert_close(SPATIAL.wrench, velocities(PLANAR.wrench), **EXACT)
    for target in IMPULSE_TARGETS:
        torch.testing.assert_close(
            measured_impulse(SPATIAL, target), vectors(measured_impulse(PLANAR, target)), **EXACT
        )


def test_metrics_agree_with_the_plane():
    predicted = PLANAR.v_post * torch.linspace(0.5, 1.5, 300)[:, None].double()
    predictions = [Prediction(predicted, PLANAR.wrench), Prediction(velocities(predicted), SPATIAL.wrench)]
    for metric in METRICS.values():
        plane, space = (metric.error(*pair) for pair in zip((PLANAR, SPATIAL), predictions, strict=True))
        torch.testing.assert_close(space, plane, **EXACT)
    for norm in NORMS:
        there = bounds.distance(SPATIAL, velocities(predicted), norm)
        torch.testing.assert_close(there, bounds.distance(PLANAR, predicted, norm), **EXACT)
    assert torch.equal(back_spin(SPATIAL, velocities(predicted)), back_spin(PLANAR, predicted))
    outside = [outside_admissible(x, 1.5 * measured_impulse(x)) for x in (PLANAR, SPATIAL)]
    assert torch.equal(*outside)
    assert outside[0].any()


def test_the_wrench_is_that_of_the_motion():
    wrench = TOSSED.wrench
    body = TOSSED.mass, TOSSED.world_inertia, TOSSED.r
    after = rigid_body.apply_wrench(*body, TOSSED.v_pre, wrench)
    torch.testing.assert_close(after, TOSSED.v_post, **EXACT)
    # Angular momentum about the contact point changes by τ alone.
    change = TOSSED.v_post - TOSSED.v_pre
    spun = (TOSSED.world_inertia @ change[:, 3:, None])[..., 0]
    about = spun - torch.linalg.cross(TOSSED.r, TOSSED.mass[:, None] * change[:, :3])
    torch.testing.assert_close(wrench[:, 3:], about, **EXACT)
    slope = rigid_body.velocity_per_wrench(*body)
    torch.testing.assert_close((slope @ wrench[..., None])[..., 0], change, **EXACT)
    J = rigid_body.contact_jacobian(TOSSED.r)
    torch.testing.assert_close((J @ TOSSED.v_pre[..., None])[..., 0], TOSSED.v_c, **EXACT)
    torch.testing.assert_close(TOSSED.W, J @ slope[..., :3], **EXACT)
    energy = rigid_body.squared_mass_norm(*body[:2], TOSSED.v_post) - rigid_body.squared_mass_norm(
        *body[:2], TOSSED.v_pre
    )
    point = wrench * torch.tensor((1, 1, 1, 0, 0, 0))
    after = rigid_body.apply_wrench(*body, TOSSED.v_pre, point)
    energy = rigid_body.squared_mass_norm(*body[:2], after) - rigid_body.squared_mass_norm(*body[:2], TOSSED.v_pre)
    gained = rigid_body.energy_excess(TOSSED.W, TOSSED.v_c, point[:, :3])
    torch.testing.assert_close(energy / 2, gained, **EXACT)


def test_a_rotation_turns_the_body_to_the_world():
    turn = torch.tensor((0.6, 0.0, 0.0, 0.8), dtype=torch.float64)  # about z by 2 atan(4/3)
    x = rigid_body.rotation(2 * turn) @ torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)
    torch.testing.assert_close(x, torch.tensor((-0.28, 0.96, 0.0), dtype=torch.float64))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_in_space_is_read_as_it_was_saved(tmp_path, suffix):
    cov = torch.eye(6).expand(300, 6, 6).double() + 0.1
    impacts = TOSSED.replace(v_pre_cov=cov, q_post=TOSSED.q, time=TOSSED.order, source=str(tmp_path / f"t{suffix}"))
    table.save(impacts, impacts.source)
    read = table.load(impacts.source)
    assert read.fingerprint() == impacts.fingerprint()
    assert read.space is impacts.space
    frame = table.preview(tmp_path / f"t{suffix}").header
    assert {"rz", "qw", "wz_post", "inertia_z", "cov_vz_wx"} <= {*frame}


def test_one_moment_of_inertia_is_that_about_every_axis():
    ball = TOSSED.replace(inertia=TOSSED.inertia[:, 0])
    torch.testing.assert_close(ball.world_inertia, ball.inertia[:, :1, None] * torch.eye(3).double(), **EXACT)


def broken(column, value):
    impacts = in_space(synthetic.load(20, seed=1))
    fields = {name: getattr(impacts, name).clone() for name in ("r", "q", "v_pre", "v_post", "inertia")}
    fields[column[0]][(3, *column[1:])] = value
    return impacts.replace(**fields)


REFUSED = {
    "quaternion": (lambda: broken(("q", 3), 2.0), r"row 4 .* column qw: the quaternion .* length 1"),
    "inertia": (
        lambda: broken(("inertia", 1), 1.0),
        r"row 4 .* column inertia_y: .* at most the sum of the two others",
    ),
    "approach": (
        lambda: TOSSED.replace(
            r=TOSSED.r.roll(1, -1), v_pre=TOSSED.v_pre * torch.tensor((1, 1, -1, 0, 0, 0)), v_post=TOSSED.v_pre
        ),
        r"column vz: must approach the floor: .* the normal is z, upwards, and the contact points lie towards -x",
    ),
    "left-handed": (
        lambda: SPATIAL.replace(
            v_post=SPATIAL.v_post * torch.tensor((1, 1, 1, -1, -1, -1)),
            v_pre=SPATIAL.v_pre * torch.tensor((1, 1, 1, -1, -1, -1)),
            validate=True,
        ),
        r"axes must be right-handed, and I Δω is nearer to −r × m Δv",
    ),
    "scalar last": (
        lambda: TOSSED.replace(
            shape=(box := Cuboid((0.02, 0.03, 0.04))),
            r=contact_point(box, TOSSED.q[:, 3:]),
            q=torch.cat((TOSSED.q[:, :3], TOSSED.q[:, 3:].roll(-1, -1)), -1),
        ),
        r"the scalar of a quaternion must come first, in qw; .* m with the scalar last; rename the columns",
    ),
    "shape": (lambda: SPATIAL.replace(q=PLANAR.q), r"q must have shape \(300, 7\), got \(300, 3\)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_mistakes_are_refused_in_one_line(name):
    make, message = REFUSED[name]
    with pytest.raises(DataError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


PLANE_ALONE = {
    "feature space": lambda: Features.of(SPATIAL, "x2_polar"),
    "law whittaker .fazeli2017.": lambda: find("whittaker", "fazeli2017").at(0.1, 0.5).impulse(SPATIAL.W, SPATIAL.v_c),
    "effect contact_patch": lambda: ContactModel(
        base=find("whittaker").at(0.1, 0.5), effects={"contact_patch": find_effect("contact_patch")()}
    ).predict(SPATIAL),
}


@pytest.mark.parametrize("what", PLANE_ALONE)
def test_what_exists_in_the_plane_alone_says_so(what):
    with pytest.raises(ContactLearnError, match=f"{what}.* exists for bodies that move in a plane alone"):
        PLANE_ALONE[what]()


def test_a_spatial_table_needs_its_columns(tmp_path):
    path = tmp_path / "drops.csv"
    path.write_text("mass,qw,qx,qy,qz\n1,1,0,0,0\n")
    with pytest.raises(DataError, match=r"needed: mass, inertia_x, .* qz, vx, vy, vz, wx"):
        table.load(path)


def test_moments_of_inertia_may_be_stated_for_all():
    moments = [4e-5, 5e-5, 6e-5]
    frame = SPATIAL.to_frame().drop(columns=["inertia_x", "inertia_y", "inertia_z"])
    impacts = table.load(frame, inertia=moments)
    assert impacts.inertia.tolist() == [moments] * len(frame)
    for one in (table.load(frame, inertia=4e-5), table.load(frame.assign(inertia=4e-5))):
        assert one.inertia.tolist() == [[4e-5] * 3] * len(frame)
    with pytest.raises(DataError, match=r"at most the sum of the two others, got \[.*0\.0003\]"):
        table.load(frame, inertia=[1e-4, 1e-4, 3e-4])
    with pytest.raises(DataError, match="three along the body's axes, got"):
        table.load(frame, inertia=[1e-4, 1e-4])
    with pytest.raises(DataError, match="inertia is one number in a plane"):
        table.load(PLANAR.to_frame().drop(columns="inertia"), inertia=moments)


@pytest.mark.parametrize("norm", NORMS)
def test_the_bound_agrees_with_the_plane(norm):
    plane, space = bounds.irb(PLANAR, norm), bounds.irb(SPATIAL, norm)
    distances = [bounds.distance(x, found.v_post, norm) for x, found in ((PLANAR, plane), (SPATIAL, space))]
    torch.testing.assert_close(*distances, rtol=1e-9, atol=1e-9)  # a root: squares agree to rounding
    torch.testing.assert_close(space.wrench, velocities(plane.wrench), rtol=1e-9, atol=1e-9)


def least(impacts, row, norm):
    """The bound of a trial by a solver of cone programmes."""
    W, v_c = impacts.W[row].numpy(), impacts.v_c[row].numpy()
    L = np.linalg.cholesky(W)
    slope = rigid_body.velocity_per_wrench(impacts.mass, impacts.world_inertia, impacts.r)[row, :, :3].numpy()
    change = (impacts.v_post - impacts.v_pre)[row].numpy()
    D = np.eye(6)
    if norm == "mass":
        D[:3, :3], D[3:, 3:] = impacts.mass[row].item() * np.eye(3), impacts.world_inertia[row].numpy()
    start = np.linalg.solve(L, v_c)
    size = np.linalg.norm(start)
    # Unknown p = Lᵀ P / |L⁻¹ v_c|: the energy ball is |p + start/size| ≤ 1.
    slope = slope @ np.linalg.inv(L.T) * size
    H = sparse.csc_matrix(np.triu(2 * slope.T @ D @ slope))
    up, rise = np.linalg.inv(L.T)[2], L[2]
    A = np.vstack((np.zeros(3), -np.eye(3), -up, -rise))
    b = np.concatenate(((1.0,), start / size, (0.0,), (v_c[2] / size,)))
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas = False, 1e-13, 1e-13, 1e-13
    cones = [clarabel.SecondOrderConeT(4), clarabel.NonnegativeConeT(2)]
    x = np.array(
        clarabel.DefaultSolver(H, -2 * slope.T @ D @ change, sparse.csc_matrix(A), b, cones, settings).solve().x
    )
    missed = change - slope @ x
    return np.sqrt(missed @ D @ missed)


@pytest.mark.parametrize("norm", NORMS)
def test_the_bound_is_that_of_a_solver(norm):
    """Outcomes of every kind: inside, of too much energy, that pull, that penetrate, and those at two limits."""
    found = bounds.irb(TOSSED, norm)
    distance = bounds.distance(TOSSED, found.v_post, norm).numpy()
    assert not outside_admissible(TOSSED, found.wrench[:, :3]).any()
    assert (found.wrench[:, 3:] == 0).all()
    expected = np.array([least(TOSSED, row, norm) for row in range(120)])
    np.testing.assert_allclose(distance[:120], expected, rtol=1e-5, atol=1e-6)


def test_best_post_hoc_and_the_bound_hold_for_laws():
    laws = {name: find(name).at(0.2, 0.4) for name in ("whittaker", "wang_mason", "mirtich", "drumwright_shell")}
    predictions = {name: ContactModel(base=law).predict(TOSSED) for name, law in laws.items()}
    best, chosen = bounds.best_post_hoc(TOSSED, predictions)
    least = bounds.distance(TOSSED, bounds.irb(TOSSED).v_post)
    errors = torch.stack([bounds.distance(TOSSED, one.v_post) for one in predictions.values()])
    torch.testing.assert_close(bounds.distance(TOSSED, best.v_post), errors.amin(0))
    assert len({*chosen.tolist()}) == 4
    gains = outside_admissible(TOSSED, predictions["wang_mason"].wrench[:, :3])
    assert (least <= errors[1] + 1e-9)[~gains].all()


def test_a_patch_is_of_the_plane():
    with pytest.raises(ContactLearnError, match="a contact patch exists for bodies that move in a plane alone"):
        bounds.irb(SPATIAL, patch=0.01)


def thrown(law, mu=0.2, eps=0.4, noise=0.0):
    """Bodies in space that follow a law, with noise of the velocities after contact."""
    outcome = ContactModel(base=find(law).at(mu, eps)).predict(TOSSED).v_post
    errors = torch.randn(outcome.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    return TOSSED.replace(v_post=outcome + noise * errors * torch.tensor((1.0,) * 3 + (10.0,) * 3))


@pytest.mark.parametrize("law", ["whittaker", "drumwright_shell", "wang_mason", "mirtich"])
def test_coefficients_are_identified_in_space(law):
    impacts = thrown(law, noise=0.01)
    fit = joint.fit(impacts, law)
    assert fit.converged
    error = (fit.values - torch.tensor((0.2, 0.4))).abs()
    assert (error < 4 * fit.standard_errors).all()
    assert (fit.standard_errors < 0.02).all()
    known = (0.01,) * 3 + (0.1,) * 3
    again = joint.fit(impacts, law, options=FitOptions(noise=known, noise_before=(1e-4,) * 6, starts=2))
    assert ((again.values - fit.values).abs() < 3 * fit.standard_errors).all()


@pytest.mark.parametrize("effect", ["contact_patch:path", "rolling_resistance:path", "directional_friction:path"])
def test_effects_along_the_path_are_fitted_beside_noise_before_contact(effect):
    """Latent states are a batch of their own; the law's coefficients stay those of the data, which have none of it."""
    noise = {"noise": (0.01,) * 3 + (0.1,) * 3, "noise_before": (1e-3,) * 3 + (1e-2,) * 3}
    impacts = thrown("wang_mason", noise=0.01)
    fit = joint.fit(impacts, "wang_mason", [effect], options=FitOptions(**noise, starts=2))
    assert ((fit.values[:2] - torch.tensor((0.2, 0.4))).abs() < 4 * fit.standard_errors[:2]).all()


def test_identification_agrees_with_the_plane():
    sizes = {"sizes": (60,), "repetitions": 2, "box": Box(nodes=16)}
    plane, space = (fit_subsets(one, "whittaker", **sizes) for one in (PLANAR, SPATIAL))
    for name in ("mu", "eps", "cost"):
        torch.testing.assert_close(getattr(space, name), getattr(plane, name), rtol=1e-6, atol=1e-9)


def test_a_fit_refuses_what_does_not_exist_in_space():
    with pytest.raises(ContactLearnError, match=r"law mirtich .* exists for bodies that move in a plane alone"):
        joint.fit(SPATIAL, find("mirtich", "fazeli2017"))
    with pytest.raises(ContactLearnError, match="effect orientation_dependent_moment:harmonics exists for bodies"):
        joint.fit(SPATIAL, "whittaker", ["orientation_dependent_moment"])


OBJECTS = tuple(("oak", "beech", "ash")[k % 3] for k in range(300))
THERE = {  # values in space: y is up in the plane
    "com_offset": lambda a, b: (a, 0.0, b),
    "shape_error": lambda a, b: (a, 0.0, b),
    "surface_tilt": lambda phi: (phi, 0.0),
    "orientation_offset": lambda delta: (delta, 0.0, 0.0),
}
IN_SPACE = [kind for forms in effect_catalogue().values() for kind in forms if kind.spaces == BOTH]


@pytest.mark.parametrize("kind", IN_SPACE, ids=lambda kind: str(kind.id))
def test_effects_agree_with_the_plane(kind):
    slower = torch.linspace(0.1, 1, len(PLANAR), dtype=torch.float64)[:, None]  # some effects act on slow impacts alone
    plane = PLANAR.replace(object=OBJECTS, v_pre=slower * PLANAR.v_pre, validate=False)
    effect = kind().prepare(plane)
    again = kind().prepare(in_space(plane))
    assert again.equation == effect.equation
    shares = torch.linspace(0.2, 0.4, len(effect.parameters)).tolist()
    values = [p.start + share * (p.high - p.start) for p, share in zip(effect.parameters, shares, strict=True)]
    law = find("wang_mason").at(0.15, 0.6)
    outcomes = []
    there = THERE.get(kind.name, lambda *own: own)(*values)
    for impacts, one in ((plane, effect.at(values)), (in_space(plane), again.at(there))):
        model = ContactModel(base=law, effects={"it": one})
        outcomes.append(model.predict(impacts).v_post)
        rest = ContactModel(base=law, effects={"it": one.vanished()}).predict(impacts)
        assert torch.equal(rest.v_post, ContactModel(base=law).predict(impacts).v_post)
    torch.testing.assert_close(outcomes[1], velocities(outcomes[0]), rtol=1e-9, atol=1e-9)
    change = outcomes[0] - rest.v_post[:, [0, 2, 4]] * torch.tensor((1, 1, -1))
    assert kind.name == "corner_radius" or change.abs().max() > 1e-6  # an ellipse has no corners


def test_effects_agree_with_mechanics_in_space():
    """A tracked point of a body moves as the body does: the same toss, told of another point of it."""
    law, d = find("wang_mason").at(0.2, 0.4), torch.tensor((0.01, -0.02, 0.005), dtype=torch.float64)
    away = (rigid_body.rotation(TOSSED.q[:, 3:]) @ d[:, None])[..., 0]

    def of_another_point(v):
        return torch.cat((v[:, :3] - torch.linalg.cross(v[:, 3:], away), v[:, 3:]), -1)

    tracked = TOSSED.replace(r=TOSSED.r + away, v_pre=of_another_point(TOSSED.v_pre))
    model = ContactModel(base=law, effects={"it": find_effect("com_offset")().at(d)})
    outcome = ContactModel(base=law).predict(TOSSED).v_post
    torch.testing.assert_close(model.predict(tracked).v_post, of_another_point(outcome), **EXACT)


def test_a_tilted_floor_is_a_turned_world():
    law, lean = find("wang_mason").at(0.2, 0.4), torch.tensor((-0.07, -0.1, 0.0), dtype=torch.float64)
    R = rigid_body.rotation(rigid_body.turn_quaternion(torch.tensor((1.0, 0, 0, 0)).double(), lean))
    v_pre, outcome = (v.reshape(-1, 2, 3) @ R.mT for v in (TOSSED.v_pre, ContactModel(base=law).predict(TOSSED).v_post))
    q = torch.cat((TOSSED.q[:, :3] @ R.mT, rigid_body.turn_quaternion(TOSSED.q[:, 3:], lean)), -1)
    turned = TOSSED.replace(r=TOSSED.r @ R.mT, q=q, v_pre=v_pre.flatten(1), validate=False)
    model = ContactModel(base=law, effects={"it": find_effect("surface_tilt", "seen")().at((0.1, -0.07))})
    torch.testing.assert_close(model.predict(turned).v_post, outcome.flatten(1), **EXACT)
    torch.testing.assert_close(rigid_body.rotation(q[:, 3:]), R @ rigid_body.rotation(TOSSED.q[:, 3:]), **EXACT)


def test_a_body_that_flies_on_obeys_eulers_equations():
    law, dt = find("wang_mason").at(0.2, 0.4), 0.005
    late = ContactModel(base=law, effects={"it": find_effect("gravity_impulse")().at([dt])}).predict(TOSSED).v_post
    v_post = ContactModel(base=law).predict(TOSSED).v_post
    torch.testing.assert_close(
        late[:, :3] - v_post[:, :3], torch.tensor((0.0, 0.0, -9.81 * dt)).expand(len(late), 3).double()
    )
    R = rigid_body.rotation(TOSSED.q[:, 3:])
    for k in range(20):
        moments, body = TOSSED.inertia[k].numpy(), (R[k].T @ v_post[k, 3:]).numpy()

        def rates(t, y, moments=moments):
            spin, attitude = y[:3], y[3:].reshape(3, 3)
            turning = np.array([[0, -spin[2], spin[1]], [spin[2], 0, -spin[0]], [-spin[1], spin[0], 0]])
            return np.concatenate((np.cross(moments * spin, spin) / moments, (attitude @ turning).ravel()))

        end = solve_ivp(rates, (0, dt), np.concatenate((body, R[k].numpy().ravel())), rtol=1e-10, atol=1e-12).y[:, -1]
        expected = torch.tensor(end[3:].reshape(3, 3) @ end[:3])
        turned = (expected - v_post[k, 3:]).norm()
        assert (late[k, 3:] - expected).norm() < 0.02 * turned + 1e-9  # one step of second order


def test_corners_are_round_in_space():
    """A box lands on spheres whose centres lie within its sides; the table computes the same points."""
    q, half, radius = TOSSED.q, torch.tensor((0.05, 0.04, 0.03)).double(), 0.006
    R = rigid_body.rotation(q[:, 3:])
    corners = torch.cartesian_prod(*[torch.tensor((-1.0, 1.0)).double()] * 3)
    for inner, shape in ((half, Cuboid(tuple(half))), (half - radius, Cuboid(tuple(half), radius))):
        centres = (inner * corners) @ R.mT
        lowest = centres[torch.arange(300), centres[..., 2].argmin(-1)]
        down = (half - inner)[0] * torch.tensor((0.0, 0.0, -1.0)).double()
        torch.testing.assert_close(contact_point(shape, q[:, 3:]), lowest + down, **EXACT)
    boxes = TOSSED.replace(shape=Cuboid(tuple(half)), r=contact_point(Cuboid(tuple(half)), q[:, 3:]), validate=False)
    rounded = find_effect("corner_radius")(radius).state(State.of(boxes))
    torch.testing.assert_close(rounded.r, lowest + down, **EXACT)
    with pytest.raises(DataError, match="a body in space has the shape of one, got Disc"):
        TOSSED.replace(shape=Disc(0.1))


@pytest.mark.parametrize("kind", IN_SPACE, ids=lambda kind: str(kind.id))
def test_effects_turn_with_the_contact(kind):
    """A turn of everything about the normal turns the outcome, but where the effect names a direction or a place."""
    if kind.name in ("surface_tilt", "location_dependent_friction", "location_dependent_restitution"):
        return
    shape = Cuboid((0.05, 0.04, 0.03))
    impacts = TOSSED.replace(shape=shape, r=contact_point(shape, TOSSED.q[:, 3:]), validate=False, object=OBJECTS)
    about = torch.tensor((0.0, 0.0, 0.7), dtype=torch.float64)
    R = rigid_body.rotation(rigid_body.turn_quaternion(torch.tensor((1.0, 0, 0, 0)).double(), about))
    q = torch.cat((impacts.q[:, :3] @ R.mT, rigid_body.turn_quaternion(impacts.q[:, 3:], about)), -1)
    image = impacts.replace(r=impacts.r @ R.mT, q=q, v_pre=(impacts.v_pre.view(-1, 2, 3) @ R.mT).flatten(1))
    effect = kind().prepare(impacts)
    effect = effect.at([p.start + 0.2 * (p.high - p.start) for p in effect.parameters])
    model = ContactModel(base=find("wang_mason").at(0.3, 0.6), effects={"it": effect})
    turned = (model.predict(impacts).v_post.view(-1, 2, 3) @ R.mT).flatten(1)
    torch.testing.assert_close(model.predict(image).v_post, turned, rtol=1e-9, atol=1e-9)


def ball(slip, spin, mu=0.5, eps=0.6, **effects):
    """A ball of 1 kg and 0.1 m falls at 2 m/s with a slip (m/s) along y and a spin (rad/s) about the normal."""
    return struck((0, slip, -2.0, 0, 0, spin), mu, eps, **effects)


def struck(v, mu=0.5, eps=0.6, **effects):
    """Velocity after impact of a ball of 1 kg and 0.1 m."""
    shape = Sphere(0.1)
    q = torch.tensor([[0, 0, 0, 1.0, 0, 0, 0]]).double()
    v = torch.tensor([v], dtype=torch.float64)
    one = torch.ones(1).double()
    impacts = Impacts(
        one, one[:, None] * shape.gyration_squared(), contact_point(shape, q[:, 3:]), q, v, v, shape=shape
    )
    return ContactModel(base=find("wang_mason").at(mu, eps), effects=effects).predict(impacts).v_post[0]


def test_a_ball_rebounds_sideways_and_loses_spin():
    for form, share in (("slip", "beta"), ("impulse", "e_t")):
        v = ball(0.5, 0.0, effect=find_effect("tangential_restitution", form)(**{share: 0.4}))
        slip = v[1] + 0.1 * v[3]  # of the lowest point: v + ω × r
        assert slip.item() == pytest.approx(-0.4 * 0.5, rel=1e-12), form
    dry = find_effect("torsional_friction", "dry")(c=0.001, omega_s=1e-6)
    inertia, P_n = 0.004, 3.2
    assert ball(0.0, 10.0, effect=dry)[5].item() == pytest.approx(10 - 0.001 * P_n / inertia, rel=1e-9)
    assert ball(0.0, 0.1, effect=dry)[5].item() == pytest.approx(0, abs=1e-12)  # it stops, and does not reverse
    sliding = find_effect("torsional_friction", "sliding")(c=0.001)
    lost = [10 - ball(slip, 10.0, effect=sliding)[5].item() for slip in (0.0, 20.0)]
    assert lost[0] == pytest.approx(0.001 * P_n / inertia, rel=1e-6)
    assert 0 < lost[1] < 0.01 * lost[0]


def test_a_ball_that_rolls_is_slowed_down_while_the_contact_lasts():
    resisted = find_effect("rolling_resistance", "path")(c=0.005, omega_s=1e-6)
    inertia, P_n = 0.004, 3.2
    free = struck((0, 0, -2.0, 6.0, -8.0, 3.0), mu=0.0, effect=resisted)
    lost = 0.005 * P_n / inertia
    assert free[3:].tolist() == pytest.approx([6 - 0.6 * lost, -8 + 0.8 * lost, 3], rel=1e-9)
    rolling = struck((1.0, 0, -2.0, 0, 10.0, 0), effect=resisted)  # friction holds the contact point
    assert rolling[4].item() == pytest.approx(10 - 0.005 * P_n / (inertia + 0.01), rel=1e-6)
    assert rolling[0].item() == pytest.approx(0.1 * rolling[4].item(), abs=1e-9)

    def slides(P_n, velocity):  # dv/dP_n of a ball whose friction turns its spin
        v, omega = velocity[:2], velocity[2:]
        slip = v + 0.1 * np.array((-omega[1], omega[0]))
        friction = -0.05 * slip / np.hypot(*slip)
        moment = 0.1 * np.array((friction[1], -friction[0])) - 0.005 * omega / np.hypot(*omega)
        return np.concatenate((friction, moment / inertia))

    start = np.array((2.0, 1.0, -6.0, 8.0))
    exact = solve_ivp(slides, (0, P_n), start, rtol=1e-10, atol=1e-12).y[:, -1]
    found, alone = (struck((2.0, 1.0, -2.0, -6.0, 8.0, 0), mu=0.05, **e)[[0, 1, 3, 4]] for e in ({"e": resisted}, {}))
    change = (found - alone).numpy()
    left = exact - found.numpy()
    assert np.abs(left[2:]).max() < 0.05 * np.abs(change[2:]).max()


def stribeck(v):
    return 1 + 1.5 * (-v.norm(dim=1, keepdim=True) / 0.5).exp()


def on_pile(v):
    return 1 + (v @ torch.tensor((0.5, -0.3)).double()[:, None]) / v.norm(dim=1, keepdim=True)


@pytest.mark.parametrize(("effect", "factor"), [
    (find_effect("velocity_dependent_friction", "stribeck_path")(1.5, 0.5), stribeck),
    (find_effect("directional_friction", "path")(0.5, -0.3), on_pile),
])  # fmt: skip
def test_friction_follows_the_slip_as_it_turns(effect, factor):
    law = find("wang_mason").at(0.1, 0.6)
    alone, found = (ContactModel(base=law, effects=e).predict(TOSSED).wrench[:, :3] for e in ({}, {"it": effect}))
    steps, v, P, slowest = 1000, TOSSED.v_c, torch.zeros_like(alone), torch.inf
    rise = (TOSSED.W @ alone[..., None])[:, 2, 0]
    for _ in range(steps):
        slip = v[:, :2].norm(dim=1, keepdim=True)
        slowest = slip.clamp_max(slowest)
        friction = -0.1 * factor(v[:, :2]) * v[:, :2] / slip
        force = torch.cat((friction, torch.ones_like(slip)), 1)
        rate = (TOSSED.W @ force[..., None])[..., 0]
        step = rise / steps / rate[:, 2]
        v, P = v + rate * step[:, None], P + force * step[:, None]
    slides = slowest[:, 0] > 0.1
    assert slides.sum() > 100
    turned = torch.linalg.cross(v, TOSSED.v_c)[slides, 2] / (v.norm(dim=1) * TOSSED.v_c.norm(dim=1))[slides]
    assert turned.abs().max() > 0.2
    error, change = ((one - P)[slides].norm(dim=1) for one in (found, alone))
    assert error.max() < 0.05 * change.max()
    assert error.median() < 0.01 * change.median()


PLANTED = {
    "damping and drag": {"spin_damping": [0.1], "side_drag": [0.05]},
    "surface": {"torsional_friction": [0.002], "tangential_restitution": [0.3]},
    "mass centre": {"com_offset": [0.003, -0.004, 0.006]},
    "floor": {"surface_tilt": [0.02, -0.03], "sampling_delay": [0.004]},
    "pile and air": {"directional_friction:path": [0.3, -0.2], "side_drag:horizontal": [0.05]},
    "body": {"shape_error": [0.1, -0.05, 0.08], "orientation_offset": [0.05, -0.03, 0.02]},
}


@pytest.mark.parametrize("name", PLANTED)
def test_effects_are_fitted_in_space(name):
    """Of bodies of any pose; their derivatives are those of the fit."""
    shape = Ellipsoid((0.08, 0.06, 0.04))
    bodies = TOSSED.replace(shape=shape, r=contact_point(shape, TOSSED.q[:, 3:]), validate=False)
    tossed = bodies[bodies.v_c[:, 2] < -0.2]
    kinds = [find_effect(*key.split(":")) for key in PLANTED[name]]
    effects = {kind.name: kind().prepare(tossed) for kind in kinds}
    values = PLANTED[name].values()
    truth = {key: effect.at(own) for (key, effect), own in zip(effects.items(), values, strict=True)}
    model = ContactModel(base=find("whittaker").at(0.2, 0.4), effects=truth)
    fit = joint.fit(tossed.replace(v_post=model.predict(tossed).v_post), "whittaker", list(PLANTED[name]))
    wanted = torch.tensor([0.2, 0.4, *(x for own in values for x in own)]).double()
    torch.testing.assert_close(fit.values, wanted, rtol=1e-4, atol=1e-5)
