"""Friction differs from impact to impact."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State
from contactlearn.scatter.base import Component, Perturbed


class Friction(Component):
    """μ_k = μ + u_k, μ_k ≥ 0.

    Only impacts that slide show it.  It is not stripes or spots of the floor, which follow the place
    (`location_dependent_friction`), nor the normal's scatter, which moves the normal impulse as well.
    """

    symbol = "μ"
    unit = "–"
    highest = 0.2
    in_words = "friction by {sigma}"
    source = "Fazeli et al. 2017, Fig. 3.6"

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n 1"]
    ) -> Perturbed:
        return state, (mu + u[..., 0]).clamp_min(0), eps
