"""Tracks: flights, contacts and their errors on simulated recordings with known truth, and what is refused."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.conventions import find_flight_model, find_frame, find_gravity
from contactlearn.data.recordings.flights import STEADY, Air, FlightOptions, find_flights, fit
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.result import Reason
from contactlearn.data.recordings.track import Recording, Track, continuous
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.report.text import tracks as text
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import simulate

RATE, SIGMA = 250.0, np.array((5e-5, 5e-5, math.radians(0.1)))
CHI_3 = 7.815  # 95 % quantile with three degrees of freedom


def track_of(pose: np.ndarray, time: np.ndarray | None = None, name: str = "one") -> Track:
    time = np.arange(len(pose)) / RATE if time is None else time
    return Track(name=name, time=time, pose=pose)


def bounce(
    *, before=(0.6, -2.0, 5.0), after=(0.3, 1.2, -8.0), at=0.1013, frames=60, noise=1.0, seed=0, theta=0.3, rate=RATE
) -> np.ndarray:
    """Poses of a body with one contact at (0, 0, θ), and its velocities there."""
    tau = np.arange(frames) / rate - at
    v = np.where(tau[:, None] < 0, before, after)
    pose = v * tau[:, None] + np.stack((0 * tau, -9.81 / 2 * tau**2, theta + 0 * tau), 1)
    return pose + noise * SIGMA * np.random.default_rng(seed).standard_normal(pose.shape)


def one_contact(pose: np.ndarray, **options):
    found = find_contacts(track_of(pose), options=FlightOptions(**options))
    assert len(found.contacts) == 1, found.refusals
    return found.contacts[0]


def matched(size: int, camera: Camera, seed: int):
    """Each accepted contact of simulated recordings with the index of the true one that is nearest in time."""
    recordings, truth = simulate(size, camera, seed=seed)
    founds, pairs = [], []
    for k, recording in enumerate(recordings):
        assert recording.angle is not None
        pose = np.column_stack((recording.position, continuous(recording.angle, recording.time)))
        founds.append(find_contacts(track_of(pose, recording.time, recording.name)))
        mine = np.flatnonzero(truth.recording == k)
        pairs += [(c, int(mine[np.abs(truth.time[mine] - c.time).argmin()])) for c in founds[-1].contacts]
    return founds, pairs, truth


def test_flights_that_plates_brake_show_their_own_accelerations_and_meet_within_their_errors():
    """Each flight has its own acceleration, contacts last 3 ms, and recordings skip frames there."""
    camera = Camera(frames=250, noise=2e-5, angle_noise=7e-4, lasting=3e-3, skipped=0.5)
    recordings, truth = simulate(12, camera, drag=0.5, plates=0.15, seed=3)
    gravity = find_gravity(recordings)
    frame = find_frame(recordings, gravity)
    model = find_flight_model(recordings, frame, gravity)
    np.testing.assert_allclose(model.prior[0] / np.array((1, 1, 30)), 0.15, rtol=0.5)
    tracks = [frame.track(recording) for recording in recordings]
    free, steady = (
        [find_contacts(track, physics).contacts for track in tracks]
        for physics in (model, replace(model, prior=STEADY))
    )
    assert sum(map(len, free)) > 1.3 * sum(map(len, steady))
    scores = []
    for k, hit in [(k, hit) for k, hits in enumerate(free) for hit in hits]:
        mine = np.flatnonzero(truth.recording == k)
        error = hit.v_pre - truth.v_pre[mine[np.abs(truth.time[mine] - hit.time).argmin()]]
        scores.append(error @ np.linalg.solve(hit.covariance[:3, :3], error))
    assert np.mean(np.array(scores) < CHI_3) > 0.85


@pytest.mark.parametrize("drag", [0.0, 0.8])
def test_a_flight_is_fitted_with_its_covariance(drag):
    """Standardised errors of the state are standard normal, at the reference and far from it."""
    air, time = Air(drag=drag), np.arange(30) / RATE
    state = np.array((0.1, 0.5, -3.0, 0.7, 1.5, 20.0))
    v, tau = state[3:], time
    s = -np.expm1(-drag * tau) / drag if drag else tau
    b = (tau - s) / drag if drag else tau**2 / 2
    exact = state[:3] + np.stack((v[0] * s, v[1] * s - 9.81 * b, v[2] * tau), 1)
    rng, scores = np.random.default_rng(0), []
    for _ in range(300):
        flight = fit(time, exact + SIGMA * rng.standard_normal(exact.shape), np.arange(30), SIGMA, air)
        pose, velocity, covariance = flight.at(0.0)
        difference = np.append(pose, velocity) - state
        difference[2] = turn(difference[2])
        scores.append(difference @ np.linalg.solve(covariance, difference))
    assert np.mean(scores) == pytest.approx(6, abs=0.7)  # χ² with 6 degrees of freedom; 4 standard errors


@pytest.mark.parametrize(("rate", "spin"), [(250.0, 700.0), (250.0, -700.0), (1000.0, 2000.0)])
def test_angles_are_unwrapped_at_any_rate_below_half_a_turn_a_frame(rate, spin):
    time = np.arange(200) / rate
    angle = turn(spin * time + 1.0)
    angle[[50, 51, 90]] = np.nan
    out = continuous(angle, time)
    seen = np.isfinite(out)
    np.testing.assert_allclose(np.diff(out[seen]) / np.diff(time[seen]), spin, rtol=1e-9)


def test_the_state_at_contact_is_right_and_so_are_its_errors():
    """Twenty-five recordings at 250 frames a second; the benchmark has more."""
    founds, pairs, truth = matched(25, Camera(frames=250), seed=5)
    clean = truth.frames.min(1) >= FlightOptions().narrowest(Air()) + 1
    assert len({j for _, j in pairs if clean[j]}) >= 0.96 * clean.sum()
    errors, inside = [], []
    for c, j in pairs:
        assert abs(c.time - truth.time[j]) < 4.5 * c.covariance[9, 9] ** 0.5  # 0.01 frames, but for a grazing contact
        assert c.missing == 0
        error = np.concatenate((c.v_pre - truth.v_pre[j], c.v_post - truth.v_post[j], c.pose - truth.q[j]))
        error[8] = turn(error[8])
        errors.append(error / np.sqrt(c.covariance.diagonal()[:9]))
        inside += [
            float(error[k] @ np.linalg.solve(c.covariance[k, k], error[k])) < CHI_3 for k in (slice(3), slice(3, 6))
        ]
    assert (np.abs(np.mean(errors, 0)) < 0.3).all()  # four standard errors of the mean
    assert 0.88 < np.mean(inside) <= 0.99
    assert all(np.allclose(found.sigma, SIGMA, rtol=0.2) for found in founds)


@pytest.mark.parametrize("missing", [0, 1, 2, 3])
@pytest.mark.parametrize("marked", [False, True])
def test_missing_frames_are_counted(missing, marked):
    """Whether the recording skips them or marks them as lost."""
    pose = bounce(frames=70, seed=missing)
    hidden = np.arange(26, 26 + missing)  # the contact is at frame 25.3
    if marked:
        pose[hidden] = np.nan
    else:
        pose = np.delete(pose, hidden, 0)
    contact = one_contact(pose)
    assert (contact.missing, contact.lost) == ((0, missing) if marked else (missing, 0))
    assert contact.time == pytest.approx(0.1013, abs=2e-4)
    np.testing.assert_allclose(contact.v_post, (0.3, 1.2, -8.0), atol=0.15)


@pytest.mark.parametrize(
    "change",
    [
        lambda pose: np.column_stack((pose[:, :2], turn(pose[:, 2] + 3.0))),
        lambda pose: np.where(np.arange(60)[:, None] % 7 == 3, np.nan, pose),
        lambda pose: pose + 40 * SIGMA * np.isin(np.arange(60), (9, 10, 40))[:, None],
        lambda pose: pose + 40 * SIGMA * (np.arange(60) == 23)[:, None],
        lambda pose: pose + np.array((1e3, -20, 500)),
    ],
    ids=["wrapped", "every seventh lost", "bad frames", "bad beside contact", "far away"],
)
def test_ugly_tracks_give_the_same_contact(change):
    plain, ugly = one_contact(bounce()), one_contact(change(bounce()))
    assert ugly.time == pytest.approx(plain.time, abs=1e-4)
    np.testing.assert_allclose(ugly.v_pre, plain.v_pre, atol=0.08)
    np.testing.assert_allclose(ugly.v_post, plain.v_post, atol=0.08)


def test_exact_tracks_give_exact_contacts():
    contact = one_contact(bounce(noise=0.0))
    assert contact.time == pytest.approx(0.1013, abs=1e-9)
    np.testing.assert_allclose(contact.v_pre, (0.6, -2.0, 5.0), atol=1e-6)
    pose = bounce(noise=1.0)[:25]
    bad = pose.copy()
    bad[12] += 50 * SIGMA
    states = [fit(np.arange(25) / RATE, p, np.arange(25), SIGMA, Air()).state for p in (pose, bad)]
    assert (np.abs(states[1] - states[0])[:3] < SIGMA).all()
    pose = bounce(seed=2)
    pose[[19, 20]] += 40 * SIGMA
    found = find_contacts(track_of(pose))
    assert len(found.contacts) == 1
    assert found.flights[found.contacts[0].flight].last >= 24


@pytest.mark.parametrize("seed", range(4))
def test_a_contact_lasts_as_long_as_frames_are_in_neither_flight(seed):
    """The velocity changes steadily over 4 ms, in which there are four frames."""
    tau, lasts = np.arange(240) / 1000 - 0.1013, 4e-3
    soft = bounce(rate=1000, frames=240, seed=seed)
    soft += np.maximum(lasts / 2 - np.abs(tau), 0)[:, None] ** 2 / (2 * lasts) * np.array((-0.3, 3.2, -13.0))
    track = track_of(soft, np.arange(240) / 1000)
    (hit,) = find_contacts(track).contacts
    error = hit.v_pre - (0.6, -2.0, 5.0)
    assert error @ np.linalg.solve(hit.covariance[:3, :3], error) < 16


def test_blur_and_a_hand_do_no_harm():
    founds, pairs, truth = matched(8, Camera(frames=300, exposure=0.003, held=0.1), seed=2)
    scores = [
        float((c.v_pre - truth.v_pre[j]) @ np.linalg.solve(c.covariance[:3, :3], c.v_pre - truth.v_pre[j]))
        for c, j in pairs
    ]
    assert np.median(scores) < 5
    held = [r for found in founds for r in found.refusals if r.reason is Reason.HAND_OR_WALL]
    assert len(held) == len(founds)


def refusals(pose: np.ndarray) -> set[Reason]:
    found = find_contacts(track_of(pose))
    assert not found.contacts
    return {refusal.reason for refusal in found.refusals}


def two_hits(apart: float, seed: int = 0) -> np.ndarray:
    """A body that hits twice, `apart` seconds between."""
    time, rng = np.arange(60) / RATE - 0.1013, np.random.default_rng(seed)
    velocities = np.array(((0.6, -2.0, 5.0), (0.2, 0.1, 30.0), (0.3, 1.5, -8.0)))
    spans = np.stack((np.minimum(time, 0), np.clip(time, 0, apart), np.maximum(time - apart, 0)), 1)
    pose = spans @ velocities + np.stack((0 * time, -9.81 / 2 * time**2, 0 * time), 1)
    return pose + SIGMA * rng.standard_normal(pose.shape)


@pytest.mark.parametrize("apart", [0.002, 0.004, 0.007, 0.012, 0.02])
def test_several_hits_are_refused(apart):
    assert Reason.DOUBLE_HIT in refusals(two_hits(apart))


def test_few_and_lost_frames_are_refused():
    pose = bounce()
    assert refusals(pose[22:]) == {Reason.TOO_FEW_FRAMES}
    assert refusals(pose[:30]) == {Reason.TOO_FEW_FRAMES}
    assert refusals(pose[:5]) == {Reason.TOO_FEW_FRAMES}
    pose[23:29] = np.nan
    assert refusals(pose) == {Reason.LOST_FRAMES}
    assert refusals(np.full((40, 3), np.nan)) == {Reason.LOST_FRAMES}
    mended = find_contacts(track_of(np.delete(bounce(at=1.0), [20, 21, 30], 0)))  # frames that are skipped in flight
    assert not mended.refusals
    np.testing.assert_allclose(mended.track.time, np.delete(np.arange(60), [20, 21, 30]) / RATE)
    time = np.arange(200) / RATE
    still = np.zeros((200, 3)) + SIGMA * np.random.default_rng(0).standard_normal((200, 3))
    sliding = still + np.stack((0.5 * time - 0.3 * time**2, 0 * time, 0 * time), 1)
    carried = still + np.stack((0.2 * np.sin(9 * time), 0.3 - 0.1 * np.cos(7 * time), 0 * time), 1)
    assert refusals(still) == {Reason.REST}
    assert refusals(sliding) == {Reason.SLIDING}
    assert refusals(carried) <= {Reason.SLIDING, Reason.HAND_OR_WALL}


def test_windows_grow_with_the_frame_rate_and_the_noise():
    """Until rest differs from flight."""
    widths = [
        find_flights(track_of(bounce(rate=rate, frames=200, at=0.05), np.arange(200) / rate)).width
        for rate in (250, 1000)
    ]
    assert widths[0] == FlightOptions().narrowest(Air()) < widths[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.array((0.0, 0.2, 0.1))}, "time must grow; it runs back at frame 3"),
        ({"time": np.array((0.0, 0.1, 0.1))}, "time must grow; it repeats at frame 3"),
        ({"time": np.array((0.0, np.nan, 0.1))}, "is not a number at frame 2"),
        ({"time": np.zeros(1), "position": np.zeros((1, 2)), "angle": np.zeros(1)}, "has 1 frames"),
        ({"angle": None}, "needs x, y and an angle, or x, y, z and a quaternion"),
        ({"position": np.zeros((3, 3))}, "needs x, y and an angle"),
        ({"position": np.zeros((2, 2))}, "position must have shape"),
    ],
)
def test_what_is_no_recording_is_refused(changes, message):
    good = {"time": np.arange(3.0), "position": np.zeros((3, 2)), "angle": np.zeros(3)}
    with pytest.raises(DataError, match=message):
        Recording(name="a", source="a.csv", **(good | changes))


def test_a_track_is_the_recording_upright():
    """In space, with tilted axes, mm and the scalar last."""
    c, s = math.cos(0.35), math.sin(0.35)
    camera = Camera(frames=100, axes=((c, 0, s), (0, 1, 0), (-s, 0, c)), order="xyzw", length=1000)
    recordings, _ = simulate(5, camera, seed=1)
    plain, _ = simulate(5, replace(camera, axes=((1, 0, 0), (0, 1, 0)), length=1), seed=1)
    frame = find_frame(recordings, find_gravity(recordings))
    assert (frame.order, frame.scale) == ("xyzw", 1e-3)
    track, flat = frame.track(recordings[0]), plain[0]
    assert flat.angle is not None
    assert np.abs(track.pose[:, :2] - flat.position).max() < 1e-3
    assert np.abs(turn(track.pose[:, 2] - flat.angle)).max() < 0.02
    assert np.abs(track.out_of_plane).max() < 1e-3
    assert np.degrees(track.tilted).max() < 1


def bounces(at, velocities, *, frames, noise, seed) -> np.ndarray:
    """Poses of a body with contacts at instants, and its velocities between them: after each, and before the first."""
    tau, rng = np.arange(frames) / RATE, np.random.default_rng(seed)
    starts = (0.0, *at)
    pose, here = np.zeros((frames, 3)), np.zeros(3)
    for k, (start, v) in enumerate(zip(starts, velocities, strict=True)):
        end = starts[k + 1] if k + 1 < len(starts) else np.inf
        inside, since = (tau >= start) & (tau < end), (tau - start)[:, None]
        pose[inside] = (here + np.asarray(v) * since - (0, 9.81 / 2, 0) * since**2)[inside]
        if end < np.inf:
            here = here + np.asarray(v) * (end - start) - np.array((0, 9.81 / 2, 0)) * (end - start) ** 2
    return pose + noise * SIGMA * rng.standard_normal(pose.shape)


def test_a_flight_with_frames_of_the_next_one_is_too_short():
    """After nine frames a light contact follows, and others soon: the next flight is no flight of its own."""
    before, after = (0.5, -0.5, 5.0), (0.4, 0.18, -3.0)
    light, lighter = (0.38, 0.05, -2.0), (0.36, 0.02, -1.0)
    accepted = 0
    for seed in range(20):
        at = (0.1215, 0.1215 + 9.4 / RATE, 0.1215 + 13 / RATE, 0.1215 + 15 / RATE)
        pose = bounces(at, (before, after, light, lighter, (0.3, 0.0, 0.0)), frames=48, noise=4, seed=seed)
        found = find_contacts(track_of(pose))
        width = find_flights(track_of(pose)).width
        assert width >= 11, "the noise asks for longer flights than nine frames"
        accepted += len(found.contacts)
        assert all(len(contact.after.frames) >= width for contact in found.contacts)
    assert accepted <= 2


def of_bounces(count: int, *, folded: float = math.inf, slowed: float = 1.0) -> list[Recording]:
    """Recordings of a bounce, whose angles begin again after some rad, of a video that is shown slower."""
    poses = [bounce(seed=k, theta=0.9 * k, noise=4.0) for k in range(count)]
    return [
        Recording(
            name=f"{k}",
            source="file",
            time=np.arange(len(pose)) / RATE * slowed,
            position=pose[:, :2],
            angle=pose[:, 2] % folded if math.isfinite(folded) else pose[:, 2],
        )
        for k, pose in enumerate(poses)
    ]


@pytest.mark.parametrize(("period", "folds"), [(math.pi, 2), (math.pi / 2, 4), (2 * math.pi, 1), (math.inf, 1)])
def test_angles_that_begin_again_are_followed(period, folds):
    """A fitted ellipse shows its angle but for half a turn: every jump would end a flight."""
    recordings = of_bounces(6, folded=period)
    frame = find_frame(recordings, find_gravity(recordings))
    assert frame.folds == folds
    assert any(clue.convention == "period" for clue in frame.clues) == (folds > 1)
    for recording in recordings:
        assert len(find_contacts(frame.track(recording)).contacts) == 1


def test_a_video_in_slow_motion_is_told_its_frame_rate():
    with pytest.raises(DataError, match=r"0\.15\d.* m/s².* at 250 frames a second.*slowed 8 times.*data\.rate=250"):
        find_gravity(of_bounces(4, slowed=8.0))


@pytest.mark.parametrize(("unit", "scale"), [(None, 900.0), ("mm", 1000.0)], ids=["pixels", "mm"])
@pytest.mark.parametrize("braked", [0.0, 0.4], ids=["air", "sliding"])
def test_a_level_table_has_no_gravity_to_find(unit, scale, braked):
    """A puck between four rails, which slows down by friction in m/s²: its velocity turns at rails alone."""
    rng, step, recordings = np.random.default_rng(3), 1 / 120, list[Recording]()
    for k in range(6):
        turn = rng.uniform(0, 2 * np.pi)
        position, velocity = np.array((0.6, 0.4)), 2.5 * np.array((np.cos(turn), np.sin(turn)))
        pose = np.empty((300, 2))
        for frame in pose:
            frame[:] = position
            position = position + step * velocity
            velocity = velocity - braked * step * velocity / np.linalg.norm(velocity)
            out = (position < 0) | (position > (1.2, 0.8))
            velocity = np.where(out, -0.8 * np.sign(position - (0.6, 0.4)) * np.abs(velocity), velocity)
        pose = scale * (pose + 3e-4 * rng.standard_normal(pose.shape))
        time, angle = step * np.arange(300), np.zeros(300)
        recordings.append(Recording(name=str(k), source="puck", time=time, position=pose, angle=angle, unit=unit))
    with pytest.raises(DataError, match=r"nothing falls: .* level table .* a row a hit"):
        find_frame(recordings, find_gravity(recordings))


@pytest.mark.parametrize("contacts", [1, 3, 4])
def test_a_floor_through_few_contacts_has_no_error(contacts):
    floor = SimpleNamespace(height=Estimate(value=-8.04e-3, error=0.0), rests=0, scatter=1e-9)
    tracked = SimpleNamespace(floor=floor, survey=SimpleNamespace(contacts=[None] * contacts, rests=()))
    ((_, said),) = text._floor(tracked)
    assert ("too few contacts" in said, "±" in said) == ((contacts < 4), (contacts >= 4))
