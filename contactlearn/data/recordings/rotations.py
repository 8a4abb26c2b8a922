"""Quaternions of recordings: the axis that bodies turn about, the angle in a plane, the tilt out of it.

A quaternion turns the body's axes into the file's, whichever way round those go; `order` says where its scalar is.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.track import Array, Recording

_APART = 8  # frames between two orientations that are compared


def matrices(quaternion: Float[Array, "t 4"], order: str) -> Float[Array, "t 3 3"]:
    """Rotation matrices of quaternions of any length."""
    w, x, y, z = (quaternion if order == "wxyz" else np.roll(quaternion, 1, axis=1)).T / np.linalg.norm(
        quaternion, axis=1
    )
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def rotation_axis(recordings: Sequence[Recording], order: str) -> tuple[Float[Array, "3"], float]:
    """Axis, in the file's axes, about which bodies turn, and by how many rad in eight frames when they are fast."""
    scatter, angles = np.zeros((3, 3)), []
    for recording in recordings:
        assert recording.quaternion is not None
        R = matrices(recording.quaternion[recording.seen], order)
        if len(R) <= _APART:
            continue
        step = R[_APART:] @ R[:-_APART].transpose(0, 2, 1)
        vector = np.stack(
            (step[:, 2, 1] - step[:, 1, 2], step[:, 0, 2] - step[:, 2, 0], step[:, 1, 0] - step[:, 0, 1]), -1
        )
        scatter += vector.T @ vector
        angles.append(np.arccos(np.clip((np.trace(step, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    fast = float(np.quantile(np.concatenate(angles), 0.9)) if angles else 0.0
    return np.linalg.eigh(scatter)[1][:, -1], fast


def body_axes(recordings: Sequence[Recording], order: str, normal: Float[Array, "3"]) -> Float[Array, "2 3"]:
    """The body's first axis that lies in the plane, more or less, and the mean direction of the normal in the body."""
    total = np.zeros(3)
    for recording in recordings:
        assert recording.quaternion is not None
        total += (matrices(recording.quaternion[recording.seen], order).transpose(0, 2, 1) @ normal).sum(0)
    mean = total / max(float(np.linalg.norm(total)), 1e-300)
    lies = np.flatnonzero(np.abs(mean) < 0.5)
    return np.stack((np.eye(3)[lies[0] if len(lies) else 0], mean))


def planar_angle(
    quaternion: Float[Array, "t 4"], order: str, axes: Float[Array, "3 3"], pointer: Float[Array, "3"]
) -> Float[Array, " t"]:
    """Angle in rad of an axis of the body in the plane, from right to up."""
    seen = matrices(quaternion, order) @ pointer
    return np.arctan2(seen @ axes[1], seen @ axes[0])


def tilt(
    quaternion: Float[Array, "t 4"], order: str, axes: Float[Array, "3 3"], normal: Float[Array, "3"]
) -> Float[Array, " t"]:
    """Angle in rad between the normal of the plane and that direction in the body."""
    return np.arccos(np.clip(matrices(quaternion, order) @ normal @ axes[2], -1, 1))
