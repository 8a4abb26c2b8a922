"""Drumwright & Shell (2010): maximum dissipation in compression, Poisson restitution.

Compression minimises ½ (v_c + W P)ᵀ M_c (v_c + W P) subject to P_n ≥ 0, |P_t| ≤ μ P_n and
v_n⁺ ≥ 0; then P = (1 + ε) P^c.  The programme's solution is −M_c v_c where the cone holds it, else
the best point N (−σ μ, 1) of one cone edge,

    N = (−v_n + σ μ v_t) / (W_nn − 2 σ μ W_tn + μ² W_tt).

v_c⁺ is then at right angles to that edge, v_c⁺ = |v_t⁺| (σ, μ), so v_n⁺ ≥ 0 never binds; and as
N (W_nn − σ μ W_tn) = v_n⁺ − v_n > 0, the tangential part of −M_c v_c has the sign −σ.
v_n⁺ = −ε v_n + (1 + ε) v_n^c ≥ 0, so a second compression is never needed either.
"""

import torch
from torch import Tensor

from contactlearn.laws.base import Contact, stick


def compression(contact: Contact, mu: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t^c, P_n^c) of the convex programme."""
    w_tt, w_tn, w_nn, v_t, v_n = contact
    t_stick, n_stick = stick(contact, -v_n)
    slope = -t_stick.sign() * mu
    n_edge = (slope * v_t - v_n) / (w_nn + slope * (slope * w_tt - 2 * w_tn))
    sticks = t_stick.abs() <= mu * n_stick
    return torch.where(sticks, t_stick, -slope * n_edge), torch.where(sticks, n_stick, n_edge)


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) = (1 + ε) P^c in N s."""
    t_c, n_c = compression(contact, mu)
    return (1 + eps) * t_c, (1 + eps) * n_c


def fazeli2017(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """As computed for the paper: P = (P_t^c, (1 + ε) P_n^c); energy can be gained."""
    t_c, n_c = compression(contact, mu)
    return t_c, (1 + eps) * n_c


VARIANTS = {"textbook": textbook, "fazeli2017": fazeli2017}
