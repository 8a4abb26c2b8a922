"""Oblique impacts rebound differently."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect, parameter
from contactlearn.effects.functions import SLIP, SpeedReference, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class SlipDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the slip before contact.

        linear    ε + c |v_t|/v_ref
        curve     ε + s(|v_t|), see `functions.Spline`

    It is not a dependence on the speed of approach (`velocity_dependent_restitution`).
    """

    spaces = BOTH
    source = "oblique impact"
    speed = SLIP


class LinearSlipRestitution(SpeedReference, SlipDependentRestitution):
    """ε → ε + c |v_t|/v_ref.  It does not level off (`RestitutionOverSlip`)."""

    form = "linear"
    formula = "ε ← ε + c |v_t|/v_ref"
    in_words = "ε changes by {c} times the slip speed over its median"
    c: Tensor | float = parameter("c", "–", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.c * self.ratio(state)


class RestitutionOverSlip(Spline, SlipDependentRestitution):
    """ε → ε + s(|v_t|).  It is not proportional to the slip (`LinearSlipRestitution`)."""

    formula = "ε ← ε + s(|v_t|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = SLIP
