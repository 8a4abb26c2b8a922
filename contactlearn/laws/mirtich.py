"""Mirtich (1996): Routh's path with Stronge's energetic restitution (1990).

The path is that of Wang & Mason; restitution ends where the normal work that it gives back,
∫ v_n dp from p_c on, is ε² times the normal work of compression.  v_n is linear in p on both pieces
of the path, so both works are quadratic and the end is a square root.

The paper's authors integrated a viscous path instead, dP_t/dp = −μ v_t (μ in s/m), on which the
slip decays exponentially and never quite ends.
"""

import math

import torch
from torch import Tensor

from contactlearn.laws.base import Contact
from contactlearn.laws.wang_mason import routh_path


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) in N s at the end of restitution."""
    path = routh_path(contact, mu)
    w = -contact.v_n
    compressed_first = path.v_slip >= w  # compression ends before the slip does
    v_left = torch.where(compressed_first, 0.0, w - path.v_slip)
    p_slip = torch.where(torch.isfinite(path.p_slip), path.p_slip, 0.0)
    # Normal work of compression, J: over one piece of the path, or over both.
    work_first = 0.5 * w**2 / torch.where(compressed_first, path.stiffness, 1.0)
    work_both = p_slip * (w - 0.5 * path.stiffness * p_slip) + 0.5 * v_left**2 / path.stiffness_after
    # Restitution on the second piece alone.
    p_second = path.p_c + eps * (2 * work_both / path.stiffness_after).sqrt()
    # Restitution that starts on the first piece, and goes on to the second where the slip ends in it.
    p_first = (1 + eps) * path.p_c
    crosses = compressed_first & (p_first > path.p_slip)
    v_end = torch.where(crosses, path.v_slip - w, 1.0)
    work_end = 0.5 * v_end**2 / torch.where(crosses, path.stiffness, 1.0)
    work_left = torch.where(crosses, eps**2 * work_first - work_end, 0.0)
    p_crossed = p_slip + 2 * work_left / (v_end + (v_end**2 + 2 * path.stiffness_after * work_left).sqrt())
    return path.impulse(torch.where(compressed_first, torch.where(crosses, p_crossed, p_first), p_second))


def fazeli2017(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """As computed for the paper: the viscous path, whose two ends are roots found by Newton's method.

    v_n(p) is convex or concave and increases through its root; the restored work is convex.  Each
    iteration starts on the side from which Newton's converges monotonically, and its last step is
    taken with gradients, which makes them exact (implicit function theorem).
    """
    with torch.no_grad():
        p = _compression_start(contact, mu)
        for _ in range(_NEWTON_STEPS):
            _, v_n, rate, _ = _viscous_path(contact, mu, p)
            p = p - v_n / rate
    _, v_n, rate, _ = _viscous_path(contact, mu, p.detach())
    p_c = p - v_n / rate.detach()
    work_c = -_viscous_path(contact, mu, p_c)[3]
    with torch.no_grad():
        # The rate changes monotonically to that of a stick, so the smaller of both bounds the work below.
        lowest = torch.minimum(rate, contact.w_nn - contact.w_tn**2 / contact.w_tt)
        p = p_c + eps * (2 * work_c / lowest).sqrt()
        for _ in range(_NEWTON_STEPS):
            _, v_n, _, work = _viscous_path(contact, mu, p)
            p = p - torch.where(v_n > 0, (work + (1 - eps**2) * work_c) / torch.where(v_n > 0, v_n, 1.0), 0.0)
    _, v_n, _, work = _viscous_path(contact, mu, p.detach())
    excess = work + (1 - eps**2) * work_c
    ends = eps > 0  # at ε = 0 restitution is empty
    p = torch.where(ends, p - excess / torch.where(ends, v_n, 1.0).detach(), p_c)
    return _viscous_path(contact, mu, p)[0], p


_NEWTON_STEPS = 6


def _viscous_path(contact: Contact, mu: Tensor, p: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(P_t, v_n, dv_n/dp, ∫ v_n dp from 0) at clock p, from v_t' = W_tn − z' v_t with z = μ W_tt p."""
    w_tt, w_tn, w_nn, v_t, v_n = contact
    z = mu * w_tt * p
    # φ_k = (1/(k−1)! − φ_{k−1}) / z with φ_0 = e^(−z), from φ_3 down so that small z loses no digits.
    small = z < _SMALL
    safe = torch.where(small, 1.0, z)
    series = z.new_zeros(())
    for coefficient in reversed(_PHI_3):
        series = coefficient - z * series
    phi_3 = torch.where(small, series, (0.5 - (1 + torch.expm1(-safe) / safe) / safe) / safe)
    phi_2 = 0.5 - z * phi_3
    phi_1 = 1 - z * phi_2
    slip = p * (v_t * phi_1 + w_tn * p * phi_2)  # ∫ v_t dp
    slip_twice = p**2 * (v_t * phi_2 + w_tn * p * phi_3)
    P_t = -mu * slip
    v_t_now = v_t + w_tt * P_t + w_tn * p
    work = p * (v_n + 0.5 * w_nn * p) - w_tn * mu * slip_twice
    return P_t, v_n + w_tn * P_t + w_nn * p, w_nn - w_tn * mu * v_t_now, work


_SMALL = 0.05  # below it the closed form of φ_3 loses more than 3 digits, above it the series is too short
_PHI_3 = tuple(1 / math.factorial(k + 3) for k in range(8))


def _compression_start(contact: Contact, mu: Tensor) -> Tensor:
    """First guess of p_c on the side of the root where Newton's method is monotone.

    Both the tangent at p = 0 and the asymptote of v_n(p) bound it: from below where v_n is concave
    (their roots are then too late …) and from above where it is convex; the better of both is used.
    """
    w_tt, w_tn, w_nn, v_t, v_n = contact
    start_rate = w_nn - w_tn * mu * v_t
    end_rate = w_nn - w_tn**2 / w_tt
    tangent = -v_n / torch.where(start_rate > 0, start_rate, 1.0)
    # Asymptote v_n − (W_tn / W_tt) (v_t − e) + end_rate p with e = W_tn / (μ W_tt), the final slip.
    drag = torch.where(mu > 0, mu * w_tt, 1.0)
    asymptote = (-v_n + (w_tn / w_tt) * (v_t - w_tn / drag)) / end_rate
    convex = end_rate >= start_rate
    nearer = torch.where(convex, torch.minimum(tangent, asymptote), torch.maximum(tangent, asymptote))
    return torch.where(mu > 0, torch.where(start_rate > 0, nearer, asymptote), -v_n / w_nn)


VARIANTS = {"textbook": textbook, "fazeli2017": fazeli2017}
