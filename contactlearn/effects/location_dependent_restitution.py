"""The floor rebounds more in some places than in others."""

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.floor_functions import BorderOnFloor, FieldOverFloor, SpotOnFloor, StripOnFloor
from contactlearn.effects.functions import AlongFloor, StretchOfFloor


class LocationDependentRestitution(ChangesRestitution, Effect):
    """ε depends on the place on the floor.

        along      ε + Σ c_k P_k(u), k = 1 … 5, along x, see `functions.AlongFloor`
        stretch    in the plane a stretch of the floor
        field      in space a smooth function of x and y
        border     in space another half of the floor, whose border has any bearing
        spot       in space a round spot
        strip      in space a strip of any bearing, such as tape

    It is not a drift in time (`parameter_drift`).
    """

    source = "non-uniform or bending floor"
    mirror_symmetric = False


class RestitutionAlongFloor(AlongFloor, LocationDependentRestitution):
    """ε → ε + Σ c_k P_k(u).  It is the same along y (`RestitutionOverFloor`)."""


class RestitutionOfStretch(StretchOfFloor, LocationDependentRestitution):
    """ε → ε + a exp(−(t/b)²ⁿ), t from the middle of a stretch.  It has edges (`RestitutionAlongFloor`)."""


class RestitutionOverFloor(FieldOverFloor, LocationDependentRestitution):
    """ε → ε + Σ c_ij P_i(u) P_j(w), i + j = 1, 2.  It has no edge (`RestitutionBorder`)."""


class RestitutionBorder(BorderOnFloor, LocationDependentRestitution):
    """ε → ε + a/(1 + exp(−t/b)), t beyond a border.  It is no field without an edge (`RestitutionOverFloor`)."""


class RestitutionSpot(SpotOnFloor, LocationDependentRestitution):
    """ε → ε + a exp(−(s/b)²ⁿ), s from the middle of a spot.  It is no strip (`RestitutionStrip`)."""


class RestitutionStrip(StripOnFloor, LocationDependentRestitution):
    """ε → ε + a exp(−(t/b)²ⁿ), t from the middle of a strip.  It has two borders (`RestitutionBorder`)."""
