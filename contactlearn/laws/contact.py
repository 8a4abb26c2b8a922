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


class SpatialContact(NamedTuple):
    """W (1/kg) and v_c (m/s) by component in the axes of the slip, each [..., N]: 1 along the slip, 2 across, n up.

    The slip across is 0.  Where there is no slip at all, 1 is along the slip that a normal impulse would start.
    """

    w_11: Values
    w_12: Values
    w_22: Values
    w_1n: Values
    w_2n: Values
    w_nn: Values
    slip: Values
    v_n: Values

    @classmethod
    def of(
        cls, W: Float[Tensor, "*#batch 3 3"], v_c: Float[Tensor, "*#batch 3"]
    ) -> "tuple[SpatialContact, tuple[Values, Values]]":
        """Take W and v_c apart; return also the cosine and sine of the direction of the slip."""
        w_xx, w_xy, w_xn, _, w_yy, w_yn, _, _, w_nn = W.flatten(-2).unbind(-1)
        v_x, v_y, v_n = v_c.unbind(-1)
        still = (v_x == 0) & (v_y == 0)
        a, b = torch.where(still, w_xn, v_x), torch.where(still, w_yn, v_y)
        a = torch.where((a == 0) & (b == 0), 1.0, a)
        length = torch.hypot(a, b)
        c, s = a / length, b / length
        cc, cs, ss = c * c, c * s, s * s
        w_11, w_22 = cc * w_xx + 2 * cs * w_xy + ss * w_yy, ss * w_xx - 2 * cs * w_xy + cc * w_yy
        w_12 = cs * (w_yy - w_xx) + (cc - ss) * w_xy
        slip = torch.where(still, 0.0, length)
        return cls(w_11, w_12, w_22, c * w_xn + s * w_yn, c * w_yn - s * w_xn, w_nn, slip, v_n), (c, s)


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
