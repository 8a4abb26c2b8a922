"""The way from a recording in a file's units and axes to a track, with the evidence for it: conventions of the file.

An orientation turns the body's axes into the file's, whatever their sense: a quaternion, whose `order` says where the
scalar is; turns in rad about the file's x, y and z, whose `order` says which comes first; a rotation vector in rad; or
a matrix, row by row.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.poses import Array, conjugate, product
from contactlearn.data.recordings.track import Recording, Track, continuous, rotations
from contactlearn.mechanics.rigid_body import rotation

_LENGTH_TOLERANCE = 1e-3  # by which the length of a quaternion may differ from 1
_FRAME_STRIDE = 8  # frames between two orientations that are compared


ORDERS: dict[int, tuple[str, ...]] = {
    4: ("wxyz", "xyzw"),
    3: ("xyz", "zyx", "xzy", "yxz", "yzx", "zxy", "rotvec"),
    9: ("rows",),
}
"""Readings of an orientation by the number of its columns: a quaternion; turns about x, y and z, or a vector of
rotation; a matrix."""
_REGULAR = 2.0  # times the least change of the spin, up to which turns are read in an order


def scalar_first(columns: Float[Array, "t c"], order: str) -> Float[Array, "t 4"]:
    """Quaternions, scalar first, of orientations as a file has them; those of 4 columns may have any length."""
    if len(order) == 4 and order != "rows":
        return columns if order == "wxyz" else np.roll(columns, 1, axis=1)
    seen = np.isfinite(columns).all(1)
    if order == "rows":
        seen &= rotations(columns)
        R = columns[seen].reshape(-1, 3, 3)
        turned = Rotation.from_matrix(R) if len(R) else Rotation.identity(0)
    elif order == "rotvec":
        turned = Rotation.from_rotvec(columns[seen])
    else:
        turned = Rotation.from_euler(order, columns[seen][:, ["xyz".index(axis) for axis in order]])
    quaternions = np.full((len(columns), 4), np.nan)
    quaternions[seen] = turned.as_quat(scalar_first=True)
    return quaternions


def orders_of(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """The readings of orientations; of three numbers those in which bodies spin most steadily."""
    first = recordings[0].quaternion
    orders = ORDERS[4 if first is None else first.shape[1]]
    if len(orders) < 3:
        return orders
    changes = {order: _unsteadiness(recordings, order) for order in orders}
    return tuple(
        order for order in sorted(orders, key=changes.__getitem__) if changes[order] <= _REGULAR * min(changes.values())
    )[:2]


def _unsteadiness(recordings: Sequence[Recording], order: str) -> float:
    """Median change of the turn from one step of frames to the next, in rad."""
    quaternions = list[Array]()
    for recording in recordings:
        assert recording.quaternion is not None
        R = matrices(recording.quaternion[recording.seen], order)[:: _FRAME_STRIDE // 2]
        turn = Rotation.from_matrix(R[1:] @ R[:-1].transpose(0, 2, 1)).as_rotvec() if len(R) > 2 else np.zeros((0, 3))
        quaternions.append(np.linalg.norm(np.diff(turn, axis=0), axis=1))
    every = np.concatenate(quaternions)
    return float(np.median(every)) if len(every) else 0.0


def matrices(quaternion: Float[Array, "t c"], order: str) -> Float[Array, "t 3 3"]:
    """Rotation matrices of orientations as a file has them; quaternions may have any length."""
    return rotation(torch.from_numpy(np.ascontiguousarray(scalar_first(quaternion, order)))).numpy()


def rotation_axis(recordings: Sequence[Recording], order: str) -> tuple[Float[Array, "3"], float]:
    """Axis, in the file's axes, about which bodies turn, and by how many rad in eight frames when they are fast."""
    scatter, angles = np.zeros((3, 3)), []
    for recording in recordings:
        assert recording.quaternion is not None
        R = matrices(recording.quaternion[recording.seen], order)
        if len(R) <= _FRAME_STRIDE:
            continue
        step = R[_FRAME_STRIDE:] @ R[:-_FRAME_STRIDE].transpose(0, 2, 1)
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
    quaternion: Float[Array, "t c"], order: str, axes: Float[Array, "3 3"], pointer: Float[Array, "3"]
) -> Float[Array, " t"]:
    """Angle in rad of an axis of the body in the plane, from right to up."""
    seen = matrices(quaternion, order) @ pointer
    return np.arctan2(seen @ axes[1], seen @ axes[0])


def tilt(
    quaternion: Float[Array, "t c"], order: str, axes: Float[Array, "3 3"], normal: Float[Array, "3"]
) -> Float[Array, " t"]:
    """Angle in rad between the normal of the plane and that direction in the body."""
    return np.arccos(np.clip(matrices(quaternion, order) @ normal @ axes[2], -1, 1))


@dataclass(frozen=True, kw_only=True)
class Clue:
    """One convention: whether it is stated, or found, or None where it is assumed, and the number that shows it."""

    convention: str
    value: str
    stated: bool | None
    quantity: str
    number: float
    unit: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """The way from a recording to a track.

    Args:
        scale: metres in the file's unit of length.
        axes: rows are right, up and, of recordings in space, away, in the file's axes; right, away and up of a body
            that moves in space.
        order: of a quaternion.
        angle: radians in the file's unit of angle.
        sense: 1, or −1 where rotations turn the other way than the axes say: quaternions turn the world's axes into
            the body's.
        body: of recordings in space, the body's own axes: the one that gives θ, and the one that it turns about.
        folds: how often a file's angle begins again in a turn: twice that of a fitted ellipse.
        clues: of every convention.
    """

    scale: float
    axes: Float[Array, "r d"]
    order: str = "wxyz"
    angle: float = 1.0
    sense: int = 1
    body: Float[Array, "2 3"] | None = None
    folds: int = 1
    clues: tuple[Clue, ...] = ()

    @property
    def in_space(self) -> bool:
        """Whether tracks are of a body that moves in space."""
        return len(self.axes) == 3 and self.body is None

    def track(self, recording: Recording) -> Track:
        """The recording in the plane of motion or in space, in SI units and world axes.

        Raises:
            DataError: a quaternion in space whose length is not 1.
        """
        seen = recording.seen
        position = np.where(seen[:, None], recording.position, np.nan) * self.scale
        if self.in_space:
            pose = np.column_stack((position @ self.axes.T, self._turned(recording)))
            return Track(name=recording.name, time=recording.time, pose=pose)
        planar = position @ self.axes[:2].T
        if recording.quaternion is not None and self.body is not None:
            quaternion = np.where(seen[:, None], recording.quaternion, np.nan)
            angle = planar_angle(quaternion, self.order, self.axes, self.body[0])
            away = position @ self.axes[2]
            out_of_plane = away - (np.nanmedian(away) if seen.any() else 0.0)
            tilted = tilt(quaternion, self.order, self.axes, self.body[1])
        else:
            assert recording.angle is not None
            right, up = self.axes[:, 0]
            turned = 1 if self.axes[0, 0] * self.axes[1, 1] - self.axes[0, 1] * self.axes[1, 0] > 0 else -1
            angle = np.arctan2(up, right) + turned * self.angle * np.where(seen, recording.angle, np.nan)
            out_of_plane = tilted = None
        pose = np.column_stack((planar, self.sense * continuous(angle, recording.time, self.folds)))
        return Track(name=recording.name, time=recording.time, pose=pose, out_of_plane=out_of_plane, tilted=tilted)

    def _turned(self, recording: Recording) -> Float[Array, "t 4"]:
        """Unit quaternions from the body's axes to the world's."""
        assert recording.quaternion is not None
        q = scalar_first(recording.quaternion, self.order)
        length = np.linalg.norm(q, axis=1)
        if (bad := np.flatnonzero(recording.seen & (np.abs(length - 1) > _LENGTH_TOLERANCE))).size:
            raise DataError(
                f"{recording.source}: {recording.name}: frame {bad[0] + 1}: a quaternion must be of length 1, got "
                f"{length[bad[0]]:g}; are its columns mixed up (data.columns.quaternion)?"
            )
        q = np.where(recording.seen[:, None], q / np.maximum(length, 0.5)[:, None], np.nan)
        world = Rotation.from_matrix(self.axes).as_quat(scalar_first=True)
        return product(world, q if self.sense > 0 else conjugate(q))
