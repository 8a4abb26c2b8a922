"""The contact is a patch, and its centre of pressure moves."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.path import retraced
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class ContactPatch(Effect):
    """The normal impulse acts c − k r_x to the right of the contact point: τ → τ + (c − k r_x) P_n.

    The contact responds while it lasts, so that v_n⁺ stays (`path.retraced`).  It is not a resistance to
    rolling, which follows the spin (`rolling_resistance`).
    """

    formula = "τ ← τ − k r_x P_n + c P_n while the contact lasts, P_t and P_n responding"
    source = "finite contact area"
    mirror_symmetric = False
    adds_energy = True
    k: Tensor | float = parameter("k", "–", -1.0, 1.0)
    c: Tensor | float = parameter("c", "m", -0.01, 0.01)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return retraced(state, wrench, arm=self.c - self.k * state.r[..., 0])
