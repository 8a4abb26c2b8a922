"""Drumwright & Shell (2010): maximum dissipation in compression, Poisson restitution.

Compression minimises ½ (v_c + W P)ᵀ M_c (v_c + W P) subject to P_n ≥ 0, |P_t| ≤ μ P_n and
v_n⁺ ≥ 0; then P = (1 + ε) P^c.  The programme's solution is −M_c v_c where the cone holds it, else
the best point N (−σ μ, 1) of one cone edge,

    N = (−v_n + σ μ v_t) / (W_nn − 2 σ μ W_tn + μ² W_tt).

v_c⁺ is then at right angles to that edge, v_c⁺ = |v_t⁺| (σ, μ), so v_n⁺ ≥ 0 never binds; and as
N (W_nn − σ μ W_tn) = v_n⁺ − v_n > 0, the tangential part of −M_c v_c has the sign −σ.
v_n⁺ = −ε v_n + (1 + ε) v_n^c ≥ 0, so a second compression is never needed either.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Values, stick


def compression(contact: Contact, mu: Values) -> tuple[Values, Values]:
    """Return (P_t^c, P_n^c) in N s, the solution of the convex programme."""
    w_tt, w_tn, w_nn, v_t, v_n = contact
    t_stick, n_stick = stick(contact, -v_n)
    slope = -t_stick.sign() * mu
    n_edge = (slope * v_t - v_n) / (w_nn + slope * (slope * w_tt - 2 * w_tn))
    sticks = t_stick.abs() <= mu * n_stick
    return torch.where(sticks, t_stick, -slope * n_edge), torch.where(sticks, n_stick, n_edge)


@dataclass(frozen=True)
class DrumwrightShell(Law):
    """Maximum dissipation in compression, then P = (1 + ε) P^c; it never adds energy."""

    label: ClassVar[str] = "Drumwright–Shell"
    citations: ClassVar[tuple[str, ...]] = ("drumwright2010",)
    paper: ClassVar[int | None] = 4

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = compression(contact, mu)
        return (1 + eps) * t_c, (1 + eps) * n_c


@dataclass(frozen=True)
class DrumwrightShellFazeli2017(Law):
    """Drumwright & Shell's law as computed for the paper: P = (P_t^c, (1 + ε) P_n^c); it can add energy."""

    name: ClassVar[str] = DrumwrightShell.name
    variant: ClassVar[str] = "fazeli2017"
    label: ClassVar[str] = DrumwrightShell.label
    citations: ClassVar[tuple[str, ...]] = (*DrumwrightShell.citations, "fazeli2017")
    adds_energy: ClassVar[bool] = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = compression(contact, mu)
        return t_c, (1 + eps) * n_c
