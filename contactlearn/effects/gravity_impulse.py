"""The body flies on between contact and the second measurement."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, altered, columns
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.space import BOTH, PLANE


class GravityImpulse(Effect):
    """v_y → v_y − g Δt: a contact of finite duration, or a frame taken late.

    In space the spin changes as well, at a constant angular momentum (Euler's equations, in one midpoint step).  It is
    not a loss in the contact itself, which would grow with the speed.
    """

    spaces = BOTH
    formula = "v_y⁺ ← v_y⁺ − g Δt"
    in_words = "gravity acts for {dt} more"
    source = "finite duration"
    of_recording = True
    dt: Tensor | float = parameter("Δt", "s", 0.0, 0.1)

    def velocity(self, state: State, v_post: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        dt, d = torch.as_tensor(self.dt), state.space.d
        v_post = altered(v_post, d - 1, -rigid_body.GRAVITY * dt)
        if state.space is PLANE:
            return v_post
        omega, dt = v_post[..., d:], dt[..., None]
        inertia, momentum = state.world_inertia, rigid_body.spin_momentum(state.world_inertia, omega)
        halfway = omega + dt / 2 * rigid_body.spin(inertia, torch.linalg.cross(momentum, omega))
        later = rigid_body.turn_quaternion(state.orientation, dt * halfway)
        turned = rigid_body.inertia_in_world(state.inertia, columns(*state.q[..., :d].unbind(-1), *later.unbind(-1)))
        change = rigid_body.spin(turned, momentum) - rigid_body.spin(inertia, momentum)  # 0 without delay
        return columns(*v_post[..., :d].unbind(-1), *(omega + change).unbind(-1))
