"""Simulated recordings of bodies that are thrown onto a floor, with the truth about every contact.

motion   flights, contacts by a law, rest: poses at any instant
camera   a tracker with noise, blur, lost and bad frames, wrong frame rate, axes and order of quaternions
load     impacts from such recordings, by the same way as from real ones
write    the recordings as CSV files
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
import torch

from contactlearn import laws
from contactlearn.data.tracks import Tracked, find_impacts
from contactlearn.data.tracks_synthetic.camera import Camera, TrueContacts, record
from contactlearn.data.tracks_synthetic.motion import Body, throw
from contactlearn.effects import Effect
from contactlearn.errors import UnknownNameError
from contactlearn.impacts import Impacts
from contactlearn.model import ContactModel
from contactlearn.numerics import finite_number, whole
from contactlearn.shapes import Ellipse
from contactlearn.tracks.track import Recording

SEMI_AXES, MASS = (0.035, 0.025), 0.0364  # m, kg: the published ellipse
"""Of the simulated body, an ellipse of uniform density."""
AXES = {
    "plane": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "image": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "y_up": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "z_up": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
"""The tracker's axes in world axes: a plane with y up, an image with y down, a space with y or with z up."""


def load(**settings: Any) -> Impacts:
    """Impacts from simulated recordings of an ellipse; the settings are those of `find`."""
    return find(**settings).impacts


def find(
    size: int = 200,
    folder: str | None = None,
    law: str = "wang_mason",
    mu: float = 0.12,
    eps: float = 0.55,
    drag: float = 0.0,
    rate: float = 250.0,
    noise: float = 5e-5,
    angle_noise: float = math.radians(0.1),
    exposure: float = 0.0,
    lost: float = 0.0,
    bad: float = 0.0,
    skipped: float = 0.0,
    stated_rate: float | None = None,
    axes: str = "plane",
    order: str = "wxyz",
    seed: int = 0,
) -> Tracked:
    """Impacts from simulated recordings of an ellipse, and what was found on the way to them.

    Args:
        size: number of recordings, each of two seconds.
        folder: where they are written; None is outputs/tracks/seed_SEED.
        law: that is true, with its coefficients of friction `mu` and restitution `eps`, and `drag` of the air in 1/s.
        rate: frames a second.
        noise: standard deviation of x and y in m, and `angle_noise` that of θ in rad.
        exposure: s over which a frame is the mean pose.
        lost: share of lost frames.
        bad: share of frames with a gross error.
        skipped: share of recordings that skip frames at the first contact.
        stated_rate: frames a second that the time stamps pretend.
        axes: of the tracker, one of `AXES`.
        order: of quaternions' components.
        seed: of motions and faults.

    Raises:
        DataError: a value out of its range, or see `contactlearn.data.tracks.find_impacts`.
        UnknownNameError: no such law or axes.
    """
    if axes not in AXES:
        raise UnknownNameError("axes of a tracker", axes, AXES)
    camera = Camera(
        rate=finite_number("rate", rate, 20, 1e5),
        frames=round(2 * rate),
        noise=finite_number("noise", noise, 0),
        angle_noise=finite_number("angle_noise", angle_noise, 0),
        exposure=finite_number("exposure", exposure, 0, 1 / rate),
        lost=finite_number("lost", lost, 0, 1),
        bad=finite_number("bad", bad, 0, 1),
        skipped=finite_number("skipped", skipped, 0, 1),
        stated_rate=stated_rate,
        axes=AXES[axes],
        order=order,
    )
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    recordings, _ = simulate(size, camera, law=law, mu=mu, eps=eps, drag=drag, seed=seed)
    place = Path("outputs") / "tracks" / f"seed_{seed}" if folder is None else Path(folder)
    write_recordings(recordings, place)
    return find_impacts(place, mass=MASS, shape=Ellipse(SEMI_AXES))


def simulate(
    size: int,
    camera: Camera = Camera(),
    *,
    law: str = "wang_mason",
    mu: float = 0.12,
    eps: float = 0.55,
    effects: Mapping[str, Effect] = MappingProxyType({}),
    drag: float = 0.0,
    seed: int = 0,
) -> tuple[list[Recording], TrueContacts]:
    """Simulate recordings of ellipses that are thrown onto a floor, and return them with the truth."""
    shape = Ellipse(SEMI_AXES)
    model = ContactModel(laws.find(law).at(mu, eps), effects=dict(effects))
    body = Body(
        shape=shape,
        mass=MASS,
        inertia=MASS * shape.gyration_squared(),
        model=model,
        drag=finite_number("drag", drag, 0),
    )
    motion = throw(body, size, torch.Generator().manual_seed(seed))
    return record(motion, camera, seed)


def write_recordings(recordings: Sequence[Recording], folder: Path) -> None:
    """Write recordings as CSV files of a folder, a file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for recording in recordings:
        names = ("x", "y", "z")[: recording.position.shape[1]]
        columns = {"time": recording.time, **dict(zip(names, recording.position.T, strict=True))}
        rotations = ("theta",) if recording.quaternion is None else ("q1", "q2", "q3", "q4")
        columns |= dict(zip(rotations, recording.rotation.T, strict=True))
        pd.DataFrame(columns).to_csv(folder / f"{recording.name}.csv", index=False, float_format="%.9g")
