"""Poses from markers, and the shape of a body that is known by its markers alone: their convex hull.

The pose is the rotation that brings the markers of a reference frame nearest to those of a frame: in a plane the angle
of Σ a_k · conj(b_k) as complex numbers, in space Kabsch's decomposition.  Unless the markers' places in the body are
known, the tracked point is their mean, which is not the centre of mass.

For the hull, markers on the outline or its corners are assumed: the contact point is then the lowest of them.  Markers
further in make a body that is too small, and every contact point is too high by as much, which no recording shows: the
floor's height is free.  Unless the centre of mass is stated, it is that of a hull of uniform density.

Of a body whose shape is stated, markers on its corners show where its axes are: any assignment of markers to corners is
tried.  Two that fit alike are one where the body is symmetric; else the axes are unknown.
Source: Kabsch 1976; Umeyama 1991.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist, pdist
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.frame import Frame, matrices
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.result import RecordedContact
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.track import Mask, Recording, finite
from contactlearn.mechanics.shapes import Polygon, Polytope, Shape, Solid, contact_point


def pose_of_markers(
    markers: Float[Array, "t m d"],
    time: Float[Array, " t"],
    places: Sequence[Sequence[float]] = (),
    *,
    name: str,
    source: str,
    unit: str | None = None,
) -> Recording:
    """Return a recording of poses from markers in a plane or in space.

    Frames in which a marker was lost are lost.  Without known places the tracked point is the mean of the markers, and
    the orientation is zero in the first frame that has all.

    Args:
        markers: in each frame.
        time: of the frames in s.
        places: of the markers in the body about the point that is to be tracked, where they are known.
        name: of the recording.
        source: the file that it came from.
        unit: of length, where the format says so.

    Raises:
        DataError: fewer than two markers (three in space), not as many as places, or no frame with all of them.
    """
    count, dimensions = markers.shape[1:]
    if count < dimensions:
        raise DataError(f"{source}: {name}: a pose needs {dimensions} markers, got {count}")
    if len(places) not in (0, count):
        raise DataError(f"{source}: {name}: has {count} markers, and other recordings {len(places)}")
    seen = finite(markers.reshape(len(markers), -1))
    if not seen.any():
        raise DataError(f"{source}: {name}: no frame has all of the {count} markers")
    centre = markers.mean(1)
    arms = markers - centre[:, None]
    body = np.array(places, dtype=np.float64) if len(places) else arms[int(np.argmax(seen))]
    off = body.mean(0)
    reference = body - off
    R, angle = _rotations(arms, reference, seen)
    quaternion = None
    if angle is None:
        quaternion = np.where(seen[:, None], Rotation.from_matrix(R).as_quat(scalar_first=True), np.nan)
    return Recording(
        name=name,
        source=source,
        time=time,
        position=centre - R @ off,
        angle=angle,
        quaternion=quaternion,
        unit=unit,
        order=None if quaternion is None else "wxyz",
        markers=off + (arms[seen] @ R[seen]).mean(0),
    )


_MOST_CORNERS = 24  # of a body whose corners are compared with markers
_OFF_CORNER = 0.1  # of the body's radius, by which markers are off its corners, as those on its faces are
_OFF_SIDE = 0.25  # of the distance of the nearest two corners, which is the width of a rod; half of it is its axis
_ALIKE = 2.0  # times the least distance, up to which another pose fits as well


def _rotations(
    arms: Float[Array, "t m d"], reference: Float[Array, "m d"], seen: Mask
) -> tuple[Float[Array, "t d d"], Float[Array, " t"] | None]:
    """Rotations that bring the reference nearest to the arms, and in the plane their angles."""
    if arms.shape[2] == 2:
        z, zero = arms[..., 0] + 1j * arms[..., 1], reference[:, 0] + 1j * reference[:, 1]
        angle = np.angle((z * zero.conj()).sum(1))
        R = np.stack((np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)), -1).reshape(-1, 2, 2)
        return R, angle
    U, _, V = np.linalg.svd(np.where(seen[:, None, None], arms, 0.0).transpose(0, 2, 1) @ reference)
    mirror = np.ones((len(arms), 3))
    mirror[:, 2] = np.linalg.det(U @ V)
    return (U * mirror[:, None]) @ V, None


_FLAT = 1e-3  # width of a hull over its length, at least

Centre = str | Sequence[float] | None
"""Of mass: None for that of a uniform hull, "mean" of the markers, or weights of the markers."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerHull:
    """The hull of a body's markers.

    Args:
        shape: about the centre of mass.
        places: of the markers [m, d] in the body about the centre of mass, in the files' unit and axes.
        error: standard error in m of a marker's place along an axis, by the scatter over recordings; 0 of a single one.
    """

    shape: Polygon
    places: Float[Array, "m d"]
    error: float

    def contact_covariance(self, contacts: Sequence[RecordedContact]) -> Float[Array, "n 2 2"]:
        """Covariances of the contact points relative to the centre of mass in m²: by θ's error and the marker's place.

        Which marker is the lowest is taken for certain; where two are equally low the point may be the other one.
        """
        theta = torch.tensor([float(contact.pose[2]) for contact in contacts], dtype=torch.float64)
        r = contact_point(self.shape, theta).numpy()
        across = np.stack((-r[:, 1], r[:, 0]), 1)
        variance = np.array([contact.covariance[8, 8] for contact in contacts])
        return variance[:, None, None] * across[:, :, None] * across[:, None, :] + self.error**2 * np.eye(2)


def hull_of_markers(recordings: Sequence[Recording], frame: Frame, centre: Centre = None) -> MarkerHull:
    """Find the hull of the markers in the plane of motion.

    Args:
        recordings: of one body, whose orientations are relative to the same places of the markers.
        frame: of the recordings.
        centre: of mass.

    Raises:
        DataError: no markers, fewer than three, all on a line, or a centre of mass outside of them.
    """
    places = np.stack([markers_of(recording) for recording in recordings])
    projection = _projection(recordings[0], frame)
    planar = places @ projection.T
    spread = float(np.sqrt(planar.var(0, ddof=1).mean() / len(planar))) if len(planar) > 1 else 0.0
    mean, points = places.mean(0), planar.mean(0)
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:
        corners = points[:0]
    width = np.linalg.svd(points - points.mean(0), compute_uv=False)
    if not len(corners) or width[1] < _FLAT * width[0]:
        raise DataError(f"{recordings[0].source}: the markers are on a line, which is no body; state data.shape")
    middle = _centroid(corners) if centre is None else _weights(centre, len(points)) @ points
    vertices = tuple((float(x), float(y)) for x, y in corners - middle)
    return MarkerHull(shape=Polygon(vertices), places=mean - np.linalg.pinv(projection) @ middle, error=spread)


def places_on_corners(recordings: Sequence[Recording], frame: Frame, shape: Shape) -> Float[Array, "m d"] | None:
    """Return places of markers on a body's corners, in its axes about its centre of mass, in the files' unit.

    None where they are on no corners, or on those that several poses of the body would have.
    """
    if not isinstance(shape, Polygon | Polytope) or recordings[0].markers is None:
        return None
    places = np.mean([one.markers for one in recordings if one.markers is not None], axis=0)
    if isinstance(shape, Solid):
        if (placed := _on_corners(frame.scale * places, shape.corners().numpy())) is None:
            return None
        turned, middle = placed
        return (places - middle / frame.scale) @ turned.T
    projection = _projection(recordings[0], frame)
    if (placed := _on_corners(places @ projection.T, shape.corners().numpy())) is None:
        return None
    return places_turned(recordings, frame, *placed)


def places_turned(
    recordings: Sequence[Recording], frame: Frame, turned: Float[Array, "2 2"], middle: Float[Array, "2"]
) -> Float[Array, "m d"]:
    """Return places of markers in the axes of a body in the plane, to which a matrix turns those of θ as it was read.

    Args:
        recordings: of the body.
        frame: of the recordings.
        turned: from the axes at θ = 0 to the body's.
        middle: of the body in m, about the tracked point in the axes at θ = 0.
    """
    places = np.mean([one.markers for one in recordings if one.markers is not None], axis=0)
    projection = _projection(recordings[0], frame)
    places = places - np.linalg.pinv(projection) @ middle
    if frame.body is None:
        return places @ (np.linalg.inv(projection) @ turned @ projection).T
    x, z = projection.T @ turned[0], frame.body[1]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return places @ np.stack((x, np.cross(z, x), z)).T


def _on_corners(
    markers: Float[Array, "m d"], corners: Float[Array, "v d"]
) -> tuple[Float[Array, "d d"], Float[Array, " d"]] | None:
    """Rotation R and origin c with which R (marker − c) are corners; None if there are none, or several."""
    (count, d), size = markers.shape, float(np.linalg.norm(corners, axis=1).max())
    if not d <= count <= len(corners) <= _MOST_CORNERS:
        return None
    allowed = min(_OFF_CORNER * size, _OFF_SIDE * float(pdist(corners).min()))
    first = [int(np.linalg.norm(markers - markers.mean(0), axis=1).argmax())]
    while len(first) < d:  # markers that are far from each other's line or plane
        away = markers - markers[first[0]]
        for k in first[1:]:
            along = away[k] / np.linalg.norm(away[k])
            away = away - np.outer(away @ along, along)
        first.append(int(np.linalg.norm(away, axis=1).argmax()))
    fits: list[tuple[float, Array, Array]] = []
    for chosen in permutations(range(len(corners)), d):
        turned, middle = _placed(markers[first], corners[[*chosen]])
        if np.abs((markers[first] - middle) @ turned.T - corners[[*chosen]]).max() > 2 * allowed:
            continue
        _, nearest = linear_sum_assignment(cdist((markers - middle) @ turned.T, corners))
        turned, middle = _placed(markers, corners[nearest])
        off = (markers - middle) @ turned.T - corners[nearest]
        fits.append((float(np.sqrt((off**2).sum(1).mean())), turned, middle))
    fits = sorted(fits, key=lambda one: one[0])
    if not fits or fits[0][0] > allowed:
        return None
    least, turned, middle = fits[0]
    outline = corners @ turned + middle
    for off, *other in fits:
        apart = cdist(outline, corners @ other[0] + other[1])
        if off <= _ALIKE * least + 1e-3 * size and apart.min(1).max() > allowed:
            return None
    return turned, middle


def _placed(markers: Float[Array, "m d"], corners: Float[Array, "m d"]) -> tuple[Array, Array]:
    """Rotation R and origin c for which R (marker − c) are nearest to corners."""
    U, _, V = np.linalg.svd((corners - corners.mean(0)).T @ (markers - markers.mean(0)))
    mirror = np.ones(len(U))
    mirror[-1] = np.linalg.det(U @ V)
    R = (U * mirror) @ V
    return R, markers.mean(0) - R.T @ corners.mean(0)


def markers_of(recording: Recording) -> Float[Array, "m d"]:
    """Mean places of a recording's markers in the body.

    Raises:
        DataError: it has none, or fewer than three.
    """
    if recording.markers is None:
        raise DataError(
            f"{recording.source}: data.shape must be given: the contact point is the lowest point of the body's shape, "
            "and without markers (data.columns.markers) nothing else shows it"
        )
    if len(recording.markers) < NEEDED.markers_of_hull:
        raise DataError(
            f"{recording.source}: data.shape must be given: {len(recording.markers)} markers have no hull; "
            f"{NEEDED.markers_of_hull} or more on the body's outline do"
        )
    return recording.markers


def _projection(recording: Recording, frame: Frame) -> Float[Array, "2 d"]:
    """The way from places in the body, in the file's unit and axes, to the body's plane at θ = 0, in m."""
    k = int(np.argmax(recording.seen))
    theta = float(frame.track(recording).pose[k, 2])
    if recording.quaternion is not None:
        R = matrices(recording.quaternion[k : k + 1], frame.order)[0]
    else:
        assert recording.angle is not None
        R = _turned(float(recording.angle[k]))
    return frame.scale * _turned(-theta) @ frame.axes[:2] @ R


def _turned(angle: float) -> Float[Array, "2 2"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array(((c, -s), (s, c)))


def _weights(centre: str | Sequence[float], count: int) -> Float[Array, " m"]:
    if centre == "mean":
        return np.full(count, 1 / count)
    try:
        weights = np.array([float(x) for x in centre])
    except (TypeError, ValueError):
        weights = np.zeros(0)
    if len(weights) != count or not np.isfinite(weights).all() or weights.sum() == 0:
        raise DataError(f"data.centre must be mean, or {count} weights of the markers, got {centre!r}")
    return weights / weights.sum()


def _centroid(corners: Float[Array, "v 2"]) -> Float[Array, "2"]:
    """Of the area inside of corners in order; about the first of them, so that places far away cost no digits."""
    p = corners - corners[0]
    q = np.roll(p, -1, 0)
    share = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    return corners[0] + share @ (p + q) / (3 * share.sum())
