"""Laws of planar impact from the literature: the impulse (P_t, P_n) that a law makes of the approach.

    wang-mason, mirtich   Routh's path, restitution after Poisson and after Stronge
    ap-newton, ap-poisson  final slip, as of Anitescu and Potra
    whittaker             friction against the first slip, all along
    drumwright-shell      the impulse that leaves the least energy, and a share ε of it once more

W = (W_tt, W_tn, W_nn) is the inverse mass at the contact; arrays by trial throughout.
"""

from dataclasses import dataclass

import numpy as np


def inverse_mass(mass, inertia, rx, ry):
    """W of contacts at (rx, ry) from the centre, in the contact's axes."""
    return 1 / mass + ry * ry / inertia, -rx * ry / inertia, 1 / mass + rx * rx / inertia


@dataclass(frozen=True)
class Path:
    """Routh's path: dP_t/dP_n and dv_n/dP_n before (1) and after (2) the slip stops, at P_n = stop."""

    k1: np.ndarray
    k2: np.ndarray
    a1: np.ndarray
    a2: np.ndarray
    stop: np.ndarray

    def reach(self, vn, target):
        """P_n at which v_n, rising, is the target."""
        one = (target - vn) / self.a1
        two = self.stop + (target - (vn + self.a1 * self.stop)) / self.a2
        return np.where((self.a1 > 0) & (one <= self.stop), one, two)

    def tangential(self, Pn):
        """P_t where the normal impulse is P_n."""
        stop = np.where(np.isfinite(self.stop), self.stop, 0)
        return np.where(Pn <= self.stop, self.k1 * Pn, self.k1 * stop + self.k2 * (Pn - stop))


def routh_path(W, vt, mu):
    """Slip against friction until it stops, then rest if the cone allows it, else slip the other way."""
    tt, tn, nn = W
    s = np.sign(vt)
    k2 = np.where(np.abs(tn) <= mu * tt, -tn / tt, -np.sign(tn) * mu)
    k1 = np.where(s == 0, k2, -s * mu)
    b1 = tn + k1 * tt
    stop = np.where(s == 0, 0.0, np.where(s * b1 < 0, -vt / b1, np.inf))
    return Path(k1, k2, nn + k1 * tn, nn + k2 * tn, stop)


def poisson(path, vn, eps):
    """The impulse of restitution is ε times that of compression."""
    return (1 + eps) * path.reach(vn, 0.0)


def stronge(path, vn, eps):
    """The work of restitution is ε² times that of compression, with its sign."""
    Pc = path.reach(vn, 0.0)
    stop = np.where(np.isfinite(path.stop), path.stop, 1e30)
    early = Pc <= path.stop  # compression ends before the slip does
    first = np.where(early, Pc, stop)
    second = np.where(early, 0.0, Pc - stop)
    v1 = vn + path.a1 * np.minimum(first, 1e20)
    work = vn * first + path.a1 * first * first / 2
    work = work + np.where(early, 0.0, v1 * second + path.a2 * second * second / 2)
    back = -(eps**2) * work
    length = np.sqrt(np.maximum(2 * back / np.abs(path.a1), 0))
    room = np.where(early, stop - Pc, 0.0)
    fits = early & (length <= room)
    slides_on = early & ~fits
    done = np.where(slides_on, path.a1 * np.minimum(room, 1e10) ** 2 / 2, 0.0)
    v = np.where(slides_on, path.a1 * np.minimum(room, 1e10), 0.0)
    rest = (-v + np.sqrt(np.maximum(v * v + 2 * path.a2 * (back - done), 0))) / path.a2
    return np.where(fits, Pc + length, np.where(early, stop, Pc) + rest)


def along_path(rule):
    """A law of Routh's path that ends by `rule`."""

    def law(W, vt, vn, mu, eps):
        path = routh_path(W, vt, mu)
        Pn = rule(path, vn, eps)
        return path.tangential(Pn), Pn

    return law


def _impulse_for(W, vt, b):
    """The impulse that stops the slip and changes v_n by b."""
    tt, tn, nn = W
    det = tt * nn - tn**2
    return (-vt * nn - tn * b) / det, (tt * b + tn * vt) / det


def final_slip(W, vt, vn, mu, target):
    """Friction against the slip after impact, v_n⁺ = target."""
    tt, tn, nn = W
    b = target - vn
    Pt, Pn = _impulse_for(W, vt, b)
    done = (np.abs(Pt) <= mu * Pn + 1e-15) & (Pn >= 0)
    for sign in (1.0, -1.0):
        a = nn - sign * mu * tn
        p = b / a
        after = vt + (tn - sign * mu * tt) * p
        good = ~done & (a > 0) & (p >= 0) & (sign * after >= -1e-12)
        Pt[good], Pn[good] = (-sign * mu * p)[good], p[good]
        done |= good
    Pt[~done] = np.nan
    return Pt, Pn


def anitescu_potra_newton(W, vt, vn, mu, eps):
    """Final slip with v_n⁺ = −ε v_n."""
    return final_slip(W, vt, vn, mu, -eps * vn)


def anitescu_potra_poisson(W, vt, vn, mu, eps):
    """Final slip to v_n = 0, then ε times that normal impulse with friction against the final slip once more."""
    tt, tn, nn = W
    Pt, Pn = final_slip(W, vt, vn, mu, 0 * vn)
    vt_c, vn_c = vt + tt * Pt + tn * Pn, 0 * vn
    q = eps * Pn
    more = np.clip(-(vt_c + tn * q) / tt, -mu * q, mu * q)
    sinks = tn * more + nn * q < 0
    Pt_c, Pn_c = final_slip(W, vt_c, vn_c, mu, 0 * vn)
    return Pt + np.where(sinks, Pt_c, more), Pn + np.where(sinks, Pn_c, q)


def whittaker(W, vt, vn, mu, eps):
    """Rest if the cone allows it, else friction against the slip before impact."""
    b = -(1 + eps) * vn
    Pt, Pn = _impulse_for(W, vt, b)
    rests = (np.abs(Pt) <= mu * Pn) & (Pn >= 0)
    s = np.sign(vt)
    p = b / (W[2] - s * mu * W[1])
    return np.where(rests, Pt, -s * mu * p), np.where(rests, Pn, p)


def drumwright_shell(W, vt, vn, mu, eps):
    """The least energy within the cone and without sinking in, times 1 + ε."""
    tt, tn, nn = W
    det = tt * nn - tn**2
    rest_t, rest_n = -(nn * vt - tn * vn) / det, -(tt * vn - tn * vt) / det
    candidates = [(rest_t, rest_n)]
    for sign in (1.0, -1.0):
        e = sign * mu
        for k in (-(e * vt + vn) / (tt * e**2 + 2 * tn * e + nn), -vn / (tn * e + nn)):
            candidates.append((k * e, k))
    best, Pt, Pn = np.full(vt.shape, np.inf), np.zeros_like(vt), np.zeros_like(vt)
    for t, n in candidates:
        energy = tt * (t - rest_t) ** 2 + 2 * tn * (t - rest_t) * (n - rest_n) + nn * (n - rest_n) ** 2
        allowed = (n >= -1e-12) & (np.abs(t) <= mu * n + 1e-9) & (vn + tn * t + nn * n >= -1e-9)
        better = allowed & (energy < best)
        best[better], Pt[better], Pn[better] = energy[better], t[better], n[better]
    return (1 + eps) * Pt, (1 + eps) * Pn


LAWS = {
    "wang-mason": along_path(poisson),
    "mirtich": along_path(stronge),
    "ap-newton": anitescu_potra_newton,
    "ap-poisson": anitescu_potra_poisson,
    "whittaker": whittaker,
    "drumwright-shell": drumwright_shell,
}


def impulse(name, W, vt, vn, mu, eps):
    """(P_t, P_n) of the law `name`; not a number where it has no solution."""
    with np.errstate(all="ignore"):
        return LAWS[name](W, vt, vn, np.maximum(mu, 0.0), np.clip(eps, 0, 1.0))
