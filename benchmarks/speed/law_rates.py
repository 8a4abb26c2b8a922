"""Rate of every law on a whole (μ, ε) grid, against a Lemke solver that takes one contact at a time.

    python benchmarks/speed/law_rates.py [--rounds 7] [--quick]

Each law resolves 1718 contacts (the number of published drops) on a 64 × 64 grid of (μ, ε), 7.0
million impulses in one call; Lemke's method gets one 4 × 4 complementarity problem a contact, in
plain Python on lists, which at this size is faster than NumPy.  It runs once beside each law.
The laws write into reused memory (`out=`), as a sweep over a large grid does: allocating 113 MB a call can
cost more than the fastest laws.  The last row is what allocating and filling it alone costs.

A second table has the laws in space against the same law in the plane, both of 20 000 contacts with a μ and an ε each,
and on the 1718 contacts of a grid.
"""

import math
import statistics
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "benchmarks")]

from contacts import friction_lcp  # noqa: E402

from contactlearn.laws import catalogue, find  # noqa: E402
from contactlearn.mechanics import rigid_body  # noqa: E402
from contactlearn.mechanics.space import SPACE  # noqa: E402
from contactlearn.testing.laws import Contacts  # noqa: E402
from speed.harness import header, interleaved, parsed, parser, row, seconds  # noqa: E402

TRIALS, GRID = 1718, 64
BARS = {"whittaker": 1000}  # times Lemke's rate; 400 for the others
LEAST = 400
SPATIAL, MOST = 20_000, 20  # contacts, and times the time in the plane
# Without a closed form: two roots of a viscous path by Newton's method, and the time that a spring pushes.
ITERATED = (("mirtich", "fazeli2017"), ("spring_dashpot", "textbook"))


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


Contact = tuple[float, ...]
"""W_tt, W_tn, W_nn, v_t, v_n, μ, ε."""


def lemke(M: list[list[float]], q: list[float]) -> list[float]:
    """One solution z by Lemke's complementary pivoting, on lists: for 4 × 4 twice as fast as NumPy.

    Basic variables are kept as affine functions of the n + 1 others.  Variable i < n is z_i, n + i
    is w_i and 2 n the artificial one.
    """
    n = len(q)
    lowest = min(q)
    if lowest >= 0:
        return [0.0] * n
    rows = [[q[i], *M[i], 1.0] for i in range(n)]
    basic, others = list(range(n, 2 * n)), [-1, *range(n), 2 * n]
    row, column = q.index(lowest), n + 1
    for _ in range(50):
        leaving = basic[row]
        basic[row], others[column] = others[column], leaving
        pivot = rows[row]
        factor = -1 / pivot[column]
        pivot[column] = -1.0
        rows[row] = pivot = [x * factor for x in pivot]
        for i in range(n):
            if i != row:
                line = rows[i]
                factor = line[column]
                if factor:
                    line[column] = 0.0
                    rows[i] = [a + factor * b for a, b in zip(line, pivot, strict=True)]
        if leaving == 2 * n:
            z = [0.0] * n
            for i, line in zip(basic, rows, strict=True):
                if i < n:
                    z[i] = line[0]
            return z
        column = others.index(leaving - n if leaving >= n else leaving + n)
        best = math.inf
        for i, line in enumerate(rows):
            if line[column] < -1e-12:
                ratio = -line[0] / line[column]
                if ratio < best - 1e-13 or (ratio <= best + 1e-13 and basic[i] == 2 * n):
                    best, row = ratio, i
        if best == math.inf:
            raise ArithmeticError("Lemke's method ended on a ray")
    raise ArithmeticError("Lemke's method cycled")


def lemke_loop(contacts: list[Contact]) -> None:
    """Solve Anitescu & Potra's problem with Newton restitution, building it included."""
    for w_tt, w_tn, w_nn, v_t, v_n, mu, eps in contacts:
        lemke(*friction_lcp(w_tt, w_tn, w_nn, mu, v_t, (1 + eps) * v_n))


def agree(W: torch.Tensor, v_c: torch.Tensor, mus: torch.Tensor, epses: torch.Tensor) -> float:
    """Largest relative difference of the law and its rival, so that both rates are of the same problem."""
    P = find("anitescu_potra_newton").at(mus, epses).impulse(W, v_c)
    worst = 0.0
    for w, v, mu, eps, p in zip(*(x.tolist() for x in (W, v_c, mus, epses, P)), strict=True):
        z = lemke(*friction_lcp(w[0][0], w[0][1], w[1][1], mu, v[0], (1 + eps) * v[1]))
        worst = max(worst, float(np.hypot(z[1] - z[2] - p[0], z[0] - p[1]) / np.hypot(*p)))
    return worst


def in_space(rounds: int, grid: int) -> int:
    """Print the time of each law in space over that in the plane; return how many take too long."""
    each = [Contacts.draw(SPATIAL), Contacts.draw_in_space(SPATIAL)]
    few = [contacts.part(slice(TRIALS)) for contacts in each]
    mus = torch.linspace(0, 1.0, grid, dtype=torch.float64)[:, None, None]
    epses = torch.linspace(0, 1, grid, dtype=torch.float64)[:, None]
    out = [torch.empty(grid, grid, TRIALS, c.v_c.shape[-1], dtype=torch.float64) for c in few]
    names = [name for name in catalogue() if SPACE in find(name).spaces]

    def alone(name: str, k: int) -> None:
        find(name).at(each[k].mu, each[k].eps).impulse(each[k].W, each[k].v_c)

    def on_grid(name: str, k: int) -> None:
        find(name).at(mus, epses).impulse(few[k].W, few[k].v_c, out=out[k])

    calls = {(name, call, k): partial(call, name, k) for name in names for call in (alone, on_grid) for k in (0, 1)}
    for call in calls.values():
        call()  # warm up
    times = interleaved({key: partial(seconds, call) for key, call in calls.items()}, rounds)

    def ratio(name: str, call: Callable[[str, int], None]) -> float:
        return statistics.median(b / a for a, b in zip(*(times[name, call, k] for k in (0, 1)), strict=True))

    print(f"\n{SPATIAL} contacts of one μ and ε each, and {TRIALS} x {grid} x {grid}")
    header("law", "in space, ns a contact", "× the plane", "× the plane on the grid", "at most")
    missed = 0
    for name in names:
        nanoseconds = statistics.median(times[name, alone, 1]) / SPATIAL * 1e9
        slower = ratio(name, alone), ratio(name, on_grid)
        missed += max(slower) > MOST
        row(name, f"{nanoseconds:.0f}", *(f"{x:.1f}" for x in slower), f"{MOST}{', missed' * (max(slower) > MOST)}")
    return missed


def main() -> int:
    options = parsed(parser(__doc__, rounds=7))
    grid = 8 if options.quick else GRID
    W, v_c = ellipse_contacts(TRIALS, seed=0)
    mus, epses = torch.linspace(0, 1.2, grid, dtype=torch.float64), torch.linspace(0, 1, grid, dtype=torch.float64)
    rng = np.random.default_rng(1)
    each = [torch.from_numpy(rng.uniform(0, high, TRIALS)) for high in (1.2, 1.0)]
    print(f"Lemke and the law differ by at most {agree(W, v_c, *each):.1e} of |P|")
    contacts = [
        (w[0][0], w[0][1], w[1][1], *v, mu, eps)
        for w, v, mu, eps in zip(*(x.tolist() for x in (W, v_c, *each)), strict=True)
    ]
    out, many = torch.empty((grid, grid, TRIALS, 2), dtype=torch.float64), TRIALS * grid**2
    cases = [(name, variant) for name, family in catalogue().items() for variant in family]

    def resolve(name: str, variant: str) -> None:
        find(name, variant).at(mus[:, None, None], epses[:, None]).impulse(W, v_c, out=out)

    clocks = {}
    for case in cases:
        resolve(*case)  # warm up
        clocks["lemke", *case] = lambda: seconds(lemke_loop, contacts)
        clocks[case] = lambda case=case: seconds(resolve, *case)
    clocks["writing the result"] = lambda: seconds(lambda: torch.empty_like(out).fill_(1.0))
    times = interleaved(clocks, options.rounds)

    print(f"\n{TRIALS} contacts x {grid} x {grid} (mu, eps) = {many / 1e6:.2f} million impulses a call")
    print(f"median of {options.rounds} rounds, one thread, torch {torch.__version__}")
    header("law", "variant", "million/s", "× Lemke", "required")
    missed = 0
    for case in cases:
        pairs = zip(times["lemke", *case], times[case], strict=True)
        ratio = statistics.median(rival / TRIALS / (own / many) for rival, own in pairs)
        bar = BARS.get(case[0], LEAST)
        missed += ratio < bar and case not in ITERATED
        mark = "" if ratio >= bar else ", missed (iterated)" if case in ITERATED else ", missed"
        row(*case, f"{many / statistics.median(times[case]) / 1e6:.1f}", f"{ratio:.0f}", f"{bar}{mark}")
    lemkes = [value for case in cases for value in times["lemke", *case]]
    rivals = {"lemke, one a contact": (lemkes, TRIALS), "writing the result": (times["writing the result"], many)}
    for name, (values, count) in rivals.items():
        row(name, "", f"{count / statistics.median(values) / 1e6:.3f}", "", "")
    missed += in_space(options.rounds, grid)
    return 1 if missed and not options.quick else 0


if __name__ == "__main__":
    sys.exit(main())
