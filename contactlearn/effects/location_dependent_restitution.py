"""The floor rebounds more in some places than in others."""

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import AlongFloor
from contactlearn.mechanics.space import BOTH


class LocationDependentRestitution(AlongFloor, ChangesRestitution, Effect):
    """ε depends on the place along the floor.  It is not a drift in time (`parameter_drift`)."""

    spaces = BOTH
    formula = "ε ← ε + Σ c_k P_k(u), k = 1 … 5, u = x on its span"
    source = "non-uniform or bending floor"
    mirror_symmetric = False
