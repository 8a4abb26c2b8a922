"""Guide walls or air slow the body before it is measured again."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class SideDrag(Effect):
    """(v_x, v_y) → (1 − c) (v_x, v_y) after contact.

    It is not a lower restitution: v_x shrinks as well, however the contact ends.
    """

    formula = "(v_x⁺, v_y⁺) ← (1 − c) (v_x⁺, v_y⁺)"
    source = "guide walls, air"
    c: Tensor | float = parameter("c", "–", 0.0, 0.5)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        kept = 1 - self.c
        return columns(kept * v_post[..., 0], kept * v_post[..., 1], v_post[..., 2])
