"""Studies of recordings: units, axes, orders and readings that are found, caught or missed; motion out of the plane."""

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.conventions import Conventions, find_flight_model, find_frame, find_gravity
from contactlearn.data.recordings.result import Reason
from contactlearn.data.recordings.survey import TrackOptions, search_recording
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import find_impacts, track_options
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import AXES, MASS, SEMI_AXES, simulate, write_recordings
from sensitivity.studies.cases import between
from sensitivity.study import AllThresholds, Study, each

RATE = Camera().rate


def leaning(radians: float) -> tuple[tuple[float, ...], ...]:
    """Axes of a camera in the plane that is turned against the floor."""
    c, s = math.cos(radians), math.sin(radians)
    return (c, s, 0.0), (-s, c, 0.0)


def spatial(radians: float, axes: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Axes of a tracker in space that is turned about up."""
    c, s = math.cos(radians), math.sin(radians)
    return tuple(map(tuple, np.asarray(axes) @ np.array(((c, 0, s), (0, 1, 0), (-s, 0, c)))))


def _caught(stated: Conventions):
    """Whether recordings contradict what is stated."""

    def caught(recordings: list[Recording], thresholds: AllThresholds) -> bool:
        try:
            find_frame(recordings, find_gravity(recordings), stated, thresholds.tracks)
        except DataError:
            return True
        return False

    return caught


def _timed(kind: str, seed: int) -> list[Recording]:
    off = between(0.003, 0.008, seed) if kind == "right" else between(0.01, 0.1, seed)
    camera = Camera(stated_rate=RATE * (1 + off * (-1) ** seed), noise=between(5e-5, 5e-4, seed + 1))
    return simulate(6, camera, seed=seed)[0]


SCALE = Study(
    name="scale of recordings", null=each(16, "right"), planted=each(16, "wrong"), prepare=_timed,
    alarm=_caught(Conventions(unit="m")),
)  # fmt: skip


def _turned(kind: str, seed: int) -> list[Recording]:
    """A camera that is turned by so many degrees."""
    low, high = {"level": (1, 8), "wrong": (12, 90)}[kind]
    angle = math.radians(between(low, high, seed)) * (-1) ** seed
    return simulate(6, Camera(axes=leaning(angle), noise=between(5e-5, 5e-4, seed + 1)), seed=seed)[0]


LEANING = Study(
    name="stated up", null=each(16, "level"), planted=each(16, "wrong"), prepare=_turned,
    alarm=_caught(Conventions(up="y")),
)  # fmt: skip


def _wrapped(kind: str, seed: int) -> list[Recording]:
    """Angles of an ellipse that begin again after half a turn, as those of a fit to its image, or after a turn."""
    camera = Camera(noise=between(5e-5, 5e-4, seed), angle_noise=math.radians(between(0.1, 2, seed + 1)))
    period = math.pi if kind == "half turns" else 2 * math.pi
    return [replace(one, angle=one.angle % period) for one in simulate(6, camera, seed=seed)[0]]


def _begin_again(recordings: list[Recording], thresholds: AllThresholds) -> bool:
    """Whether angles are found to begin again within a turn."""
    try:
        return find_frame(recordings, find_gravity(recordings), Conventions(), thresholds.tracks).folds > 1
    except DataError:
        return False


WRAPPED = Study(
    name="angles modulo half a turn", null=each(16, "turns"), planted=each(16, "half turns"), prepare=_wrapped,
    alarm=_begin_again,
)  # fmt: skip


def _in_space(kind: str, seed: int) -> list[Recording]:
    """Recordings in space: of bodies that fly about a plane, or leave it, or tilt."""
    noise = math.radians(between(0.1, 1, seed))
    order = "xyzw" if kind == "wrong" else "wxyz"
    axes = np.array(spatial(between(0.1, 0.9, seed) * (-1) ** seed, AXES["y_up"]))
    recordings = simulate(6, Camera(axes=axes, order=order, angle_noise=noise), seed=seed)[0]
    away, right = axes[:, 2], axes[:, 0]
    found = []
    for recording in recordings:
        swing = np.sin(6 * recording.time)
        position, quaternion = recording.position, recording.quaternion
        match kind:
            case "near" | "leaves":
                reach = between(0.0005, 0.004, seed) if kind == "near" else between(0.006, 0.03, seed)
                position = position + np.outer(reach * swing, away)
            case "steady" | "tilts":
                tilt = math.radians(between(0.5, 3, seed) if kind == "steady" else between(6, 20, seed)) * swing
                turn = np.column_stack((np.cos(tilt / 2), np.outer(np.sin(tilt / 2), right)))
                quaternion = _product(turn, quaternion)
        found.append(replace(recording, position=position, quaternion=quaternion))
    return found


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Products of quaternions (w, x, y, z), one a frame."""
    scalar = p[:, 0] * q[:, 0] - (p[:, 1:] * q[:, 1:]).sum(1)
    vector = p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])
    return np.column_stack((scalar, vector))


ORDER = Study(
    name="order of quaternions", null=each(12, "thrown"), planted=each(12, "wrong"), prepare=_in_space,
    alarm=_caught(Conventions(order="wxyz")),
)  # fmt: skip


def _refused(recordings: list[Recording], thresholds: AllThresholds) -> bool:
    """Whether most recordings leave the plane."""
    options = TrackOptions(conventions=Conventions(order="wxyz"), thresholds=thresholds.tracks)
    gravity = find_gravity(recordings)
    frame = find_frame(recordings, gravity, options.conventions)
    model = find_flight_model(recordings, frame, gravity)
    refusals = [search_recording(recording, frame, model, options).refusals for recording in recordings]
    return sum(any(one.reason is Reason.OUT_OF_PLANE for one in of) for of in refusals) > len(recordings) / 2


APART = Study(
    name="out of the plane", null=each(12, "near"), planted=each(12, "leaves"), prepare=_in_space, alarm=_refused
)
TILTED = Study(
    name="tilt out of the plane", null=each(12, "steady"), planted=each(12, "tilts"), prepare=_in_space, alarm=_refused
)


def _read(kind: str, seed: int) -> list[Recording]:
    """Recordings in the plane, in radians or degrees, of a poor tracker; or each with a zero of θ of its own."""
    camera = Camera(angle_noise=math.radians(between(1, 15, seed)), degrees=seed % 2 == 1)
    recordings, turn = simulate(3, camera, seed=seed)[0], 360.0 if camera.degrees else 2 * math.pi
    if kind == "clear":
        return recordings
    zeros = turn * np.random.default_rng(seed).random(len(recordings))
    return [replace(one, angle=one.angle + zero) for one, zero in zip(recordings, zeros, strict=True)]


def _reading(right: bool):
    """Whether the right reading of angles is found, or a wrong one."""

    def found(recordings: list[Recording], thresholds: AllThresholds) -> bool:
        in_degrees = max(float(np.nanmax(np.abs(one.angle))) for one in recordings) > 10
        options = replace(track_options(), thresholds=thresholds.tracks)
        with tempfile.TemporaryDirectory() as folder:
            write_recordings(recordings, Path(folder))
            try:
                frame = find_impacts(folder, mass=MASS, shape=Ellipse(SEMI_AXES), options=options).survey.frame
            except DataError:
                return False
        return ((frame.angle < 1) == in_degrees and frame.sense == 1) == right

    return found


READING = Study(
    name="reading of angles", null=each(24, "unzeroed"), planted=each(16, "clear"), prepare=_read,
    alarm=_reading(True), false_alarm=_reading(False),
)  # fmt: skip
