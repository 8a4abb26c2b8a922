"""Tosses of a cube onto a board: impacts of single corners between two free flights, in space.

S. Pfrommer, M. Halm and M. Posa published 570 tosses with ContactNets (CoRL 2020, BSD 3-Clause, repository
DAIRLab/contact-nets); the recordings are no part of this package.  A recording has poses in metres with unit
quaternions (body to world, scalar first), z up, the board at z = 0.

In flight the mass centre falls along a parabola, and the cube, whose moments of inertia are equal, turns about a fixed
axis: the rotation vector from the middle frame is linear in time.  Both are fitted by least squares to the frames
between two contacts.  A contact is taken

    where the lowest corner has a least height between two flights of enough frames that scatter as others do,
    if these meet there, one corner is lowest by a margin, and it is as high as the lowest corners of other contacts.

That height is below 0, for the published cube has sharp corners and the real one round ones.  The scatter of the frames
about all flights gives the covariances of the velocities at contact.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import finite_number, whole
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Cuboid

if TYPE_CHECKING:  # pandas takes long to load
    import pandas as pd

_NAME = "tosses.parquet"
_COLUMNS = ("recording", "time", "x", "y", "z", "qw", "qx", "qy", "qz")
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_LOW = 0.012  # m, height of the lowest corner in a frame next to a contact, at most: a frame's way at 1.8 m/s
_LENGTHS = (12, 8, 6, 5, 4)  # frames of a flight that are fitted; fewer where more scatter, as those near an edge do
_SCATTER = np.array((2.5e-4, 2.5e-3))  # m and rad, of a flight that nothing touches at most: five times the usual
_APART = 0.001  # m, by which the flights of a contact may miss each other
_SUNK = 0.004  # m, by which the height of the corner may differ from the median one
_ALONE = 0.004  # m, by which the second corner is higher at contact, at least
_UPRIGHT = 0.99  # cosine between an axis of the cube and the normal from which on it lies on a face
_ROUNDS = 2  # of the middle pose of a flight

Array = np.ndarray


def load(
    root: str | os.PathLike[str] | None = None,
    mass: float = 0.37,
    inertia: float = 8.1e-4,
    half: float = 0.0524,
    fewest: int = 4,
) -> Impacts:
    """Find the impacts of single corners; a trial is named by its recording and its frame.

    Args:
        root: folder with `cube_tosses/tosses.parquet` or `tosses.parquet`; the environment variable CONTACTLEARN_DATA
            if None.
        mass: as published, kg.
        inertia: about each axis, as published, kg m².
        half: half side, as published, m.
        fewest: frames of a flight, at least.

    Raises:
        DataError: no file, one that cannot be read, quaternions that are not unit or scalar last, or no impact.
    """
    sizes = {"mass": mass, "inertia": inertia, "half": half}
    mass, inertia, half = (finite_number(f"data.{name}", value, 0, above=True) for name, value in sizes.items())
    fewest, path = whole("data.fewest", fewest, 4), _find(root)
    hits = [hit for toss in _tosses(path) for hit in _hits(toss, half, fewest)]
    if not hits:
        raise DataError(f"{path}: no impact of a single corner between two flights; is z up, and the board at z = 0?")
    usual = np.median([hit.height for hit in hits])
    hits = [hit for hit in hits if abs(hit.height - usual) < _SUNK]
    flights = [flight for hit in hits for flight in (hit.before, hit.after)]
    free = np.array([flight.frames - 2 for flight in flights])[:, None]
    typical = np.sqrt((free * np.square([flight.scatter for flight in flights])).sum(0) / free.sum())
    both = ([(hit.time, hit.before) for hit in hits], [(hit.time, hit.after) for hit in hits])
    q, q_post = (_stacked([flight.pose(time) for time, flight in side]) for side in both)
    v_pre, v_post = (_stacked([flight.velocity(time) for time, flight in side]) for side in both)
    variances = (np.array([flight.slope_variance for _, flight in side])[:, None] * np.square(typical) for side in both)
    v_pre_cov, v_post_cov = (torch.diag_embed(torch.from_numpy(np.repeat(one, 3, 1))) for one in variances)
    count = len(hits)
    impacts = Impacts(
        mass=torch.full((count,), mass, dtype=torch.float64),
        inertia=torch.full((count,), inertia, dtype=torch.float64),
        r=_stacked([hit.r for hit in hits]),
        q=q,
        v_pre=v_pre,
        v_post=v_post,
        q_post=q_post,
        v_pre_cov=v_pre_cov,
        v_post_cov=v_post_cov,
        time=torch.tensor([hit.time for hit in hits], dtype=torch.float64),
        trial=tuple(hit.name for hit in hits),
        recording=tuple(hit.toss for hit in hits),
        object=("cube",) * count,
        shape=Cuboid((half, half, half)),
        source=path.name,
        validate=False,
    )
    return impacts[impacts.v_c[:, 2] < 0].replace(order=None, validate=True)


def _stacked(rows: Sequence[Array]) -> torch.Tensor:
    return torch.from_numpy(np.stack(rows))


def _find(root: str | os.PathLike[str] | None) -> Path:
    """Where the recordings lie."""
    folder = root or os.environ.get("CONTACTLEARN_DATA")
    if not folder:
        raise DataError(f"say where {_NAME} lies: data.root=FOLDER, or the environment variable CONTACTLEARN_DATA")
    places = [Path(folder).expanduser() / "cube_tosses" / _NAME, Path(folder).expanduser() / _NAME]
    for place in places:
        if place.is_file():
            return place
    raise DataError(f"no {_NAME} at {places[0]} or {places[1]}; give its folder by data.root=…")


@dataclass(frozen=True, kw_only=True)
class _Toss:
    name: str
    time: Float[Array, " n"]
    position: Float[Array, "n 3"]
    quaternion: Float[Array, "n 4"]


def _tosses(path: Path) -> Iterator[_Toss]:
    import pandas as pd

    try:
        frames = pd.read_parquet(path, columns=list(_COLUMNS))
    except Exception as error:  # a damaged file can break anything
        raise DataError(f"{path}: cannot be read as recordings of {', '.join(_COLUMNS)}: {error}") from error
    length = np.linalg.norm(frames[["qw", "qx", "qy", "qz"]].to_numpy(), axis=1)
    if (bad := np.flatnonzero(~(np.abs(length - 1) < 1e-3))).size:
        place = f"{path}: row {bad[0] + 1}, columns qw, qx, qy, qz"
        raise DataError(f"{place}: must be a quaternion of length 1, got {length[bad[0]]:g}")
    _check_order(path, frames.groupby("recording").last())
    for name, one in frames.groupby("recording", sort=False):
        values = one.to_numpy(float)[:, 1:]
        yield _Toss(name=str(name), time=values[:, 0], position=values[:, 1:4], quaternion=values[:, 4:])


def _check_order(path: Path, last: "pd.DataFrame") -> None:
    """Refuse quaternions with the scalar last: at the end the cube lies on a face."""
    from scipy.spatial.transform import Rotation

    turns = last[["qw", "qx", "qy", "qz"]].to_numpy()
    first, second = (
        float(np.median(np.abs(Rotation.from_quat(turns, scalar_first=order).as_matrix()[:, 2]).max(-1)))
        for order in (True, False)
    )
    if first < _UPRIGHT < second:
        raise DataError(
            f"{path}: the scalar must come first, qw, qx, qy, qz; with it last alone the cube ends on a face "
            f"(cosine {second:.3f} against {first:.3f}); rename the columns"
        )


@dataclass(frozen=True, kw_only=True)
class _Flight:
    """A free flight about its middle time: position, velocity, rotation and spin there, and what the fit leaves.

    `scatter` is the standard deviation of the positions (m) and of the rotation vectors (rad), `slope_variance` that of
    a velocity for a scatter of 1, in 1/s².
    """

    frames: int
    middle: float
    position: Float[Array, "3"]
    linear: Float[Array, "3"]
    rotation: Float[Array, "3 3"]
    spin: Float[Array, "3"]
    scatter: tuple[float, float]
    slope_variance: float

    def at(self, time: float) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        """Position and rotation matrix at a time."""
        from scipy.spatial.transform import Rotation

        t = time - self.middle
        fall = np.array((0, 0, -0.5 * GRAVITY * t**2))
        turned = Rotation.from_rotvec(self.spin * t).as_matrix() @ self.rotation
        return self.position + self.linear * t + fall, turned

    def pose(self, time: float) -> Float[Array, "7"]:
        """Position and quaternion at a time."""
        from scipy.spatial.transform import Rotation

        position, turned = self.at(time)
        return np.concatenate((position, Rotation.from_matrix(turned).as_quat(scalar_first=True)))

    def velocity(self, time: float) -> Float[Array, "6"]:
        """Velocity of the centre and spin at a time."""
        fall = np.array((0, 0, -GRAVITY * (time - self.middle)))
        return np.concatenate((self.linear + fall, self.spin))


def _fitted(toss: _Toss, rows: Array) -> _Flight:
    """The flight through some frames."""
    from scipy.spatial.transform import Rotation

    time = toss.time[rows]
    middle = time.mean()
    t = time - middle
    A = np.stack((np.ones_like(t), t), 1)
    solve = np.linalg.pinv(A)
    rising = toss.position[rows] + np.outer(0.5 * GRAVITY * t**2, (0, 0, 1))
    line = solve @ rising
    turns = Rotation.from_quat(toss.quaternion[rows], scalar_first=True)
    centre = turns[len(rows) // 2]
    vectors = turning = np.zeros((len(t), 3))
    for _ in range(_ROUNDS):
        vectors = (turns * centre.inv()).as_rotvec()
        turning = solve @ vectors
        centre = Rotation.from_rotvec(turning[0]) * centre
    free = 3 * (len(rows) - 2)
    scatter = [float(np.sqrt(np.square(x - A @ y).sum() / free)) for x, y in ((rising, line), (vectors, turning))]
    return _Flight(
        frames=len(rows),
        middle=middle,
        position=line[0],
        linear=line[1],
        rotation=centre.as_matrix(),
        spin=turning[1],
        scatter=(scatter[0], scatter[1]),
        slope_variance=float(1 / np.square(t).sum()),
    )


@dataclass(frozen=True, kw_only=True)
class _Hit:
    name: str
    toss: str
    time: float
    before: _Flight
    after: _Flight
    r: Float[Array, "3"]
    height: float  # of the corner, m


def _hits(toss: _Toss, half: float, fewest: int) -> Iterator[_Hit]:
    """The impacts of a toss."""
    from scipy.spatial.transform import Rotation

    corners = half * Rotation.from_quat(toss.quaternion, scalar_first=True).as_matrix() @ _CORNERS.T
    lowest = toss.position[:, 2] + corners[:, 2].min(-1)
    inner = np.flatnonzero((lowest[1:-1] < lowest[:-2]) & (lowest[1:-1] <= lowest[2:]) & (lowest[1:-1] < _LOW)) + 1
    ends = np.concatenate(((-1,), inner, (len(lowest),)))
    for before, here, after in zip(ends, ends[1:], ends[2:], strict=False):
        hit = _hit(toss, half, (before, here, after), fewest)
        if hit is not None:
            yield hit


def _hit(toss: _Toss, half: float, frames: tuple[int, int, int], fewest: int) -> _Hit | None:
    """The impact about a frame between those of its neighbours, if it is one of a single corner."""
    before, here, after = frames
    first = _free(toss, np.arange(here - 1, before, -1), fewest)
    second = _free(toss, np.arange(here + 1, after), fewest)
    if first is None or second is None:
        return None
    # The instant at which the flights meet, from the components in which their velocities differ.
    time = toss.time[here]
    for _ in range(3):
        gap = second.at(time)[0] - first.at(time)[0]
        change = first.velocity(time)[:3] - second.velocity(time)[:3]
        time = time + float(gap @ change / (change @ change))
    if abs(time - toss.time[here]) > 1.5 * np.diff(toss.time).mean():
        return None
    position, turned = first.at(time)
    corners = half * turned @ _CORNERS.T
    order = np.argsort(corners[2])
    heights = position[2] + corners[2, order[:2]]
    missed = np.linalg.norm(second.at(time)[0] - position)
    if missed > _APART or heights[1] - heights[0] < _ALONE:
        return None
    r, height = corners[:, order[0]], float(heights[0])
    return _Hit(name=f"{toss.name}-{here}", toss=toss.name, time=time, before=first, after=second, r=r, height=height)


def _free(toss: _Toss, rows: Array, fewest: int) -> _Flight | None:
    """The flight through the most frames, the first of which is next to a contact, that scatter as a free one does."""
    for length in (size for size in (len(rows), *_LENGTHS) if fewest <= size <= min(len(rows), _LENGTHS[0])):
        flight = _fitted(toss, np.sort(rows[:length]))
        if (np.array(flight.scatter) <= _SCATTER).all():
            return flight
    return None
