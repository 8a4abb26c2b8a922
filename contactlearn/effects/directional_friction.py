"""The floor has a grain: it is rougher one way than the other."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class DirectionalFriction(Effect):
    """μ → μ (1 + a sign v_t), with the slip before contact.

    It is not a tilt of the floor, which also acts where the contact sticks (`surface_tilt`).
    """

    formula = "μ ← μ (1 + a sign v_t)"
    source = "surface texture"
    mirror_symmetric = False
    a: Tensor | float = parameter("a", "–", -1.0, 1.0)

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        return mu * (1 + self.a * state.v_t.sign()), eps
