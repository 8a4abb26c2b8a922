"""Poses from markers: the rotation that brings the markers of a reference frame nearest to those of a frame.

In a plane it is the angle of Σ a_k · conj(b_k) as complex numbers, in space that of Kabsch's decomposition.
Unless the markers' places in the body are known, the tracked point is their mean, which is not the centre of mass.
Source: Kabsch 1976; Umeyama 1991.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.track import Array, Recording, finite


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
    if dimensions == 2:
        z, zero = arms[..., 0] + 1j * arms[..., 1], reference[:, 0] + 1j * reference[:, 1]
        angle, quaternion = np.angle((z * zero.conj()).sum(1)), None
        R = np.stack((np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)), -1).reshape(-1, 2, 2)
    else:
        U, _, V = np.linalg.svd(np.where(seen[:, None, None], arms, 0.0).transpose(0, 2, 1) @ reference)
        mirror = np.ones((len(time), 3))
        mirror[:, 2] = np.linalg.det(U @ V)
        R = (U * mirror[:, None]) @ V
        angle, quaternion = None, np.where(seen[:, None], _quaternion(R), np.nan)
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


def _quaternion(R: Float[Array, "t 3 3"]) -> Float[Array, "t 4"]:
    """Quaternions (w, x, y, z) of rotations: the eigenvector of the largest eigenvalue; Bar-Itzhack 2000."""
    K = np.empty((len(R), 4, 4))
    K[:, 0, 0] = np.trace(R, axis1=1, axis2=2)
    vector = np.stack((R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]), -1)
    K[:, 0, 1:] = K[:, 1:, 0] = vector
    K[:, 1:, 1:] = R + R.transpose(0, 2, 1) - K[:, :1, :1] * np.eye(3)
    return np.linalg.eigh(K)[1][:, :, -1]
