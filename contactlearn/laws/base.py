"""What the laws share: the contact in components, and the two elementary solutions.

A law is a pure function (contact, μ, ε) → (P_t, P_n) of broadcastable tensors.  All laws assume
an approach, v_n < 0, and that W is positive definite.  Divisions by a quantity that may vanish
in a branch that is not taken are guarded, so gradients stay finite there.
"""

from typing import NamedTuple

import torch
from torch import Tensor


class Contact(NamedTuple):
    """W (1/kg) and v_c (m/s) by component, each [..., N]."""

    w_tt: Tensor
    w_tn: Tensor
    w_nn: Tensor
    v_t: Tensor
    v_n: Tensor


def slip_direction(contact: Contact) -> Tensor:
    """s = ±1: sign of v_t, or where v_t = 0 of the slip that a normal impulse would start."""
    s = torch.where(contact.v_t == 0, contact.w_tn, contact.v_t).sign()
    return torch.where(s == 0, torch.ones_like(s), s)


def stick(contact: Contact, target: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) with v_t⁺ = 0 and v_n⁺ − v_n = `target` (m/s)."""
    w_tt, w_tn, w_nn, v_t, _ = contact
    det = w_tt * w_nn - w_tn**2
    return -(w_nn * v_t + w_tn * target) / det, (w_tt * target + w_tn * v_t) / det


def within(x: Tensor, bound: Tensor) -> Tensor:
    """x clamped to ± bound, with a gradient to the bound that also holds where it is 0 (torch.clamp's does not)."""
    return torch.where(x.abs() < bound, x, x.sign() * bound)


def complementary(contact: Contact, mu: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    """Contact with v_n⁺ − v_n = `target` > 0 and Coulomb friction against the *final* slip.

    The one solution of the complementarity problem 0 ≤ P_n ⊥ v_n⁺ − v_n − target ≥ 0 with
    P_t = −σ μ P_n, σ v_t⁺ ≥ 0.  Along the line v_n⁺ − v_n = target, v_t⁺ grows with P_t, so the
    final slip has the sign of the frictionless one, and sliding in that direction has
    W_nn − σ μ W_tn > 0 whenever sticking is not in the cone.
    """
    t_stick, n_stick = stick(contact, target)
    slope = -t_stick.sign() * mu
    sticks = t_stick.abs() <= mu * n_stick
    n_slide = target / torch.where(sticks, 1.0, contact.w_nn - slope * contact.w_tn)
    return torch.where(sticks, t_stick, -slope * n_slide), torch.where(sticks, n_stick, n_slide)
