"""Gravity acts between contact and the second measurement."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.rigid_body import GRAVITY


@dataclass(frozen=True, eq=False)
class GravityImpulse(Effect):
    """v_y → v_y − g Δt: a contact of finite duration, or a frame taken late.

    It is not a loss in the contact itself, which would grow with the speed.
    """

    formula = "v_y⁺ ← v_y⁺ − g Δt"
    in_words = "gravity acts for {dt} more"
    source = "finite duration"
    dt: Tensor | float = parameter("Δt", "s", 0.0, 0.1)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        fall = GRAVITY * self.dt
        return columns(v_post[..., 0], v_post[..., 1] - fall, v_post[..., 2])
