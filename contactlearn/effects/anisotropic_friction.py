"""The floor is rougher in some directions than in others."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesFriction, Effect, usual_parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.rigid_body import slip_heading
from contactlearn.mechanics.space import SPACE


class AnisotropicFriction(ChangesFriction, Effect):
    """μ → μ + a_1 cos α + b_1 sin α + a_2 cos 2α + b_2 sin 2α, α the heading of the slip before contact.

    The second harmonics are a texture with two axes, the first one a grain like a cat's coat.  In a plane
    `directional_friction` is the grain.  The friction stays against the slip: its force is not turned.
    """

    spaces = (SPACE,)
    formula = "μ ← μ + a₁ cos α + b₁ sin α + a₂ cos 2α + b₂ sin 2α, α the heading of the slip before contact"
    in_words = "with the heading α of the slip μ changes by {a1} cos α, {b1} sin α, {a2} cos 2α and {b2} sin 2α"
    source = "Zmitrowicz 1981"
    citations = ("zmitrowicz1981",)
    mirror_symmetric = False
    a1: Tensor | float = usual_parameter("a₁")
    b1: Tensor | float = usual_parameter("b₁")
    a2: Tensor | float = usual_parameter("a₂")
    b2: Tensor | float = usual_parameter("b₂")

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        c, s, _ = slip_heading(state.W, state.v_c)
        return value + self.a1 * c + self.b1 * s + self.a2 * (c * c - s * s) + self.b2 * 2 * c * s
