"""Drumwright & Shell (2010): maximum dissipation in compression, Poisson restitution.

Compression minimises ½ (v_c + W P)ᵀ M_c (v_c + W P) subject to P_n ≥ 0, |P_t| ≤ μ P_n and
v_n⁺ ≥ 0; then P = (1 + ε) P^c.  The programme's solution is −M_c v_c where the cone holds it, else
the best point N (−σ μ, 1) of one cone edge,

    N = (−v_n + σ μ v_t) / (W_nn − 2 σ μ W_tn + μ² W_tt).

v_c⁺ is then at right angles to that edge, v_c⁺ = |v_t⁺| (σ, μ), so v_n⁺ ≥ 0 never binds; and as
N (W_nn − σ μ W_tn) = v_n⁺ − v_n > 0, the tangential part of −M_c v_c has the sign −σ.
v_n⁺ = −ε v_n + (1 + ε) v_n^c ≥ 0, so a second compression is never needed either.
"""

from collections.abc import Sequence

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import (
    Contact,
    Impulse,
    SpatialContact,
    Values,
    dot,
    slope,
    stick,
    stick_in_space,
    towards,
    value,
    where,
)


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

    On the cone it is (W + λ D) P = −v_c, D = diag(1, 1, −μ²), with λ > 0 for which |P_t| = μ P_n.  With x = μ λ and the
    adjugate of the matrix, P_t/P_n = μ T/N, all quadratic in x, and |T| = |N|; d = det(W_tt + λ) is positive.
    """
    w_11, w_12, w_22, w_1n, w_2n, w_nn, v_1, v_2, v_n = contact
    stuck = stick_in_space(contact, -v_n)
    sticks = torch.hypot(stuck[0], stuck[1]) <= mu * stuck[2]
    m = mu.clamp_min(_SMOOTH)
    det, trace, none = w_11 * w_22 - w_12 * w_12, w_11 + w_22, torch.zeros_like(sticks * v_n)
    a_1, a_2, a_12 = w_12 * w_2n - w_22 * w_1n, w_12 * w_1n - w_11 * w_2n, w_1n * w_2n - w_12 * w_nn
    T_1 = (
        m * (v_1 * (w_22 * w_nn - w_2n**2) + v_2 * a_12 + v_n * a_1),
        v_1 * (w_nn - m**2 * w_22) + v_2 * m**2 * w_12 - v_n * w_1n,
        -m * v_1,
    )
    T_2 = (
        m * (v_1 * a_12 + v_2 * (w_11 * w_nn - w_1n**2) + v_n * a_2),
        v_1 * m**2 * w_12 + v_2 * (w_nn - m**2 * w_11) - v_n * w_2n,
        none - m * v_2,
    )
    N = m**2 * (v_1 * a_1 + v_2 * a_2 + v_n * det), m * (v_n * trace - v_1 * w_1n - v_2 * w_2n), v_n
    d = m**2 * det, m * trace, none + 1
    with torch.no_grad():
        pole = (
            w_nn * d[0] + m**2 * (w_1n * a_1 + w_2n * a_2),
            w_nn * d[1] - m * d[0] - m * dot((w_1n, w_2n), (w_1n, w_2n)),
        )
        x, low, high = _secular_root((T_1, T_2, N), m, (*pole, w_nn - m * d[1]), w_nn / m)
        beyond = low > 0
        for _ in range(_MOST_STEPS):
            gap, rate = _excess(T_1, T_2, N, d, x)
            if not (~sticks & ~(gap.abs() <= _SETTLED * (rate * x).abs())).any():
                break
            left = (gap > 0) != beyond
            low, high = torch.where(left, x, low), torch.where(left, high, x)
            x = x - gap / rate
            x = torch.where((x >= low) & (x <= high), x, torch.where(high < torch.inf, 0.5 * (low + high), 4 * low))
        x = torch.where(sticks, 1.0, x)
    gap, rate = _excess(T_1, T_2, N, d, x)
    x = x - gap / rate.detach()
    sign = value(N, x).detach().sign()
    u_1, u_2 = towards(-sign * value(T_1, x), -sign * value(T_2, x))
    form = w_11 * u_1 * u_1 + 2 * w_12 * u_1 * u_2 + w_22 * u_2 * u_2
    n = (-v_n - mu * (v_1 * u_1 + v_2 * u_2)) / (w_nn + mu * (2 * (w_1n * u_1 + w_2n * u_2) + mu * form))
    slides = mu * n * u_1, mu * n * u_2, n
    return where(sticks, stuck, slides)


_SMOOTH = 1e-10  # friction below which the direction of the impulse is that of none
_POLE_STEPS, _STEPS = 8, 4  # of Newton's method, from one side: few of 10⁵ random contacts need one of the next
_MOST_STEPS = 20  # of those that rounding leaves away from the root, which may bisect
_SETTLED = 1e-6  # relative step after which the next is at rounding error


def _excess(
    T_1: Sequence[Values], T_2: Sequence[Values], N: Sequence[Values], d: Sequence[Values], x: Values
) -> tuple[Values, Values]:
    """|T| − |N|, and d times the derivative of its ratio to d, which is nearly straight."""
    T, n = (value(T_1, x), value(T_2, x)), value(N, x)
    square = dot(T, T).clamp_min(1e-300)
    gap = square * square.rsqrt() - n.abs()
    growth = dot(T, (slope(T_1, x), slope(T_2, x))) * square.rsqrt() - n.sign() * slope(N, x)
    return gap, growth - gap * slope(d, x) / value(d, x)


def _secular_root(
    adjugate: Sequence[Sequence[Values]], m: Values, det: Sequence[Values], start: Values
) -> tuple[Values, Values, Values]:
    """Return x > 0 with |T| = |N|, and between what it lies.

    |T|² − N² = ρ (x − p)² − g² e², where the determinant c_0 + c_1 x + c_2 x² − m x³ is −m (x − p) e with its positive
    root p, e = e_0 + e_1 x + x² and ρ > 0 quadratic.  So p − x = ± g e/√ρ, and e/√ρ is concave and nearly the straight
    line that it becomes far out: Newton's method from there is monotone (Conn, Gould & Toint 2000, §7.3).  The root
    lies beyond the pole where N is positive there.
    """
    (T_1, T_2, N), (c_0, c_1, c_2) = adjugate, det
    pole = start
    for _ in range(_POLE_STEPS):
        rate = torch.addcmul(torch.addcmul(c_1, pole, c_2, value=2), m * pole, pole, value=-3)
        pole = pole - value((c_0, c_1, torch.addcmul(c_2, m, pole, value=-1)), pole) / rate
    e_0 = c_0 / (m * pole)
    e = e_0, (e_0 + c_1 / m) / pole, torch.ones_like(pole)
    t_1, t_2, n = (value(p, pole) for p in (T_1, T_2, N))
    square = (n * n - dot((t_1, t_2), (t_1, t_2))).clamp_min(0) / value(e, pole) ** 2
    s_0, s_1, s_2 = (
        one(T_1) + one(T_2) - one(N) + square * one(e)
        for one in (lambda p: p[0] * p[0], lambda p: 2 * p[0] * p[1], lambda p: p[1] * p[1] + 2 * p[0] * p[2])
    )
    rho_0 = s_0 / pole**2
    rho_1 = (s_1 / pole + 2 * rho_0) / pole
    rho = rho_0, rho_1, (((s_2 - rho_0) / pole + 2 * rho_1) / pole).clamp_min(1e-300)
    g, per_rho = torch.where(n > 0, -square.sqrt(), square.sqrt()), rho[2].rsqrt()
    x = (pole - g * per_rho * (e[1] - 0.5 * rho_1 / rho[2])) / (1 + g * per_rho)
    low, high = torch.where(n > 0, pole, 0.0), torch.where(n > 0, torch.inf, pole)
    x = torch.maximum(x, low)
    for _ in range(_STEPS):
        height, square = value(e, x), value(rho, x).clamp_min(1e-300)
        per_rho = g * square.rsqrt()
        gap = torch.addcmul(x - pole, height, per_rho)
        x = x - gap / torch.addcmul(e[2], per_rho, slope(e, x) - 0.5 * height * slope(rho, x) / square)
    return torch.where((x >= low) & (x <= high), x, torch.where(n > 0, 2 * pole, 0.5 * pole)), low, high


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
