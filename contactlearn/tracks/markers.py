"""Poses from markers: the rotation that brings the markers of a reference frame nearest to those of a frame.

In a plane it is the angle of Σ a_k · conj(b_k) as complex numbers, in space that of Kabsch's decomposition.
The tracked point is the mean of the markers, not the centre of mass.  Source: Kabsch 1976; Umeyama 1991.
"""

import numpy as np
from jaxtyping import Float

from contactlearn.errors import DataError
from contactlearn.tracks.track import Array, Recording, finite


def pose_of_markers(
    markers: Float[Array, "t m d"], time: Float[Array, " t"], *, name: str, source: str, unit: str | None = None
) -> Recording:
    """Return a recording of poses from markers in a plane or in space.

    Frames in which a marker was lost are lost; the orientation is zero in the first frame that has all.

    Raises:
        DataError: fewer than two markers (three in space), or no frame with all of them.
    """
    count, dimensions = markers.shape[1:]
    if count < dimensions:
        raise DataError(f"{source}: {name}: a pose needs {dimensions} markers, got {count}")
    seen = finite(markers.reshape(len(markers), -1))
    if not seen.any():
        raise DataError(f"{source}: {name}: no frame has all of the {count} markers")
    centre = markers.mean(1)
    arms = markers - centre[:, None]
    reference = arms[int(np.argmax(seen))]
    if dimensions == 2:
        z, zero = arms[..., 0] + 1j * arms[..., 1], reference[:, 0] + 1j * reference[:, 1]
        return Recording(
            name=name, source=source, time=time, position=centre, angle=np.angle((z * zero.conj()).sum(1)), unit=unit
        )
    U, _, V = np.linalg.svd(np.where(seen[:, None, None], arms, 0.0).transpose(0, 2, 1) @ reference)
    mirror = np.ones((len(time), 3))
    mirror[:, 2] = np.linalg.det(U @ V)
    R = (U * mirror[:, None]) @ V
    quaternion = np.where(seen[:, None], _quaternion(R), np.nan)
    return Recording(
        name=name, source=source, time=time, position=centre, quaternion=quaternion, unit=unit, order="wxyz"
    )


def _quaternion(R: Float[Array, "t 3 3"]) -> Float[Array, "t 4"]:
    """Quaternions (w, x, y, z) of rotations: the eigenvector of the largest eigenvalue; Bar-Itzhack 2000."""
    K = np.empty((len(R), 4, 4))
    K[:, 0, 0] = np.trace(R, axis1=1, axis2=2)
    vector = np.stack((R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]), -1)
    K[:, 0, 1:] = K[:, 1:, 0] = vector
    K[:, 1:, 1:] = R + R.transpose(0, 2, 1) - K[:, :1, :1] * np.eye(3)
    return np.linalg.eigh(K)[1][:, :, -1]
