"""Smooth functions of the place along the floor, on the span of the measurements."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import parameter
from contactlearn.mechanics.impacts import Impacts


@dataclass(frozen=True, eq=False)
class AlongFloor:
    """Σ c_k P_k(u), k = 1 … 5, with Legendre's polynomials; u in [−1, 1] is the place on the span, or its nearer end.

    The span is left open for `prepare`: the middle nine tenths of the measured places, for single trials far out
    would otherwise bend the functions to themselves.
    """

    c1: Tensor | float = parameter("c₁", "–", -0.5, 0.5)
    c2: Tensor | float = parameter("c₂", "–", -0.5, 0.5)
    c3: Tensor | float = parameter("c₃", "–", -0.5, 0.5)
    c4: Tensor | float = parameter("c₄", "–", -0.5, 0.5)
    c5: Tensor | float = parameter("c₅", "–", -0.5, 0.5)
    span: tuple[float, float] | None = None  # of x in m; None: that of nine tenths of the measurements

    def prepare(self, impacts: Impacts) -> Self:
        """Return the functions with the span of the impacts where it is open, rounded outwards to 0.1 mm."""
        if self.span is not None:
            return self
        x = impacts.q[:, 0]
        low, high = x.quantile(torch.tensor((0.05, 0.95), dtype=x.dtype, device=x.device)).tolist()
        return replace(self, span=(round(low - 5e-5, 4), round(high + 5e-5, 4)))

    def change(self, x: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at x [..., N] in m.

        Raises:
            ContactLearnError: the span is open, empty, or none.
        """
        if not isinstance(self.span, tuple) or len(self.span) != 2 or not self.span[0] < self.span[1]:
            rule = "a span must be [low, high] of x in m with low < high, given or taken by prepare(impacts)"
            raise ContactLearnError(f"{rule}; got {self.span}")
        low, high = self.span
        u = ((2 * x - low - high) / (high - low)).clamp(-1, 1)
        before, now = torch.ones_like(u), u
        total = self.c1 * now
        for k, coefficient in enumerate((self.c2, self.c3, self.c4, self.c5), 2):
            before, now = now, ((2 * k - 1) * u * now - (k - 1) * before) / k
            total = total + coefficient * now
        return total
