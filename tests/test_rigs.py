"""Simulated rigs: mechanics of the bodies, faults of the camera, and the impacts that are found on them."""

import math
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.conventions import find_flight_model, find_frame, find_gravity
from contactlearn.data.recordings.frame import Frame
from contactlearn.data.recordings.track import Recording

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from accuracy.rigs import GRAVITY, SIDE, Rig, move, record

QUIET = Rig(noise=0.0, duration=6e-4)
CHI_3 = 7.815  # 95 % quantile with three degrees of freedom
STEP = 1e-4  # s; contacts of half a millisecond have a handful of them


@cache
def moved(body: str, others: float = 0.0):
    return move([replace(QUIET, body=body)] * 8, seed=1, seconds=0.45, others=others, step=STEP)


def test_flights_are_parabolas_and_contacts_lose_energy():
    """Without plates the velocity after a contact and gravity give the one before the next."""
    found, energy = record(QUIET, moved("square"), seed=0), []
    for one, next_ in pairwise(found.contacts):
        if one.recording != next_.recording:
            continue
        after = next_.time[0] - one.time[1]
        np.testing.assert_allclose(next_.v[0], one.v[1] + after * one.a[1], atol=1e-9)
        np.testing.assert_allclose(one.a[1], (0, -GRAVITY, 0), atol=1e-12)
    for one in found.contacts:
        kinetic = (one.v**2 * (1, 1, QUIET.gyration_squared)).sum(1) / 2
        energy.append(np.diff(kinetic + GRAVITY * one.q[:, 1])[0])
    assert len(energy) > 10
    assert max(energy) < 0


def test_impulses_act_at_the_lowest_corner():
    """I Δω = r × m Δv, but for the turn of a corner in the contact's duration."""
    for one in record(QUIET, moved("square"), seed=0).contacts:
        flat = abs((one.q[0, 2] + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        if flat < 0.2 or one.v[0, 1] > -0.5:  # where the next corner follows within the contact
            continue
        change, theta = one.v[1] - one.v[0], one.q[:, 2].mean()
        corner = SIDE / math.sqrt(2) * np.exp(1j * (theta + np.pi / 4 + np.arange(4) * np.pi / 2))
        x, y = min((c.real, c.imag) for c in corner if c.imag == corner.imag.min())
        moment = x * change[1] - y * change[0]
        spun = QUIET.gyration_squared * change[2]
        assert spun == pytest.approx(moment, abs=0.05 * SIDE * np.hypot(*change[:2]))


def test_the_camera_records_what_the_faults_say():
    plain = record(QUIET, moved("square"), seed=0)
    rig = replace(QUIET, scale=1.02, pace=0.98, sense=-1, zero=0.1, height=-0.01, tracked=(2e-3, -1e-3))
    wrong = record(rig, moved("square"), seed=0)
    theta = plain.table.theta.to_numpy()
    x, y = rig.tracked
    np.testing.assert_allclose(wrong.table.time, plain.table.time / 0.98)
    np.testing.assert_allclose(
        wrong.table.x, 1.02 * (plain.table.x + np.cos(theta) * x - np.sin(theta) * y), atol=1e-12
    )
    np.testing.assert_allclose(
        wrong.table.y, 1.02 * (plain.table.y - 0.01 + np.sin(theta) * x + np.cos(theta) * y), atol=1e-12
    )
    assert np.abs(np.exp(1j * (wrong.table.theta + theta - 0.1)) - 1).max() < 1e-12
    for one, other in zip(plain.contacts, wrong.contacts, strict=True):
        assert other.stated == pytest.approx(one.stated / 0.98)
        np.testing.assert_allclose(other.v[:, 2], -0.98 * one.v[:, 2])


@pytest.mark.parametrize("body", ["square", "ellipse"])
def test_frames_are_lost_at_contacts_alone(body):
    kept, lost = (record(replace(QUIET, body=body, lost=share), moved(body), seed=0) for share in (0.0, 1.0))
    hard = [one for one in lost.contacts if one.skipped]
    missing = len(kept.table) - len(lost.table)
    assert 0 < missing == sum(one.skipped for one in hard)
    assert min(-one.v[0, 1] for one in hard) > 0.9


def test_scenes_that_are_no_drops_touch_something_else_or_for_long():
    found = record(QUIET, moved("square", others=1.0), seed=0)
    assert "drop" not in found.scenes
    for number, scene in enumerate(found.scenes, 1):
        if scene in ("wall", "hand"):
            assert not all(one.floor for one in found.contacts if one.recording == number)
    assert not all(one.single for one in found.contacts)


def test_gravity_is_found_though_bodies_rest_for_most_of_the_time():
    """Some hop so fast that their noise looks large, and at rest they agree with any small acceleration."""
    rig = replace(QUIET, noise=5e-5, duration=3e-3)
    found = find_gravity(recordings(record(rig, move([rig] * 6, seed=0, seconds=1.2, step=2e-4), seed=0)))
    assert abs(found.size - GRAVITY) < 3 * found.error < 0.05


@pytest.mark.parametrize(("rate", "duration"), [(250.0, 2.5e-3), (1000.0, 2e-3)])
def test_contacts_of_milliseconds_are_found(rate, duration):
    """Lever arms turn and friction changes while they last, so flights miss each other by many errors."""
    rig = replace(QUIET, noise=2e-5, duration=duration, rate=rate)
    seen = record(rig, move([rig] * 12, seed=2, seconds=0.6, step=STEP), seed=0)
    clean, found = set(), set()
    for number, recording in enumerate(recordings(seen), 1):
        mine = [one for one in seen.contacts if one.recording == number]
        clean |= {id(o) for o in mine if min(o.frames) >= rate / 15 and np.ptp(o.time) <= 3e-3}
        for hit in find_contacts(Frame(scale=1.0, axes=np.eye(2)).track(recording)).contacts:
            true = min(mine, key=lambda one: abs(one.stated - hit.time))
            assert abs(true.stated - hit.time) < np.ptp(true.time) / 2 + 0.5 / rate
            found.add(id(true))
    assert len(clean) >= 10
    assert clean <= found


def test_gravity_is_what_falls_though_bodies_roll_for_longer_and_slow_alike():
    rng, taken = np.random.default_rng(0), []
    for number in range(8):
        flies, rolls = np.arange(60) / 250, np.arange(350) / 250
        x = np.append(0.5 * flies, 0.12 + 2 * rolls - rolls**2 / 2)
        y = np.append(0.5 - GRAVITY * flies**2 / 2, np.full(350, 0.03))
        position = np.stack((x, y), 1) + rng.normal(0, 5e-5, (410, 2))
        taken.append(Recording(name=str(number), source="", time=np.arange(410) / 250, position=position, angle=0 * x))
    found = find_gravity(taken)
    assert abs(found.size - GRAVITY) < 4 * found.error < 0.1


def recordings(filmed):
    return [
        Recording(name=str(name), source="rig", time=one.time.to_numpy(), position=one[["x", "y"]].to_numpy(),
                  angle=one.theta.to_numpy())
        for name, one in filmed.table.groupby("recording")
    ]  # fmt: skip


def test_velocities_are_right_though_the_tracked_point_wobbles():
    """A millimetre off the centre of mass, it does not fly on a parabola; without a correction a third are outside."""
    rig = replace(QUIET, noise=5e-5, tracked=(8e-4, -6e-4))
    seen = record(rig, move([rig] * 24, seed=3, seconds=0.6, step=2e-4), seed=0)
    gravity = find_gravity(recordings(seen))
    frame = find_frame(recordings(seen), gravity)
    model = find_flight_model(recordings(seen), frame, gravity)
    np.testing.assert_allclose(model.centre, (-8e-4, 6e-4), atol=1e-4)
    inside = {True: [], False: []}
    for corrected in inside:
        physics = model if corrected else replace(model, centre=(0.0, 0.0))
        for number, recording in enumerate(recordings(seen), 1):
            for hit in find_contacts(frame.track(recording), physics).contacts:
                true = min((o for o in seen.contacts if o.recording == number), key=lambda o: abs(o.stated - hit.time))
                v = true.v + true.a * (hit.time - true.stated + true.time.mean() - true.time)[:, None]
                for half, velocity in enumerate((hit.v_pre, hit.v_post)):
                    error, part = velocity - v[half], slice(3 * half, 3 * half + 3)
                    inside[corrected].append(error @ np.linalg.solve(hit.covariance[part, part], error) < CHI_3)
    assert np.mean(inside[True]) > 0.88
    assert np.mean(inside[False]) < 0.8
