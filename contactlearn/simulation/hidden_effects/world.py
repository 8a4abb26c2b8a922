"""The world behind the measurements: the true body, its floor and its camera.

`States` are drops as they are reported, without noise.  `World.outcome` makes the true contact of
each (the pose at that instant, the true body, the floor's own axes), resolves it (`contact`), and
returns the velocity as a camera would report it.  In a world without hidden effects every reported
state is true.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.mechanics.rigid_body import contact_velocity, rotate
from contactlearn.mechanics.shapes import Shape, contact_point
from contactlearn.simulation.hidden_effects.contact import (
    COMPLIANT_STEPS,
    STEPS,
    ContactState,
    collide_compliant,
    collide_rigid,
    detach,
)

GRAZING = 0.05  # a contact point approaches at more than this share of the body's speed
_EPS, _MU = (0.02, 0.98), (0.0, 1.5)  # ranges of the coefficients under all effects


class States(NamedTuple):
    """N drops as reported, without noise."""

    mass: Tensor  # [N] kg
    inertia: Tensor  # [N] kg m²
    x: Tensor  # [N] m
    theta: Tensor  # [N] rad
    v: Tensor  # [N, 3] m/s, rad/s, of the tracked point
    age: Tensor  # [N] place in the sequence of measurements as a share, in (0, 1]


class ContactContext(NamedTuple):
    """The true contact at first touch, in the floor's axes, of which effects are functions."""

    mass: Tensor  # [N] kg
    inertia: Tensor  # [N] kg m²
    r: Tensor  # [N, 2] m
    v: Tensor  # [N, 3] m/s, rad/s
    v_c: Tensor  # [N, 2] m/s
    x: Tensor  # [N] m
    theta: Tensor  # [N] rad, of the body in world axes
    age: Tensor  # [N]


@dataclass(frozen=True)
class World:
    """A body and a floor; the hidden effects change copies of it."""

    shape: Shape
    mu: float
    eps: float
    energetic: bool  # Stronge's restitution, else Poisson's
    compliant: bool = False  # contacts have springs
    # State
    tilt: float = 0.0  # rad, of the floor
    turn: float = 0.0  # rad, true minus reported orientation
    delay: float = 0.0  # s, from the reported pose to contact
    scale: tuple[float, float] = (1.0, 1.0)  # true over nominal lengths along the body's axes
    centre: tuple[float, float] = (0.0, 0.0)  # m, centre of mass minus tracked point in the body's axes
    inertia_factor: float = 1.0  # true over reported moment of inertia
    # Contact
    restitution: tuple[Callable[[ContactContext], Tensor], ...] = ()  # factors on ε
    friction: tuple[Callable[[ContactContext, Tensor], Tensor], ...] = ()  # factors on μ at a slip in m/s
    levers: tuple[Callable[[ContactContext, Tensor], Tensor], ...] = ()  # moment per normal impulse in m
    compliance: float = 0.0  # k_n/k_t and resilience of the tangential spring, where `compliant`
    resilience: float = 0.0
    adhesion: float = 0.0  # J, work that it takes to part
    # Velocity: changes of (v_x, v_y, ω) of the centre of mass until it is measured
    after: tuple[Callable[[ContactContext, Tensor], Tensor], ...] = ()

    def touch(self, states: States) -> ContactContext:
        """The contacts as they are."""
        spin = states.v[:, 2]
        theta = states.theta + self.turn + spin * self.delay
        offset = self._centre(theta)
        level = torch.tensor(-self.tilt, dtype=theta.dtype)
        v = torch.cat((rotate(states.v[:, :2] + _cross(spin, offset), level), spin[:, None]), -1)
        r = contact_point(self.shape, theta - self.tilt, self.scale) - rotate(offset, level)
        x = states.x + states.v[:, 0] * self.delay
        inertia = states.inertia * self.inertia_factor
        return ContactContext(states.mass, inertia, r, v, contact_velocity(r, v), x, theta, states.age)

    def approaches(self, states: States) -> Tensor:
        """Where the contact point comes down on the floor, truly: bool [N]."""
        context = self.touch(states)
        return context.v_c[:, 1] < -GRAZING * context.v[:, :2].norm(dim=-1)

    def outcome(self, states: States, steps: int | None = None) -> Tensor:
        """Velocity [N, 3] of the tracked point as it is reported after contact, without noise."""
        context = self.touch(states)
        eps = self.eps * torch.ones_like(context.x)
        for factor in self.restitution:
            eps = eps * factor(context)

        def friction(slip: Tensor) -> Tensor:
            mu = self.mu * torch.ones_like(slip)
            for factor in self.friction:
                mu = mu * factor(context, slip)
            return mu.clamp(*_MU)

        def lever(spin: Tensor) -> Tensor:
            return sum((lever(context, spin) for lever in self.levers), torch.zeros_like(spin))

        contact = ContactState(
            context.mass, context.inertia, context.r, context.v, eps.clamp(*_EPS), self.energetic, friction, lever
        )
        if self.compliant:
            v = collide_compliant(contact, self.compliance, self.resilience, steps or COMPLIANT_STEPS)
        else:
            v = collide_rigid(contact, steps or STEPS)
        if self.adhesion:
            v = detach(contact, v, self.adhesion)
        v = torch.cat((rotate(v[:, :2], torch.tensor(self.tilt, dtype=v.dtype)), v[:, 2:]), -1)
        for change in self.after:
            v = change(context, v)
        return torch.cat((v[:, :2] - _cross(v[:, 2], self._centre(context.theta)), v[:, 2:]), -1)

    def _centre(self, theta: Tensor) -> Tensor:
        """Centre of mass minus tracked point [N, 2] in world axes."""
        return rotate(torch.tensor(self.centre, dtype=theta.dtype).expand(len(theta), 2), theta)


def _cross(spin: Tensor, arm: Tensor) -> Tensor:
    """Velocity [N, 2] at the end of an arm [N, 2] that turns at a spin [N]."""
    return torch.stack((-spin * arm[:, 1], spin * arm[:, 0]), -1)
