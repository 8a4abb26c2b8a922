"""Recordings of bodies in space: free turning, flights, and impacts of tosses whose truth is known."""

import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import DataError
from contactlearn.data.audit.corrections import correct
from contactlearn.data.recordings import angles, poses
from contactlearn.data.recordings.angles import reading_residual
from contactlearn.data.recordings.contacts import _refused_gap
from contactlearn.data.recordings.flights import Air, Flights, fit
from contactlearn.data.recordings.floor import find_floor
from contactlearn.data.recordings.result import Reason, RecordedContact
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Track
from contactlearn.data.tracks import find_impacts, track_options
from contactlearn.laws import find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Cuboid, Cylinder, Polygon, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation.camera import Camera, record
from contactlearn.simulation.recordings import Body, throw, write_recordings

RATE, MASS, NOISE = 148.0, 0.4, (5e-5, 5e-4)  # 1/s, kg, m and rad
BOX = Cuboid((0.05, 0.05, 0.05))
LAW = find("wang_mason").at(0.18, 0.5)
MOMENTS = {"equal": None, "a box": (1.0, 1.3, 1.6), "a rod": (1.0, 9.0, 9.5)}


@pytest.mark.parametrize("moments", MOMENTS.values(), ids=MOMENTS)
def test_free_turning_obeys_euler(moments):
    """An independent integration of Euler's equations in the body's axes, and the angular momentum of the world's."""
    rng, I = np.random.default_rng(0), np.array(moments or (1.0,) * 3)  # noqa: E741
    q, spin, tau = rng.standard_normal(4), rng.normal(0, 12, 3), np.array((-0.2, 0.05, 0.3))
    q /= np.linalg.norm(q)
    found, spins = poses.free_turn(q, spin, tau, moments)
    start = Rotation.from_quat(q, scalar_first=True)

    def rates(_, state):
        a, v, w = state[0], state[1:4], state[4:]
        return np.concatenate(([-(v @ w) / 2], (a * w + np.cross(v, w)) / 2, np.cross(I * w, w) / I))

    for k, t in enumerate(tau):
        exact = solve_ivp(rates, (0, t), np.concatenate((q, start.inv().apply(spin))), rtol=1e-11, atol=1e-12).y[:, -1]
        apart = Rotation.from_quat(found[k], scalar_first=True) * Rotation.from_quat(exact[:4], scalar_first=True).inv()
        assert apart.magnitude() < 1e-4
        end = Rotation.from_quat(found[k], scalar_first=True)
        first, last = (R.apply(I * R.inv().apply(w)) for R, w in ((start, spin), (end, spins[k].copy())))
        assert last == pytest.approx(first, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("moments", MOMENTS.values(), ids=MOMENTS)
def test_a_flight_in_space_is_fitted_with_its_covariance(moments):
    air, scores = Air(gravity=(0.0, 0.0, -GRAVITY), prior=((0.0,) * 6,) * 2, moments=moments), []
    time, rng, sigma = np.arange(24) / RATE, np.random.default_rng(1), np.repeat(NOISE, 3)
    q, spin, v = np.array((1.0, 0, 0, 0)), np.array((4.0, -2.5, 3.0)), np.array((0.4, -0.3, 1.0))
    turned, _ = poses.free_turn(q, spin, time, moments)
    position = np.outer(time, v) - np.outer(time**2 / 2, (0, 0, GRAVITY))
    exact = np.column_stack((position, turned))
    for _ in range(200):
        noisy = poses.displaced(exact, sigma * rng.standard_normal((24, 6)))
        pose, velocity, covariance = fit(time, noisy, np.arange(24), sigma, air).at(0.0)
        error = np.append(poses.away(pose, exact[0]), velocity - np.append(v, spin))
        scores.append(error @ np.linalg.solve(covariance, error))
    assert np.mean(scores) == pytest.approx(12, abs=1.6)  # χ² with 12 degrees of freedom; 4 standard errors, and 3 %


@pytest.mark.parametrize("seconds", [0.1, 0.3])
@pytest.mark.parametrize("moments", MOMENTS.values(), ids=MOMENTS)
def test_a_body_that_turns_fast_is_followed_over_its_whole_flight(moments, seconds):
    """Euler's equations over one and a half turns are far from linear in the spin."""
    air = Air(gravity=(0.0, 0.0, -GRAVITY), prior=((0.0,) * 6,) * 2, moments=moments)
    time, rng, sigma = np.arange(round(240 * seconds)) / 240, np.random.default_rng(2), np.repeat(NOISE, 3)
    q, spin = np.array((0.5, 0.5, -0.5, 0.5)), np.array((-3.0, 30.0, -15.0))
    exact = np.column_stack((0 * time, 0 * time, -GRAVITY * time**2 / 2, poses.free_turn(q, spin, time, moments)[0]))
    flight = fit(
        time, poses.displaced(exact, sigma * rng.standard_normal((len(time), 6))), np.arange(len(time)), sigma, air
    )
    assert len(flight.frames) == len(time)
    assert np.sqrt(np.mean(flight.residual[:, 3:] ** 2)) < 1.2 * NOISE[1]
    assert flight.velocities(0.0)[3:] == pytest.approx(spin, abs=0.15)


@pytest.mark.parametrize(("rises", "reason"), [(0.05, Reason.IN_THE_AIR), (0.002, Reason.SLIDING)])
def test_a_body_slides_only_where_its_lowest_point_stays_on_the_floor(rises, reason):
    """Frames in no flight at the end of a recording, whose speed alone is that of a body that slides."""
    time = np.arange(40) / RATE
    pose = np.column_stack((1.5 * time, 0 * time, 0.05 + 0 * time, np.tile((1.0, 0, 0, 0), (40, 1))))
    track = Track(name="one", time=time, pose=pose, low=np.append(0.0, np.full(39, rises)))
    search = Flights(flights=(), sigma=np.repeat(NOISE, 3), width=12)
    assert _refused_gap(track, 0, 39, search, TrackThresholds()).reason == reason


def toss(rng, number, solid=BOX, centre=(0.0, 0.0, 0.0), heavier=1.0, corner=0.0):
    """Rows of frames about one impact, the velocities before and after it of the tracked point, and the instant."""
    gyration = solid.gyration_squared()
    shape = replace(solid, corner=corner) if corner else solid
    I = MASS * heavier * torch.diag(gyration)  # noqa: E741
    while True:
        turn = Rotation.random(random_state=rng)
        down = torch.tensor(-turn.as_matrix()[2])
        corners = turn.apply(solid.touching(down) if isinstance(solid, Cylinder) else solid.corners())
        heights = np.sort(corners[:, 2])
        before = np.concatenate((rng.normal(0, 0.7, 2), (-rng.uniform(0.8, 1.5),), rng.normal(0, 6, 3)))
        if heights[1] - heights[0] < 0.02:
            continue
        R = torch.tensor(turn.as_matrix())
        q = torch.tensor(turn.as_quat(scalar_first=True))
        d = turn.apply(centre)
        r = contact_point(shape, q).numpy()
        body = torch.tensor(MASS)[None].double(), (R @ I @ R.mT)[None], torch.tensor(r - d)[None]
        v_c = rigid_body.contact_velocity(body[2], torch.tensor(before)[None])
        if v_c[0, 2] > -0.5:
            continue
        P = LAW.impulse(rigid_body.inverse_inertia(*body), v_c)
        wrench = torch.cat((P, torch.zeros(1, 3, dtype=torch.float64)), -1)
        after = rigid_body.apply_wrench(*body, torch.tensor(before)[None], wrench)[0].numpy()
        if after[2] + np.cross(after[3:], r)[2] > 0.3:
            break
    place, rows = rng.uniform(0, 1), []
    for count in range(-14, 13):
        t = (count + place) / RATE
        v = before if t < 0 else after
        turned, _ = poses.free_turn(q.numpy(), v[3:], np.array(t), tuple(gyration.tolist()))
        position = np.array((0, 0, -r[2])) + d + v[:3] * t - (0, 0, 0.5 * GRAVITY * t**2)
        position = position - Rotation.from_quat(turned, scalar_first=True).apply(centre) + rng.normal(0, NOISE[0], 3)
        noisy = poses.product(poses.quaternion(rng.normal(0, NOISE[1], 3)), turned)
        rows.append((number, (count + 14) / RATE, *position, *noisy))
    states = [np.append(v[:3] - np.cross(v[3:], d), v[3:]) for v in (before, after)]
    return rows, *states, (14 - place) / RATE


NAMES = ["recording", "time", "x", "y", "z", "qw", "qx", "qy", "qz"]


def written(folder, count, seed, **rig):
    rng = np.random.default_rng(seed)
    made = [toss(rng, number, **rig) for number in range(count)]
    table = pd.DataFrame([row for rows, *_ in made for row in rows], columns=NAMES).astype({"recording": int})
    table.to_parquet(folder / "tosses.parquet")
    return made, table


@pytest.fixture(scope="module")
def tosses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tosses")
    return folder, *written(folder, 60, 5)


def impacts_in(folder, shape=BOX, inertia=None, **settings):
    return find_impacts(folder, mass=MASS, shape=shape, inertia=inertia, options=track_options(**settings))


@pytest.fixture(scope="module")
def found(tosses):
    return impacts_in(tosses[0], contact_time=1e-5)


def test_velocities_are_within_their_errors(tosses, found):
    made, impacts = tosses[1], found.impacts
    assert len(impacts) >= 57
    rows, inside = [int(name) for name in impacts.recording], []
    for side, truth in (("pre", 1), ("post", 2)):
        known = torch.tensor(np.array([made[row][truth] for row in rows]))
        error = getattr(impacts, f"v_{side}") - known
        deviation = getattr(impacts, f"v_{side}_cov").diagonal(dim1=-2, dim2=-1).sqrt()
        inside.append((error.abs() < 1.96 * deviation).double().mean().item())
    assert 0.93 < np.mean(inside) < 0.975
    chi_square = np.array([contact.chi_square for contact in found.survey.contacts])
    assert np.mean(chi_square) == pytest.approx(5, abs=1.7)  # χ² with 5 degrees of freedom; 4 standard errors
    (hand,) = [clue for clue in found.survey.frame.clues if clue.convention == "axes"]
    assert (hand.value, hand.stated) == ("right-handed", None)
    assert (impacts.time - torch.tensor([made[row][3] for row in rows])).abs().max() < 5e-4
    ratio = impacts.wrench[:, :2].norm(dim=-1) / impacts.wrench[:, 2]
    assert ratio.quantile(0.9) < 0.2  # μ is 0.18


def test_the_rig_card_finds_corners_centre_and_inertia_without_a_law(tmp_path):
    centre = (0.003, -0.002, 0.004)
    made, _ = written(tmp_path, 70, 8, centre=centre, heavier=1.2, corner=0.004)
    impacts = impacts_in(tmp_path, sense="as_read").impacts
    rig = impacts.apparatus
    known = {f"centre_{axis}": x for axis, x in zip("abc", centre, strict=True)}
    for name, truth in {**known, "inertia": np.log(1.2), "corner": 0.004}.items():
        one = getattr(rig, name)
        assert abs(one.value - truth) < 4 * one.error < abs(truth)
    assert {row.name for row in rig.differing} >= {*known, "inertia", "corner"}
    right = correct(impacts, ["rig"])
    rows = [int(name) for name in right.recording]
    turn = rigid_body.rotation(right.q[:, 3:])
    d = rigid_body.matvec(turn, torch.tensor(centre).double().expand(len(rows), 3))
    tracked = torch.tensor(np.array([made[row][1] for row in rows]))
    assert (right.v_pre[:, :3] - tracked[:, :3] - rigid_body.swept(d, tracked[:, 3:])).abs().median() < 4e-3
    assert right.wrench[:, 3:].norm(dim=-1).median() < 0.3 * impacts.wrench[:, 3:].norm(dim=-1).median()


def turned_back(table):
    return table.assign(qx=-table.qx, qy=-table.qy, qz=-table.qz)


MISTAKES = {
    "not unit": (lambda t: t.assign(qw=2.0), {}, r"frame 1: a quaternion must be of length 1, got 2\."),
    "scalar last": (
        lambda t: t.rename(columns={"qw": "a", "qx": "qw", "qy": "qx", "qz": "qy"}).rename(columns={"a": "qz"}),
        {"sense": "as_read"}, r"contradict data\.order=wxyz and data\.sense=as_read.* data\.order=xyzw",
    ),
    "world to body": (turned_back, {"sense": "as_read"}, r"contradict .*data\.sense=as_read.* data\.sense=mirrored"),
    "left-handed": (lambda t: t.assign(x=-t.x), {}, "axes must be right-handed"),
    "up is y": (lambda t: t, {"up": "y"}, r"bodies fall 90\.\d° off the axis y that data.up calls up; is up z"),
    "no body": (lambda t: t, {"inertia": (1e-4, 1e-4, 3e-4)}, r"at most the sum of the two others, got \[.*0\.0003\]"),
    "in a plane": (
        lambda t: t.assign(theta=np.arctan2(t.qy, t.qw)),
        {"columns": {"position": ["x", "z"], "angle": "theta"}},
        r"data\.shape is a body in space, which needs positions x, y, z and quaternions",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("mistake", "settings", "message"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_refused_in_one_line(tosses, tmp_path, mistake, settings, message):
    mistake(tosses[2].query("recording < 8")).to_parquet(tmp_path / "tosses.parquet")
    with pytest.raises(DataError, match=message) as refused:
        impacts_in(tmp_path, **settings)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("said", ["# exported from Unity 2022", "# left-handed, y up"])
def test_left_handed_axes_are_asked_about(tosses, tmp_path, said):
    """Impacts of a box look the same in a mirror: its file says it, or nothing does."""
    rows = tosses[2].query("recording < 2").to_csv(index=False)
    (tmp_path / "tosses.csv").write_text(f"{said}\n{rows}")
    message = (
        r"position: \[x, y, {column: z, factor: -1}\], quaternion: \[qw, {column: qx, factor: -1}, {column: qy, fac"
    )
    with pytest.raises(DataError, match=message):
        impacts_in(tmp_path)
    found = impacts_in(tmp_path, columns={"position": ["x", "y", {"column": "z", "factor": 1}]})
    assert found.survey.frame.clues[2].value == "right-handed"


@pytest.mark.nightly
def test_exchanged_edges_of_a_box_are_refused(tmp_path, monkeypatch):
    """Not by few contacts: three points lie on a floor with the edges in some order by chance."""
    right, wrong = Cuboid((0.07, 0.045, 0.045)), Cuboid((0.045, 0.07, 0.045))
    written(tmp_path, 8, 3, solid=right)
    contradicts = pytest.raises(
        DataError, match=r"contradict data\.shape: .* with it as half: \[0\.07, 0\.045, 0\.045\]"
    )
    with contradicts:
        impacts_in(tmp_path, wrong)
    contacts = impacts_in(tmp_path, right, sense="as_read").survey.contacts
    for count, refused in ((3, nullcontext()), (8, contradicts)):
        searched = {"a": SimpleNamespace(contacts=contacts[:count])}
        monkeypatch.setattr(angles, "search_reading", lambda *_, found=searched: (None, None, found))
        with refused:
            angles._check_edges(
                [SimpleNamespace(source="a")], None, track_options(), wrong, wrong.gyration_squared(),
                {("wxyz", "as_read"): {}}, 1.0,
            )  # fmt: skip


@pytest.mark.parametrize("sense", [None, "as_read"])
def test_exchanged_edges_of_a_rectangle_are_refused(tmp_path, sense):
    half = np.array((0.045, 0.03))
    corners = half * ((1, 1), (-1, 1), (-1, -1), (1, -1))
    shape, turned = (Polygon(tuple(map(tuple, points.tolist()))) for points in (corners, corners[:, ::-1][::-1]))
    gyration = float(half @ half) / 3
    body = Body(shape=shape, mass=0.1, inertia=0.1 * gyration, model=ContactModel(find("wang_mason").at(0.2, 0.6)))
    takes, _ = record(throw(body, 10, torch.Generator().manual_seed(1)), Camera(frames=220), 1)
    write_recordings(takes, tmp_path)
    options = track_options(unit="m", angle="rad", sense=sense)
    assert len(find_impacts(tmp_path, mass=0.1, shape=shape, options=options).impacts) > 10
    with pytest.raises(DataError, match=r"contradict data\.shape: .* with it turned by (90|270)°"):
        find_impacts(tmp_path, mass=0.1, shape=turned, options=options)


@pytest.mark.parametrize("few", [4, 5, 6])
def test_few_contacts_show_the_sense_of_quaternions_by_their_heights(found, few):
    """No slope of the floor, which would pass through most of them in any sense."""
    searched = {"a": SimpleNamespace(contacts=found.survey.contacts[:few])}
    residuals = [reading_residual(searched, BOX, BOX.gyration_squared(), sense) for sense in (1, -1)]
    assert residuals[0] < 1e-3
    assert residuals[1] > 0.03


def test_a_contact_on_an_edge_is_refused_with_the_height_of_its_other_corner(found):
    from contactlearn.data.recordings.floor import off_the_floor

    edge = torch.tensor(Rotation.from_euler("x", 30, degrees=True).as_quat(scalar_first=True))
    pose = np.append((0.0, 0.0, -contact_point(BOX, edge)[2].item() + found.floor.height.value), edge.numpy())
    contacts = [*found.survey.contacts, replace(found.survey.contacts[0], pose=pose, number=9)]
    floor = find_floor(contacts, BOX)
    kept, refusals = off_the_floor(contacts, BOX, floor)
    assert len(kept) == len(contacts) - 1
    assert [(one.reason, one.unit) for one in refusals] == [(Reason.SECOND_CORNER, "mm")]
    assert "another corner" in refusals[0].quantity


@pytest.mark.parametrize(("tilt", "alone"), [(0.3, False), (8.0, True)])
def test_a_contact_in_the_plane_is_refused_as_another_corner_comes_down(tilt, alone):
    from contactlearn.data.recordings.floor import off_the_floor

    shape, floor_at = Polygon(((0.05, 0.03), (-0.05, 0.03), (-0.05, -0.03), (0.05, -0.03))), 0.2
    contacts = []
    for k, angle in enumerate((0.7, 1.1, 2.0, -0.8, -2.1, 2.6, 0.4, np.radians(tilt))):
        height = floor_at - contact_point(shape, torch.tensor(angle))[1].item()
        contacts.append(
            RecordedContact(
                recording="a",
                number=k,
                time=1.0 * k,
                v_pre=np.array((0.2, -1.0, 3.0)),
                v_post=np.array((0.1, 0.8, -1.0)),
                pose=np.array((0.01 * k, height, angle)),
                covariance=1e-10 * np.eye(10),
                missing=0,
                certainty=1.0,
                lost=0,
                chi_square=1.0,
                lasting=1e-3,
                flight=0,
            )
        )
    kept, refusals = off_the_floor(contacts, shape, find_floor(contacts, shape), longest=3e-3)
    assert (contacts[-1] in kept) is alone
    assert [one.reason for one in refusals] == [Reason.SECOND_CORNER] * (not alone)


@pytest.mark.parametrize(("longest", "alone"), [(1e-4, True), (3e-3, False)])
def test_a_contact_is_refused_if_another_corner_comes_down_within_the_longest_contact(found, longest, alone):
    from contactlearn.data.recordings.floor import off_the_floor

    first = found.survey.contacts[0]
    tilted = torch.tensor(Rotation.from_euler("xy", (1.2, 0.9), degrees=True).as_quat(scalar_first=True))
    pose = np.append((0.0, 0.0, -contact_point(BOX, tilted)[2].item() + found.floor.height.value), tilted.numpy())
    flat = replace(first, pose=pose, v_pre=np.array((0.3, 0.0, -1.0, 0.0, 0.0, 0.0)), number=9)
    contacts = [*found.survey.contacts, flat]
    kept, refusals = off_the_floor(contacts, BOX, find_floor(contacts, BOX), longest=longest)
    assert (flat in kept) is alone
    assert len(refusals) == (not alone)


@pytest.mark.nightly  # a minute
def test_the_published_tosses():
    folder = Path(os.environ.get("CONTACTLEARN_DATA", "")) / "cube_tosses"
    if not (folder / "tosses.parquet").is_file():
        pytest.skip("the published tosses are not here")
    impacts = find_impacts(folder, mass=0.37, inertia=8.1e-4, shape=Cuboid((0.0524,) * 3)).impacts
    assert len(impacts) >= 460
    ratio = impacts.wrench[:, :2].norm(dim=-1) / impacts.wrench[:, 2]
    assert 0.1 < ratio.median() < 0.25  # the board was tilted to 0.18
