"""Oblique impacts rebound differently."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.curve import CoefficientCurve
from contactlearn.effects.speed import SpeedReference
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class SlipDependentRestitution(Effect):
    """ε is a function of the slip before contact.

        linear    ε + c |v_t|/v_ref
        curve     ε + s(|v_t|), see `contactlearn.effects.curve`

    It is not a dependence on the speed of approach (`velocity_dependent_restitution`).
    """

    source = "oblique impact"
    component = 0

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ and ε(|v_t|)."""


@dataclass(frozen=True, eq=False)
class LinearSlipRestitution(SpeedReference, SlipDependentRestitution):
    """ε → ε + c |v_t|/v_ref.  It does not level off (`RestitutionOverSlip`)."""

    form = "linear"
    formula = "ε ← ε + c |v_t|/v_ref"
    c: Tensor | float = parameter("c", "–", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.c * state.v_t.abs() / known(self.v_ref)


@dataclass(frozen=True, eq=False)
class RestitutionOverSlip(CoefficientCurve, SlipDependentRestitution):
    """ε → ε + s(|v_t|).  It is not proportional to the slip (`LinearSlipRestitution`)."""

    form = "curve"
    formula = "ε ← ε + s(|v_t|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    variable, unit = "|v_t|", "m/s"

    def along(self, state: State) -> Float[Tensor, "... n"]:
        return state.v_t.abs()

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.change(self.along(state))
