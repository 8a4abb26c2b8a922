"""Flights beside a hop that is too short to be seen as one: frames of it are not among their own."""

import numpy as np
import pytest

from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.rigid_body import GRAVITY

NOISE = np.array((5e-4, 5e-4, np.radians(1)))  # of a poor tracker, in which a flight of 12 frames is not seen
RATE, FRAMES = 250.0, 90
FALL = np.array((0.0, GRAVITY, 0.0))


def hopping(seed, hop):
    """A flight, a hop of so many frames, a flight of 20 and another; the last contact, and the velocity before it."""
    rng = np.random.default_rng(seed)
    contacts = (30 + rng.random() + np.array((0.0, hop, hop + 20))) / RATE
    velocities = np.array(
        ((0.5, -1.0, -3.0), (0.45, GRAVITY * hop / RATE / 2, 4.0), (0.42, GRAVITY * 10 / RATE, 2.0), (0.4, 0.5, -3.0))
    )
    time, pose, q = np.arange(FRAMES) / RATE, np.empty((FRAMES, 3)), np.array((0.0, 0.15, 0.0))
    starts, ends = (0.0, *contacts), (*contacts, np.inf)
    for start, end, v in zip(starts, ends, velocities, strict=True):
        flies = (time >= start) & (time < end)
        since = time[flies, None] - start
        pose[flies] = q + v * since - FALL * since**2 / 2
        if np.isfinite(end):
            q = q + v * (end - start) - FALL * (end - start) ** 2 / 2
    pose += NOISE * rng.standard_normal(pose.shape)
    before = velocities[2] - FALL * (contacts[2] - contacts[1])
    return Track(name=str(seed), time=time, pose=pose), contacts[2], before


@pytest.mark.parametrize("hop", [6, 7])
def test_errors_are_those_stated_beside_a_hop_that_is_not_seen(hop):
    """Two flights that do not meet in one contact end there at none: each was cut where they cross, and kept frames."""
    errors = []
    for seed in range(60):
        track, instant, before = hopping(seed, hop)
        hits = [hit for hit in find_contacts(track).contacts if abs(hit.time - instant) < 0.5 / RATE]
        errors += [(hit.v_pre - before) / hit.covariance.diagonal()[:3] ** 0.5 for hit in hits]
    assert len(errors) >= 55
    assert (np.mean(np.square(errors), 0) < 1.6).all()  # 1 is right; 2.5 and 3.9 in y with the frames of the hop
