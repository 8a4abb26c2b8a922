"""Recordings of MuJoCo's bodies: impacts agree with the engine's own states, and clatter is refused."""

import math

import numpy as np
import pytest

from contactlearn.data import tracks
from contactlearn.data.recordings.flights import Air, FlightOptions, find_flights
from contactlearn.data.recordings.poses import turn
from contactlearn.simulation import recordings, recordings_mujoco
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.mujoco import Bench, Hidden
from contactlearn.simulation.recordings import write_recordings

CONTACT_TIME, RATE = 1e-3, 250.0  # s, frames/s
CAMERA = Camera(rate=RATE, frames=250)
GRAVITY = 9.81


def bench(kind="ellipse", **hidden):
    return Bench(
        kind=kind,
        semi_axes=(0.035, 0.025),
        mass=0.0364,
        mu=0.12,
        eps=0.55,
        contact_time=CONTACT_TIME,
        hidden=Hidden(**hidden),
    )


def found_in(folder, recordings, true):
    write_recordings(recordings, folder)
    options = tracks.track_options(contact_time=CONTACT_TIME)
    return tracks.find_impacts(folder, mass=true.mass, shape=true.body, options=options)


@pytest.fixture(scope="module")
def ellipses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ellipses")
    recordings, truth = recordings_mujoco.record_bounces(12, bench(tilt=0.01), CAMERA, seed=1)
    return found_in(folder, recordings, bench()), truth, folder


def true_one(truth, contact):
    mine = np.flatnonzero(truth.recording == int(contact.recording) - 1)
    return int(mine[np.abs(truth.time[mine] - contact.time).argmin()])


def test_impacts_agree_with_the_engines_states_within_their_errors(ellipses):
    """Standardised residuals of velocities, of the flights at the instant that was found, and of the pose."""
    found, truth, _ = ellipses
    scores = []
    for contact in found.survey.contacts:
        j = true_one(truth, contact)
        late = contact.time - truth.time[j]
        assert abs(late) < CONTACT_TIME / 2
        fallen = np.array((0.0, -GRAVITY * late, 0.0))
        errors = contact.v_pre - truth.v_pre[j] - fallen, contact.v_post - truth.v_post[j] - fallen
        scores.append(np.concatenate(errors) / contact.covariance.diagonal()[:6] ** 0.5)
        moved = CONTACT_TIME / 2 * np.abs(truth.v_post[j] - truth.v_pre[j])
        off = contact.pose - truth.q[j]
        off[2] = turn(off[2])
        assert (np.abs(off) < moved + CONTACT_TIME / 2 * np.abs(truth.v_pre[j]) + (3e-4, 3e-4, 0.01)).all()
    assert len(scores) >= 35
    assert (np.abs(np.mean(scores, 0)) < 4 / len(scores) ** 0.5).all()
    assert 0.8 < np.std(scores) < 1.2
    shortest = max(find_flights(one.track).width for one in found.reload({"0001", "0002"})) + 1
    clean = {int(j) for j in np.flatnonzero(truth.frames.min(1) >= shortest)}
    there = {true_one(truth, contact) for contact in found.survey.contacts}
    assert shortest <= FlightOptions().narrowest(Air()) + 2, "the noise asks for few frames more"
    assert len(clean & there) >= 0.93 * len(clean)
    assert min(truth.frames[j].min() for j in there) >= shortest - 3
    slope = ellipses[0].impacts.apparatus.slope
    assert abs(slope.value - 0.01) < 4 * slope.error
    assert slope.error < 1e-3


@pytest.mark.nightly
def test_the_source_writes_its_recordings_and_finds_their_impacts(tmp_path):
    settings = {"size": 4, "folder": str(tmp_path), "contact_time": CONTACT_TIME, "rate": 500.0, "lost": 0.01}
    found = recordings_mujoco.find(**settings, angle_noise=math.radians(0.05), seed=3)
    assert len(list(tmp_path.glob("*.csv"))) == 4
    assert len(found.impacts) >= 8
    assert found.impacts.shape == bench().body
    assert abs(found.impacts.apparatus.gravity.value - GRAVITY) < 4 * found.impacts.apparatus.gravity.error


@pytest.mark.parametrize(("source", "order"), [(recordings, "xyzw"), (recordings_mujoco, "wxyz")])
def test_a_tracker_in_space_is_simulated_too(source, order, tmp_path):
    found = source.find(size=5, seed=1, axes="z_up", order=order, folder=str(tmp_path))
    assert found.survey.frame.order == order
    assert len(found.impacts) > 10
