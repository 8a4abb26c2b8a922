"""Inertia and centre of mass of bodies that rock on an edge, against integrated motion with and without friction."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from contactlearn.data.recordings.rocking import rocked, rocking
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import ROCKING, Apparatus, Estimate
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Cuboid, Ellipsoid, Polyhedron

BOX = Cuboid((0.05, 0.04, 0.06))
TETRAHEDRON = Polyhedron(tuple((0.05 * x, 0.05 * y, 0.05 * x * y) for x in (-1, 1) for y in (-1, 1)))
CENTRE, KAPPA = np.array((0.002, -0.003, 0.004)), math.log(1.2)
TIME = np.arange(25) / 250


def motion(body, edge, slides, rng):
    """Poses of a body that rocks on an edge, whose mass centre is at an angle β above the floor, seen from there."""
    ends = body.corners().numpy()[edge]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    arm = CENTRE - ends[0]
    arm = arm - along * (arm @ along)
    corner, d = CENTRE - arm, np.linalg.norm(arm)
    square = math.exp(KAPPA) * (along**2 @ body.gyration_squared().numpy())

    def rates(_, state):
        lever, rise = d * math.cos(state[0]), d * math.sin(state[0])
        if not slides:
            return state[1], -GRAVITY * lever / (square + d * d)
        return state[1], -lever * (GRAVITY - rise * state[1] ** 2) / (square + lever * lever)

    start = math.pi / 2 + rng.uniform(-0.3, 0.3)
    beta = solve_ivp(rates, (0, TIME[-1]), (start, rng.uniform(-2, 2)), t_eval=TIME, rtol=1e-10, atol=1e-12).y[0]
    level = Rotation.align_vectors([(0, 1, 0), (0, 0, 1)], [along, arm / d])[0]
    turned = Rotation.from_rotvec((math.pi / 2 - beta)[:, None] * (0, 1, 0)) * level
    turned = Rotation.from_rotvec((0, 0, rng.uniform(-3, 3))) * turned
    position = -turned.apply(corner)
    if slides:
        position[:, :2] = -turned.apply(CENTRE)[:, :2] + 0.1 * TIME[:, None]
    return np.concatenate((position, turned.as_quat(scalar_first=True)), 1)


def tracks(body, slides, noise, seed=0):
    rng, edges = np.random.default_rng(seed), body.edges().numpy()
    for edge in np.tile(edges, (36 // len(edges), 1)):
        pose = motion(body, edge, slides, rng)
        turned = Rotation.from_rotvec(rng.normal(0, 10 * noise, (len(TIME), 3)))
        q = turned * Rotation.from_quat(pose[:, 3:], scalar_first=True)
        position = pose[:, :3] + rng.normal(0, noise, (len(TIME), 3))
        pose = np.concatenate((position, q.as_quat(scalar_first=True)), 1)
        yield Track(name="", time=TIME, pose=pose)


@pytest.mark.parametrize("body", [BOX, TETRAHEDRON], ids=["box", "tetrahedron"])
@pytest.mark.parametrize("slides", [False, True], ids=["sticks", "slides without friction"])
@pytest.mark.parametrize("noise", [1e-9, 5e-5])
def test_inertia_and_centre_are_found_whatever_friction_is(body, slides, noise):
    gyration = body.gyration_squared().numpy()
    found = [one for track in tracks(body, slides, noise) if len(one := rocking(track, body))]
    card = rocked(found, gyration, (0.0, 0.0, -GRAVITY), {})
    for name, truth in zip(ROCKING, (KAPPA, *CENTRE), strict=True):
        allowed = 4 * card[name].error if noise > 1e-6 else 1e-3 if name == "rocking_inertia" else 1e-5
        assert abs(card[name].value - truth) < allowed, name
        assert card[name].error < (0.03 if name == "rocking_inertia" else 1e-3)
    assert not rocked(found[:5], gyration, (0.0, 0.0, -GRAVITY), {})
    rows = Apparatus(gravity=Estimate(value=GRAVITY, error=0.01), delay=Estimate(value=0.0, error=1e-4), **card).rows()
    assert not any(row.differs for row in rows[2:])  # a witness is not applied


def test_what_parallel_edges_do_not_show_is_no_estimate():
    """Forces along an edge have no moment about it, so the centre of mass along it is unknown."""
    gyration, edges = BOX.gyration_squared().numpy(), BOX.edges().numpy()
    along = np.diff(BOX.corners().numpy()[edges], axis=1)[:, 0]
    found = [
        one
        for seed in range(2)
        for track, edge in zip(tracks(BOX, False, 5e-5, seed), np.tile(np.arange(len(edges)), 3), strict=True)
        if along[edge, 0] and len(one := rocking(track, BOX))
    ]
    card = rocked(found, gyration, (0.0, 0.0, -GRAVITY), {})
    assert [*card] == ["rocking_inertia", "rocking_b", "rocking_c"]
    for name, truth in zip(card, (KAPPA, *CENTRE[1:]), strict=True):
        assert abs(card[name].value - truth) < 4 * card[name].error


def test_flight_rest_and_other_bodies_do_not_rock():
    track = next(tracks(BOX, False, 5e-5))
    flies, lies = track.pose.copy(), np.repeat(track.pose[:1], len(TIME), 0)
    flies[:, 2] += 2 * TIME
    lies[:, 2:] = BOX.half[2], 1, 0, 0, 0
    for pose in (flies, lies):
        moved = Track(name="", time=TIME, pose=pose)
        assert not len(rocking(moved, BOX))
    assert not len(rocking(track, Ellipsoid(BOX.half)))
