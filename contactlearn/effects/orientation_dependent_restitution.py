"""Some sides of the body are softer than others."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import AroundBody, CurveAroundBody, SpotOnBody
from contactlearn.effects.state import State


class OrientationDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the side on which the body lands.

        harmonics   ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, a body that is not uniform
        spot        ε − a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a soft spot of half-width w about θ_0
        curve       harmonics up to the fourth

    It is not a loss that comes with the lever arm r_x (`configuration_dependent_restitution`).
    """

    source = "non-uniform body"
    mirror_symmetric = False


class HarmonicRestitution(AroundBody, OrientationDependentRestitution):
    """ε → ε + a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ.  It is not one soft spot (`SoftSpot`)."""

    form = "harmonics"
    formula = "ε ← ε + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ"
    in_words = "around the body ε changes by {a1} cos θ, {b1} sin θ, {a2} cos 2θ and {b2} sin 2θ"


class SoftSpot(SpotOnBody, OrientationDependentRestitution):
    """ε → ε − a/(1 + (2 sin((θ − θ_0)/2)/w)⁴).  It is not a smooth change all around (`HarmonicRestitution`)."""

    form = "spot"
    formula = "ε ← ε − a/(1 + (2 sin((θ − θ₀)/2)/w)⁴)"
    in_words = "ε changes by {a:-} about θ = {theta_0}, within ±{w}"

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value - self.change(state.theta)


class RestitutionAroundBody(CurveAroundBody, OrientationDependentRestitution):
    """ε → ε + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4.  It has no edge (`SoftSpot`)."""

    form = "curve"
    formula = "ε ← ε + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4"
