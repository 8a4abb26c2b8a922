"""Some sides of the body are rougher than others."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import AroundBody, CurveAroundBody, SpotOnBody


class OrientationDependentFriction(ChangesFriction, Effect):
    """μ is a function of the side on which the body lands.

        harmonics   μ + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform
        spot        μ + a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a rough spot of half-width w about θ_0
        curve       harmonics up to the fourth

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
