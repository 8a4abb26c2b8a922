"""A tracker that follows moving bodies, with the faults of real ones, and the truth about every contact."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import finite_number
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.track import Recording

AXES = {
    "plane": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "image": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "y_up": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "z_up": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
"""The tracker's axes in world axes: a plane with y up, an image with y down, a space with y or with z up."""
_BLUR = 9  # instants of an exposure
_SPIKE = 30.0  # standard deviations of a bad frame, at least; up to twice that


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A tracker and its faults, all off but the noise.

    Args:
        rate: frames a second.
        frames: of a recording.
        noise: standard deviation of x and y in m.
        angle_noise: standard deviation of θ in rad, about any axis in space.
        held: s for which a hand holds the body still before it is thrown.
        exposure: s over which a frame is the mean pose.
        lost: share of frames that are marked as lost.
        bad: share of frames with a gross error.
        lasting: s over which a contact changes the velocity, steadily.
        skipped: share of recordings that skip one or two frames at the first contact without a gap in their times.
        stated_rate: frames a second that the time stamps pretend; `rate` if None.
        length: the file's units of length in a metre, 1000 for mm.
        degrees: whether an angle in the plane is in degrees.
        wrapped: whether it is brought to one turn.
        axes: one of `AXES`, or the file's axes in world axes (right, up, away) as rows [2 or 3][3]; in space a
            quaternion is recorded.
        order: of the quaternion's components, wxyz or xyzw.

    Raises:
        DataError: a value out of its range.
        UnknownNameError: no such axes.
    """

    rate: float = 250.0
    frames: int = 500
    noise: float = 5e-5
    angle_noise: float = math.radians(0.1)
    held: float = 0.0
    exposure: float = 0.0
    lost: float = 0.0
    bad: float = 0.0
    lasting: float = 0.0
    skipped: float = 0.0
    stated_rate: float | None = None
    length: float = 1.0
    degrees: bool = False
    wrapped: bool = True
    axes: str | Sequence[Sequence[float]] = "plane"
    order: str = "wxyz"

    def __post_init__(self) -> None:
        rate = finite_number("rate", self.rate, 20, 1e5)
        limits = {"noise": math.inf, "angle_noise": math.inf, "exposure": 1 / rate, "lost": 1, "bad": 1, "skipped": 1}
        for name, high in limits.items():
            finite_number(name, getattr(self, name), 0, high)
        if isinstance(self.axes, str) and self.axes not in AXES:
            raise UnknownNameError("axes of a tracker", self.axes, AXES)
        if self.order not in ("wxyz", "xyzw"):
            raise DataError(f"order must be wxyz or xyzw, got {self.order!r}")

    @property
    def world_axes(self) -> Float[Array, "d 3"]:
        """The file's axes in world axes, as rows."""
        return np.asarray(AXES[self.axes] if isinstance(self.axes, str) else self.axes, dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """Flights of N bodies, K each at most; where a body has fewer, its `start` is infinite.

    Args:
        start: [N, K] instants in s at which a flight and the one before it meet; that of the first is 0.
        q: poses [N, K, 3] at the start.
        v: velocities [N, K, 3] at the start.
        v_before: velocities [N, K, 3] before the contact that the flight starts with.
        rests: [N] instants in s from when on a body stays on the floor; infinite where it still flies.
        poses: poses [N, T, 3] of the bodies at instants [N, T] of their own.
    """

    start: Float[Tensor, "n k"]
    q: Float[Tensor, "n k 3"]
    v: Float[Tensor, "n k 3"]
    v_before: Float[Tensor, "n k 3"]
    rests: Float[Tensor, " n"]
    poses: Callable[[Tensor], Tensor]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrueContacts:
    """Every contact of every recording that ends before it does.

    Args:
        recording: [C] index of the recording.
        time: [C] s, in the recording's time, of an honest frame rate.
        q: pose [C, 3] at contact, θ in [−π, π).
        v_pre: velocity [C, 3] before contact.
        v_post: velocity [C, 3] after it.
        frames: [C, 2] frames of the flights before and after it.
        skipped: [C] frames that the recording skips there.
    """

    recording: Int[np.ndarray, " c"]
    time: Float[Array, " c"]
    q: Float[Array, "c 3"]
    v_pre: Float[Array, "c 3"]
    v_post: Float[Array, "c 3"]
    frames: Int[np.ndarray, "c 2"]
    skipped: Int[np.ndarray, " c"]


def record(motion: Motion, camera: Camera, seed: int) -> tuple[list[Recording], TrueContacts]:
    """Record the motions, each from a random phase of the frames."""
    rng = np.random.default_rng(seed)
    count, step = len(motion.start), 1 / camera.rate
    clock = (np.arange(camera.frames) - rng.random((count, 1))) * step - camera.held + step
    first = motion.start[:, 1].numpy()
    skips = rng.integers(1, 3, count) * (rng.random(count) < camera.skipped) * np.isfinite(first)
    late = clock > first[:, None]
    clock = clock + late * skips[:, None] * step
    offsets = np.linspace(-0.5, 0.5, _BLUR) * camera.exposure if camera.exposure else np.zeros(1)
    pose = np.mean([_poses(motion, np.maximum(clock + dt, 0.0), camera.lasting) for dt in offsets], 0)
    sigma = np.array((camera.noise, camera.noise, camera.angle_noise))
    pose = pose + sigma * rng.standard_normal(pose.shape)
    bad = rng.random(clock.shape) < camera.bad
    gross = rng.uniform(1, 2, pose.shape) * np.sign(rng.standard_normal(pose.shape))
    pose = pose + bad[..., None] * gross * _SPIKE * sigma
    pose[rng.random(clock.shape) < camera.lost] = np.nan
    time = np.arange(camera.frames) / (camera.stated_rate or camera.rate)
    recordings = [_recording(f"{k + 1:04d}", time, poses, camera, rng) for k, poses in enumerate(pose)]
    return recordings, _truth(motion, clock, skips)


def _poses(motion: Motion, clock: Array, lasting: float) -> Float[Array, "n t 3"]:
    """Poses of bodies whose contacts last: apart from the flights by Δv (T/2 − |τ|)² / 2T."""
    poses = motion.poses(torch.from_numpy(clock)).numpy()
    for k in range(1, motion.start.shape[1] if lasting else 0):
        tau = np.abs(clock - motion.start[:, k, None].numpy())
        inside, change = np.maximum(lasting / 2 - tau, 0.0), (motion.v - motion.v_before)[:, k].numpy()
        poses = poses + (inside**2)[..., None] / (2 * lasting) * change[:, None]
    return poses


def _truth(motion: Motion, clock: Array, skips: np.ndarray) -> TrueContacts:
    starts = motion.start.numpy()
    ends = np.concatenate((starts[:, 1:], np.full((len(starts), 1), np.inf)), 1)
    ends = np.minimum(np.where(np.isfinite(starts), ends, np.inf), motion.rests.numpy()[:, None])
    inside = (clock[:, None] > starts[..., None]) & (clock[:, None] < ends[..., None])
    frames = inside.sum(-1)
    there = np.isfinite(starts) & (starts < clock[:, -1:])
    there[:, 0] = False
    rows, columns = np.nonzero(there)
    q, v, v_before = (part.numpy()[rows, columns] for part in (motion.q, motion.v, motion.v_before))
    q[:, 2] = (q[:, 2] + np.pi) % (2 * np.pi) - np.pi
    skipped = np.where(columns == 1, skips[rows], 0)
    earlier = np.where(columns > 1, skips[rows], 0) * (clock[0, 1] - clock[0, 0])
    return TrueContacts(
        recording=rows,
        time=starts[rows, columns] - clock[rows, 0] - earlier,
        q=q,
        v_pre=v_before,
        v_post=v,
        frames=np.stack((frames[rows, columns - 1], frames[rows, columns]), -1),
        skipped=skipped,
    )


def _recording(name: str, time: Array, pose: Array, camera: Camera, rng: np.random.Generator) -> Recording:
    axes = camera.world_axes
    source = f"{name}.csv"
    if len(axes) == 2:
        flipped = np.linalg.det(axes[:, :2]) < 0  # angles are counted from the first axis to the second
        zero = math.atan2(axes[0, 1], axes[0, 0])
        angle = (pose[:, 2] - zero) * (-1 if flipped else 1)
        angle = (angle + np.pi) % (2 * np.pi) - np.pi if camera.wrapped else angle
        position = pose[:, :2] @ axes[:, :2].T * camera.length
        return Recording(
            name=name, source=source, time=time, position=position, angle=np.degrees(angle) if camera.degrees else angle
        )
    away = np.where(np.isnan(pose[:, 0]), np.nan, rng.normal(0, camera.noise, len(pose)))
    position = np.column_stack((pose[:, :2], away)) @ axes.T * camera.length
    wobble = rng.normal(0, camera.angle_noise / 2, (len(pose), 2))
    half = pose[:, 2] / 2
    vector = np.column_stack((wobble * np.cos(half)[:, None], np.sin(half))) @ axes.T * np.linalg.det(axes)
    quaternion = np.column_stack((np.cos(half), vector))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    quaternion = quaternion if camera.order == "wxyz" else np.roll(quaternion, -1, axis=1)
    return Recording(name=name, source=source, time=time, position=position, quaternion=quaternion)
