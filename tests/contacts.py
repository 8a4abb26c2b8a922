"""Random contacts, and slow independent references of the impact laws in plain NumPy.

Nothing here is shared with `contactlearn.laws`: the complementarity problems are enumerated, the convex
programme goes to an interior-point solver, and the paths in impulse space are followed in small steps.
"""

import itertools
from typing import NamedTuple

import clarabel
import numpy as np
import pytest
import torch
from scipy import sparse
from torch import Tensor

from contactlearn.laws import find, names

torch.set_num_threads(1)  # for batches of this size two threads mostly wait for each other: three times as slow


class Bodies(NamedTuple):
    """Random bodies on approach: mass [n] kg, inertia [n] kg m², r [n, 2] m, v [n, 3]."""

    mass: Tensor
    inertia: Tensor
    r: Tensor
    v: Tensor


class Contacts(NamedTuple):
    """Inputs of a law: W [n, 2, 2] in 1/kg, v_c [n, 2] in m/s, μ [n], ε [n]."""

    W: Tensor
    v_c: Tensor
    mu: Tensor
    eps: Tensor

    def __getitem__(self, rows):  # rows of all four, where a tuple would give one of the four
        return Contacts(*(x[rows] for x in self))

    def numpy(self) -> tuple[np.ndarray, ...]:
        return tuple(x.numpy() for x in self)


def _draw(n: int, seed: int):
    rng = np.random.default_rng(seed)
    mass = 10 ** rng.uniform(-1, 1, n)
    gyration = 10 ** rng.uniform(-2, 0, n)
    # |r| from a thirtieth to thirty radii of gyration: from W ≈ 1/m to nearly singular.
    length = gyration * 10 ** rng.uniform(-1.5, 1.5, n)
    angle = rng.uniform(-np.pi, 0, n)
    r = length[:, None] * np.stack((np.cos(angle), np.sin(angle)), -1)
    r[rng.random(n) < 0.02, 0] = 0.0
    v_n = -(10 ** rng.uniform(-1, 1, n))
    # Slip from a thousandth to thirty times the approach; one in fifty starts with none at all.
    v_t = rng.choice([-1, 1], n) * -v_n * 10 ** rng.uniform(-3, 1.5, n)
    v_t[rng.random(n) < 0.02] = 0.0
    mu, eps = rng.uniform(0, 1.5, n), rng.uniform(0, 1, n)
    mu[rng.random(n) < 0.02] = 0.0
    end = rng.random(n)
    eps[end < 0.02], eps[end > 0.98] = 0.0, 1.0
    omega = rng.normal(0, 5, n)
    return mass, mass * gyration**2, r, v_t, v_n, omega, mu, eps


def random_bodies(n: int, seed: int) -> Bodies:
    """The bodies of `random_contacts`, with a random spin."""
    mass, inertia, r, v_t, v_n, omega, _, _ = _draw(n, seed)
    v = np.stack((v_t + r[:, 1] * omega, v_n - r[:, 0] * omega, omega), -1)
    return Bodies(*map(torch.from_numpy, (mass, inertia, r, v)))


def random_contacts(n: int, seed: int) -> Contacts:
    """Contacts of random bodies, with μ in [0, 1.5] and ε in [0, 1], ends included."""
    mass, inertia, r, v_t, v_n, _, mu, eps = _draw(n, seed)
    J = np.zeros((n, 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1
    J[:, 0, 2], J[:, 1, 2] = -r[:, 1], r[:, 0]
    W = (J / np.stack((mass, mass, inertia), -1)[:, None]) @ J.transpose(0, 2, 1)
    return Contacts(*map(torch.from_numpy, (W, np.stack((v_t, v_n), -1), mu, eps)))


def shared(contacts: Contacts, mu: float, eps: float) -> Contacts:
    """The same contacts with one μ and one ε."""
    return contacts._replace(mu=torch.full_like(contacts.mu, mu), eps=torch.full_like(contacts.eps, eps))


# --- Linear complementarity: find z ≥ 0 with w = M z + q ≥ 0 and zᵀw = 0 -----------------------


def enumerate_lcp(M: np.ndarray, q: np.ndarray, tolerance: float = 1e-9) -> list[np.ndarray]:
    """All solutions z at a complementary basis, each basis solved as a linear system."""
    n = len(q)
    scale = max(1.0, abs(q).max())
    solutions = []
    for basis in itertools.product((False, True), repeat=n):
        inside = np.array(basis)
        z = np.zeros(n)
        A = M[np.ix_(inside, inside)]
        if inside.any():
            if np.linalg.cond(A) > 1e13:
                continue
            z[inside] = np.linalg.solve(A, -q[inside])
        if z.min() >= -tolerance * scale and (M @ z + q)[~inside].min(initial=0) >= -tolerance * scale:
            solutions.append(z)
    return solutions


def friction_lcp(w_tt, w_tn, w_nn, mu, v_t, v_n, normal=0.0):
    """M, q of one contact in z = (P_n, β⁺, β⁻, λ), with P_t = β⁺ − β⁻ and λ = |v_t⁺| while sliding.

    v_n is the free normal velocity minus its lower bound; `normal` is a normal impulse that is
    applied in any case, so that z[0] is what comes on top of it and friction may use the sum.
    """
    M = [[w_nn, w_tn, -w_tn, 0.0], [w_tn, w_tt, -w_tt, 1.0], [-w_tn, -w_tt, w_tt, 1.0], [mu, -1.0, -1.0, 0.0]]
    return M, [v_n + w_nn * normal, v_t + w_tn * normal, -v_t - w_tn * normal, mu * normal]


def anitescu_potra(contacts: Contacts, restitution: str) -> tuple[np.ndarray, np.ndarray]:
    """P [n, 2] of the complementarity problems, and the share of P_n that is extra impulse of decompression [n]."""

    def solve(W, mu, v_c, normal=0.0, size=0.0):
        M, q = friction_lcp(W[0, 0].item(), W[0, 1].item(), W[1, 1].item(), mu.item(), *v_c.tolist(), normal)
        found = [np.array([z[1] - z[2], z[0]]) for z in enumerate_lcp(np.array(M), np.array(q))]
        assert found, "the complementarity problem has a solution"
        assert np.ptp(found, axis=0).max() <= 1e-7 * max(size, np.abs(found).max()), "the impulse is unique"
        return found[0]

    result, extra = [], []
    for W, v_c, mu, eps in zip(*contacts.numpy(), strict=True):
        scale, speed = np.trace(W), np.linalg.norm(v_c)  # so that pivots compare with 1
        W, v_c = W / scale, v_c / speed
        if restitution == "newton":
            P = solve(W, mu, v_c * [1, 1 + eps])
        else:
            P_c = solve(W, mu, v_c)
            normal = eps * P_c[1]
            P_d = solve(W, mu, v_c + W @ P_c, normal, size=abs(P_c).max())
            P = P_c + P_d + [0, normal]
            extra.append(P_d[1] / P[1])
        result.append(P * speed / scale)
    return np.array(result), np.array(extra)


# --- The convex programme of Drumwright & Shell -----------------------------------------------


def drumwright_shell_compression(contacts: Contacts) -> np.ndarray:
    """P^c [n, 2]: minimum of ½ PᵀWP + Pᵀv_c with P_n ≥ 0, |P_t| ≤ μ P_n, v_n⁺ ≥ 0, by Clarabel."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    result = []
    for W, v_c, mu, _ in zip(*contacts.numpy(), strict=True):
        # In y = Lᵀ P with W = L Lᵀ the objective is ½ |y − y_0|²; the solver gets y / |y_0|.
        inverse = np.linalg.inv(np.linalg.cholesky(W))
        y_0 = -inverse @ v_c
        size = np.linalg.norm(y_0)
        A = np.array([[0, -1], [1, -mu], [-1, -mu], -W[1]]) @ inverse.T
        rows = np.linalg.norm(A, axis=1)
        b = np.array([0, 0, 0, v_c[1] / size]) / rows
        A, identity = sparse.csc_matrix(A / rows[:, None]), sparse.eye(2, format="csc")
        cones = [clarabel.NonnegativeConeT(4)]
        solution = clarabel.DefaultSolver(identity, -y_0 / size, A, b, cones, settings).solve()
        assert solution.status == clarabel.SolverStatus.Solved
        result.append(inverse.T @ np.array(solution.x) * size)
    return np.array(result)


# --- Integration in impulse space ---------------------------------------------------------------


class Integrated(NamedTuple):
    """P [n, 2] at the end, and of Coulomb's path the phase in which the slip ended and how it went on."""

    P: np.ndarray
    slip_ended: np.ndarray  # 0 in compression, 1 in restitution, 2 never
    reversed: np.ndarray


def integrate(contacts: Contacts, restitution: str, friction: str, steps: int) -> Integrated:
    """Follow dP_t/dp in about `steps` equal steps of the clock p = P_n.

    Coulomb's friction is stepped as by Moreau: the impulse of a step that ends the slip, clamped to
    the cone, which is first order where the slip ends and exact elsewhere.  Viscous friction
    dP_t/dp = −μ v_t takes the implicit midpoint rule, of second order.
    """
    w = -contacts.v_c[:, 1].numpy() / contacts.W[:, 1, 1].numpy()
    end = _follow(contacts, restitution, friction, 1e-3 * w, growth=1.03).P[:, 1]
    return _follow(contacts, restitution, friction, end / steps)


def _follow(contacts: Contacts, restitution: str, friction: str, h: np.ndarray, growth: float = 1.0) -> Integrated:
    W, v_c, mu, eps = contacts.numpy()
    w_tt, w_tn, w_nn = W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]
    p, P_t, work, goal = np.zeros((4, len(mu)))
    phase = np.zeros(len(mu), dtype=int)  # 0 compression, 1 restitution, 2 done
    slip_ended, turned = np.full(len(mu), 2), np.zeros(len(mu), dtype=bool)
    direction = np.sign(v_c[:, 0])
    for _ in range(1_000_000):
        if (phase == 2).all():
            return Integrated(np.stack((P_t, p), -1), slip_ended, turned)
        v_t = v_c[:, 0] + w_tt * P_t + w_tn * p
        v_n = v_c[:, 1] + w_tn * P_t + w_nn * p
        poisson = (phase == 1) & (restitution == "poisson")
        step = np.where(poisson, np.minimum(h, goal - p), h)
        if friction == "coulomb":
            d_t = np.clip(-(v_t + w_tn * step) / w_tt, -mu * step, mu * step)
        else:
            d_t = -mu * step * (v_t + 0.5 * w_tn * step) / (1 + 0.5 * mu * step * w_tt)
        d_n = w_tn * d_t + w_nn * step
        share = np.ones(len(mu))  # of the step, up to where its phase ends
        ends = (phase == 0) & (v_n + d_n >= 0)
        share[ends] = -v_n[ends] / d_n[ends]
        if restitution == "stronge":
            left = goal - work
            stops = (phase == 1) & (step * (v_n + 0.5 * d_n) >= left)
            root = np.sqrt(np.maximum(v_n**2 + 2 * d_n * left / step, 0))
            share[stops] = (2 * left / (step * np.maximum(v_n + root, 1e-300)))[stops]
        elif restitution == "newton":
            left = -eps * v_c[:, 1] - v_n  # of v_n
            stops = (phase == 1) & (d_n >= left)
            share[stops] = (left / d_n)[stops]
        else:
            stops = poisson & (goal - p <= h)
        share[phase == 2] = 0
        after = direction * (v_t + w_tt * d_t + w_tn * step)
        stopped = (slip_ended == 2) & (share > 0) & (after <= 1e-12 * abs(v_c).max(-1))
        slip_ended[stopped] = phase[stopped]
        turned |= (slip_ended < 2) & (share > 0) & (after < -1e-9 * abs(v_c).max(-1))
        work += share * step * (v_n + 0.5 * share * d_n)
        P_t, p = P_t + share * d_t, p + share * step
        # Works are counted from p_c on in restitution: it gives back ε² of what compression took.
        goal = np.where(ends, (1 + eps) * p if restitution == "poisson" else -(eps**2) * work, goal)
        work = np.where(ends, 0.0, work)
        phase = phase + ends + stops
        h = h * growth
    raise ArithmeticError("the path has no end")


# --- Laws by name -------------------------------------------------------------------------------

VARIANTS = ("textbook", "fazeli2017")
DIFFER = {"whittaker", "anitescu_potra_poisson", "drumwright_shell", "mirtich"}  # in the paper's variant
DISTINCT = [
    pytest.param(name, variant, id=f"{name}-{variant}")
    for name in names()
    for variant in VARIANTS[: 1 + (name in DIFFER)]
]


def impulse(name, W, v_c, mu, eps, *, variant="textbook", e_t=None, out=None):
    """P [..., N, 2] of a law; e_t is Chatterjee and Ruina's alone."""
    law = find(name, variant)
    options = {} if e_t is None or "e_t" not in law.options else {"e_t": e_t}
    return find(name, variant, **options).at(mu, eps).impulse(W, v_c, out=out)
