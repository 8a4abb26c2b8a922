"""Anitescu & Potra (1997) with Poisson restitution: two complementarity problems.

Compression brings v_n to 0 with impulse P^c; decompression adds the normal impulse ε P_n^c with
Coulomb friction against the final slip of that phase.  The extra normal impulse of the original
method, which would keep v_n⁺ ≥ 0, is never needed with one planar contact: where compression
ends sliding, W_nn > σ μ W_tn, and where it ends sticking the second phase has v_t = 0 to begin with.
"""

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import (
    Contact,
    Impulse,
    SpatialContact,
    Values,
    complementary,
    complementary_in_space,
    opposing,
    within,
)


class AnitescuPotraPoisson(Law):
    """Poisson restitution in two complementarity problems; it never adds energy."""

    label = "Anitescu–Potra Poisson"
    citations = ("anitescu1997",)
    paper = 3

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        w_tt, w_tn, _, v_t, v_n = contact
        t_c, n_c = complementary(contact, mu, -v_n)
        n_d = eps * n_c
        # Tangential impulse that ends the slip of the second phase, clamped to its cone.
        t_d = -(v_t + w_tt * t_c + w_tn * (n_c + n_d)) / w_tt
        stuck = t_c.abs() < mu * n_c  # then v_t = 0 but for rounding
        t_d = torch.where(stuck, within(-w_tn / w_tt, mu) * n_d, within(t_d, mu * n_d))
        return t_c + t_d, n_c + n_d

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s, of a circular cone."""
        w_11, w_12, w_22, w_1n, w_2n, _, slip, across, v_n = contact
        c_1, c_2, n_c = complementary_in_space(contact, mu, -v_n)
        n_d = eps * n_c
        b_1 = slip + w_11 * c_1 + w_12 * c_2 + w_1n * (n_c + n_d)
        b_2 = across + w_12 * c_1 + w_22 * c_2 + w_2n * (n_c + n_d)
        det, none = w_11 * w_22 - w_12**2, torch.zeros_like(n_d)
        d_1, d_2 = (w_12 * b_2 - w_22 * b_1) / det, (w_12 * b_1 - w_11 * b_2) / det
        u_1, u_2 = opposing((w_11, w_12, w_22), (b_1, b_2), mu * n_d, (none, none))
        sticks = torch.hypot(d_1, d_2) <= mu * n_d
        d_1, d_2 = torch.where(sticks, d_1, mu * n_d * u_1), torch.where(sticks, d_2, mu * n_d * u_2)
        return c_1 + d_1, c_2 + d_2, n_c + n_d


class AnitescuPotraPoissonFazeli2017(Law):
    """Anitescu & Potra's law as computed for the paper: P = (P_t^c, (1 + ε) P_n^c), restitution without friction.

    v_n⁺ = ε W_nn P_n^c ≥ 0, so a second problem is never needed; it can add energy.
    """

    name = AnitescuPotraPoisson.name
    variant = "fazeli2017"
    label = AnitescuPotraPoisson.label
    citations = (*AnitescuPotraPoisson.citations, "fazeli2017")
    adds_energy = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = complementary(contact, mu, -contact.v_n)
        return t_c, (1 + eps) * n_c
