"""The floor has a grain: it is rougher one way than the other."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.path import retraced
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class DirectionalFriction(Effect):
    """μ (1 + a) against slip to the right and μ (1 − a) against slip to the left, at every instant.

    What this changes of Routh's path is added to what the law gives (`path.retraced`).  It is not a tilt of the
    floor, which also acts where the contact sticks at once (`surface_tilt`).
    """

    formula = "μ ← μ (1 + a sign v_t) at every instant"
    source = "surface texture"
    mirror_symmetric = False
    adds_energy = True
    a: Tensor | float = parameter("a", "–", -0.9, 0.9)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        (mu, _), grain = state.coefficients, self.a * state.v_t.sign()
        return retraced(state, wrench, friction=(mu * (1 + grain), mu * (1 - grain)))
