"""The normal impulse acts beside the contact point, on some sides of the body more than on others."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect
from contactlearn.effects.harmonics import ArmAroundBody
from contactlearn.effects.path import retraced
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class OrientationDependentMoment(ArmAroundBody, Effect):
    """The normal impulse acts a_1 cos θ + b_1 sin θ + a_2 cos 2θ + b_2 sin 2θ to the right of the contact point.

    The contact responds while it lasts, so that v_n⁺ stays (`path.retraced`): the true contour of the body differs from
    the nominal one.  It is not an arm that follows the lever r_x (`contact_patch`).
    """

    formula = (
        "τ ← τ + (a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ) P_n while the contact lasts, P_t and P_n responding"
    )
    source = "contour of the body"
    mirror_symmetric = False
    adds_energy = True

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return retraced(state, wrench, arm=self.change(state.theta))
