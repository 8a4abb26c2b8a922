"""Bodies about to touch, as a simulation has them: one or many, from plain numbers, arrays or tensors.

    state = BodyState(pose=(0, 0.02, 0.3), velocity=(1, -2, 5), mass=0.05, inertia=1e-5, shape=Disc(0.02))
    after = model.step(state)
    after.velocity, after.flies

Leading axes come before the components, as many as wanted: pose [..., 3], in space [..., 7].  `Impacts` are
measurements instead.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.mechanics.impacts import UNIT, Impacts
from contactlearn.mechanics.rigid_body import orientation_of, swept
from contactlearn.mechanics.shapes import Shape, contact_point, require_dimension
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyState:
    """Pose and velocity of the tracked point just before contact, and the body's inertia.

    Args:
        pose: (x, y, θ) [..., 3] in m, m, rad, or in space (x, y, z, q_w, q_x, q_y, q_z) [..., 7].
        velocity: (v_x, v_y, ω) [..., 3] in m/s, m/s, rad/s, or in space (v_x, v_y, v_z, ω_x, ω_y, ω_z) [..., 6].
        mass: in kg, positive.
        inertia: about the mass centre in kg m², positive; in space of all axes, or principal moments [..., 3].
        r: contact point minus tracked point [..., d] in m, world axes; that of the shape above a level floor if None.
        shape: of the body about the tracked point.
        order: number of impacts of these surfaces so far and this one, of which a drift depends.
        object: name of the body.

    Raises:
        DataError: no numbers, of another shape, a quaternion that is not of length 1, or a shape of the other space.
    """

    pose: Any
    velocity: Any
    mass: Any
    inertia: Any
    r: Any = None
    shape: Shape | None = None
    order: Any = 1.0
    object: str = "body"

    def __post_init__(self) -> None:
        pose, moments = self._numbers("pose"), self._numbers("inertia")
        sizes = {"pose": pose.shape[-1] if pose.ndim else 0, "velocity": 3, "mass": 0, "inertia": 0, "order": 0}
        space = next((one for one in BOTH if len(one.pose) == sizes["pose"]), None)
        if space is None:
            raise DataError(f"pose of a body's state must have 3 components, or 7 in space, got {list(pose.shape)}")
        sizes |= {"velocity": space.D, "inertia": 3 if space is SPACE else 0} | (
            {} if self.r is None else {"r": space.d}
        )
        if space is SPACE and not moments.ndim:
            object.__setattr__(self, "inertia", moments.expand(3))
        given = {name: self._tensor(name, size) for name, size in sizes.items()}
        try:
            batch = np.broadcast_shapes(*(x.shape[:-1] if sizes[name] else x.shape for name, x in given.items()))
        except ValueError:
            seen = ", ".join(f"{name} {list(x.shape)}" for name, x in given.items())
            raise DataError(f"leading axes of a body's state must broadcast against each other, got {seen}") from None
        for name, x in given.items():
            object.__setattr__(self, name, x.expand(*batch, *x.shape[-1:]) if sizes[name] else x.expand(batch))
        if space is SPACE and (wrong := (length := self.pose[..., 3:].norm(dim=-1)).sub(1).abs() > UNIT).any():
            raise DataError(
                "the quaternion (q_w, q_x, q_y, q_z) of a pose (x, y, z, q_w, q_x, q_y, q_z) must be of length 1, got "
                f"{length[wrong][0].item():g}"
            )
        require_dimension("state of a body", self.shape, space)

    def _numbers(self, name: str) -> Tensor:
        given = getattr(self, name)
        try:
            if isinstance(given, list | tuple) and any(isinstance(part, Tensor) for part in given):
                given = torch.stack(torch.broadcast_tensors(*(torch.as_tensor(x, dtype=torch.float64) for x in given)))
            return torch.as_tensor(given, dtype=torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise DataError(f"{name} of a body's state must be numbers, got {given!r}") from None

    def _tensor(self, name: str, size: int) -> Tensor:
        value = self._numbers(name)
        if size and (not value.ndim or value.shape[-1] != size):
            raise DataError(f"{name} of a body's state must have {size} components, got shape {list(value.shape)}")
        return value

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return PLANE if self.pose.shape[-1] == 3 else SPACE

    @property
    def batch(self) -> torch.Size:
        """Leading axes; empty for one state."""
        return self.mass.shape

    def repeated(self, count: int) -> "BodyState":
        """Return the states `count` times along a new first axis."""
        return replace(self, pose=self.pose.expand(count, *self.pose.shape))

    def as_impacts(self, *, validate: bool = True) -> Impacts:
        """Return the states as N impacts without an outcome: their `v_post` is 0 and means nothing.

        With `validate=False` the contact points need not approach.

        Raises:
            DataError: the contact point is not known, does not approach, or a number is impossible.
        """
        r = self.r
        if r is None:
            if self.shape is None:
                raise DataError("a body's state needs its contact point r, or its shape, such as shape=Disc(0.02)")
            r = contact_point(self.shape, orientation_of(self.pose))
        mass, inertia, r, pose, velocity, order = map(
            self.flat, (self.mass, self.inertia, r, self.pose, self.velocity, self.order)
        )
        return Impacts(
            *(mass, inertia, r, pose, velocity, torch.zeros_like(velocity)),
            order=order, object=(self.object,) * len(mass), shape=self.shape, source="state of a body",
            validate=validate,
        )  # fmt: skip

    def flat(self, value: Tensor) -> Tensor:
        """Return a value of each state with one leading axis [N]."""
        return value.reshape(self.batch.numel(), *value.shape[len(self.batch) :])


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyOutcome:
    """State of the tracked point just after contact.

    Args:
        pose: as before, [..., 3] in m, m, rad, or [..., 7].
        velocity: [..., D] in m/s and rad/s.
        wrench: [..., D] in N s and N m s, that takes the body from the velocity before to this one.
        mass_centre: mass centre minus tracked point [..., d] in m, world axes; None where they are one point.
        covariance: [..., D, D] of the velocity; None unless it was asked for.
    """

    pose: Float[Tensor, "*batch pose"]
    velocity: Float[Tensor, "*batch D"]
    wrench: Float[Tensor, "*batch D"]
    mass_centre: Float[Tensor, "*batch d"] | None = None
    covariance: Float[Tensor, "*batch D D"] | None = None

    @property
    def flies(self) -> str:
        """The point that flies on a parabola until the next contact."""
        return "tracked point" if self.mass_centre is None else "mass centre"

    @property
    def flying_velocity(self) -> Float[Tensor, "*batch d"]:
        """Velocity [..., d] in m/s of the point that flies on a parabola."""
        d = self.velocity.shape[-1] // 3 + 1
        velocity, spin = self.velocity[..., :d], self.velocity[..., d:]
        return velocity if self.mass_centre is None else velocity + swept(self.mass_centre, spin)

    def reshaped(self, batch: torch.Size) -> Self:
        """Return the outcome with the last leading axis [N] of each part split into others."""
        parts = {name: value for name, value in vars(self).items() if value is not None}
        own = {name: 2 if name == "covariance" else 1 for name in parts}
        shaped = {
            name: value.reshape(*value.shape[: -own[name] - 1], *batch, *value.shape[value.ndim - own[name] :])
            for name, value in parts.items()
        }
        return type(self)(**shaped)
