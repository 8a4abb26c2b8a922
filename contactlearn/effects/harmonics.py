"""Functions of the body's orientation, of period 2π: a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import parameter


@dataclass(frozen=True, eq=False)
class _Harmonics:
    a1: Tensor | float
    b1: Tensor | float
    a2: Tensor | float
    b2: Tensor | float

    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at orientations θ [..., N] in rad."""
        first = self.a1 * theta.cos() + self.b1 * theta.sin()
        return first + self.a2 * (2 * theta).cos() + self.b2 * (2 * theta).sin()


@dataclass(frozen=True, eq=False)
class AroundBody(_Harmonics):
    """A change of μ or ε around the body."""

    a1: Tensor | float = parameter("a₁", "–", -0.5, 0.5)
    b1: Tensor | float = parameter("b₁", "–", -0.5, 0.5)
    a2: Tensor | float = parameter("a₂", "–", -0.5, 0.5)
    b2: Tensor | float = parameter("b₂", "–", -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class ArmAroundBody(_Harmonics):
    """A change of the arm, in m, at which the normal impulse acts beside the contact point."""

    a1: Tensor | float = parameter("a₁", "m", -0.01, 0.01)
    b1: Tensor | float = parameter("b₁", "m", -0.01, 0.01)
    a2: Tensor | float = parameter("a₂", "m", -0.01, 0.01)
    b2: Tensor | float = parameter("b₂", "m", -0.01, 0.01)
