"""Some sides of the body are rougher than others."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import AroundBody, CurveAroundBody, SpotOnBody
from contactlearn.effects.side_functions import CapOnBody, ContactOnBody, CornersOfBody, FacesOfBody, SidesOfBody


class OrientationDependentFriction(ChangesFriction, Effect):
    """μ is a function of the side on which the body lands.

        harmonics   μ + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform
        spot        μ + a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a rough spot of half-width w about θ_0
        curve       harmonics up to the fourth

    In space of the direction of the floor from the body, in its own axes, or of that of the contact point:

        sides       μ + spherical harmonics of the first and second degree
        cap         μ + a/(1 + (2 sin(γ/2)/w)⁴), one side, γ from its middle
        contact     the same by the direction of the contact point, such as one corner or edge of a polyhedron
        faces       a value for each of the six faces of a box
        corners     a value for each of its eight corners

    It is not a floor that is rougher one way than the other (`directional_friction`).
    """

    source = "non-uniform body"
    mirror_symmetric = False


class HarmonicFriction(AroundBody, OrientationDependentFriction):
    """μ → μ + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ.  It is not one rough spot (`RoughSpot`)."""


class RoughSpot(SpotOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin((θ − θ_0)/2)/w)⁴).  It is not a smooth change all around (`HarmonicFriction`)."""


class FrictionAroundBody(CurveAroundBody, OrientationDependentFriction):
    """μ → μ + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4.  It has no edge (`RoughSpot`)."""


class FrictionOfSides(SidesOfBody, OrientationDependentFriction):
    """μ → μ + spherical harmonics of the direction of the floor.  It has no edge (`FrictionOfCap`)."""


class FrictionOfCap(CapOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin(γ/2)/w)⁴).  It is one side of the body (`FrictionOfSides`)."""


class FrictionOfContact(ContactOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin(γ/2)/w)⁴) by the contact point: one corner of any body (`FrictionOfCorners`)."""


class FrictionOfFaces(FacesOfBody, OrientationDependentFriction):
    """Each of the six faces of a box has its μ: of the face that is nearest to the floor (`FrictionOfCorners`)."""


class FrictionOfCorners(CornersOfBody, OrientationDependentFriction):
    """Each of the eight corners of a box has its μ, by the signs s of the contact point (`FrictionOfFaces`)."""

    usual_range = ("–", -0.2, 0.2)  # of one of seven: together they reach what no pair of surfaces has
