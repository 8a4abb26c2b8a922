"""The surfaces cling before they part."""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class Adhesion(Effect):
    """The normal impulse loses a constant c, up to all of the rebound.

    It is not a lower restitution, whose loss grows with the speed.
    """

    formula = "P_n ← P_n − c"
    source = "Johnson, Kendall & Roberts 1971"
    c: Tensor | float = parameter("c", "N s", 0.0, 0.05)

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        rebound = (state.contact_after(wrench)[..., 1] / state.W[..., 1, 1]).clamp_min(0)
        return columns(P_t, P_n - torch.minimum(self.c, rebound), tau)
