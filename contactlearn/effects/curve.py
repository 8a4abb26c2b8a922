"""Smooth curves over one variable of an impact: natural cubic splines through four knots.

    s(u) = Σ c_k S_k(u), k = 1 … 3;      S_k rises by 1 from knot k to knot k + 1, and by 0 from any other to the next

So c_k is the rise of s from one knot to the next.  s is straight beyond the outer knots, and 0 midway between the
inner ones, or at the first one where the curve starts at rest.  Knots that are left open are quantiles of the
variable over the measurements.

`CoefficientCurve` is a change of μ or ε, `ArmCurve` one of the arm of the normal impulse.  A form of an effect says
what the variable is and what the curve changes.
Source: Hastie, Tibshirani & Friedman 2009, §5.2.1.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts

Knots = tuple[float, ...]

_QUANTILES = (0.05, 0.35, 0.65, 0.95)  # of four knots: Harrell 2015, §2.4.6
_FROM_REST = (1 / 3, 2 / 3, 0.95)  # of those after one at 0
_CLOSEST = 0.1  # of an even spacing; where two would be nearer, as with few distinct values, all are spaced evenly


@dataclass(frozen=True, eq=False)
class Spline(ABC):
    """A curve over one variable; see the module."""

    formula: ClassVar[str]
    variable: ClassVar[str]
    """Its letter in formulas."""
    unit: ClassVar[str]
    """Its unit, – for a number."""
    at_rest: ClassVar[bool] = False
    """Whether the first knot is at 0, and the curve is 0 there."""

    c1: Tensor | float
    c2: Tensor | float
    c3: Tensor | float
    knots: Knots | None = None  # four values of the variable; None: quantiles of the measurements

    @abstractmethod
    def along(self, state: State) -> Float[Tensor, "... n"]:
        """Return values [..., N] of the variable, known before contact, among which the knots lie."""

    def prepare(self, impacts: Impacts) -> Self:
        """Return the curve with its knots at quantiles over the impacts where they are open."""
        if self.knots is not None:
            return self
        values = self.along(State.of(impacts))
        return replace(self, knots=_from_rest(values) if self.at_rest else _spread(values))

    def change(self, u: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate s at values u [..., N] of the variable.

        Raises:
            ContactLearnError: the knots are open, or not four increasing numbers.
        """
        if self.knots is None or len(self.knots) != 4 or any(b <= a for a, b in pairwise(self.knots)):
            rule = f"the knots of a curve are four increasing values of {self.variable}"
            raise ContactLearnError(f"{rule}, given or taken by prepare(impacts); got {self.knots}")
        shapes = _shapes(u, self.knots, self.knots[0] if self.at_rest else (self.knots[1] + self.knots[2]) / 2)
        return self.c1 * shapes[..., 0] + self.c2 * shapes[..., 1] + self.c3 * shapes[..., 2]

    @property
    def equation(self) -> str:
        """The formula, and the knots once they are known."""
        if self.knots is None:
            return self.formula
        unit = "" if self.unit == "–" else f" {self.unit}"
        return f"{self.formula} at {self.variable} = {', '.join(f'{knot:g}' for knot in self.knots)}{unit}"


@dataclass(frozen=True, eq=False)
class CoefficientCurve(Spline):
    """A curve of μ or ε."""

    c1: Tensor | float = parameter("c₁", "–", -0.5, 0.5)
    c2: Tensor | float = parameter("c₂", "–", -0.5, 0.5)
    c3: Tensor | float = parameter("c₃", "–", -0.5, 0.5)


@dataclass(frozen=True, eq=False)
class ArmCurve(Spline):
    """A curve of the arm, in m, at which the normal impulse acts beside the contact point."""

    c1: Tensor | float = parameter("c₁", "m", -0.01, 0.01)
    c2: Tensor | float = parameter("c₂", "m", -0.01, 0.01)
    c3: Tensor | float = parameter("c₃", "m", -0.01, 0.01)


def _spread(values: Float[Tensor, "..."]) -> Knots:
    """Knots at quantiles of values, or evenly spaced where these are too few."""
    knots = values.flatten().quantile(torch.tensor(_QUANTILES, dtype=values.dtype, device=values.device)).tolist()
    if knots[0] == knots[-1]:  # a variable that does not vary
        knots = [knots[0] - 0.5, *knots[1:-1], knots[0] + 0.5]
    return _separate(knots)


def _from_rest(sizes: Float[Tensor, "..."]) -> Knots:
    """Knots at 0 and at quantiles of values that are not negative."""
    knots = sizes.flatten().quantile(torch.tensor(_FROM_REST, dtype=sizes.dtype, device=sizes.device)).tolist()
    return _separate([0.0, *knots[:-1], knots[-1] or 1.0])


def _separate(knots: list[float]) -> Knots:
    """Space knots evenly if some are too close, and round them to a thousandth of their span or a little less."""
    low, high = knots[0], knots[-1]
    even = (high - low) / 3
    if min(b - a for a, b in pairwise(knots)) < _CLOSEST * even:
        knots = [low, low + even, high - even, high]
    digits = 2 - math.floor(math.log10(high - low))
    return tuple(round(knot, digits) for knot in knots)


def _shapes(u: Float[Tensor, "... n"], knots: Knots, zero: float) -> Float[Tensor, "... n 3"]:
    """S_k at u [..., N], which are 0 at u = `zero`."""
    rises, origin = _rises(knots, zero, u.device)
    return (_truncated(u, knots) - origin) @ rises


@lru_cache(maxsize=256)
def _rises(knots: Knots, zero: float, device: torch.device) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
    """The matrix from truncated powers to S_k, and the powers at `zero`."""
    at_knots = _truncated(torch.tensor(knots, dtype=torch.float64), knots)
    origin = _truncated(torch.tensor(zero, dtype=torch.float64), knots)
    return torch.linalg.inv(at_knots.diff(dim=0)).to(device), origin.to(device)


def _truncated(u: Float[Tensor, "*batch"], knots: Knots) -> Float[Tensor, "*batch 3"]:
    """Basis [..., 3] of the natural cubic splines without the constant: u itself and two that bend."""
    span = knots[-1] - knots[0]
    t, (first, second, third, last) = (u - knots[0]) / span, ((knot - knots[0]) / span for knot in knots)
    cubes = {knot: (t - knot).clamp_min(0) ** 3 for knot in (first, second, third, last)}
    bends = [(cubes[knot] - cubes[last]) / (last - knot) for knot in (first, second, third)]
    return torch.stack((t, bends[0] - bends[2], bends[1] - bends[2]), -1)
