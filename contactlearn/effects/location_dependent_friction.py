"""The floor is rougher in some places than in others."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import AlongFloor
from contactlearn.mechanics.space import BOTH


class LocationDependentFriction(AlongFloor, ChangesFriction, Effect):
    """μ depends on the place along the floor.  It is not a drift in time (`parameter_drift`)."""

    spaces = BOTH
    formula = "μ ← μ + Σ c_k P_k(u), k = 1 … 5, u = x on its span"
    source = "worn or soiled floor"
    mirror_symmetric = False
