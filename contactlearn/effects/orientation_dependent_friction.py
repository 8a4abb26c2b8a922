"""Some sides of the body are rougher than others."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect
from contactlearn.effects.harmonics import AroundBody
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class OrientationDependentFriction(AroundBody, Effect):
    """μ is a function of the side on which the body lands.

    It is not a floor that is rougher one way than the other (`directional_friction`).
    """

    formula = "μ ← μ + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ"
    source = "non-uniform body"
    mirror_symmetric = False

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.change(state.theta), eps
