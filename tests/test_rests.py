"""Bodies at rest: where they are still, what they tell of the floor and of the zero of θ, and what must not mislead."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch

from contactlearn.data import tracks
from contactlearn.data.recordings.floor import RestPoses, find_floor, find_rests
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.result import Rest
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, contact_point
from contactlearn.report.text.tracks import tracks_facts
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import MASS, SEMI_AXES, simulate, write_recordings

ELLIPSE, BOX = Ellipse(SEMI_AXES), Polygon(((0.035, 0.025), (-0.035, 0.025), (-0.035, -0.025), (0.035, -0.025)))
SETS, SLOPE = 60, math.radians(1.5)


def touches(shape, theta, slope):
    """Where bodies meet a sloped floor, from their centres, in world axes."""
    leans = np.array(((math.cos(slope), -math.sin(slope)), (math.sin(slope), math.cos(slope))))
    return contact_point(shape, torch.as_tensor(theta - slope, dtype=torch.float64)).numpy() @ leans.T


def height(shape, theta, slope, x):
    """Of the centre of a body that touches a sloped floor through the origin."""
    r = touches(shape, theta, slope)
    return math.tan(slope) * (x + r[..., 0]) - r[..., 1]


@cache
def balanced(shape, angle, slope, lean, off):
    """θ near an angle at which an ellipse has its centre of mass, off along its long axis, above the contact."""

    def beside(theta):
        r = touches(shape, np.array([theta]), slope)[0] - off * np.array((math.cos(theta), math.sin(theta)))
        return r[0] * math.cos(lean) + r[1] * math.sin(lean)

    low, high = angle - 0.5, angle + 0.5
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if beside(middle) * beside(low) > 0 else (low, middle)
    return low


def apparatus(rng, shape, *, zero, slope=0.0, lean=0.0, off=0.0, contacts=14, rests=8, scatter=2e-4, sunk=0.0, odd=0):
    """Contacts and rests of a body with geometry of its own; the first `odd` rests lie on books and lean."""
    theta, x = rng.uniform(-math.pi, math.pi, contacts), rng.uniform(-0.1, 0.4, contacts)
    y = height(shape, theta, slope, x) + 5e-5 * rng.standard_normal(contacts) - sunk * rng.uniform(0.5, 1.5, contacts)
    tracked = np.stack((x + off * np.cos(theta), y + off * np.sin(theta), theta - zero), 1)
    lain = []
    for k in range(rests):
        side = rng.choice(RestPoses.of(shape).angles)
        flat = side + slope if isinstance(shape, Polygon) else balanced(shape, float(side), slope, lean, off)
        leans, x = (0.2 if k < odd else 0.0) * (k % 2), rng.uniform(0.1, 0.4)
        up = float(height(shape, np.array([flat + leans + 1e-9]), slope, x)[0]) + 0.02 * (k < odd) * (1 - k % 2)
        pose = np.array((x + off * math.cos(flat), up + off * math.sin(flat), flat + leans - zero))
        pose += np.array((5e-6, 5e-6, scatter)) * rng.standard_normal(3)
        pose[2] = turn(pose[2])
        lain.append(Rest(recording=str(k), pose=pose, error=np.array((5e-6, 5e-6, 2e-4))))
    return [SimpleNamespace(pose=pose, v_pre=rng.normal(-2, 0.5, 3), v_post=np.ones(3)) for pose in tracked], lain


APPARATUS = {
    "level": (BOX, {}),
    "sloped": (BOX, {"slope": SLOPE}),
    "rolled camera": (ELLIPSE, {"slope": SLOPE, "lean": SLOPE}),
    "book and wall": (ELLIPSE, {"slope": SLOPE, "odd": 2}),
    "contacts sink": (ELLIPSE, {"slope": SLOPE, "sunk": 3e-4}),
    "mass off the centre": (ELLIPSE, {"off": 5e-4, "contacts": 40}),
    "drift": (BOX, {"scatter": 5e-3}),
}


@pytest.mark.parametrize(("shape", "settings"), APPARATUS.values(), ids=APPARATUS)
def test_standardised_errors_of_zero_and_slope_are_those_of_a_normal_distribution(shape, settings):
    """The zero is off by 1 to 4° either way; most sets have too few contacts to tell it without the rests."""
    rng, scores = np.random.default_rng(3), []
    lean = settings.get("lean", 0.0)
    for _ in range(SETS):
        zero = math.radians(rng.uniform(1, 4)) * rng.choice((-1, 1))
        contacts, rests = apparatus(rng, shape, zero=zero, **settings)
        known = Estimate(value=lean + 1e-4 * rng.standard_normal(), error=1e-4)
        floor = find_floor(contacts, shape, rests, lean=known)
        if floor.orientation is not None:
            pairs = ((floor.orientation, zero), (floor.slope, settings.get("slope", 0.0)))
            scores.append([(one.value - truth) / one.error for one, truth in pairs])
    assert len(scores) > 0.9 * SETS
    spread, mean = np.std(scores, axis=0), np.mean(scores, axis=0)
    assert ((spread > 0.7) & (spread < 1.3)).all()
    assert (np.abs(mean) < 4 * spread / math.sqrt(len(scores))).all()


@pytest.mark.parametrize("shape", [ELLIPSE, BOX], ids=["ellipse", "box"])
def test_rests_tell_the_zero_where_contacts_are_too_few(shape):
    contacts, rests = apparatus(np.random.default_rng(1), shape, zero=0.03, contacts=12)
    assert find_floor(contacts, shape).orientation is None
    assert find_floor(contacts, shape, rests[:2]).orientation is None
    zero = find_floor(contacts, shape, rests).orientation
    assert abs(zero.value - 0.03) < 4 * zero.error
    assert zero.error < math.radians(0.05)


def test_an_ellipse_on_one_pole_does_not_tell_its_zero():
    """A centre of mass off the ellipse's would turn it as much."""
    contacts, rests = apparatus(np.random.default_rng(1), ELLIPSE, zero=0.03, contacts=12, rests=30)
    same = [rest for rest in rests if abs(rest.pose[2]) < 1]
    assert len(same) > 8
    assert find_floor(contacts, ELLIPSE, same).orientation is None
    assert len(RestPoses.of(Disc(0.03)).angles) == len(RestPoses.of(Ellipse((0.03, 0.03))).angles) == 0
    rests = [Rest(recording="0", pose=np.array((0.1 * k, 0.03, k)), error=np.full(3, 1e-5)) for k in range(20)]
    contacts = [
        SimpleNamespace(pose=np.array((0.05 * k, 0.03, 2.0 * k)), v_pre=-np.ones(3), v_post=np.ones(3))
        for k in range(20)
    ]
    floor = find_floor(contacts, Disc(0.03), rests)
    assert floor.orientation is None
    assert floor.rests == 20
    assert abs(floor.slope.value) < 1e-6


@pytest.mark.parametrize("odd", [1, 2, 3])
def test_rests_on_a_book_and_against_a_wall_are_left_out(odd):
    contacts, rests = apparatus(np.random.default_rng(2), BOX, zero=0.03, contacts=20, rests=10, odd=odd)
    floor = find_floor(contacts, BOX, rests)
    assert floor.rests == 10 - odd
    without = find_floor(contacts, BOX, rests[odd:])
    assert floor == without


@pytest.mark.parametrize(("shape", "angles"), [
    (BOX, (0, 90, 180, -90)),
    (ELLIPSE, (0, 180)),
    (Ellipse((0.02, 0.03)), (90, -90)),
    (Polygon(((-0.06, -0.01), (0.02, -0.01), (0.04, 0.02))), (0, 163.300755766)),
], ids=["box", "ellipse", "upright ellipse", "triangle that tips over from one side"])  # fmt: skip
def test_stable_sides(shape, angles):
    found = np.sort(np.degrees(turn(RestPoses.of(shape).angles + 1e-9)))
    np.testing.assert_allclose(found, np.sort(np.degrees(turn(np.radians(angles) + 1e-9))), atol=1e-6)
    for angle in RestPoses.of(shape).angles.tolist():  # the body is lowest there: its centre rises to both sides
        heights = -contact_point(shape, torch.tensor([angle - 0.05, angle, angle + 0.05], dtype=torch.float64))[:, 1]
        assert heights.argmin() == 1


def lying_track(change, frames=250, sigma=5e-5):
    time = np.arange(frames) / 250
    pose = np.array((0.1, 0.025, 0.01)) + change(time)[:, None] * np.array((0.0, 0.0, 1.0))
    pose += np.array((sigma, sigma, 20 * sigma)) * np.random.default_rng(0).standard_normal(pose.shape)
    return Track(name="lies", time=time, pose=pose), np.array((1, 1, 20)) * sigma


def test_a_body_is_still_from_when_on_it_no_longer_rocks():
    track, sigma = lying_track(lambda t: 0.3 * np.exp(-t / 0.1) * np.cos(12 * t))
    (rest,) = find_rests(track, [(0.0, 1.0)], sigma)
    np.testing.assert_allclose(rest.pose, (0.1, 0.025, 0.01), atol=4 * rest.error.max())
    assert rest.error[2] < 5e-4
    rocks, sigma = lying_track(lambda t: 0.1 * np.cos(12 * t))
    assert find_rests(rocks, [(0.0, 1.0)], sigma) == ()
    assert find_rests(track, [(0.8, 1.0)], sigma) == ()
    assert find_rests(track, [(0.0, 0.05)], sigma) == ()


def test_recordings_tell_their_zero_by_bodies_at_rest(tmp_path):
    """Ellipses that rock to rest; a camera that is rolled sees a floor, a gravity and bodies that lean alike."""
    write_recordings(simulate(10, Camera(), seed=4)[0], tmp_path)
    for file in tmp_path.iterdir():
        table, (c, s) = pd.read_csv(file), (math.cos(0.01), math.sin(0.01))
        turned = table.assign(x=c * table.x - s * table.y, y=s * table.x + c * table.y)
        turned.assign(theta=table.theta + 0.01 - math.radians(2.5)).to_csv(file, index=False, float_format="%.9g")
    found = tracks.find_impacts(tmp_path, mass=MASS, shape=ELLIPSE)
    known = found.impacts.apparatus
    assert len(found.survey.rests) == 10
    assert found.floor.rests >= 9
    assert abs(known.orientation.value - math.radians(2.5)) < 3.5 * known.orientation.error
    assert known.orientation.error < math.radians(0.05)
    assert abs(known.slope.value - 0.01) < 3.5 * known.slope.error
    assert (
        "rests",
        f"{found.floor.rests} of 10 bodies at rest lie flat on the floor, which is also fitted to them",
    ) in tracks_facts(found)


@pytest.mark.parametrize("late", [0.0, 4e-4])
def test_contacts_that_last_sink_by_the_mass_at_the_contact_and_leave_the_corners(late):
    """A spring under a corner is touched for as long as √mass there; that is the whole mass below the centre.

    Angles that are read late, and sides that land flat and higher, move no corner either.
    """
    rng, sunk, shape = np.random.default_rng(5), 3e-4, replace(BOX, corner=0.004)
    theta = rng.uniform(-math.pi, math.pi, 80)
    r, v = touches(shape, theta, 0.0), rng.normal((0, -1.5, 0), (0.3, 0.4, 8), (80, 3))
    mass, speed = 1 / (1 + r[:, 0] ** 2 / shape.gyration_squared()), v[:, 1] + v[:, 2] * r[:, 0]
    push = np.stack((0 * mass, 1 + 0 * mass, r[:, 0] / shape.gyration_squared()), 1)
    after = v + (1.5 * mass * np.abs(speed))[:, None] * push
    y = -r[:, 1] + sunk * speed * np.sqrt(mass) + 1e-5 * rng.standard_normal(80)
    flat = np.abs((theta + math.pi / 4) % (math.pi / 2) - math.pi / 4) < 0.03
    poses = np.stack((0 * y, y + 1e-3 * flat, theta + late * (v + after)[:, 2] / 2), 1)
    hits = [SimpleNamespace(pose=pose, v_pre=b, v_post=a) for pose, b, a in zip(poses, v, after, strict=True)]
    floor = find_floor(hits, BOX)
    assert flat.any()
    assert floor.sinking.value == pytest.approx(sunk, rel=0.1)
    for name, true in (("corner", 0.004), ("late", -late)):
        assert abs(floor.outline[name].value - true) < 3 * floor.outline[name].error < 4e-4
