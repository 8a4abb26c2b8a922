"""Functions of the place (x, y) on a floor in space, which restitution and friction share.

    FieldOverFloor     Σ c_ij P_i(u) P_j(w), i + j = 1, 2, with Legendre's polynomials
    BorderOnFloor      a/(1 + exp(−t/b)): another half-plane, whose border has any bearing
    SpotOnFloor        a exp(−(s/b)²ⁿ): a round spot with a sharp edge, or like a hill
    StripOnFloor       a exp(−(t/b)²ⁿ): a strip of any bearing, such as tape

Lengths are in units of half the wider span of the measured places, about the middle of both spans, so that a bearing is
one and ranges suit every floor: (u, w) is the place, s the distance from the middle of the spot, and t that from a line
with the normal (cos φ, sin φ) at u_0 cos φ + w_0 sin φ = d.  `functions.AlongFloor` is the planar place-dependence.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import OWN_FAMILY, parameter, usual_parameter
from contactlearn.effects.functions import SHARPNESS, within_part
from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import SPACE

_INNER = (0.025, 0.975)  # quantiles of the places between which a span lies: single trials far out do not bend a field
_LEAST = 1e-4  # m, of a half-span

Square = tuple[float, float, float]
"""Middle (x, y) of a floor and its half-span, m."""


class OverFloor(Frozen, ABC):
    """A function of the place, added to a coefficient; the square is left open for `prepare`."""

    spaces = (SPACE,)
    mirror_symmetric = False
    form: ClassVar[str | None]
    formula: ClassVar[str]
    square: Square | None = None  # middle (x, y) and half-span in m; None: of the measurements

    @abstractmethod
    def change(self, u: Float[Tensor, "... n"], w: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at places (u, w) [..., N]."""

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the function on the square of the impacts where it is open."""
        if self.square is not None:
            return self
        quantiles = torch.tensor(_INNER, dtype=impacts.q.dtype, device=impacts.q.device)
        low, high = impacts.q[:, :2].quantile(quantiles, dim=0)
        middle, half = ((low + high) / 2).tolist(), ((high - low) / 2).max().item()
        return replace(self, square=(round(middle[0], 4), round(middle[1], 4), max(round(half, 4), _LEAST)))

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the function of the place added.

        Raises:
            ContactLearnError: the square is open, or has no width.
        """
        if not isinstance(self.square, tuple) or len(self.square) != 3 or not self.square[2] > 0:
            rule = "a square is its middle (x, y) and half its width > 0 in m, given or taken by prepare(impacts)"
            raise ContactLearnError(f"{rule}; got {self.square}")
        x, y, half = self.square
        return value + self.change((state.q[..., 0] - x) / half, (state.q[..., 1] - y) / half)

    @property
    def equation(self) -> str:
        """The formula, and the square once it is known."""
        if self.square is None:
            return self.formula
        x, y, half = self.square
        return f"{self.formula}, lengths in {half:g} m about ({x:g}, {y:g}) m"


class FieldOverFloor(OverFloor):
    """c_10 u + c_01 w + c_20 P_2(u) + c_11 u w + c_02 P_2(w)."""

    form = "field"
    formula = "{quantity} ← {quantity} + c₁₀ u + c₀₁ w + c₂₀ P₂(u) + c₁₁ u w + c₀₂ P₂(w), u and w = x and y"
    c10: Tensor | float = usual_parameter("c₁₀")
    c01: Tensor | float = usual_parameter("c₀₁")
    c20: Tensor | float = usual_parameter("c₂₀")
    c11: Tensor | float = usual_parameter("c₁₁")
    c02: Tensor | float = usual_parameter("c₀₂")

    def change(self, u: Float[Tensor, "... n"], w: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        u, w = u.clamp(-1, 1), w.clamp(-1, 1)
        second = self.c20 * (3 * u * u - 1) / 2 + self.c02 * (3 * w * w - 1) / 2
        return self.c10 * u + self.c01 * w + self.c11 * u * w + second


class _Shaped(OverFloor):
    """A change a of one part of the floor; b is half a width, of a border its softness."""

    refines = (OWN_FAMILY,)
    a: Tensor | float = usual_parameter("a")

    def in_metres(self, name: str) -> tuple[float, float] | None:
        """Return the half-span, and for a place where its zero lies, both in m; None of what is no length."""
        if name not in ("u_0", "w_0", "d", "b") or self.square is None:
            return None
        x, y, half = self.square
        phi = float(getattr(self, "phi", 0.0))
        return half, {"u_0": x, "w_0": y, "d": x * math.cos(phi) + y * math.sin(phi)}.get(name, 0.0)


class BorderOnFloor(_Shaped):
    """a/(1 + exp(−t/b)) at a distance t from a border."""

    form = "border"
    formula = "{quantity} ← {quantity} + a/(1 + exp(−t/b)), t = x cos φ + y sin φ − d"
    in_words = "{quantity} changes by {a} beyond the line x cos φ + y sin φ = {d}, φ = {phi}, within {b}"
    phi: Tensor | float = parameter("φ", "rad", -3.2, 3.2, vanishing=None, start=0.0)
    d: Tensor | float = parameter("d", "–", -0.9, 0.9, vanishing=None, start=0.0)
    b: Tensor | float = parameter("b", "–", 0.01, 0.3, vanishing=None, start=0.1)

    def change(self, u: Float[Tensor, "... n"], w: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        return self.a * torch.sigmoid(_distance(u, w, self.phi, self.d) / self.b)


class SpotOnFloor(_Shaped):
    """a exp(−(s/b)²ⁿ) at a distance s from the middle of a spot."""

    form = "spot"
    formula = "{quantity} ← {quantity} + a exp(−(s/b)²ⁿ), s² = (x − u₀)² + (y − w₀)²"
    in_words = "{quantity} changes by {a} in a spot about ({u_0}, {w_0}), {b} in radius, its edge of sharpness {n}"
    u_0: Tensor | float = parameter("u₀", "–", -1.1, 1.1, vanishing=None, start=0.0)
    w_0: Tensor | float = parameter("w₀", "–", -1.1, 1.1, vanishing=None, start=0.0)
    b: Tensor | float = parameter("b", "–", 0.1, 1.2, vanishing=None, start=0.5)
    n: Tensor | float = parameter("n", "–", *SHARPNESS, vanishing=None, start=3.0)

    def change(self, u: Float[Tensor, "... n"], w: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        return self.a * within_part((u - self.u_0).square() + (w - self.w_0).square(), self.b, self.n)


class StripOnFloor(_Shaped):
    """a exp(−(t/b)²ⁿ) at a distance t from the middle line of a strip."""

    form = "strip"
    formula = "{quantity} ← {quantity} + a exp(−(t/b)²ⁿ), t = x cos φ + y sin φ − d"
    in_words = (
        "{quantity} changes by {a} on a strip about the line x cos φ + y sin φ = {d}, φ = {phi}, {b} to each side, "
        "edges of sharpness {n}"
    )
    phi: Tensor | float = parameter("φ", "rad", -1.6, 1.6, vanishing=None, start=0.0)
    d: Tensor | float = parameter("d", "–", -1.0, 1.0, vanishing=None, start=0.0)
    b: Tensor | float = parameter("b", "–", 0.03, 0.6, vanishing=None, start=0.3)
    n: Tensor | float = parameter("n", "–", *SHARPNESS, vanishing=None, start=3.0)

    def change(self, u: Float[Tensor, "... n"], w: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        return self.a * within_part(_distance(u, w, self.phi, self.d).square(), self.b, self.n)


def _distance(
    u: Float[Tensor, "... n"], w: Float[Tensor, "... n"], phi: Tensor | float, d: Tensor | float
) -> Float[Tensor, "... n"]:
    """Distance from a line, along its normal."""
    phi = torch.as_tensor(phi)
    return u * phi.cos() + w * phi.sin() - d
