"""State: the impacts as effects see them, tensors that carry gradients and leading axes.

`Impacts` are measurements, validated and fixed; a model derives a `State` from them.  Effects of
the place `state` change it, and it keeps the changes of frame, so that a velocity can be brought back to measured axes:

    tilt      angle in rad from the world's axes to those of the contact; r, q and v_pre are in the latter; in space the
              matrix [..., 3, 3] from axes of the contact to the world's
    offset    centre of mass minus the tracked point, m; v_pre is the centre of mass's

`stretch` is the factor on the body's nominal shape along its own axes, `corner` the radius of its corners in m.
`body` is a number for the name of each trial's object (`mechanics.bodies`), which selects its shape, and `covariates`
has the numbers of further quantities by name (`Impacts.covariate_codes`); a state that no table is behind has none.

Once the law's coefficients are known they are in `mu` and `eps`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.bodies import AnyShape, per_body
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import contact_point
from contactlearn.mechanics.space import PLANE, SPACE, Space

Coefficients = tuple[Float[Tensor, "..."], Float[Tensor, "..."]]
"""(μ, ε), each of a shape that broadcasts against the impacts [..., N]."""

_BARELY = 1e-9  # m/s
_CENTRED = 1e-24  # squared lever below which a contact point lies under the mass centre
_MEASURED = ("mass", "inertia", "r", "q", "v_pre", "order")


@dataclass(frozen=True, eq=False)
class State:
    """Fields as in `Impacts`, [..., N] and [..., N, D] with leading axes, in contact axes."""

    mass: Float[Tensor, "*#batch n"]
    inertia: Float[Tensor, "..."]
    r: Float[Tensor, "*#batch n d"]
    q: Float[Tensor, "*#batch n pose"]
    v_pre: Float[Tensor, "*#batch n D"]
    order: Float[Tensor, "*#batch n"]
    shape: AnyShape | None = None
    stretch: tuple[Tensor | float, ...] = (1.0, 1.0, 1.0)
    tilt: Float[Tensor, "..."] | None = None
    offset: Float[Tensor, "... d"] | None = None
    mu: Float[Tensor, "..."] | None = None
    eps: Float[Tensor, "..."] | None = None
    corner: Tensor | float = 0.0
    body: Int[Tensor, "*#batch n"] | None = None
    covariates: Mapping[str, Float[Tensor, "*#batch n"]] = field(default_factory=dict)

    @classmethod
    def of(cls, impacts: Impacts, rows: Int[Tensor, "... n"] | slice = slice(None)) -> "State":
        """Return the measured state of all impacts, or of those at `rows` [..., n]."""
        mass, inertia, r, q, v_pre, order = (getattr(impacts, name)[rows] for name in _MEASURED)
        covariates = {name: values[rows] for name, values in impacts.covariate_codes.items()}
        return cls(mass, inertia, r, q, v_pre, order, impacts.shape, body=impacts.body[rows], covariates=covariates)

    def __getitem__(self, which: Tensor | slice | tuple[slice, slice]) -> "State":
        """Return the measured state of some of the trials, or of some of the leading axes."""
        covariates = {name: values[which] for name, values in self.covariates.items()}
        return self.replace(
            **{name: getattr(self, name)[which] for name in (*_MEASURED, "body")}, covariates=covariates
        )

    def replace(self, **changes: Any) -> "State":
        """Return a copy with some fields changed."""
        return replace(self, **changes)

    @property
    def coefficients(self) -> Coefficients:
        """(μ, ε) of the law.

        Raises:
            ContactLearnError: the law has not given them yet.
        """
        if self.mu is None or self.eps is None:
            raise ContactLearnError("μ and ε are known after the place `law` alone; give state.replace(mu=…, eps=…)")
        return self.mu, self.eps

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return PLANE if self.r.shape[-1] == 2 else SPACE

    @cached_property
    def world_inertia(self) -> Float[Tensor, "..."]:
        """Moment of inertia in kg m²: [..., N] in the plane, [..., N, 3, 3] in world axes in space."""
        return rigid_body.inertia_in_world(self.inertia, self.q)

    def in_world(self, vector: Float[Tensor, "... d"]) -> Float[Tensor, "... n d"]:
        """Return a vector [..., d] in axes of the body in those of the contact."""
        return rigid_body.in_world(vector, self.q)

    @property
    def orientation(self) -> Float[Tensor, "..."]:
        """θ [..., N] in rad, in space the quaternion [..., N, 4] from the body to the axes of the contact."""
        return rigid_body.orientation_of(self.q)

    @property
    def x(self) -> Float[Tensor, "... n"]:
        """Position along the floor, m."""
        return self.q[..., 0]

    @property
    def theta(self) -> Float[Tensor, "... n"]:
        """Orientation against the floor, rad."""
        return self.q[..., 2]

    @property
    def v_t(self) -> Float[Tensor, "... n"]:
        """Slip before contact in the plane, with its sign, m/s."""
        return self.v_c[..., 0]

    @property
    def slip(self) -> Float[Tensor, "... n"]:
        """Speed of the slip before contact, m/s."""
        return self.v_t.abs() if self.space is PLANE else self.v_c[..., :2].norm(dim=-1)

    @property
    def v_n(self) -> Float[Tensor, "... n"]:
        """Normal velocity of the contact point before contact, m/s; negative on approach."""
        return self.v_c[..., -1]

    @property
    def incidence(self) -> Float[Tensor, "... n"]:
        """Angle of incidence arctan(|v_t|/|v_n|) of the contact point, rad."""
        return torch.atan2(self.slip, -self.approach[..., -1])

    @property
    def lever(self) -> Float[Tensor, "... n"]:
        """|r_x|/ρ, ρ² = I/m: arm of the normal impulse in radii of gyration about the axis that it turns."""
        if self.space is PLANE:
            return self.r[..., 0].abs() * (self.mass / self.inertia).sqrt()
        turning = rigid_body.contact_jacobian(self.r)[..., 2, 3:]
        square = self.mass * (turning * rigid_body.spin(self.world_inertia, turning)).sum(-1)
        return square.clamp_min(_CENTRED).sqrt()

    @property
    def omega(self) -> Float[Tensor, "... n"]:
        """Spin before contact, rad/s."""
        return self.v_pre[..., 2]

    @cached_property
    def constant(self) -> "State":
        """The same state without derivatives."""
        return self.replace(**{f.name: _detached(getattr(self, f.name)) for f in fields(self)})

    def plus(self, changed: "State") -> "State":
        """Return the state with the difference of a changed one to its `constant` added to it."""
        pairs = {f.name: (getattr(self.constant, f.name), getattr(changed, f.name)) for f in fields(self)}
        return self.replace(
            **{name: _plus(getattr(self, name), *pair) for name, pair in pairs.items() if pair[0] is not pair[1]}
        )

    @cached_property
    def W(self) -> Float[Tensor, "... n d d"]:
        """Inverse effective inertia at the contact [..., N, d, d], 1/kg."""
        return rigid_body.inverse_inertia(self.mass, self.world_inertia, self.r)

    @cached_property
    def v_c(self) -> Float[Tensor, "... n d"]:
        """Velocity of the contact point before contact, its normal component last [..., N, d], m/s."""
        return rigid_body.contact_velocity(self.r, self.v_pre)

    @property
    def approach(self) -> Float[Tensor, "... n d"]:
        """v_c for a law, which expects an approach: v_n is at most −1e-9 m/s, also where the state has v_n ≥ 0."""
        return torch.cat((self.v_c[..., :-1], self.v_c[..., -1:].clamp_max(-_BARELY)), -1)

    def v_after(self, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        """Velocity [..., N, D] after a wrench, in contact axes and of the centre of mass."""
        return rigid_body.apply_wrench(self.mass, self.world_inertia, self.r, self.v_pre, wrench)

    def contact_after(self, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n d"]:
        """Velocity [..., N, d] of the contact point after a wrench, m/s."""
        return rigid_body.contact_velocity(self.r, self.v_after(wrench))

    def turned(self, angle: Float[Tensor, "..."]) -> "State":
        """Return the state with the orientation changed by `angle` in rad, and the contact point with it.

        It is [..., N] in the plane, and in space a rotation vector [..., N, 3].
        """
        before = self.orientation
        after = before + angle if self.space is PLANE else rigid_body.turn_quaternion(before, angle)
        return self.replace(
            q=columns(*self.q.unbind(-1)[: self.space.d], *_parts(after, self.space)),
            r=self.r + (self.contact_points(after) - self.contact_points(before)),
        )

    def tilted(self, tilt: Float[Tensor, "..."], orientation: Float[Tensor, "..."]) -> "State":
        """Return the state in axes that a `tilt` takes to those of this one, with the body's orientation in them."""
        d, back = self.space.d, -tilt if self.space is PLANE else tilt.mT
        velocity, spin = self.v_pre[..., :d], self.v_pre[..., d:]
        spin = spin if self.space is PLANE else _rotated(spin, back)
        return self.replace(
            r=_rotated(self.r, back),
            q=columns(*_rotated(self.q[..., :d], back).unbind(-1), *_parts(orientation, self.space)),
            v_pre=columns(*_rotated(velocity, back).unbind(-1), *spin.unbind(-1)),
            tilt=tilt if self.tilt is None else self.tilt + tilt if self.space is PLANE else self.tilt @ tilt,
            offset=None if self.offset is None else _rotated(self.offset, back),
        )

    def contact_points(self, theta: Float[Tensor, "..."]) -> Float[Tensor, "... n d"]:
        """Contact point [..., N, d] of each trial's stretched body at an `orientation`, m.

        Raises:
            ContactLearnError: the shape is not known.
        """
        if self.shape is None:
            raise ContactLearnError("the contact point of an unknown shape cannot move; give state.replace(shape=…)")
        return per_body(self.shape, self.body, lambda shape: contact_point(shape, theta, self.stretch, self.corner))

    @property
    def height(self) -> Float[Tensor, "... n"]:
        """Height in m of the contact point."""
        height = self.q[..., self.r.shape[-1] - 1] + self.r[..., -1]
        return height if self.offset is None else height + self.offset[..., -1]

    @property
    def mass_centre(self) -> Float[Tensor, "... n 2"] | None:
        """Centre of mass minus tracked point [..., N, 2] in world axes, m; None where they are one point."""
        return self.offset if self.offset is None or self.tilt is None else _rotated(self.offset, self.tilt)

    def as_measured(self, v_post: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        """Return the velocity of the tracked point in world axes, from that of the centre of mass in contact axes."""
        if self.offset is None and self.tilt is None:
            return v_post
        velocity, spin = v_post[..., : self.space.d], v_post[..., self.space.d :]
        if self.offset is not None:
            velocity = velocity - rigid_body.swept(self.offset, spin)
        if self.tilt is not None:
            velocity = _rotated(velocity, self.tilt)
            spin = spin if self.space is PLANE else _rotated(spin, self.tilt)
        return columns(*velocity.unbind(-1), *spin.unbind(-1))


def _parts(orientation: Float[Tensor, "..."], space: Space) -> tuple[Tensor, ...]:
    """Components of an orientation in a pose."""
    return (orientation,) if space is PLANE else orientation.unbind(-1)


def _rotated(vector: Float[Tensor, "... d"], turn: Float[Tensor, "..."]) -> Float[Tensor, "... d"]:
    """A vector turned by an angle [...] in rad, in space by a matrix [..., 3, 3]."""
    return rigid_body.rotate(vector, turn) if vector.shape[-1] == 2 else rigid_body.matvec(turn, vector)


def columns(*parts: Float[Tensor, "..."]) -> Float[Tensor, "... k"]:
    """Stack K parts [..., N], broadcast against each other, side by side along a new last axis; [0] of no part."""
    return torch.stack(torch.broadcast_tensors(*parts), -1) if parts else torch.zeros(0, dtype=torch.float64)


def altered(vector: Float[Tensor, "... k"], part: int, change: Float[Tensor, "..."]) -> Float[Tensor, "... k"]:
    """Return a vector [..., K] with a change of one of its parts."""
    parts = list(vector.unbind(-1))
    parts[part] = parts[part] + change
    return columns(*parts)


def _detached(value: Any) -> Any:
    """A field without derivatives."""
    if isinstance(value, tuple):
        return tuple(_detached(part) for part in value)
    return value.detach() if isinstance(value, Tensor) else value


def _plus(value: Any, before: Any, after: Any) -> Any:
    """A field with a change added to it."""
    if isinstance(value, tuple):
        return tuple(_plus(*parts) for parts in zip(value, before, after, strict=True))
    return after if value is None else value + (after - before)
