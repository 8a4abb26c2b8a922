"""Studies of recordings: accepted contacts, reasons of refusal, contacts off the floor."""

import math
from dataclasses import dataclass, replace

import numpy as np

from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.flights import Air, FlightOptions
from contactlearn.data.recordings.floor import find_floor, off_the_floor
from contactlearn.data.recordings.result import Reason, RecordedContact
from contactlearn.data.recordings.track import Recording, Track, continuous
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.simulation.camera import Camera, TrueContacts
from contactlearn.simulation.recordings import SEMI_AXES, simulate
from sensitivity.studies.cases import between
from sensitivity.study import AllThresholds, Study, each

BODY = Ellipse(SEMI_AXES)
CAMERAS = {
    "plain": Camera(),
    "noisy": Camera(noise=5e-4, angle_noise=math.radians(1)),
    "fast": Camera(rate=1000.0, frames=1200, noise=2e-4, angle_noise=math.radians(0.4)),
    "bad": Camera(lost=0.02, bad=0.01),
    "skips": Camera(skipped=0.5),
    "held": Camera(held=0.2, noise=2e-4),
    "gaps": Camera(lost=0.25, bad=0.01),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Recorded:
    """Tracks, the true contacts of them, and the frames a second."""

    tracks: tuple[Track, ...]
    truth: TrueContacts
    rate: float


def flat(recording: Recording) -> Track:
    """The track of a recording that is in world axes and SI units."""
    assert recording.angle is not None
    pose = np.column_stack((recording.position, continuous(recording.angle, recording.time)))
    return Track(name=recording.name, time=recording.time, pose=pose)


def _recorded(kind: str, seed: int) -> Recorded:
    recordings, truth = simulate(12, CAMERAS[kind], seed=seed)
    return Recorded(tracks=tuple(map(flat, recordings)), truth=truth, rate=CAMERAS[kind].rate)


def nearest(truth: TrueContacts, recording: int, time: float) -> int:
    """Number of the true contact of a recording that is nearest in time, −1 where it has none."""
    mine = np.flatnonzero(truth.recording == recording)
    return int(mine[np.abs(truth.time[mine] - time).argmin()]) if len(mine) else -1


def _matched(recorded: Recorded, thresholds: AllThresholds) -> tuple[int, int, int]:
    """Clean contacts, those of them that are found, and accepted ones that are no true contact or miscount frames."""
    truth, clean, found, false = recorded.truth, 0, 0, 0
    for k, track in enumerate(recorded.tracks):
        mine = np.flatnonzero(truth.recording == k)
        sure = {int(j) for j in mine if truth.frames[j].min() > 2 * FlightOptions().narrowest(Air())}
        hits = find_contacts(track, limits=thresholds.tracks).contacts
        right = {
            j for hit in hits
            if (j := nearest(truth, k, hit.time)) >= 0
            and abs(truth.time[j] - hit.time) < 0.5 / recorded.rate and hit.missing == truth.skipped[j]
        }  # fmt: skip
        clean, found, false = clean + len(sure), found + len(sure & right), false + len(hits) - len(right)
    return clean, found, false


def _all_found(recorded: Recorded, thresholds: AllThresholds) -> bool:
    clean, found, _ = _matched(recorded, thresholds)
    return 50 * found >= 49 * clean


CONTACTS = Study(
    name="contacts of recordings", null=each(4, *CAMERAS), planted=each(4, *CAMERAS), prepare=_recorded,
    alarm=_all_found, false_alarm=lambda recorded, thresholds: _matched(recorded, thresholds)[2] > 0,
)  # fmt: skip


def _crafted(kind: str, seed: int) -> Track:
    """A body that is thrown up from the floor and falls back; what it then does is the kind."""
    step, sigma, up = 0.004, between(5e-5, 4e-4, seed), between(1.5, 3, seed + 1)
    time, flight = np.arange(300) * step, 2 * up / GRAVITY
    tau, top = np.minimum(time, flight), up**2 / (2 * GRAVITY)
    x, y = 0.5 * tau, up * tau - GRAVITY / 2 * tau**2
    after = np.maximum(time - flight, 0.0)
    match kind:
        case "slides":
            x = x + between(0.02, 0.3, seed + 2) * after
        case "stands" | "caught":
            height = top * (between(0.01, 0.2, seed + 2) if kind == "stands" else between(0.25, 0.9, seed + 2))
            caught = (up + math.sqrt(up**2 - 2 * GRAVITY * height)) / GRAVITY
            x, y = 0.5 * np.minimum(time, caught), np.where(time < caught, y, height)
        case "lies":
            x, y = np.zeros_like(time), np.zeros_like(time)
        case "jumps" | "grazes":
            late = time >= flight / 2
            slower = between(0.02, 0.2, seed + 2) if kind == "grazes" else 0.0
            x = x + late * (between(0.005, 0.02, seed + 2) * (kind == "jumps") - slower * (tau - flight / 2))
    pose = np.column_stack((x, y, 2.0 * tau))
    pose = pose + np.array((sigma, sigma, 20 * sigma)) * np.random.default_rng(seed).standard_normal(pose.shape)
    return Track(name=kind, time=time, pose=pose)


def _called(reason: Reason):
    def called(track: Track, thresholds: AllThresholds) -> bool:
        refusals = find_contacts(track, limits=thresholds.tracks).refusals
        return any(refusal.reason is reason for refusal in refusals)

    return called


SLIDING = Study(
    name="sliding", null=each(10, "falls", "stands"), planted=each(20, "slides"), prepare=_crafted,
    alarm=_called(Reason.SLIDING),
)  # fmt: skip


def _low(kind: str, seed: int) -> Track:
    """A body in space that slides on its corners, or is carried along over the floor."""
    track = _crafted("slides", seed)
    low, high = (0.0005, 0.008) if kind == "slides" else (0.005, 0.05)
    after = track.time > 2 * between(1.5, 3, seed + 1) / GRAVITY  # the flight of `_crafted`
    return replace(track, low=np.where(after, between(low, high, seed + 3), 0.0))


LYING = Study(
    name="sliding in space", null=each(16, "carried"), planted=each(16, "slides"), prepare=_low,
    alarm=_called(Reason.SLIDING),
)  # fmt: skip
HAND = Study(
    name="hands", null=each(10, "stands", "lies"), planted=each(20, "caught"), prepare=_crafted,
    alarm=_called(Reason.HAND_OR_WALL),
)  # fmt: skip
JUMPS = Study(
    name="jumps of a track", null=each(20, "grazes"), planted=each(20, "jumps"), prepare=_crafted,
    alarm=_called(Reason.LOST_FRAMES),
)  # fmt: skip


def _on_a_floor(kind: str, seed: int) -> list[RecordedContact]:
    """Contacts of a few recordings; a hand strikes the body in the last, or the zero of θ is off in all."""
    recordings, _ = simulate(12, CAMERAS["noisy" if seed % 2 else "plain"], seed=seed)
    hits = [hit for recording in recordings for hit in find_contacts(flat(recording)).contacts]
    match kind:
        case "hand":
            raised = np.array((0.0, between(0.002, 0.02, seed), 0.0))
            last = hits[-1].recording
            return [replace(hit, pose=hit.pose + raised * (hit.recording == last)) for hit in hits]
        case "turned":
            turned = np.array((0.0, 0.0, math.radians(between(1, 4, seed))))
            return [replace(hit, pose=hit.pose + turned) for hit in hits]
    return hits


FLOOR = Study(
    name="contacts off the floor", null=each(16, "floor"), planted=each(16, "hand"), prepare=_on_a_floor,
    alarm=lambda hits, thresholds: bool(
        off_the_floor(hits, BODY, find_floor(hits, BODY, limits=thresholds.tracks), thresholds.tracks)[1]
    ),
)  # fmt: skip


def _zeroed(hits: list[RecordedContact], thresholds: AllThresholds) -> bool:
    """Whether any number of the contacts, from eight on, says that the zero of θ is off."""
    for count in (8, 16, 24, len(hits)):
        zero = find_floor(hits[:count], BODY, limits=thresholds.tracks).orientation
        if zero is not None and abs(zero.value) > 3 * zero.error:
            return True
    return False


ZERO = Study(name="zero of θ", null=each(20, "floor"), planted=each(20, "turned"), prepare=_on_a_floor, alarm=_zeroed)
