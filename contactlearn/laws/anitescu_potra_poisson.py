"""Anitescu & Potra (1997) with Poisson restitution: two complementarity problems.

Compression brings v_n to 0 with impulse P^c; decompression adds the normal impulse ε P_n^c with
Coulomb friction against the final slip of that phase.  The extra normal impulse of the original
method, which would keep v_n⁺ ≥ 0, is never needed with one planar contact: where compression
ends sliding, W_nn > σ μ W_tn, and where it ends sticking the second phase has v_t = 0 to begin with.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Values, complementary, within


@dataclass(frozen=True)
class AnitescuPotraPoisson(Law):
    """Poisson restitution in two complementarity problems; it never adds energy."""

    label: ClassVar[str] = "Anitescu–Potra Poisson"
    citations: ClassVar[tuple[str, ...]] = ("anitescu1997",)
    paper: ClassVar[int | None] = 3

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


@dataclass(frozen=True)
class AnitescuPotraPoissonFazeli2017(Law):
    """Anitescu & Potra's law as computed for the paper: P = (P_t^c, (1 + ε) P_n^c), restitution without friction.

    v_n⁺ = ε W_nn P_n^c ≥ 0, so a second problem is never needed; it can add energy.
    """

    name: ClassVar[str] = AnitescuPotraPoisson.name
    variant: ClassVar[str] = "fazeli2017"
    label: ClassVar[str] = AnitescuPotraPoisson.label
    citations: ClassVar[tuple[str, ...]] = (*AnitescuPotraPoisson.citations, "fazeli2017")
    adds_energy: ClassVar[bool] = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = complementary(contact, mu, -contact.v_n)
        return t_c, (1 + eps) * n_c
