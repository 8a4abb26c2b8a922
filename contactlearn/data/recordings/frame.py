"""The way from a recording in a file's units and axes to a track in the plane of motion, with the evidence for it."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.flight import Air
from contactlearn.data.recordings.rotations import planar_angle, tilt
from contactlearn.data.recordings.track import Array, Recording, Track, continuous
from contactlearn.mechanics.apparatus import Measured
from contactlearn.mechanics.rigid_body import GRAVITY


@dataclass(frozen=True, kw_only=True)
class Clue:
    """One convention: where it comes from, and the number that shows it."""

    convention: str
    value: str
    stated: bool
    quantity: str
    number: float
    unit: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """The way from a recording to a track.

    Args:
        scale: metres in the file's unit of length.
        axes: rows are right, up and, in space, away, in the file's axes.
        order: of a quaternion.
        angle: radians in the file's unit of angle.
        sense: 1, or −1 where rotations turn the other way than the axes say.
        body: in space, the body's own axes: the one that gives θ, and the one that it turns about.
        gravity: in the plane, (g_x, g_y) in m/s², and its error.
        drag: linear drag of the air in 1/s, and its error.
        clues: of every convention.
    """

    scale: float
    axes: Float[Array, "r d"]
    order: str = "wxyz"
    angle: float = 1.0
    sense: int = 1
    body: Float[Array, "2 3"] | None = None
    gravity: tuple[float, float] = (0.0, -GRAVITY)
    gravity_error: float = 0.0
    drag: float = 0.0
    drag_error: float = 0.0
    clues: tuple[Clue, ...] = ()

    @property
    def air(self) -> Air:
        """Free flight with 9.81 m/s² in the measured direction."""
        size = np.hypot(*self.gravity)
        return Air(gravity=(self.gravity[0] / size * GRAVITY, self.gravity[1] / size * GRAVITY), drag=self.drag)

    @property
    def lean(self) -> Measured:
        """Angle in rad of gravity from straight down to the right."""
        g_x, g_y = self.gravity
        return Measured(value=math.atan2(g_x, -g_y), error=self.gravity_error / math.hypot(g_x, g_y))

    def track(self, recording: Recording) -> Track:
        """The recording in the plane of motion, in SI units and world axes."""
        seen = recording.seen
        position = np.where(seen[:, None], recording.position, np.nan) * self.scale
        planar = position @ self.axes[:2].T
        if recording.quaternion is not None and self.body is not None:
            quaternion = np.where(seen[:, None], recording.quaternion, np.nan)
            angle = planar_angle(quaternion, self.order, self.axes, self.body[0])
            away = position @ self.axes[2]
            apart = away - (np.nanmedian(away) if seen.any() else 0.0)
            tilted = tilt(quaternion, self.order, self.axes, self.body[1])
        else:
            assert recording.angle is not None
            right, up = self.axes[:, 0]
            turned = 1 if self.axes[0, 0] * self.axes[1, 1] - self.axes[0, 1] * self.axes[1, 0] > 0 else -1
            angle = np.arctan2(up, right) + turned * self.angle * np.where(seen, recording.angle, np.nan)
            apart = tilted = np.zeros(len(recording))
        pose = np.column_stack((planar, self.sense * continuous(angle, recording.time)))
        return Track(name=recording.name, time=recording.time, pose=pose, apart=apart, tilted=tilted)
