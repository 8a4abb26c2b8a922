"""model.roll_out: flights and bounces against closed forms, a fine reference, and the balance of energy."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.effects import find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.free_rotation import turned
from contactlearn.mechanics.rigid_body import GRAVITY, inertia_in_world, rotation
from contactlearn.mechanics.shapes import Cuboid, Disc, Ellipse, Ellipsoid, Polygon, Sphere
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.roll_out import ENDS, Until
from contactlearn.simulation import synthetic

MODEL = ContactModel(find("wang_mason").at(0.2, 0.6))
SQUARE = Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)))
BODY = {"mass": 0.05, "inertia": 1e-5}
EXACT = 1e-9  # s
SOLID = {"mass": 0.05, "inertia": (1e-5, 1.5e-5, 2e-5)}


def in_space(flat):
    """Poses and velocities of the plane in space: x → x, y → z, ω → −ω_y."""
    x, y, theta = flat.pose.unbind(-1)
    v_x, v_y, omega = flat.velocity.unbind(-1)
    o, half = torch.zeros_like(x), theta / 2
    pose = torch.stack((x, o, y, half.cos(), o, -half.sin(), o), -1)
    return pose, torch.stack((v_x, o, v_y, o, -omega, o), -1)


def tossed(count=100):
    generator = torch.Generator().manual_seed(0)
    pose, velocity = (torch.randn(count, k, generator=generator, dtype=torch.float64) for k in (7, 6))
    pose[:, 2] = 0.1 + pose[:, 2].abs()
    pose[:, 3:] /= pose[:, 3:].norm(dim=-1, keepdim=True)
    return BodyState(pose=pose, velocity=velocity * torch.tensor((1, 1, 1, 10, 10, 10)), **SOLID)


def energy(state, q, v):
    d = v.shape[-1] // 3 + 1
    inertia = torch.as_tensor(state["inertia"], dtype=torch.float64).expand(*q.shape[:-1], 3)
    I = inertia_in_world(inertia[..., 0] if d == 2 else inertia, q)  # noqa: E741
    linear, spin = v[..., :d], v[..., d:]
    moment = I[..., None] * spin if d == 2 else (I @ spin[..., None])[..., 0]
    mass = state["mass"]
    return 0.5 * (mass * linear.square().sum(-1) + (spin * moment).sum(-1)) + mass * GRAVITY * q[..., d - 1]


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


@pytest.mark.parametrize(
    ("body", "start", "shape"),
    [
        (BODY, thrown, Disc(0.02)),
        (BODY, thrown, Ellipse((0.03, 0.015))),
        (BODY, thrown, SQUARE),
        (SOLID, tossed, Sphere(0.02)),
        (SOLID, tossed, Ellipsoid((0.03, 0.02, 0.015))),
        (SOLID, tossed, Cuboid((0.02, 0.02, 0.02), corner=2e-3)),
    ],
    ids=["disc", "ellipse", "square", "sphere", "ellipsoid", "cube"],
)
def test_energy_never_rises(body, start, shape):
    state = start(40)
    found = MODEL.roll_out(state, shape)
    bounces = [energy(body, found.poses, v) for v in (found.before, found.after)]
    change = torch.cat((energy(body, state.pose, state.velocity)[:, None], torch.stack(bounces, -1).flatten(1)), 1)
    assert change.diff(dim=1).nan_to_num(0).max() < 1e-12
    assert change.diff(dim=1).nan_to_num(0).min() < -0.01
    assert (found.contacts[found.ended == 0] == 10).all()


@pytest.mark.parametrize(
    ("flat", "deep", "moments"),
    [
        (Disc(0.02), Sphere(0.02), 1e-5),
        (SQUARE, Cuboid((0.02, 1e-15, 0.02)), (1e-5, 1e-5, 2e-5)),  # all of it in one plane
        (Ellipse((0.03, 0.015)), Ellipsoid((0.03, 0.02, 0.015)), (3e-5, 1e-5, 2.5e-5)),
    ],
    ids=["ball", "box", "egg"],
)
@pytest.mark.parametrize("law", ["whittaker", "wang_mason"])
@pytest.mark.parametrize("offset", [(), (3e-3, -2e-3)], ids=["uniform", "off centre"])
def test_a_planar_body_in_space_flies_as_in_the_plane(flat, deep, moments, law, offset):
    state, base = thrown(20), find(law).at(0.2, 0.6)
    pose, velocity = in_space(state)
    made = find_effect("com_offset", "tracked")
    effects = [{"com_offset": made(*one)} if offset else {} for one in (offset, (*offset[:1], 0.0, *offset[1:]))]
    plane = ContactModel(base, effects=effects[0]).roll_out(state, flat, until=Until(bounces=3))
    solid = BodyState(pose=pose, velocity=velocity, mass=0.05, inertia=moments)
    space = ContactModel(base, effects=effects[1]).roll_out(solid, deep, until=Until(bounces=3))
    assert torch.allclose(plane.times, space.times, atol=EXACT, rtol=0, equal_nan=True)
    assert torch.allclose(plane.poses[..., :2], space.poses[..., (0, 2)], atol=EXACT, rtol=0, equal_nan=True)
    expected = (0, 2, 4), torch.tensor((1, 1, -1))
    assert torch.allclose(
        plane.after, space.after[..., expected[0]] * expected[1], atol=1e-8, rtol=1e-8, equal_nan=True
    )


def test_a_free_body_turns_as_eulers_equations_say():
    generator = torch.Generator().manual_seed(1)
    q, omega = (torch.randn(6, k, generator=generator, dtype=torch.float64) for k in (4, 3))
    q, omega = q / q.norm(dim=-1, keepdim=True), 20 * omega
    rows = [(1, 2, 2.9), (1, 1, 1.9), (1, 1.0001, 2), (0.1, 1, 1.05), (3, 2, 1.5), (1, 2, 2)]
    inertia, times = torch.tensor(rows, dtype=torch.float64), torch.full((6,), 0.3, dtype=torch.float64)
    found, spin = turned(q, omega, inertia, times)
    for k in range(6):
        moments = inertia[k].numpy()

        def rate(_, y, moments=moments):
            u, w = y[:4], y[4:]
            return np.concatenate(
                ([-u[1:] @ w / 2], (u[0] * w + np.cross(u[1:], w)) / 2, np.cross(moments * w, w) / moments)
            )

        start = np.concatenate((q[k], rotation(q[k]).mT @ omega[k]))
        end = solve_ivp(rate, (0, 0.3), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        assert np.abs(found[k].numpy() - end[:4]).max() < 1e-11
        assert np.abs((rotation(found[k]).mT @ spin[k]).numpy() - end[4:]).max() < 1e-9
    momentum = [
        inertia_in_world(inertia, torch.cat((q[:, :3], x), 1)) @ w[..., None] for x, w in ((q, omega), (found, spin))
    ]
    assert torch.allclose(*momentum, rtol=1e-12)


def test_contact_times_in_space_are_those_of_a_fine_reference():
    half, radius, state = np.array((0.02, 0.03, 0.01)), 2e-3, tossed(6)
    signs = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    found = MODEL.roll_out(state, Cuboid(tuple(half), corner=radius), until=Until(bounces=1))
    for k, time in enumerate(found.times[:, 0].tolist()):

        def gap(t, k=k):
            times = torch.as_tensor(np.atleast_1d(t))
            one = [x.expand(len(times), -1) for x in (state.pose[k, 3:], state.velocity[k, 3:], state.inertia[k])]
            up = rotation(turned(*one, times)[0])[:, 2].numpy()
            centre = state.pose[k, 2].item() + state.velocity[k, 2].item() * t - GRAVITY * t**2 / 2
            return centre + (up @ (signs * (half - radius)).T).min(-1) - radius

        grid = np.arange(0, time + 2e-3, 1e-3)
        first = np.flatnonzero(gap(grid) < 0)[0]
        assert abs(time - brentq(lambda t: gap(t)[0], grid[first - 1], grid[first], xtol=1e-12)) < EXACT


def test_drag_takes_the_speed_of_the_closed_form():
    state = BodyState(pose=(0, 1.0, 0), velocity=(2, 0, 0), **BODY)
    found = MODEL.roll_out(state, Disc(0.02), until=Until(bounces=1), drag=0.5)
    t = found.times[0]
    assert found.before[0, 0].item() == pytest.approx(2 * math.exp(-0.5 * t))
    assert found.poses[0, 0].item() == pytest.approx(4 * (1 - math.exp(-0.5 * t)))
    assert found.before[0, 1].item() == pytest.approx(-GRAVITY / 0.5 * (1 - math.exp(-0.5 * t)))


def test_a_body_with_an_acceleration_of_its_own_falls_and_drifts_by_it():
    state = BodyState(pose=[(0, 1.02, 0)] * 2, velocity=(1, 0, 0), **BODY)
    acceleration = torch.tensor([[0.0, 0.0], [0.4, -0.3]], dtype=torch.float64)
    found = MODEL.roll_out(state, Disc(0.02), until=Until(bounces=1), acceleration=acceleration)
    expected = (2 / (GRAVITY - acceleration[:, 1])).sqrt()
    assert torch.allclose(found.times[:, 0], expected, atol=EXACT)
    assert torch.allclose(found.poses[:, 0, 0], expected + acceleration[:, 0] * expected.square() / 2, atol=EXACT)


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


@pytest.mark.parametrize(
    ("body", "shape", "pose", "height"),
    [
        (BODY, SQUARE, (0, 0.0285, 0.7), 0.02),
        (SOLID, Cuboid((0.02, 0.02, 0.02), corner=1e-3), (0, 0, 0.035, 0.88, 0.3, 0.36, 0.05), 0.02),
        (SOLID, Cuboid((0.02, 0.03, 0.01)), (0, 0, 0.0361, 0.7, 0.5, 0.5, 0.1), 0.02),
    ],
    ids=["square", "cube", "brick"],
)
def test_a_body_that_piles_up_on_a_corner_falls_over(body, shape, pose, height):
    model, pose = ContactModel(find("anitescu_potra_poisson").at(0.3, 0.0)), torch.tensor(pose, dtype=torch.float64)
    pose[3:] /= pose[3:].norm()
    state = BodyState(pose=pose, velocity=torch.zeros(3 if len(pose) == 3 else 6), **body)
    assert ENDS[model.roll_out(state, shape).ended] == "piled up"
    found = model.roll_out(state, shape, until=Until(bounces=100, time=3.0))
    assert ENDS[found.ended] == "at rest"
    assert found.end < 1.5
    end = found.at(found.end[None])[0]
    assert end[len(pose) // 3].item() == pytest.approx(height, abs=5e-5)
    flights = found.flights
    change = energy(body, flights.pose, flights.velocity).diff()
    assert change.max() < 1e-12
    assert change.min() < -1e-4


def test_a_ball_on_the_floor_rolls_on():
    ball = BodyState(pose=(0, 0, 0.02, 1, 0, 0, 0), velocity=(0.5, 0, 0, 0, 0, 0), mass=0.05, inertia=8e-6)
    model = ContactModel(find("anitescu_potra_poisson").at(0.2, 0.6))
    found = model.roll_out(ball, Sphere(0.02), until=Until(time=0.4))
    assert ENDS[found.ended] == "time"
    speed = found.at(torch.tensor((0.25, 0.35))).diff(dim=0)[0, 0] / 0.1
    assert speed.item() == pytest.approx(5 / 7 * 0.5, rel=1e-3)  # slides until it rolls: 5/7 of the speed


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize(("friction", "mu"), [(None, 0.2), (0.35, 0.35)], ids=["the law's", "its own"])
def test_a_body_slides_as_far_as_its_friction_lets_it(space, friction, mu):
    flat = BodyState(pose=(0, 0.02, 0), velocity=(0.5, 0, 0), shape=SQUARE, **BODY)
    pose, velocity = in_space(flat) if space else (flat.pose, flat.velocity)
    box = Cuboid((0.02, 0.02, 0.02)) if space else SQUARE
    path = MODEL.roll_out(
        BodyState(pose=pose, velocity=velocity, shape=box, **BODY), until=Until(time=1), friction=friction
    )
    way = path.at(path.end[None])[..., 0].item()
    assert way == pytest.approx(0.5**2 / (2 * mu * GRAVITY), rel=0.06)  # corner by corner, in steps of 1 ms


def test_a_fan_spreads_as_the_parameters_are_uncertain():
    drops = synthetic.load(60, seed=2)
    model = joint.fit(drops, "wang_mason", {"gravity_impulse": find_effect("gravity_impulse")()}).model
    state = BodyState(pose=[(0, 0.5, 0.3), (0, 0.4, 0.3)], velocity=(1, 0, 5), mass=0.0364, inertia=1.7e-5)
    fan = model.roll_out(state, drops.shape, samples=50, generator=torch.Generator().manual_seed(1))
    assert fan.times.shape == (50, 2, 10)
    assert fan.times[:, 0, 0].std() < 1e-12
    assert 0 < fan.times[:, 0, 1].std() < fan.times[:, 0, 2].std()
    assert fan.left_out == ("gravity_impulse",)
    with pytest.raises(ContactLearnError, match="neither scatter nor a covariance of its parameters"):
        MODEL.roll_out(state, drops.shape, samples=2)


def test_bad_starts_are_refused_in_a_line():
    state = BodyState(pose=[(0, 1.0, 0), (0, 0.015, 0)], velocity=(0, 0, 0), **BODY)
    with pytest.raises(DataError, match=r"state 2 is 0\.005 m inside it"):
        MODEL.roll_out(state, Disc(0.02))
    with pytest.raises(DataError, match="needs the body's shape"):
        MODEL.roll_out(state)
