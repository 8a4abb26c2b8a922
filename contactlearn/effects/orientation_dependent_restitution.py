"""Some sides of the body are softer than others."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class OrientationDependentRestitution(Effect):
    """ε as a function of the side that the body lands on.

        harmonics   ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform
        spot        ε − a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a soft spot of half-width w about θ_0

    It is not a loss that comes with the lever arm r_x (`configuration_dependent_restitution`).
    """

    formula: ClassVar = {
        "harmonics": "ε ← ε + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ",
        "spot": "ε ← ε − a/(1 + (2 sin((θ − θ₀)/2)/w)⁴)",
    }
    source = "non-uniform body"
    mirror_symmetric = False
    a1: Tensor | float = parameter("a₁", "–", -0.5, 0.5, form="harmonics")
    b1: Tensor | float = parameter("b₁", "–", -0.5, 0.5, form="harmonics")
    a2: Tensor | float = parameter("a₂", "–", -0.5, 0.5, form="harmonics")
    b2: Tensor | float = parameter("b₂", "–", -0.5, 0.5, form="harmonics")
    a: Tensor | float = parameter("a", "–", -0.5, 0.5, form="spot")
    theta_0: Tensor | float = parameter("θ₀", "rad", -4.0, 4.0, vanishing=None, start=0.0, form="spot")
    w: Tensor | float = parameter("w", "rad", 0.1, 1.5, vanishing=None, start=0.5, form="spot")
    form: str = "harmonics"

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        theta = state.theta
        if self.form == "spot":
            away = 2 * (1 - (theta - self.theta_0).cos()) / self.w**2  # squared
            return mu, eps - self.a / (1 + away**2)
        first = self.a1 * theta.cos() + self.b1 * theta.sin()
        return mu, eps + (first + self.a2 * (2 * theta).cos() + self.b2 * (2 * theta).sin())
