"""Drumwright & Shell (2010): maximum dissipation in compression, Poisson restitution.

Compression minimises ½ (v_c + W P)ᵀ M_c (v_c + W P) subject to P_n ≥ 0, |P_t| ≤ μ P_n and
v_n⁺ ≥ 0; then P = (1 + ε) P^c.  The programme's solution is −M_c v_c where the cone holds it, else
the best point N (−σ μ, 1) of one cone edge,

    N = (−v_n + σ μ v_t) / (W_nn − 2 σ μ W_tn + μ² W_tt).

v_c⁺ is then at right angles to that edge, v_c⁺ = |v_t⁺| (σ, μ), so v_n⁺ ≥ 0 never binds; and as
N (W_nn − σ μ W_tn) = v_n⁺ − v_n > 0, the tangential part of −M_c v_c has the sign −σ.
v_n⁺ = −ε v_n + (1 + ε) v_n^c ≥ 0, so a second compression is never needed either.
"""

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values, shifted, stick, stick_in_space, where


def compression(contact: Contact, mu: Values) -> tuple[Values, Values]:
    """Return (P_t^c, P_n^c) in N s, the solution of the convex programme."""
    w_tt, w_tn, w_nn, v_t, v_n = contact
    t_stick, n_stick = stick(contact, -v_n)
    slope = -t_stick.sign() * mu
    n_edge = (slope * v_t - v_n) / (w_nn + slope * (slope * w_tt - 2 * w_tn))
    sticks = t_stick.abs() <= mu * n_stick
    return torch.where(sticks, t_stick, -slope * n_edge), torch.where(sticks, n_stick, n_edge)


def compression_in_space(contact: SpatialContact, mu: Values) -> Impulse:
    """Return (P_1, P_2, P_n) of compression in N s: the point of the cone that is nearest to −M_c v_c in the metric W.

    On the cone it is (W + λ diag(1, 1, −μ²)) P = −v_c with λ > 0 for which |P_t| = μ P_n.  With t = μ λ, w = W_tn and
    B = (μ W_tt + t)⁻¹ that is

        P_n = ν/σ,  P_t = −μ y/σ,   y = B (σ v_t + ν w),  ν = −v_n + μ wᵀ B v_t,  σ = W_nn − μ t − μ wᵀ B w,

    and |y| = |ν|.  |P_t|² − μ² P_n² falls without bound up to the pole σ = 0, and rises from there; P_n is positive at
    the root before it where ν is positive at the pole, and otherwise at the root beyond (Conn, Gould & Toint, §7.3).
    """
    w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, v_n = contact
    stuck = stick_in_space(contact, -v_n)
    sticks = torch.hypot(stuck[0], stuck[1]) <= mu * stuck[2]
    rough = mu.clamp_min(_SMOOTH)
    with torch.no_grad():
        pole = w_nn / rough
        A, w = (rough * w_11, rough * w_12, rough * w_22), (w_1n, w_2n)
        for _ in range(_POLE_STEPS):
            a_1, a_2 = shifted(A, w, pole)
            sigma = w_nn - rough * (pole + w_1n * a_1 + w_2n * a_2)
            pole = pole + sigma / (rough * (1 - a_1 * a_1 - a_2 * a_2))
        beyond = _secular(contact, rough, pole)[4] < 0
        low = torch.where(beyond, pole, 0.0)
        high = torch.where(beyond, torch.inf, pole)
        t = torch.where(beyond, 2 * pole, torch.minimum(slip * w_nn / -v_n, 0.5 * pole))
        for _ in range(_STEPS):
            _, _, excess, slope, _ = _secular(contact, rough, t)
            left = (excess > 0) != beyond
            low, high = torch.where(left, t, low), torch.where(left, high, t)
            t = t - excess / slope
            middle = torch.where(high < torch.inf, 0.5 * (low + high), 4 * low)
            t = torch.where((t >= low) & (t <= high), t, middle)
            if not (~sticks & (excess.abs() > _SETTLED * (slope * t).abs())).any():
                break
    _, _, excess, slope, _ = _secular(contact, rough, t)
    sigma, y, *_ = _secular(contact, rough, t - excess / slope.detach())
    length = -sigma.sign() * torch.hypot(*y).clamp_min(1e-150)
    u_1, u_2 = y[0] / length, y[1] / length
    form = w_11 * u_1 * u_1 + 2 * w_12 * u_1 * u_2 + w_22 * u_2 * u_2
    n = (-v_n - mu * slip * u_1) / (w_nn + mu * (2 * (w_1n * u_1 + w_2n * u_2) + mu * form))
    slides = mu * n * u_1, mu * n * u_2, n
    return where(sticks, stuck, slides)


_SMOOTH = 1e-10  # friction below which the direction of the impulse is that of none
_POLE_STEPS, _STEPS = 5, 20  # the second may bisect
_SETTLED = 1e-9  # relative step after which the next is at rounding error


def _secular(
    contact: SpatialContact, mu: Values, t: Values
) -> tuple[Values, tuple[Values, Values], Values, Values, Values]:
    """σ and y of `compression_in_space`, |y| − |ν| with its derivative, and ν."""
    w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, v_n = contact
    a_11, a_12, a_22 = mu * w_11 + t, mu * w_12, mu * w_22 + t
    det = a_11 * a_22 - a_12 * a_12
    b_11, b_12, b_22 = a_22 / det, -a_12 / det, a_11 / det
    a_1, a_2 = b_11 * w_1n + b_12 * w_2n, b_12 * w_1n + b_22 * w_2n
    e_1, e_2 = b_11 * slip, b_12 * slip
    sigma = w_nn - mu * (t + w_1n * a_1 + w_2n * a_2)
    nu = -v_n + mu * slip * a_1
    y_1, y_2 = sigma * e_1 + nu * a_1, sigma * e_2 + nu * a_2
    d_sigma, d_nu = mu * (a_1 * a_1 + a_2 * a_2 - 1), -mu * (a_1 * e_1 + a_2 * e_2)
    dy_1 = d_sigma * e_1 + d_nu * a_1 - (b_11 * y_1 + b_12 * y_2)
    dy_2 = d_sigma * e_2 + d_nu * a_2 - (b_12 * y_1 + b_22 * y_2)
    length = (y_1 * y_1 + y_2 * y_2).clamp_min(1e-300).sqrt()
    return sigma, (y_1, y_2), length - nu.abs(), (y_1 * dy_1 + y_2 * dy_2) / length - nu.sign() * d_nu, nu


class DrumwrightShell(Law):
    """Maximum dissipation in compression, then P = (1 + ε) P^c; it never adds energy."""

    label = "Drumwright–Shell"
    citations = ("drumwright2010",)
    paper = 4

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = compression(contact, mu)
        return (1 + eps) * t_c, (1 + eps) * n_c

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s, of a circular cone."""
        P_1, P_2, P_n = compression_in_space(contact, mu)
        return (1 + eps) * P_1, (1 + eps) * P_2, (1 + eps) * P_n


class DrumwrightShellFazeli2017(Law):
    """Drumwright & Shell's law as computed for the paper: P = (P_t^c, (1 + ε) P_n^c); it can add energy."""

    name = DrumwrightShell.name
    variant = "fazeli2017"
    label = DrumwrightShell.label
    citations = (*DrumwrightShell.citations, "fazeli2017")
    adds_energy = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_c, n_c = compression(contact, mu)
        return t_c, (1 + eps) * n_c
