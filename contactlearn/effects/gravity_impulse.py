"""Gravity acts between contact and the second measurement."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, altered
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.space import BOTH


class GravityImpulse(Effect):
    """v_y → v_y − g Δt: a contact of finite duration, or a frame taken late.

    It is not a loss in the contact itself, which would grow with the speed.
    """

    spaces = BOTH
    formula = "v_y⁺ ← v_y⁺ − g Δt"
    in_words = "gravity acts for {dt} more"
    source = "finite duration"
    dt: Tensor | float = parameter("Δt", "s", 0.0, 0.1)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return altered(v_post, state.space.d - 1, -GRAVITY * torch.as_tensor(self.dt))
