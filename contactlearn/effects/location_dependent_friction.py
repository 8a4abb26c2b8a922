"""The floor is rougher in some places than in others."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.floor_functions import BorderOnFloor, FieldOverFloor, SpotOnFloor, StripOnFloor
from contactlearn.effects.functions import AlongFloor, StretchOfFloor


class LocationDependentFriction(ChangesFriction, Effect):
    """μ depends on the place on the floor.

        along      μ + Σ c_k P_k(u), k = 1 … 5, along x, see `functions.AlongFloor`
        stretch    in the plane a stretch of the floor
        field      in space a smooth function of x and y
        border     in space another half of the floor, whose border has any bearing
        spot       in space a round spot
        strip      in space a strip of any bearing, such as tape

    It is not a drift in time (`parameter_drift`).
    """

    source = "worn or soiled floor"
    mirror_symmetric = False


class FrictionAlongFloor(AlongFloor, LocationDependentFriction):
    """μ → μ + Σ c_k P_k(u).  It is the same along y (`FrictionOverFloor`)."""


class FrictionOfStretch(StretchOfFloor, LocationDependentFriction):
    """μ → μ + a exp(−(t/b)²ⁿ), t from the middle of a stretch.  It has edges (`FrictionAlongFloor`)."""


class FrictionOverFloor(FieldOverFloor, LocationDependentFriction):
    """μ → μ + Σ c_ij P_i(u) P_j(w), i + j = 1, 2.  It has no edge (`FrictionBorder`)."""


class FrictionBorder(BorderOnFloor, LocationDependentFriction):
    """μ → μ + a/(1 + exp(−t/b)), t beyond a border.  It is no field without an edge (`FrictionOverFloor`)."""


class FrictionSpot(SpotOnFloor, LocationDependentFriction):
    """μ → μ + a exp(−(s/b)²ⁿ), s from the middle of a spot.  It is no strip (`FrictionStrip`)."""


class FrictionStrip(StripOnFloor, LocationDependentFriction):
    """μ → μ + a exp(−(t/b)²ⁿ), t from the middle of a strip.  It has two borders (`FrictionBorder`)."""
