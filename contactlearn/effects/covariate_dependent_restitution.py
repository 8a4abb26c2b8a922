"""Bodies rebound differently at another temperature, by another operator, from another batch."""

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import ByGroup, CovariateCurve, LinearInCovariate


class CovariateDependentRestitution(ChangesRestitution, Effect):
    """ε depends on a covariate of the table, a quantity u of each trial that is not of the contact.

        linear   ε + c (u − ū)/Δu
        curve    ε + s(u), see `functions.Spline`
        group    ε + Δ(group), of named groups or few distinct numbers

    It is not a change in time, which a covariate that drifts would show too (`parameter_drift`).
    """


class RestitutionLinearInCovariate(LinearInCovariate, CovariateDependentRestitution):
    """ε → ε + c (u − ū)/Δu.  It does not bend (`RestitutionCovariateCurve`)."""


class RestitutionCovariateCurve(CovariateCurve, CovariateDependentRestitution):
    """ε → ε + s(u).  It is no straight line (`RestitutionLinearInCovariate`)."""


class RestitutionByGroup(ByGroup, CovariateDependentRestitution):
    """ε → ε + Δ(group).  It is no dependence on the body (`body_dependent_restitution`)."""
