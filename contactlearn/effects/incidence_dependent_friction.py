"""Friction depends on the angle at which the contact point comes in."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesFriction, Effect, parameter
from contactlearn.effects.functions import INCIDENCE, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class IncidenceDependentFriction(ChangesFriction, Effect):
    """μ is a function of the angle of incidence α = arctan(|v_t|/|v_n|), 0 for a contact that does not slip.

        linear    μ + c α
        curve     μ + s(α), see `functions.Spline`

    It is not a dependence on the slip, which grows with the speed too (`velocity_dependent_friction`).
    """

    spaces = BOTH
    source = "Maw, Barber & Fawcett 1976"
    citations = ("maw1976",)


class LinearIncidenceFriction(IncidenceDependentFriction):
    """μ → μ + c α.  It does not level off (`FrictionOverIncidence`)."""

    form = "linear"
    formula = "μ ← μ + c α, α = arctan(|v_t|/|v_n|)"
    in_words = "μ changes by {c} of incidence"
    c: Tensor | float = parameter("c", "1/rad", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.c * state.incidence


class FrictionOverIncidence(Spline, IncidenceDependentFriction):
    """μ → μ + s(α).  It is not proportional to the angle (`LinearIncidenceFriction`)."""

    form = "curve"
    formula = "μ ← μ + s(α), α = arctan(|v_t|/|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = INCIDENCE
