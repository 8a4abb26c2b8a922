"""What sticks springs back sideways."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics import effective_inertia

_ROUNDING = 1e-9  # relative: nearer to its edge a contact counts as on the cone


@dataclass(frozen=True, eq=False)
class TangentialRestitution(Effect):
    """Where the slip has come to an end it rebounds, as far as the friction cone allows; v_n⁺ stays.

        v_t⁺ → v_t⁺ − s β (|v_t| + ½ ⟨−s W_tn P_n⟩),      s = sign v_t, ⟨x⟩ = x where x > 0 and 0 elsewhere

    A tangent that yields gives back a share β of the slip that it stopped.  And it answers late: where the
    normal impulse drives the contact back, at W_tn P_n, a part of that goes unresisted.  Where it drives on,
    the tangent is stretched against it already, and nothing is added.  One that slides throughout is on the cone's
    edge and does not change.  The impulse is M_c times the change.  It is not friction against the slip.
    """

    formula = "v_t⁺ ← v_t⁺ − s β (|v_t| + ½⟨−s W_tn P_n⟩) within the cone, s = sign v_t"
    source = "Maw, Barber & Fawcett 1976; Walton 1993"
    citations = (
        "maw1976",
        "walton1993",
    )
    adds_energy = True
    beta: Tensor | float = parameter("β", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        P_t, P_n, tau = wrench.unbind(-1)
        direction, M_c = -state.v_t.sign(), effective_inertia(state.W)
        t, n = M_c[..., 0, 0] * direction, M_c[..., 0, 1] * direction  # impulse per change of v_t, kg
        limit = state.mu * P_n
        room = torch.minimum(_room(limit - P_t, t - state.mu * n), _room(limit + P_t, -t - state.mu * n))
        back = (direction * state.W[..., 0, 1] * P_n).clamp_min(0)  # m/s that the coupling drives against the slip
        change = torch.minimum(self.beta * (state.v_t.abs() + back / 2), room)
        change = torch.where(room < _ROUNDING * state.v_c.norm(dim=-1), 0.0, change)
        return columns(P_t + change * t, P_n + change * n, tau)


def _room(distance: Float[Tensor, "..."], rate: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Change of v_t, m/s, at which an impulse that approaches the edge of the cone at `rate` reaches it."""
    return torch.where(rate > 0, distance / torch.where(rate > 0, rate, 1.0), torch.inf)
