"""A contact in components, and the elementary solutions that several laws share.

All of them take broadcastable tensors and assume an approach, v_n < 0, and a positive definite W.  A division by
a quantity that may vanish in a branch that is not taken is guarded, so that gradients stay finite there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.mechanics import rigid_body

Values = Float[Tensor, "*#batch"]
"""Values of each trial, broadcast against [..., N]."""
Impulse = tuple[Values, Values, Values]
"""(P_1, P_2, P_n) in N s along the slip, across it and along the normal."""

Pair = tuple[Values, Values]
"""Components along the slip and across it."""


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

    Where there is no slip at all, 1 is along the slip that a normal impulse would start.  The slip across is 0; it and
    the slip have their derivatives there, too.
    """

    w_11: Values
    w_12: Values
    w_22: Values
    w_1n: Values
    w_2n: Values
    w_nn: Values
    slip: Values
    across: Values
    v_n: Values

    @classmethod
    def of(
        cls, W: Float[Tensor, "*#batch 3 3"], v_c: Float[Tensor, "*#batch 3"]
    ) -> "tuple[SpatialContact, tuple[Values, Values]]":
        """Take W and v_c apart; return also the cosine and sine of the direction of the slip."""
        w_xx, w_xy, w_xn, _, w_yy, w_yn, _, _, w_nn = W.flatten(-2).unbind(-1)
        (c, s), (slip, across) = rigid_body.slip_heading(W, v_c)
        cc, cs, ss = c * c, c * s, s * s
        w_11, w_22 = cc * w_xx + 2 * cs * w_xy + ss * w_yy, ss * w_xx - 2 * cs * w_xy + cc * w_yy
        w_12 = cs * (w_yy - w_xx) + (cc - ss) * w_xy
        w_1n, w_2n = c * w_xn + s * w_yn, c * w_yn - s * w_xn
        return cls(w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, across, v_c[..., 2]), (c, s)


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


def stick_in_space(contact: SpatialContact, target: Values) -> Impulse:
    """Return (P_1, P_2, P_n) that ends the slip, with v_n⁺ − v_n = `target` (m/s)."""
    w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, across, _ = contact
    a_11, a_1n, a_nn = w_22 * w_nn - w_2n**2, w_12 * w_2n - w_1n * w_22, w_11 * w_22 - w_12**2
    a_12, a_22, a_2n = w_1n * w_2n - w_12 * w_nn, w_11 * w_nn - w_1n**2, w_12 * w_1n - w_11 * w_2n
    det = w_11 * a_11 + w_12 * a_12 + w_1n * a_1n
    return (
        (target * a_1n - slip * a_11 - across * a_12) / det,
        (target * a_2n - slip * a_12 - across * a_22) / det,
        (target * a_nn - slip * a_1n - across * a_2n) / det,
    )


def complementary_in_space(contact: SpatialContact, mu: Values, target: Values) -> Impulse:
    """Solve the contact with v_n⁺ − v_n = `target` > 0 and friction in a circular cone against the *final* slip.

    The normal impulse is eliminated: P_n = (target − w·P_t)/W_nn with w = W_tn, and v_t⁺ = A P_t + b with
    A = W_tt − w wᵀ/W_nn and b = v_t + w target/W_nn, so that P_t ends the slip or `opposes` it.
    """
    w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, across, _ = contact
    w_1, w_2 = w_1n / w_nn, w_2n / w_nn
    reduced = w_11 - w_1 * w_1n, w_12 - w_1 * w_2n, w_22 - w_2 * w_2n
    u_1, u_2 = opposing(reduced, (slip + w_1 * target, across + w_2 * target), mu * target / w_nn, (mu * w_1, mu * w_2))
    stuck = stick_in_space(contact, target)
    sticks = torch.hypot(stuck[0], stuck[1]) <= mu * stuck[2]
    n = target / torch.where(sticks, 1.0, w_nn + mu * (u_1 * w_1n + u_2 * w_2n))
    slides = mu * n * u_1, mu * n * u_2, n
    return where(sticks, stuck, slides)


def dot(a: Sequence[Values], b: Sequence[Values]) -> Values:
    """Return a_1 b_1 + a_2 b_2."""
    return torch.addcmul(a[0] * b[0], a[1], b[1])


def where(condition: Values, yes: Impulse, no: Impulse) -> Impulse:
    """Choose between impulses, contact by contact."""
    first, second, third = (torch.where(condition, *pair) for pair in zip(yes, no, strict=True))
    return first, second, third


def opposing(A: Impulse, b: Pair, radius: Values, pull: Pair) -> Pair:
    """Return the direction u of the friction P_t = −λ⁻¹ v_t⁺ with v_t⁺ = A P_t + b, |P_t| = radius − pull·P_t, λ > 0.

    P_t(λ) = −(A + λ)⁻¹ b = −T/d with d = det(A + λ) and T linear in λ.  N/|T|, N = d (radius − pull·P_t), grows from
    below 1, if friction cannot end the slip, to a straight line.  Newton's method finds where it is 1 from where that
    line is (Conn, Gould & Toint 2000, §7.3).  The last step is taken with gradients, which makes them exact (implicit
    function theorem).

    Args:
        A: 11, 12 and 22 of a positive definite matrix.
        b: slip without friction.
        radius: of the cone.
        pull: fall of the radius by P_t.
    """
    t = A[2] * b[0] - A[1] * b[1], A[0] * b[1] - A[1] * b[0]
    det, trace = A[0] * A[2] - A[1] * A[1], A[0] + A[2]
    with torch.no_grad():
        least = _LEAST * (torch.hypot(*t) / det).clamp_min(1e-200)
    radius = torch.maximum(radius, least)
    n = torch.addcmul(dot(pull, t), radius, det), torch.addcmul(dot(pull, b), radius, trace), radius

    def excess(shift: Values) -> tuple[Values, Values]:
        """N − |T|, and the derivative of N/|T| times |T|."""
        T = torch.addcmul(t[0], shift, b[0]), torch.addcmul(t[1], shift, b[1])
        N, square = value(n, shift), dot(T, T).clamp_min(1e-300)
        return N - square * square.rsqrt(), slope(n, shift) - N * (dot(T, b) / square)

    with torch.no_grad():
        square = dot(b, b).clamp_min(1e-300)
        shift = ((square.sqrt() - n[1]) / radius + dot(t, b) / square).clamp_min(0)
        for _ in range(_STEPS):
            gap, rate = excess(shift)
            shift = (shift - gap / rate).clamp_min(0)
    gap, rate = excess(shift)
    shift = shift - gap / rate.detach()
    return towards(torch.addcmul(t[0], shift, b[0]), torch.addcmul(t[1], shift, b[1]))


_LEAST = 1e-10  # of the impulse that ends the slip: the direction is then that of no friction at all
_STEPS = 5  # before the last one: of 10⁵ random contacts all are then at rounding error


def towards(T_1: Values, T_2: Values) -> Pair:
    """Return the direction of −T."""
    per_length = -dot((T_1, T_2), (T_1, T_2)).clamp_min(1e-300).rsqrt()
    return per_length * T_1, per_length * T_2


def value(p: Sequence[Values], x: Values) -> Values:
    """Return p_0 + p_1 x + p_2 x²."""
    return torch.addcmul(p[0], x, torch.addcmul(p[1], x, p[2]))


def slope(p: Sequence[Values], x: Values) -> Values:
    """Return the derivative of `value`."""
    return torch.addcmul(p[1], x, p[2], value=2)
