"""The contact is a patch, and its centre of pressure moves."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class ContactPatch(Effect):
    """τ → τ − k r_x P_n + c P_n: the centre of pressure lies −k r_x + c from the contact point.

    It is not a resistance to rolling, which follows the spin (`rolling_resistance`).
    """

    formula = "τ ← τ − k r_x P_n + c P_n"
    source = "finite contact area"
    mirror_symmetric = False
    adds_energy = True
    k: Tensor | float = parameter("k", "–", -1.0, 1.0)
    c: Tensor | float = parameter("c", "m", -0.01, 0.01)

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        return columns(P_t, P_n, tau + (self.c - self.k * state.r[..., 0]) * P_n)
