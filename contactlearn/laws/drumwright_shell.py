"""Drumwright & Shell (2010): maximum dissipation in compression, Poisson restitution.

Compression minimises ½ (v_c + W P)ᵀ M_c (v_c + W P) subject to P_n ≥ 0, |P_t| ≤ μ P_n and
v_n⁺ ≥ 0; then P = (1 + ε) P^c.  The programme's solution is −M_c v_c where the cone holds it, else
the better of the two cone edges, where P = N (−σ μ, 1) and

    N = max( (−v_n + σ μ v_t) / (W_nn − 2 σ μ W_tn + μ² W_tt),  −v_n / (W_nn − σ μ W_tn) ).

v_n⁺ = −ε v_n + (1 + ε) v_n^c ≥ 0, so a second compression is never needed.
"""

import torch
from torch import Tensor

from contactlearn.laws.base import Contact, stick


def compression(contact: Contact, mu: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t^c, P_n^c) of the convex programme."""
    t_stick, n_stick = stick(contact, -contact.v_n)
    n_minus, energy_minus = _edge(contact, -mu)
    n_plus, energy_plus = _edge(contact, mu)
    plus = energy_plus <= energy_minus
    n_edge = torch.where(plus, n_plus, n_minus)
    t_edge = torch.where(plus, -mu, mu) * n_edge
    sticks = t_stick.abs() <= mu * n_stick
    return torch.where(sticks, t_stick, t_edge), torch.where(sticks, n_stick, n_edge)


def _edge(contact: Contact, slope: Tensor) -> tuple[Tensor, Tensor]:
    """Best N on the cone edge P = N (−slope, 1), and the energy there (inf where none is feasible)."""
    w_tt, w_tn, w_nn, v_t, v_n = contact
    curvature = w_nn + slope * (slope * w_tt - 2 * w_tn)
    gradient = v_n - slope * v_t
    stiffness = w_nn - slope * w_tn
    feasible = stiffness > 0
    n = torch.maximum(-gradient / curvature, -v_n / torch.where(feasible, stiffness, 1.0))
    return n, torch.where(feasible, n * (0.5 * curvature * n + gradient), torch.inf)


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) = (1 + ε) P^c in N s."""
    t_c, n_c = compression(contact, mu)
    return (1 + eps) * t_c, (1 + eps) * n_c


def fazeli2017(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """As computed for the paper: P = (P_t^c, (1 + ε) P_n^c); energy can be gained."""
    t_c, n_c = compression(contact, mu)
    return t_c, (1 + eps) * n_c


VARIANTS = {"textbook": textbook, "fazeli2017": fazeli2017}
