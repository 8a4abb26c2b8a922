"""Restitution depends on the angle at which the contact point comes in."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect, parameter
from contactlearn.effects.functions import INCIDENCE, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class IncidenceDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the angle of incidence α = arctan(|v_t|/|v_n|), 0 for a contact that does not slip.

        linear    ε + c α
        curve     ε + s(α), see `functions.Spline`

    It is not a dependence on the slip, which grows with the speed too (`slip_dependent_restitution`).
    """

    spaces = BOTH
    source = "oblique impact"


class LinearIncidenceRestitution(IncidenceDependentRestitution):
    """ε → ε + c α.  It does not level off (`RestitutionOverIncidence`)."""

    form = "linear"
    formula = "ε ← ε + c α, α = arctan(|v_t|/|v_n|)"
    in_words = "ε changes by {c} of incidence"
    c: Tensor | float = parameter("c", "1/rad", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.c * state.incidence


class RestitutionOverIncidence(Spline, IncidenceDependentRestitution):
    """ε → ε + s(α).  It is not proportional to the angle (`LinearIncidenceRestitution`)."""

    form = "curve"
    formula = "ε ← ε + s(α), α = arctan(|v_t|/|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = INCIDENCE
