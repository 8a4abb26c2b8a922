"""Rate of every law on a whole (μ, ε) grid, against a Lemke solver that takes one contact at a time.

    python benchmarks/speed/law_rates.py [--quick]

Each law resolves 1718 contacts (the number of published drops) on a 64 × 64 grid of (μ, ε), 7.0
million impulses in one call; Lemke's method gets one 4 × 4 complementarity problem a contact, in
plain Python on lists, which at this size is faster than NumPy.  Where the `quadprog` package is
installed, its convex programme of Drumwright & Shell's compression is timed too.  One thread,
interleaved rounds, medians; read the ratios, the rates are the machine's.  The laws write into memory
that is used again (`out=`): a sweep over a large grid is made that way, and 113 MB of new memory a call
can cost more than the fastest laws; the last row is what allocating and filling it alone would cost.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from contacts import friction_lcp, lemke  # noqa: E402

from contactlearn.laws import catalogue, find  # noqa: E402
from contactlearn.mechanics import rigid_body  # noqa: E402

try:
    import quadprog
except ImportError:
    quadprog = None

TRIALS, GRID = 1718, 64
BARS = {"whittaker": 1000}  # times Lemke's rate; 400 for the others
LEAST = 400
ITERATED = ("mirtich", "fazeli2017")  # a viscous path without a closed form: two roots by Newton's method


def ellipse_contacts(n: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """W [n, 2, 2] and v_c [n, 2] like the published drops: a flat ellipse of 70 × 50 mm and 36 g."""
    rng = np.random.default_rng(seed)
    a, b, mass = 0.035, 0.025, 0.0364
    theta = rng.uniform(-np.pi, np.pi, n)
    height = np.sqrt((a * np.sin(theta)) ** 2 + (b * np.cos(theta)) ** 2)
    r = np.stack(((a**2 - b**2) * np.sin(theta) * np.cos(theta) / -height, -height), -1)
    v = np.stack((rng.normal(0, 0.5, n), -rng.uniform(1.0, 2.5, n), rng.normal(0, 5, n)), -1)
    mass, r, v = torch.full((n,), mass, dtype=torch.float64), torch.from_numpy(r), torch.from_numpy(v)
    W, v_c = rigid_body.inverse_inertia(mass, mass * (a**2 + b**2) / 4, r), rigid_body.contact_velocity(r, v)
    v_c[:, 1].clamp_(max=-0.1)
    return W, v_c


def lemke_rate(W: torch.Tensor, v_c: torch.Tensor, mus: list[float], epses: list[float]) -> float:
    """Impulses a second of Anitescu & Potra's problem with Newton restitution, building it included."""
    rows = [(w[0][0], w[0][1], w[1][1], *v) for w, v in zip(W.tolist(), v_c.tolist(), strict=True)]
    start = time.perf_counter()
    for (w_tt, w_tn, w_nn, v_t, v_n), mu, eps in zip(rows, mus, epses, strict=True):
        lemke(*friction_lcp(w_tt, w_tn, w_nn, mu, v_t, (1 + eps) * v_n))
    return len(rows) / (time.perf_counter() - start)


def quadprog_rate(W: torch.Tensor, v_c: torch.Tensor, mus: list[float]) -> float:
    """Compressions a second of Drumwright & Shell's convex programme."""
    W, v_c = W.numpy(), v_c.numpy()
    A, b = np.array([[0.0, 1, -1, 0], [1.0, 0, 0, 0]]), np.zeros(4)
    start = time.perf_counter()
    for w, v, mu in zip(W, v_c, mus, strict=True):
        A[1, 1] = A[1, 2] = mu
        A[:, 3], b[3] = w[1], -v[1]
        quadprog.solve_qp(w, -v, A, b)
    return len(W) / (time.perf_counter() - start)


def law_rate(
    name: str,
    variant: str,
    W: torch.Tensor,
    v_c: torch.Tensor,
    mus: torch.Tensor,
    epses: torch.Tensor,
    out: torch.Tensor,
) -> float:
    start = time.perf_counter()
    find(name, variant).at(mus[:, None, None], epses[:, None]).impulse(W, v_c, out=out)
    return out.shape[:-1].numel() / (time.perf_counter() - start)


def writing_rate(grid: int) -> float:
    """Impulses a second of allocating and filling the result, with nothing computed: the limit of a call."""
    start = time.perf_counter()
    torch.empty((grid, grid, TRIALS, 2), dtype=torch.float64).fill_(1.0)
    return TRIALS * grid**2 / (time.perf_counter() - start)


def agree(W: torch.Tensor, v_c: torch.Tensor, mus: torch.Tensor, epses: torch.Tensor) -> float:
    """Largest relative difference of the law and its rival, so that both rates are of the same problem."""
    P = find("anitescu_potra_newton").at(mus, epses).impulse(W, v_c)
    worst = 0.0
    for w, v, mu, eps, p in zip(*(x.tolist() for x in (W, v_c, mus, epses, P)), strict=True):
        z = lemke(*friction_lcp(w[0][0], w[0][1], w[1][1], mu, v[0], (1 + eps) * v[1]))
        worst = max(worst, float(np.hypot(z[1] - z[2] - p[0], z[0] - p[1]) / np.hypot(*p)))
    return worst


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="an 8 × 8 grid and two rounds: does it run?")
    quick = parser.parse_args().quick
    grid, rounds = (8, 2) if quick else (GRID, 7)
    torch.set_num_threads(1)
    W, v_c = ellipse_contacts(TRIALS, seed=0)
    mus, epses = torch.linspace(0, 1.2, grid, dtype=torch.float64), torch.linspace(0, 1, grid, dtype=torch.float64)
    rng = np.random.default_rng(1)
    each = [torch.from_numpy(rng.uniform(0, high, TRIALS)) for high in (1.2, 1.0)]
    print(f"Lemke and the law differ by at most {agree(W, v_c, *each):.1e} of |P|")

    cases = [(name, variant) for name, family in catalogue().items() for variant in family]
    rates: dict[tuple, list[float]] = {case: [] for case in cases}
    ratios: dict[tuple, list[float]] = {case: [] for case in cases}
    rivals: dict[str, list[float]] = {
        "lemke, one a contact": [],
        "quadprog, one a contact": [],
        "writing the result": [],
    }
    out = torch.empty((grid, grid, TRIALS, 2), dtype=torch.float64)
    for name, variant in cases:  # warm up
        law_rate(name, variant, W, v_c, mus, epses, out)
    for _ in range(rounds):
        for case in cases:
            rival = lemke_rate(W, v_c, *(x.tolist() for x in each))  # beside each law: the machine's pace drifts
            rates[case].append(law_rate(*case, W, v_c, mus, epses, out))
            ratios[case].append(rates[case][-1] / rival)
            rivals["lemke, one a contact"].append(rival)
        if quadprog:
            rivals["quadprog, one a contact"].append(quadprog_rate(W, v_c, each[0].tolist()))
        rivals["writing the result"].append(writing_rate(grid))

    print(f"\n{TRIALS} contacts x {grid} x {grid} (mu, eps) = {TRIALS * grid**2 / 1e6:.2f} million impulses a call")
    print(f"median of {rounds} rounds, one thread, torch {torch.__version__}\n")
    print(f"{'law':<24}{'variant':<12}{'million/s':>10}{'x Lemke':>10}{'bar':>7}")
    missed = 0
    for case in cases:
        ratio, bar = statistics.median(ratios[case]), BARS.get(case[0], LEAST)
        missed += ratio < bar and case != ITERATED
        rate = statistics.median(rates[case]) / 1e6
        verdict = "" if ratio >= bar else "  missed (iterated)" if case == ITERATED else "  missed"
        print(f"{case[0]:<24}{case[1]:<12}{rate:>10.1f}{ratio:>10.0f}{bar:>7}{verdict}")
    for name, values in rivals.items():
        if values:
            print(f"{name:<36}{statistics.median(values) / 1e6:>10.3f}")
    return 1 if missed and not quick else 0


if __name__ == "__main__":
    sys.exit(main())
