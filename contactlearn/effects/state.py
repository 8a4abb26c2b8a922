"""State: what effects see of N impacts, as tensors that carry gradients and leading axes.

`Impacts` are measurements, validated and fixed; a `State` is what a model makes of them.  Effects of
the place `state` change it, and it remembers how to bring a velocity back to what is measured:

    tilt      angle in rad from the world's axes to those of the contact; r, q and v_pre are in the latter
    offset    centre of mass minus the tracked point, m; v_pre is the centre of mass's

`stretch` is what the body is longer by along its own axes than its nominal shape.

Once the law's coefficients are known they are in `mu` and `eps`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn import mechanics
from contactlearn.impacts import Impacts
from contactlearn.shapes import Shape, contact_point

Coefficients = tuple[Float[Tensor, "..."], Float[Tensor, "..."]]
"""(μ, ε), each of a shape that broadcasts against the impacts [..., N]."""

_BARELY = 1e-9  # m/s


@dataclass(frozen=True, eq=False)
class State:
    """Fields as in `Impacts`, [..., N] and [..., N, D] with leading axes, in contact axes."""

    mass: Tensor
    inertia: Tensor
    r: Tensor
    q: Tensor
    v_pre: Tensor
    order: Tensor
    shape: Shape | None = None
    stretch: tuple[Tensor | float, Tensor | float] = (1.0, 1.0)
    tilt: Tensor | None = None
    offset: Tensor | None = None
    mu: Tensor | None = None
    eps: Tensor | None = None

    @classmethod
    def of(cls, impacts: Impacts, rows: Tensor | slice = slice(None)) -> "State":
        """The measured state, of all impacts or of those at `rows` [..., n]."""
        fields = (getattr(impacts, name)[rows] for name in ("mass", "inertia", "r", "q", "v_pre", "order"))
        return cls(*fields, impacts.shape)

    def replace(self, **changes) -> "State":
        """A copy with some fields changed."""
        return replace(self, **changes)

    @property
    def x(self) -> Tensor:
        """Position along the floor, m."""
        return self.q[..., 0]

    @property
    def theta(self) -> Tensor:
        """Orientation against the floor, rad."""
        return self.q[..., 2]

    @property
    def v_t(self) -> Tensor:
        """Slip before contact, m/s."""
        return self.v_c[..., 0]

    @property
    def v_n(self) -> Tensor:
        """Normal velocity of the contact point before contact, m/s; negative on approach."""
        return self.v_c[..., 1]

    @property
    def omega(self) -> Tensor:
        """Spin before contact, rad/s."""
        return self.v_pre[..., 2]

    @cached_property
    def W(self) -> Tensor:
        """Inverse effective inertia at the contact [..., N, 2, 2], 1/kg."""
        return mechanics.inverse_inertia(self.mass, self.inertia, self.r)

    @cached_property
    def v_c(self) -> Tensor:
        """Velocity (v_t, v_n) of the contact point before contact [..., N, 2], m/s."""
        return mechanics.contact_velocity(self.r, self.v_pre)

    @property
    def approach(self) -> Tensor:
        """v_c for a law, which expects an approach: where a changed state has v_n ≥ 0, it barely approaches."""
        return torch.stack((self.v_t, self.v_n.clamp_max(-_BARELY)), -1)

    def v_after(self, wrench: Tensor) -> Tensor:
        """(v_x, v_y, ω) [..., N, 3] after a wrench, in contact axes and of the centre of mass."""
        return mechanics.apply_wrench(self.mass, self.inertia, self.r, self.v_pre, wrench)

    def contact_after(self, wrench: Tensor) -> Tensor:
        """Velocity (v_t, v_n) [..., N, 2] of the contact point after a wrench, m/s."""
        return mechanics.contact_velocity(self.r, self.v_after(wrench))

    def turned(self, angle: Tensor) -> "State":
        """With the orientation changed by `angle` [..., N] in rad and the contact point that goes with it."""
        theta = self.theta + angle
        return self.replace(
            q=columns(*self.q.unbind(-1)[:2], theta), r=self.r + (self.lowest(theta) - self.lowest(self.theta))
        )

    def lowest(self, theta: Tensor) -> Tensor:
        """Contact point [..., N, 2] of the stretched body at orientation θ [..., N], m; the shape must be known."""
        return contact_point(self.shape, theta, self.stretch)

    def as_measured(self, v_post: Tensor) -> Tensor:
        """The velocity of the tracked point in world axes, from that of the centre of mass in contact axes."""
        velocity, spin = v_post[..., :2], v_post[..., 2]
        if self.offset is not None:
            velocity = velocity - spin[..., None] * perpendicular(self.offset)
        if self.tilt is not None:
            velocity = mechanics.rotate(velocity, self.tilt)
        return columns(*velocity.unbind(-1), spin)


def columns(*parts: Tensor) -> Tensor:
    """Parts [..., N], broadcast against each other, side by side along a new last axis."""
    return torch.stack(torch.broadcast_tensors(*parts), -1)


def perpendicular(vector: Tensor) -> Tensor:
    """The vector [..., 2] turned by a right angle: ẑ × it."""
    return torch.stack((-vector[..., 1], vector[..., 0]), -1)
