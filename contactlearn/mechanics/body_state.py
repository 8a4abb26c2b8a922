"""Bodies about to touch, as a simulation has them: one or many, from plain numbers, arrays or tensors.

    state = BodyState(pose=(0, 0.02, 0.3), velocity=(1, -2, 5), mass=0.05, inertia=1e-5, shape=Disc(0.02))
    after = model.step(state)
    after.velocity, after.flies

Leading axes come before the components, as many as wanted: pose [..., 3].  `Impacts` are measurements instead.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Shape, contact_point

_SIZES = {"pose": 3, "velocity": 3, "mass": 0, "inertia": 0, "order": 0}  # 0 for a single number


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyState:
    """Pose and velocity of the tracked point just before contact, and the body's inertia.

    Args:
        pose: (x, y, θ) [..., 3] in m, m, rad.
        velocity: (v_x, v_y, ω) [..., 3] in m/s, m/s, rad/s.
        mass: in kg, positive.
        inertia: about the mass centre in kg m², positive.
        r: contact point minus tracked point [..., 2] in m, world axes; that of the shape above a level floor if None.
        shape: of the body about the tracked point.
        order: number of impacts of these surfaces so far and this one, of which a drift depends.
        object: name of the body.

    Raises:
        DataError: no numbers, or of another shape.
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
        sizes = _SIZES | ({} if self.r is None else {"r": 2})
        given = {name: self._tensor(name, size) for name, size in sizes.items()}
        try:
            batch = torch.broadcast_shapes(*(x.shape[:-1] if sizes[name] else x.shape for name, x in given.items()))
        except RuntimeError:
            seen = ", ".join(f"{name} {list(x.shape)}" for name, x in given.items())
            raise DataError(f"leading axes of a body's state must broadcast against each other, got {seen}") from None
        for name, x in given.items():
            object.__setattr__(self, name, x.expand(*batch, *x.shape[-1:]) if sizes[name] else x.expand(batch))

    def _tensor(self, name: str, size: int) -> Tensor:
        given = getattr(self, name)
        try:
            value = torch.as_tensor(given, dtype=torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise DataError(f"{name} of a body's state must be numbers, got {given!r}") from None
        if size and (not value.ndim or value.shape[-1] != size):
            raise DataError(f"{name} of a body's state must have {size} components, got shape {list(value.shape)}")
        return value

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
            r = contact_point(self.shape, self.pose[..., 2])
        pose, velocity = self.pose.reshape(-1, 3), self.velocity.reshape(-1, 3)
        mass, inertia, order = (x.reshape(-1) for x in (self.mass, self.inertia, self.order))
        still = torch.zeros_like(velocity)
        return Impacts(
            *(mass, inertia, r.reshape(-1, 2), pose, velocity, still),
            order=order, object=(self.object,) * len(mass), shape=self.shape, source="state of a body",
            validate=validate,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyOutcome:
    """State of the tracked point just after contact.

    Args:
        pose: as before, [..., 3] in m, m, rad.
        velocity: (v_x, v_y, ω) [..., 3] in m/s, m/s, rad/s.
        wrench: (P_t, P_n, τ) [..., 3] in N s, N s, N m s, that takes the body from the velocity before to this one.
        mass_centre: mass centre minus tracked point [..., 2] in m, world axes; None where they are one point.
        covariance: [..., 3, 3] of the velocity; None unless it was asked for.
    """

    pose: Float[Tensor, "*batch 3"]
    velocity: Float[Tensor, "*batch 3"]
    wrench: Float[Tensor, "*batch 3"]
    mass_centre: Float[Tensor, "*batch 2"] | None = None
    covariance: Float[Tensor, "*batch 3 3"] | None = None

    @property
    def flies(self) -> str:
        """The point that flies on a parabola until the next contact."""
        return "tracked point" if self.mass_centre is None else "mass centre"

    @property
    def flying_velocity(self) -> Float[Tensor, "*batch 2"]:
        """Velocity [..., 2] in m/s of the point that flies on a parabola."""
        if self.mass_centre is None:
            return self.velocity[..., :2]
        x, y = self.mass_centre.unbind(-1)
        return self.velocity[..., :2] + self.velocity[..., 2:] * torch.stack((-y, x), -1)

    def reshaped(self, batch: torch.Size) -> Self:
        """Return the outcome with the last leading axis [N] of each part split into others."""
        parts = {name: value for name, value in vars(self).items() if value is not None}
        own = {name: 2 if name == "covariance" else 1 for name in parts}
        shaped = {
            name: value.reshape(*value.shape[: -own[name] - 1], *batch, *value.shape[value.ndim - own[name] :])
            for name, value in parts.items()
        }
        return type(self)(**shaped)
