"""Some sides of the body are softer than others."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class OrientationDependentRestitution(Effect):
    """ε → ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform.

    It is not a loss that comes with the lever arm r_x (`configuration_dependent_restitution`).
    """

    formula = "ε ← ε + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ"
    source = "non-uniform body"
    mirror_symmetric = False
    a1: Tensor | float = parameter("a₁", "–", -0.5, 0.5)
    b1: Tensor | float = parameter("b₁", "–", -0.5, 0.5)
    a2: Tensor | float = parameter("a₂", "–", -0.5, 0.5)
    b2: Tensor | float = parameter("b₂", "–", -0.5, 0.5)

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        theta = state.theta
        first = self.a1 * theta.cos() + self.b1 * theta.sin()
        return mu, eps + (first + self.a2 * (2 * theta).cos() + self.b2 * (2 * theta).sin())
