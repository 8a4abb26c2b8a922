"""Friction depends on the angle at which the contact point comes in."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import CurveOverIncidence, LinearInIncidence
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


class LinearIncidenceFriction(LinearInIncidence, IncidenceDependentFriction):
    """μ → μ + c α.  It does not level off (`FrictionOverIncidence`)."""


class FrictionOverIncidence(CurveOverIncidence, IncidenceDependentFriction):
    """μ → μ + s(α).  It is not proportional to the angle (`LinearIncidenceFriction`)."""
