"""Contacts rub differently at another temperature, by another operator, from another batch."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import ByGroup, CovariateCurve, LinearInCovariate


class CovariateDependentFriction(ChangesFriction, Effect):
    """μ depends on a covariate of the table, a quantity u of each trial that is not of the contact.

        linear   μ + c (u − ū)/Δu
        curve    μ + s(u), see `functions.Spline`
        group    μ + Δ(group), of named groups or few distinct numbers

    It is not a change in time, which a covariate that drifts would show too (`parameter_drift`).
    """


class FrictionLinearInCovariate(LinearInCovariate, CovariateDependentFriction):
    """μ → μ + c (u − ū)/Δu.  It does not bend (`FrictionCovariateCurve`)."""


class FrictionCovariateCurve(CovariateCurve, CovariateDependentFriction):
    """μ → μ + s(u).  It is no straight line (`FrictionLinearInCovariate`)."""


class FrictionByGroup(ByGroup, CovariateDependentFriction):
    """μ → μ + Δ(group).  It is no dependence on the body (`body_dependent_friction`)."""
