"""Functions of the body's orientation, of period 2π.

    harmonics   Σ a_k cos kθ + b_k sin kθ, k = 1, 2      smooth all around
    curve       likewise, k = 1 … 4                      down to features of about 45°
    spot        a/(1 + (2 sin((θ − θ_0)/2)/w)⁴)          one feature of half-width w about θ_0

of μ or ε (`…AroundBody`), or of the arm at which the normal impulse acts beside the contact point (`Arm…`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import torch
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
        total = torch.zeros_like(theta)
        for k, (a, b) in enumerate(self._pairs(), 1):
            total = total + a * (k * theta).cos() + b * (k * theta).sin()
        return total

    def _pairs(self) -> Iterator[tuple[Tensor, Tensor]]:
        """The coefficients a_k and b_k of each harmonic in turn."""
        coefficients = [getattr(self, f.name) for f in fields(self) if "parameter" in f.metadata]
        yield from zip(coefficients[::2], coefficients[1::2], strict=True)


@dataclass(frozen=True, eq=False)
class AroundBody(_Harmonics):
    """A change of μ or ε around the body."""

    a1: Tensor | float = parameter("a₁", "–", -0.5, 0.5)
    b1: Tensor | float = parameter("b₁", "–", -0.5, 0.5)
    a2: Tensor | float = parameter("a₂", "–", -0.5, 0.5)
    b2: Tensor | float = parameter("b₂", "–", -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class CurveAroundBody(AroundBody):
    """A change of μ or ε around the body, with finer features."""

    a3: Tensor | float = parameter("a₃", "–", -0.5, 0.5)
    b3: Tensor | float = parameter("b₃", "–", -0.5, 0.5)
    a4: Tensor | float = parameter("a₄", "–", -0.5, 0.5)
    b4: Tensor | float = parameter("b₄", "–", -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class ArmAroundBody(_Harmonics):
    """A change of the arm, in m, at which the normal impulse acts beside the contact point."""

    a1: Tensor | float = parameter("a₁", "m", -0.01, 0.01)
    b1: Tensor | float = parameter("b₁", "m", -0.01, 0.01)
    a2: Tensor | float = parameter("a₂", "m", -0.01, 0.01)
    b2: Tensor | float = parameter("b₂", "m", -0.01, 0.01)


@dataclass(frozen=True, eq=False)
class ArmCurveAroundBody(ArmAroundBody):
    """A change of that arm, with finer features."""

    a3: Tensor | float = parameter("a₃", "m", -0.01, 0.01)
    b3: Tensor | float = parameter("b₃", "m", -0.01, 0.01)
    a4: Tensor | float = parameter("a₄", "m", -0.01, 0.01)
    b4: Tensor | float = parameter("b₄", "m", -0.01, 0.01)


@dataclass(frozen=True, eq=False)
class _Spot:
    a: Tensor | float
    theta_0: Tensor | float = parameter("θ₀", "rad", -4.0, 4.0, vanishing=None, start=0.0)
    w: Tensor | float = parameter("w", "rad", 0.1, 1.5, vanishing=None, start=0.5)

    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at orientations θ [..., N] in rad."""
        away = 2 * (1 - (theta - self.theta_0).cos()) / self.w**2  # squared
        return self.a / (1 + away**2)


@dataclass(frozen=True, eq=False)
class SpotOnBody(_Spot):
    """A change of μ or ε at one spot of the body."""

    a: Tensor | float = parameter("a", "–", -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class ArmSpotOnBody(_Spot):
    """A change of the arm, in m, at one spot of the body."""

    a: Tensor | float = parameter("a", "m", -0.01, 0.01)
