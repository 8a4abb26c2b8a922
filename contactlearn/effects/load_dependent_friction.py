"""Friction depends on how hard the impact is."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesFriction, Effect, parameter
from contactlearn.effects.functions import APPROACH, SpeedReference, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class LoadDependentFriction(ChangesFriction, Effect):
    """μ is a function of the speed of approach, which stands for the load.

        power    μ (|v_n|/v_ref)^p
        curve    μ + s(|v_n|), see `functions.Spline`

    It is not a dependence on the slip (`velocity_dependent_friction`).
    """

    spaces = BOTH
    source = "Hertzian contact, p = −1/3 of the load: Bowden & Tabor 1950"
    citations = ("bowden1950",)
    speed = APPROACH


class PowerLawFriction(SpeedReference, LoadDependentFriction):
    """μ → μ (|v_n|/v_ref)^p.  It either grows or falls at every speed (`FrictionOverLoad`)."""

    form = "power"
    formula = "μ ← μ (|v_n|/v_ref)^p"
    in_words = "μ changes by {p:doubled} when the approach speed doubles"
    p: Tensor | float = parameter("p", "–", -2.0, 2.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value * self.ratio(state) ** self.p


class FrictionOverLoad(Spline, LoadDependentFriction):
    """μ → μ + s(|v_n|).  It is no law of the load (`PowerLawFriction`)."""

    formula = "μ ← μ + s(|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = APPROACH
