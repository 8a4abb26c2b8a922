"""The published drops: a planar ellipse onto a flat floor, the measurements behind Fazeli et al. (2017).

2000 drops between two glass sheets, tracked by cameras at 250 Hz; the 1718 with all six integrity
flags zero are the paper's.  The file is public (github.com/DAIRLab/ImpactModeling, BSD 3-Clause) and
is not part of this package: it is found where you say, or downloaded once.

It is imported as published.  n = [0, 1, r_x] and d = [1, 0, d₃] are the published rows of the contact
Jacobian, so r = (r_x, −d₃), although the ellipse's own contact point differs from it by some 0.3 mm.
The moment of inertia is not published, so it is a named option:

    uniform_disc   I = m (a² + b²) / 4   a uniform elliptical disc
    fazeli2017     I = m (a² + b²) / 5   as the paper's authors used

Gravity acts between both measured states.  The paper does not say whether it is removed; `free_fall` removes it.
"""

import hashlib
import io
import os
from pathlib import Path
from textwrap import shorten

import numpy as np
import torch

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import finite_number
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Ellipse

URL = "https://raw.githubusercontent.com/DAIRLab/ImpactModeling/master/Wang/Compare%20Wang/ellipse_uniform.mat"
SHA256 = "fafcb329cca4325659ca384bc9a3f43057608f21a178d37e45eefd6032ddf224"
MASS = 0.0364
"""kg"""
SEMI_AXES = (0.035, 0.025)
"""m"""
INERTIAS = {"uniform_disc": 1 / 4, "fazeli2017": 1 / 5}
"""I / (m (a² + b²)) by name."""

_NAME = "ellipse_uniform.mat"
_WIDTHS = {"states": 12, "n": 3, "d": 3, "flags": 6}


def load(
    root: str | os.PathLike[str] | None = None,
    inertia: str = "uniform_disc",
    flagged: bool = False,
    free_fall: float = 0.0,
) -> Impacts:
    """The drops as published; a trial is named by its place (from 1) among the 2000.

    Args:
        root: folder that holds `ellipse_drops/ellipse_uniform.mat` or `ellipse_uniform.mat`; by
            default the environment variable CONTACTLEARN_DATA, and where that is not set the file
            is downloaded once into the user's cache.
        inertia: a name in `INERTIAS`.
        flagged: also the 282 drops that carry an integrity flag.
        free_fall: time in s between both measured states during which gravity acts: g times it is added to v_y after
            contact.

    Raises:
        DataError: no file under the given root, no network, a file that is not the published one, or a negative free
            fall.
        UnknownNameError: no such inertia.
    """
    if inertia not in INERTIAS:
        raise UnknownNameError("inertia", inertia, INERTIAS)
    fall = torch.tensor((0.0, GRAVITY * finite_number("free_fall", free_fall, 0), 0.0), dtype=torch.float64)
    path = find(root)
    drops = _read(path)
    keep = np.arange(len(drops["states"])) if flagged else np.flatnonzero(~drops["flags"].any(1))
    states = torch.from_numpy(drops["states"][keep])
    q, v_pre, q_post, v_post = states.reshape(-1, 4, 3).unbind(1)
    mass = torch.full((len(keep),), MASS, dtype=torch.float64)
    return Impacts(
        mass=mass,
        inertia=INERTIAS[inertia] * mass * (SEMI_AXES[0] ** 2 + SEMI_AXES[1] ** 2),
        r=torch.from_numpy(np.stack((drops["n"][keep, 2], -drops["d"][keep, 2]), -1)),
        q=q,
        v_pre=v_pre,
        v_post=v_post + fall,
        q_post=q_post,
        trial=tuple(str(place + 1) for place in keep),
        object=("ellipse",) * len(keep),
        shape=Ellipse(SEMI_AXES),
        source=path.name,
    )


def find(root: str | os.PathLike[str] | None = None) -> Path:
    """Where the .mat lies: under `root` or CONTACTLEARN_DATA if either is given, else in the cache."""
    root = root or os.environ.get("CONTACTLEARN_DATA")
    if not root:
        return _download()
    places = [Path(root).expanduser() / "ellipse_drops" / _NAME, Path(root).expanduser() / _NAME]
    for place in places:
        if place.is_file():
            return place
    raise DataError(
        f"no {_NAME} at {places[0]} or {places[1]}; put it there, or leave both root and "
        f"CONTACTLEARN_DATA unset to download it"
    )


def _download() -> Path:
    import pooch

    cache = pooch.os_cache("contactlearn")
    try:
        return Path(pooch.retrieve(URL, known_hash=f"sha256:{SHA256}", fname=_NAME, path=cache))
    except (OSError, ValueError) as error:  # the network and the disk; another checksum
        reason = f"{type(error).__name__}: {shorten(str(error), 160)}"
        raise DataError(
            f"{_NAME} could not be downloaded to {cache} ({reason}); check the network, or fetch {URL} by hand and "
            f"set root or CONTACTLEARN_DATA to its folder"
        ) from error


def _read(path: Path) -> dict[str, np.ndarray]:
    """The fields of the struct array by name, [2000, width]; the file's bytes are checked first."""
    from scipy.io import loadmat

    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    seen = hashlib.sha256(content).hexdigest()
    if seen != SHA256:
        raise DataError(
            f"{path}: is not the published file: sha256 must be {SHA256}, got {seen} ({len(content)} bytes, "
            f"published 264701); it is truncated or changed: fetch it again from {URL}"
        )
    try:
        array = loadmat(io.BytesIO(content), variable_names=["bounce_array"])["bounce_array"].ravel()
        drops = {name: np.stack([drop.reshape(width) for drop in array[name]]) for name, width in _WIDTHS.items()}
        return drops | {name: drops[name].astype(np.float64) for name in ("states", "n", "d")}
    except Exception as error:  # whatever SciPy's parser trips over in a broken file
        raise DataError(
            f"{path}: cannot be parsed as the published bounce_array ({type(error).__name__}: {error}); "
            f"it is truncated: fetch it again from {URL}"
        ) from error
