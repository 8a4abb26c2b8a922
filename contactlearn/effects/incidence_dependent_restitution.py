"""Restitution depends on the angle at which the contact point comes in."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.curve import CoefficientCurve
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class IncidenceDependentRestitution(Effect):
    """ε is a function of the angle of incidence α = arctan(|v_t|/|v_n|), 0 for a contact that does not slip.

        linear    ε + c α
        curve     ε + s(α), see `contactlearn.effects.curve`

    It is not a dependence on the slip, which grows with the speed too (`slip_dependent_restitution`).
    """

    source = "oblique impact"

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ and ε(α)."""


@dataclass(frozen=True, eq=False)
class LinearIncidenceRestitution(IncidenceDependentRestitution):
    """ε → ε + c α.  It does not level off (`RestitutionOverIncidence`)."""

    form = "linear"
    formula = "ε ← ε + c α, α = arctan(|v_t|/|v_n|)"
    c: Tensor | float = parameter("c", "1/rad", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.c * state.incidence


@dataclass(frozen=True, eq=False)
class RestitutionOverIncidence(CoefficientCurve, IncidenceDependentRestitution):
    """ε → ε + s(α).  It is not proportional to the angle (`LinearIncidenceRestitution`)."""

    form = "curve"
    formula = "ε ← ε + s(α), α = arctan(|v_t|/|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    variable, unit = "α", "rad"

    def along(self, state: State) -> Float[Tensor, "... n"]:
        return state.incidence

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.change(self.along(state))
