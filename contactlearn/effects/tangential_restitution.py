"""What sticks springs back sideways."""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics import effective_inertia

_ROUNDING = 1e-9  # relative: nearer to its edge a contact counts as on the cone


@dataclass(frozen=True, eq=False)
class TangentialRestitution(Effect):
    """Where the slip has come to an end it rebounds: v_t⁺ → v_t⁺ − β v_t, as far as the friction cone allows.

        ΔP = −s M_c (β v_t, 0),      s ∈ [0, 1] the largest with |P_t| ≤ μ P_n;  v_n⁺ stays

    So v_t⁺ = −β v_t of a contact that sticks; one that slides throughout is on the cone's edge and does not
    change.  It is not friction against the slip.
    """

    formula = "v_t⁺ ← v_t⁺ − β v_t within the cone"
    source = "Maw, Barber & Fawcett 1976; Walton 1993"
    adds_energy = True
    beta: Tensor | float = parameter("β", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        direction, M_c = -state.v_t.sign(), effective_inertia(state.W)
        t, n = M_c[..., 0, 0] * direction, M_c[..., 0, 1] * direction  # impulse per change of v_t, kg
        limit = state.mu * P_n
        room = torch.minimum(_room(limit - P_t, t - state.mu * n), _room(limit + P_t, -t - state.mu * n))
        change = torch.minimum(self.beta * state.v_t.abs(), room)
        change = torch.where(room < _ROUNDING * state.v_c.norm(dim=-1), 0.0, change)
        return columns(P_t + change * t, P_n + change * n, tau)


def _room(left: Tensor, rate: Tensor) -> Tensor:
    """Change of v_t, m/s, that uses up what is left of the cone."""
    return torch.where(rate > 0, left / torch.where(rate > 0, rate, 1.0), torch.inf)
