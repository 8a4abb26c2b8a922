"""The normal impulse acts beside the contact point, on some sides of the body more than on others."""

from abc import abstractmethod

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect
from contactlearn.effects.functions import ARM, AroundBody, CurveAroundBody, SpotOnBody
from contactlearn.effects.impulse_path import perturbed_path
from contactlearn.effects.state import State, altered


class OrientationDependentMoment(Effect):
    """The normal impulse acts at an arm to the right of the contact point that depends on the side that lands.

        harmonics   a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ
        spot        a/(1 + (2 sin((θ − θ_0)/2)/w)⁴), a bump of half-width w about θ_0
        curve       harmonics up to the fourth, such as three feet
        after       harmonics, of the impulse that the law gives

    In all but `after` the contact responds while it lasts, so that v_n⁺ stays (`perturbed_path`): the true contour of
    the body differs from the nominal one.  It is not an arm that follows the lever r_x (`contact_patch`).
    """

    quantity = "the arm"
    usual_range = ARM
    source = "contour of the body"
    mirror_symmetric = False
    adds_energy = True
    like_shape = True

    @abstractmethod
    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Return the arm [..., N] in m at orientations θ [..., N] in rad."""

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return perturbed_path(state, wrench, arm=self.change(state.theta))


class HarmonicMoment(AroundBody, OrientationDependentMoment):
    """The arm is a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ.  It is not one bump (`MomentOfBump`)."""

    formula = (
        "τ ← τ + (a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ) P_n while the contact lasts, P_t and P_n responding"
    )


class MomentAfterContact(AroundBody, OrientationDependentMoment):
    """The arm is a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ, of the impulse that the law gives.

    The contact does not respond to it (`HarmonicMoment`).
    """

    form = "after"
    formula = "τ ← τ + (a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ) P_n"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return altered(wrench, 2, self.change(state.theta) * wrench[..., 1])


class MomentOfBump(SpotOnBody, OrientationDependentMoment):
    """The arm is a/(1 + (2 sin((θ − θ_0)/2)/w)⁴).  It is not a smooth change all around (`HarmonicMoment`)."""

    formula = "τ ← τ + a/(1 + (2 sin((θ − θ₀)/2)/w)⁴) P_n while the contact lasts, P_t and P_n responding"
    in_words = "the normal impulse acts at an arm of {a} about θ = {theta_0}, within ±{w}"


class MomentAroundBody(CurveAroundBody, OrientationDependentMoment):
    """The arm is Σ a_k cos kθ + b_k sin kθ, k = 1 … 4.  It has no edge (`MomentOfBump`)."""

    formula = "τ ← τ + (Σ a_k cos kθ + b_k sin kθ) P_n while the contact lasts, k = 1 … 4, P_t and P_n responding"
