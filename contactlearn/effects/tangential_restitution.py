"""What sticks springs back sideways."""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics import effective_inertia


@dataclass(frozen=True, eq=False)
class TangentialRestitution(Effect):
    """Where the contact comes to stick it rebounds: v_t⁺ = −β v_t, as far as the friction cone allows.

        ΔP = s M_c (−(β v_t − u), 0),      s ∈ [0, 1] the largest with |P_t| ≤ μ P_n

    with the part u of v_t that the law itself already turns back; v_n⁺ stays.  A contact that slides
    throughout is on the cone's edge and does not change.  It is not friction against the slip.
    """

    formula = "v_t⁺ ← −β v_t where the contact sticks, within the cone"
    source = "Maw, Barber & Fawcett 1976; Walton 1993"
    adds_energy = True
    beta: Tensor | float = parameter("β", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        direction = state.v_t.sign()
        turned = (-direction * state.contact_after(wrench)[..., 0]).clamp_min(0)
        change = -direction * (self.beta * state.v_t.abs() - turned).clamp_min(0)
        M_c = effective_inertia(state.W)
        t, n = M_c[..., 0, 0] * change, M_c[..., 0, 1] * change
        limit = state.mu * P_n
        share = torch.minimum(_room(limit - P_t, t - state.mu * n), _room(limit + P_t, -t - state.mu * n))
        return columns(P_t + share * t, P_n + share * n, tau)


def _room(left: Tensor, used: Tensor) -> Tensor:
    """Largest share s ≤ 1 of a step that uses s·used of what is left."""
    limited = used > left
    return torch.where(limited, left.clamp_min(0) / torch.where(limited, used, 1.0), 1.0)
