"""Some sides of the body are softer than others."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import AroundBody, CurveAroundBody, SpotOnBody
from contactlearn.effects.side_functions import CapOnBody, ContactOnBody, CornersOfBody, FacesOfBody, SidesOfBody
from contactlearn.effects.state import State


class OrientationDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the side on which the body lands.

        harmonics   ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform
        spot        ε − a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a soft spot of half-width w about θ_0
        curve       harmonics up to the fourth

    In space of the direction of the floor from the body, in its own axes, or of that of the contact point:

        sides       ε + spherical harmonics of the first and second degree
        cap         ε + a/(1 + (2 sin(γ/2)/w)⁴), one side, γ from its middle
        contact     the same by the direction of the contact point, such as one corner or edge of a polyhedron
        faces       a value for each of the six faces of a box
        corners     a value for each of its eight corners

    It is not a loss that comes with the lever arm r_x (`configuration_dependent_restitution`).
    """

    source = "non-uniform body"
    mirror_symmetric = False


class HarmonicRestitution(AroundBody, OrientationDependentRestitution):
    """ε → ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ.  It is not one soft spot (`SoftSpot`)."""


class SoftSpot(SpotOnBody, OrientationDependentRestitution):
    """ε → ε − a/(1 + (2 sin((θ − θ_0)/2)/w)⁴).  It is not a smooth change all around (`HarmonicRestitution`)."""

    formula = "ε ← ε − a/(1 + (2 sin((θ − θ₀)/2)/w)⁴)"
    in_words = "ε changes by {a:-} about θ = {theta_0}, within ±{w}"

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value - self.change(state.theta)


class RestitutionAroundBody(CurveAroundBody, OrientationDependentRestitution):
    """ε → ε + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4.  It has no edge (`SoftSpot`)."""


class RestitutionOfSides(SidesOfBody, OrientationDependentRestitution):
    """ε → ε + spherical harmonics of the direction of the floor.  It has no edge (`RestitutionOfCap`)."""


class RestitutionOfCap(CapOnBody, OrientationDependentRestitution):
    """ε → ε + a/(1 + (2 sin(γ/2)/w)⁴).  It is one side of the body (`RestitutionOfSides`)."""


class RestitutionOfContact(ContactOnBody, OrientationDependentRestitution):
    """ε → ε + a/(1 + (2 sin(γ/2)/w)⁴) by the contact point: one corner of any body (`RestitutionOfCorners`)."""


class RestitutionOfFaces(FacesOfBody, OrientationDependentRestitution):
    """Each of the six faces of a box has its ε: of the face that is nearest to the floor (`RestitutionOfCorners`)."""


class RestitutionOfCorners(CornersOfBody, OrientationDependentRestitution):
    """Each of the eight corners of a box has its ε, by the signs s of the contact point (`RestitutionOfFaces`)."""
