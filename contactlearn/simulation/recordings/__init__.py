"""Simulated recordings of bodies that are thrown onto a floor, with the truth about every contact.

motion   flights, contacts by a law, rest: poses at any instant
camera   a tracker with noise, blur, lost and bad frames, wrong frame rate, axes and order of quaternions
load     impacts from such recordings, by the same way as from real ones
write    the recordings as CSV files
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
import torch

from contactlearn import laws
from contactlearn.core.numerics import finite_number, whole
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import Tracked, find_impacts
from contactlearn.effects import Effect
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation.recordings.camera import AXES, Camera, TrueContacts, camera_of, record
from contactlearn.simulation.recordings.motion import Body, throw

__all__ = ["AXES", "MASS", "SEMI_AXES", "find", "load", "simulate", "write_recordings"]

SEMI_AXES, MASS = (0.035, 0.025), 0.0364  # m, kg: the published ellipse
"""Of the simulated body, an ellipse of uniform density."""


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
    seed: int = 0,
    **camera: Any,
) -> Tracked:
    """Impacts from simulated recordings of an ellipse, and what was found on the way to them.

    Args:
        size: number of recordings, each of two seconds.
        folder: where they are written; None is outputs/tracks/seed_SEED.
        law: that is true, with its coefficients of friction `mu` and restitution `eps`, and `drag` of the air in 1/s.
        seed: of motions and faults.
        camera: settings of `camera_of`.

    Raises:
        DataError: a value out of its range, or see `contactlearn.data.tracks.find_impacts`.
        UnknownNameError: no such law or axes.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    recordings, _ = simulate(size, camera_of(2.0, **camera), law=law, mu=mu, eps=eps, drag=drag, seed=seed)
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
