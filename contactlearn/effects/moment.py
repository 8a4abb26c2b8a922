"""A moment that acts while the contact lasts, so that the contact responds to it."""

import torch
from torch import Tensor

from contactlearn.effects.state import State, columns

_STICKS = 1e-9  # final slip over the speed before contact


def with_arm(state: State, wrench: Tensor, arm: Tensor) -> Tensor:
    """The wrench with τ + arm P_n, for a normal impulse whose line of action lies `arm` [..., N] in m to the right.

    P_n and P_t respond so that v_n⁺ stays what the law made it, and v_t⁺ too where the contact sticks; where it
    slides ΔP_t = ∓μ ΔP_n against the final slip.  Linear equations in (ΔP_t, ΔP_n), solved exactly.
    """
    P_t, P_n, tau = wrench.unbind(-1)
    w_tt, w_tn, w_nn = state.W[..., 0, 0], state.W[..., 0, 1], state.W[..., 1, 1]
    turn_t, turn_n = (lever * arm / state.inertia for lever in (-state.r[..., 1], state.r[..., 0]))  # Δv_c per P_n
    slip = state.contact_after(wrench)[..., 0]
    sticks = slip.abs() <= _STICKS * state.v_c.norm(dim=-1)
    slope = -slip.sign() * state.mu
    n_slide = -turn_n * P_n / (w_nn + turn_n + slope * w_tn)
    # Sticking: W_tt t + (W_tn + turn_t) n = −turn_t P_n,  W_tn t + (W_nn + turn_n) n = −turn_n P_n.
    det = w_tt * (w_nn + turn_n) - w_tn * (w_tn + turn_t)
    n_stick = (w_tn * turn_t - w_tt * turn_n) * P_n / det
    t_stick = ((w_tn + turn_t) * turn_n - (w_nn + turn_n) * turn_t) * P_n / det
    n = torch.where(sticks, n_stick, n_slide)
    t = torch.where(sticks, t_stick, slope * n_slide)
    return columns(P_t + t, P_n + n, tau + arm * (P_n + n))
