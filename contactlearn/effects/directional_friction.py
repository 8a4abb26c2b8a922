"""The floor has a grain: it is rougher one way than the other."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.impulse_path import perturbed_path, perturbed_path_in_space, smooth_norm
from contactlearn.effects.state import State
from contactlearn.mechanics.space import SPACE


class DirectionalFriction(Effect):
    """μ (1 + a) against slip to the right and μ (1 − a) against slip to the left.

        instant    of the slip at every instant, which may reverse
        initial    of the slip before contact
        path       in space μ (1 + a cos ψ + b sin ψ), ψ the direction of the slip of the instant, from x to y

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


class DirectionalFrictionInSpace(DirectionalFriction):
    """μ (1 + a cos ψ + b sin ψ) along the path of a contact in space, as on a mat with pile.

    It is rougher one way than the opposite one, which a cone that is rougher along one line is not
    (`AnisotropicFriction`).
    """

    spaces = (SPACE,)
    form = "path"
    formula = "μ ← μ (1 + a cos ψ + b sin ψ), ψ the direction of the slip along the path of the contact"
    in_words = "μ changes by {a:%} in slip along x and by {b:%} in slip along y, and by as much the other way back"
    b: Tensor | float = parameter("b", "–", -0.9, 0.9)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        (mu, _), (a, b) = state.coefficients, self.values

        def change(slip: Float[Tensor, "2 ..."]) -> Float[Tensor, "..."]:
            return mu * (a * slip[0] + b * slip[1]) / smooth_norm(slip)

        return perturbed_path_in_space(state, wrench, self.values, friction=change)
