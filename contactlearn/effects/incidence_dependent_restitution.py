"""Restitution depends on the angle at which the contact point comes in."""

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import CurveOverIncidence, LinearInIncidence
from contactlearn.mechanics.space import BOTH


class IncidenceDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the angle of incidence α = arctan(|v_t|/|v_n|), 0 for a contact that does not slip.

        linear    ε + c α
        curve     ε + s(α), see `functions.Spline`

    It is not a dependence on the slip, which grows with the speed too (`slip_dependent_restitution`).
    """

    spaces = BOTH
    source = "oblique impact"


class LinearIncidenceRestitution(LinearInIncidence, IncidenceDependentRestitution):
    """ε → ε + c α.  It does not level off (`RestitutionOverIncidence`)."""


class RestitutionOverIncidence(CurveOverIncidence, IncidenceDependentRestitution):
    """ε → ε + s(α).  It is not proportional to the angle (`LinearIncidenceRestitution`)."""
