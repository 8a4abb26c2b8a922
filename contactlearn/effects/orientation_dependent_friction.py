"""Some sides of the body are rougher than others."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import AroundBody, CurveAroundBody, SpotOnBody
from contactlearn.effects.side_functions import CapOnBody, CornersOfBody, FacesOfBody, SidesOfBody


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

    form = "harmonics"
    formula = "μ ← μ + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ"
    in_words = "around the body μ changes by {a1} cos θ, {b1} sin θ, {a2} cos 2θ and {b2} sin 2θ"


class RoughSpot(SpotOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin((θ − θ_0)/2)/w)⁴).  It is not a smooth change all around (`HarmonicFriction`)."""

    form = "spot"
    formula = "μ ← μ + a/(1 + (2 sin((θ − θ₀)/2)/w)⁴)"
    in_words = "μ changes by {a} about θ = {theta_0}, within ±{w}"


class FrictionAroundBody(CurveAroundBody, OrientationDependentFriction):
    """μ → μ + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4.  It has no edge (`RoughSpot`)."""

    form = "curve"
    formula = "μ ← μ + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4"


class FrictionOfSides(SidesOfBody, OrientationDependentFriction):
    """μ → μ + spherical harmonics of the direction of the floor.  It has no edge (`FrictionOfCap`)."""

    form = "sides"
    formula = "μ ← μ + Σ a_i n_i + b_xx (n_x² − n_z²) + b_yy (n_y² − n_z²) + Σ b_ij n_i n_j, n to the floor"


class FrictionOfCap(CapOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin(γ/2)/w)⁴).  It is one side of the body (`FrictionOfSides`)."""

    form = "cap"
    formula = "μ ← μ + a/(1 + (2 sin(γ/2)/w)⁴), γ from (λ, β) to the floor"
    in_words = "μ changes by {a} on the side at longitude {longitude} and latitude {latitude}, within ±{w}"
    refines = ("orientation_dependent_friction",)


class FrictionOfContact(CapOnBody, OrientationDependentFriction):
    """μ → μ + a/(1 + (2 sin(γ/2)/w)⁴) by the contact point: one corner of any body (`FrictionOfCorners`)."""

    form = "contact"
    formula = "μ ← μ + a/(1 + (2 sin(γ/2)/w)⁴), γ from (λ, β) to the contact point"
    in_words = "μ changes by {a} in contacts at longitude {longitude} and latitude {latitude}, within ±{w}"
    refines = ("orientation_dependent_friction",)
    of_contact_point = True


class FrictionOfFaces(FacesOfBody, OrientationDependentFriction):
    """Each of the six faces of a box has its μ: of the face that is nearest to the floor (`FrictionOfCorners`)."""

    form = "faces"
    formula = "μ ← μ + Δ of the face ±x, ±y, ±z of the body that is lowest"
    refines = ("orientation_dependent_friction",)


class FrictionOfCorners(CornersOfBody, OrientationDependentFriction):
    """Each of the eight corners of a box has its μ, by the signs s of the contact point (`FrictionOfFaces`)."""

    form = "corners"
    formula = "μ ← μ + Σ a_i s_i + Σ b_ij s_i s_j + c s_x s_y s_z, s signs of the contact point in the body's axes"
    refines = ("orientation_dependent_friction",)
    usual_range = ("–", -0.2, 0.2)  # of one of seven: together they reach what no pair of surfaces has
