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

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values
from contactlearn.laws.hodograph import Hodograph, after_work
from contactlearn.laws.wang_mason import routh_path


class Mirtich(Law):
    """Routh's path with Stronge's energetic restitution; it never adds energy."""

    label = "Mirtich"
    citations = (
        "mirtich1996",
        "stronge1990",
    )
    paper = 6

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        path = routh_path(contact, mu)
        w, p_c = -contact.v_n, path.p_c
        compressed_first = path.v_slip >= w  # compression ends before the slip does
        v_left = torch.where(compressed_first, 0.0, w - path.v_slip)
        p_slip = torch.where(torch.isfinite(path.p_slip), path.p_slip, 0.0)
        # Normal work of compression, J: over one piece of the path, or over both.
        work_first = 0.5 * w**2 / torch.where(compressed_first, path.stiffness, 1.0)
        work_both = p_slip * (w - 0.5 * path.stiffness * p_slip) + 0.5 * v_left**2 / path.stiffness_after
        work_both = torch.where(compressed_first, 1.0, work_both)
        # Restitution on the second piece alone.
        p_second = p_c + eps * (2 * work_both / path.stiffness_after).sqrt()
        # Restitution that starts on the first piece, and goes on to the second where the slip ends in it.
        p_first = (1 + eps) * p_c
        crosses = compressed_first & (p_first > path.p_slip)
        v_end = torch.where(crosses, path.v_slip - w, 1.0)
        work_end = 0.5 * v_end**2 / torch.where(crosses, path.stiffness, 1.0)
        work_left = torch.where(crosses, eps**2 * work_first - work_end, 0.0)
        p_crossed = p_slip + 2 * work_left / (v_end + (v_end**2 + 2 * path.stiffness_after * work_left).sqrt())
        return path.impulse(torch.where(compressed_first, torch.where(crosses, p_crossed, p_first), p_second))

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s; see `hodograph`."""
        path = Hodograph(contact, mu)
        compressed = path.compressed()
        return path.restored(compressed, *(after_work(kept * compressed.work) for kept in (0.0, 1 - eps**2)))


class MirtichFazeli2017(Law):
    """Mirtich's law as computed for the paper: a viscous path, whose two ends are roots found by Newton's method.

    Restitution is a path of its own that starts at p_c with v_n = 0: its work (σ d)²/2 after a clock
    of d is to be ε² of that of compression, and σ d = ε √(2 work) is nearly linear in d and loses no
    digits at ε = 0.  Each last step is taken with gradients, which makes them exact (implicit
    function theorem).
    """

    name = Mirtich.name
    variant = "fazeli2017"
    label = Mirtich.label
    citations = (*Mirtich.citations, "fazeli2017")
    mu_axis = "Viscous friction μ (s/m)"
    leaves_cone = True
    scales = False

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        w_tt, w_tn, _, v_t, v_n = contact
        with torch.no_grad():
            p = _compression_start(contact, mu)
            for _ in range(_NEWTON_STEPS):
                _, _, rise, rate, _ = _viscous_path(contact, mu, p)
                p = p - (v_n + rise * p) / rate
        _, _, rise, rate, _ = _viscous_path(contact, mu, p)
        p_c = p - (v_n + rise * p) / rate.detach()
        slip, _, _, _, square = _viscous_path(contact, mu, p_c)
        t_c = -mu * slip * p_c
        goal = eps * (-p_c * (2 * v_n + square * p_c)).sqrt()
        restitution = contact._replace(v_t=v_t + w_tt * t_c + w_tn * p_c)
        with torch.no_grad():
            d = goal / _viscous_path(restitution, mu, torch.zeros_like(p_c))[4].sqrt()
            for _ in range(_NEWTON_STEPS):
                _, _, rise, _, square = _viscous_path(restitution, mu, d)
                d = d - (d * square - goal * square.sqrt()) / rise
        _, _, rise, _, square = _viscous_path(restitution, mu, d)
        sigma = square.sqrt()
        d = d - (d * sigma - goal) * (sigma / rise).detach()
        return t_c - mu * d * _viscous_path(restitution, mu, d)[0], p_c + d


_NEWTON_STEPS = 8  # all of 10⁵ random contacts are then at rounding error; with 6 the worst is 1e-8


def _viscous_path(contact: Contact, mu: Tensor, p: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """At clock p of v_t' = W_tn − μ W_tt v_t: means and rates that stay finite as p → 0.

    Mean slip ∫ v_t dp / p, slip v_t, mean rise (v_n − v_n⁻) / p, rate dv_n/dp and the mean square
    2 ∫ (v_n − v_n⁻) dp / p².
    """
    w_tt, w_tn, w_nn, v_t, _ = contact
    phi_1, phi_2, phi_3 = _phi(mu * w_tt * p)
    slip = v_t * phi_1 + w_tn * p * phi_2
    v_t_now = v_t + p * (w_tn - mu * w_tt * slip)
    coupling = mu * w_tn
    square = w_nn - 2 * coupling * (v_t * phi_2 + w_tn * p * phi_3)
    return slip, v_t_now, w_nn - coupling * slip, w_nn - coupling * v_t_now, square


def _phi(z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """φ_k(−z) of exponential integrators, φ_k = (1/(k−1)! − φ_{k−1}) / z with φ_0 = e^(−z).

    Upwards from φ_1 where z is large, downwards from the series of φ_3 where it is small: each way
    loses digits on the other side.
    """
    small = z < _SMALL
    large, little = torch.where(small, 1.0, z), torch.where(small, z, 0.0)
    series_3 = z.new_zeros(())
    for coefficient in reversed(_PHI_3):
        series_3 = coefficient - little * series_3
    series_2 = 0.5 - little * series_3
    phi_1 = -torch.expm1(-large) / large
    phi_2 = (1 - phi_1) / large
    phi_3 = (0.5 - phi_2) / large
    return (
        torch.where(small, 1 - little * series_2, phi_1),
        torch.where(small, series_2, phi_2),
        torch.where(small, series_3, phi_3),
    )


_SMALL = 0.05  # below it the closed form of φ_3 loses more than 3 digits, above it the series is too short
_PHI_3 = tuple(1 / math.factorial(k + 3) for k in range(8))


def _compression_start(contact: Contact, mu: Tensor) -> Tensor:
    """First guess of p_c on the side of the root where Newton's method is monotone.

    A concave v_n lies below its tangent at p = 0 and its asymptote, so their roots come before its own;
    a convex one lies above both, so they come after.  The nearer of the two is used.
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
