"""The floor is rougher in some places than in others."""

from dataclasses import dataclass, replace

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.basis import smooth, span
from contactlearn.effects.state import State
from contactlearn.impacts import Impacts


@dataclass(frozen=True, eq=False)
class LocationDependentFriction(Effect):
    """μ → μ + Σ c_k P_k(u), k = 1 … 5, with Legendre's polynomials of the place u in [−1, 1] along the floor.

    Beyond the span the value at its end is kept.  It is not a drift in time (`parameter_drift`).
    """

    formula = "μ ← μ + Σ c_k P_k(u), k = 1 … 5, u = x on its span"
    source = "worn or soiled floor"
    mirror_symmetric = False
    c1: Tensor | float = parameter("c₁", "–", -0.5, 0.5)
    c2: Tensor | float = parameter("c₂", "–", -0.5, 0.5)
    c3: Tensor | float = parameter("c₃", "–", -0.5, 0.5)
    c4: Tensor | float = parameter("c₄", "–", -0.5, 0.5)
    c5: Tensor | float = parameter("c₅", "–", -0.5, 0.5)
    span: tuple[float, float] | None = None  # of x in m; None: that of nine tenths of the measurements

    def prepare(self, impacts: Impacts) -> "LocationDependentFriction":
        return self if self.span is not None else replace(self, span=span(impacts.q[:, 0]))

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        coefficients = (self.c1, self.c2, self.c3, self.c4, self.c5)
        return mu + smooth(state.x, self.span, coefficients), eps
