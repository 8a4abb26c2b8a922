"""The surfaces cling before they part."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class Adhesion(Effect):
    """Parting costs something that does not grow with the speed, up to all of the rebound.

        impulse    P_n → P_n − c
        work       v_n⁺ → √(v_n⁺² − 2 w W_nn), by P_n alone

    P_t stays: adhesion carries the friction as a load would, so P_t may exceed μ P_n.  It is not a lower
    restitution, whose loss grows with the speed.
    """

    formula: ClassVar = {"impulse": "P_n ← P_n − c, at most the rebound", "work": "v_n⁺ ← √(v_n⁺² − 2 w W_nn), by P_n"}
    source = "Johnson, Kendall & Roberts 1971"
    c: Tensor | float = parameter("c", "N s", 0.0, 0.05, form="impulse")
    w: Tensor | float = parameter("w", "J", 0.0, 0.1, form="work")
    form: str = "impulse"

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        rebound, w_nn = state.contact_after(wrench)[..., 1].clamp_min(0), state.W[..., 1, 1]
        if self.form == "impulse":
            return columns(P_t, P_n - torch.minimum(self.c, rebound / w_nn), tau)
        left = rebound.square() - 2 * self.w * w_nn
        parts = left > 0
        slower = torch.where(parts, torch.where(parts, left, 1.0).sqrt(), 0.0)
        return columns(P_t, P_n - (rebound - slower) / w_nn, tau)
