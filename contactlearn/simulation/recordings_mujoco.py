"""Simulated recordings of bodies whose flights, contacts and rest are MuJoCo's, with the truth about every contact.

    mujoco/throws            motion: an ellipse or a box is thrown onto a floor
    recordings/camera  the tracker and its faults

The engine's contacts are soft: they last about `contact_time`, and the body moves while they do.  Flights before and
after meet within that time, in each coordinate at another instant: the instant of a contact is no better known than
to a quarter of it, and v_y, which gravity changes, accordingly.  The search is told of it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from contactlearn.core.numerics import whole
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import Tracked, find_impacts, track_options
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation.mujoco.bench import Bench, Hidden
from contactlearn.simulation.mujoco.throws import bounce
from contactlearn.simulation.recordings import write_recordings
from contactlearn.simulation.recordings.camera import Camera, TrueContacts, camera_of, record


def load(**settings: Any) -> Impacts:
    """Impacts from recordings that MuJoCo simulates; the settings are those of `find`."""
    return find(**settings).impacts


def find(
    size: int = 50,
    folder: str | None = None,
    kind: str = "ellipse",
    semi_axes: Sequence[float] = (0.035, 0.025),
    mass: float = 0.0364,
    mu: float = 0.12,
    eps: float = 0.55,
    contact_time: float = 1e-3,
    tilt: float = 0.0,
    inertia_error: float = 0.0,
    seed: int = 0,
    **camera: Any,
) -> Tracked:
    """Impacts from recordings that MuJoCo simulates, and what was found on the way to them.

    Args:
        size: number of recordings, each of one second.
        folder: where they are written; None is outputs/tracks/mujoco_SEED.
        kind: of body, ellipse or box.
        semi_axes: (a, b) in m along the body's x and y axes; half the sides of a box.
        mass: in kg.
        mu: coefficient of friction.
        eps: restitution of the contact's spring and dashpot, in [0.2, 1].
        contact_time: how long they would take to rebound undamped, in s; in [10⁻⁵, 10⁻³].
        tilt: hidden: the floor is turned counter-clockwise by it, rad.
        inertia_error: hidden: κ; the true inertia is e^κ times the reported one.
        seed: of motions and faults.
        camera: settings of `recordings.camera.camera_of`.

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: a value out of its range, or see `contactlearn.data.tracks.find_impacts`.
        UnknownNameError: no such kind of body, or axes.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    hidden = Hidden(tilt=tilt, inertia_error=inertia_error)
    bench = Bench(kind=kind, semi_axes=semi_axes, mass=mass, mu=mu, eps=eps, contact_time=contact_time, hidden=hidden)
    recordings, _ = record_bounces(size, bench, camera_of(1.0, **camera), seed=seed)
    place = Path("outputs") / "tracks" / f"mujoco_{seed}" if folder is None else Path(folder)
    write_recordings(recordings, place)
    options = track_options(contact_time=bench.contact_time)
    return find_impacts(place, mass=bench.mass, shape=bench.body, options=options)


def record_bounces(size: int, bench: Bench, camera: Camera, *, seed: int = 0) -> tuple[list[Recording], TrueContacts]:
    """Simulate recordings of bodies that are thrown onto a floor, and return them with the truth.

    Raises:
        ContactLearnError: MuJoCo is not installed.
    """
    seconds = (camera.frames + 3) / camera.rate
    return record(bounce(bench, size, seconds, torch.Generator().manual_seed(seed)), camera, seed)
