"""A contact in components, and the elementary solutions that several laws share.

All of them take broadcastable tensors and assume an approach, v_n < 0, and a positive definite W.  A division by
a quantity that may vanish in a branch that is not taken is guarded, so that gradients stay finite there.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

Values = Float[Tensor, "*#batch"]
"""Values of each trial, broadcast against [..., N]."""


class Contact(NamedTuple):
    """W (1/kg) and v_c (m/s) by component, each [..., N]."""

    w_tt: Values
    w_tn: Values
    w_nn: Values
    v_t: Values
    v_n: Values

    @classmethod
    def of(cls, W: Float[Tensor, "*#batch 2 2"], v_c: Float[Tensor, "*#batch 2"]) -> "Contact":
        """Take W and v_c apart."""
        w_tt, w_tn, _, w_nn = W.flatten(-2).unbind(-1)
        return cls(w_tt, w_tn, w_nn, *v_c.unbind(-1))


def slip_direction(contact: Contact) -> Values:
    """Return s = ±1, the sign of v_t, or where v_t = 0 that of the slip that a normal impulse would start."""
    s = torch.where(contact.v_t == 0, contact.w_tn, contact.v_t).sign()
    return torch.where(s == 0, torch.ones_like(s), s)


def stick(contact: Contact, target: Values) -> tuple[Values, Values]:
    """Return (P_t, P_n) with v_t⁺ = 0 and v_n⁺ − v_n = `target` (m/s)."""
    w_tt, w_tn, w_nn, v_t, _ = contact
    det = w_tt * w_nn - w_tn**2
    return -(w_nn * v_t + w_tn * target) / det, (w_tt * target + w_tn * v_t) / det


def within(x: Values, bound: Values) -> Values:
    """Clamp x to ± bound; unlike torch.clamp's, the gradient to the bound is right where the bound is 0."""
    return torch.where(x.abs() < bound, x, x.sign() * bound)


def complementary(contact: Contact, mu: Values, target: Values) -> tuple[Values, Values]:
    """Solve the contact with v_n⁺ − v_n = `target` > 0 and Coulomb friction against the *final* slip.

    It is the unique solution of the complementarity problem 0 ≤ P_n ⊥ v_n⁺ − v_n − target ≥ 0 with
    P_t = −σ μ P_n, σ v_t⁺ ≥ 0.  Along the line v_n⁺ − v_n = target, v_t⁺ grows with P_t, so the
    final slip has the sign of the frictionless one, and sliding in that direction has
    W_nn − σ μ W_tn > 0 whenever sticking is not in the cone.
    """
    t_stick, n_stick = stick(contact, target)
    slope = -t_stick.sign() * mu
    sticks = t_stick.abs() <= mu * n_stick
    n_slide = target / torch.where(sticks, 1.0, contact.w_nn - slope * contact.w_tn)
    return torch.where(sticks, t_stick, -slope * n_slide), torch.where(sticks, n_stick, n_slide)
