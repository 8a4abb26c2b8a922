"""Friction depends on the angle at which the contact point comes in."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.curve import CoefficientCurve
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class IncidenceDependentFriction(Effect):
    """μ is a function of the angle of incidence α = arctan(|v_t|/|v_n|), 0 for a contact that does not slip.

        linear    μ + c α
        curve     μ + s(α), see `contactlearn.effects.curve`

    It is not a dependence on the slip, which grows with the speed too (`velocity_dependent_friction`).
    """

    source = "Maw, Barber & Fawcett 1976"
    citations = ("maw1976",)

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ(α) and ε."""


@dataclass(frozen=True, eq=False)
class LinearIncidenceFriction(IncidenceDependentFriction):
    """μ → μ + c α.  It does not level off (`FrictionOverIncidence`)."""

    form = "linear"
    formula = "μ ← μ + c α, α = arctan(|v_t|/|v_n|)"
    c: Tensor | float = parameter("c", "1/rad", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.c * state.incidence, eps


@dataclass(frozen=True, eq=False)
class FrictionOverIncidence(CoefficientCurve, IncidenceDependentFriction):
    """μ → μ + s(α).  It is not proportional to the angle (`LinearIncidenceFriction`)."""

    form = "curve"
    formula = "μ ← μ + s(α), α = arctan(|v_t|/|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    variable, unit = "α", "rad"

    def along(self, state: State) -> Float[Tensor, "... n"]:
        return state.incidence

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.change(self.along(state)), eps
