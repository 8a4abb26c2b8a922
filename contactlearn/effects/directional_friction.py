"""The floor has a grain: it is rougher one way than the other."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.impulse_path import perturbed_path
from contactlearn.effects.state import State


class DirectionalFriction(Effect):
    """μ (1 + a) against slip to the right and μ (1 − a) against slip to the left.

        instant    of the slip at every instant, which may reverse
        initial    of the slip before contact

    What this changes of Routh's path is added to what the law gives (`perturbed_path`).  It is not a tilt of the
    floor, which also acts where the contact sticks at once (`surface_tilt`).
    """

    place = "wrench"
    source = "surface texture"
    in_words = "μ changes by {a:%} in slip to the right, and by as much the other way to the left"
    mirror_symmetric = False
    adds_energy = True
    a: Tensor | float = parameter("a", "–", -0.9, 0.9)


class InstantDirectionalFriction(DirectionalFriction):
    """μ (1 + a sign v_t), with the slip at every instant.  It may reverse (`InitialDirectionalFriction`)."""

    form = "instant"
    formula = "μ ← μ (1 + a sign v_t) at every instant"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        (mu, _), grain = state.coefficients, self.a * state.v_t.sign()
        return perturbed_path(state, wrench, friction=(mu * (1 + grain), mu * (1 - grain)))


class InitialDirectionalFriction(DirectionalFriction):
    """μ (1 + a sign v_t), with the slip before contact, also where it reverses (`InstantDirectionalFriction`)."""

    form = "initial"
    formula = "μ ← μ (1 + a sign v_t), v_t before contact"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        (mu, _), grain = state.coefficients, self.a * state.v_t.sign()
        return perturbed_path(state, wrench, friction=(mu * (1 + grain), mu * (1 + grain)))
