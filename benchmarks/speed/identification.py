"""Per-trial identification of every trial, against loops over scipy.optimize.

    python benchmarks/speed/identification.py [--published] [--rounds 3] [--quick]

Ours gives every trial its best (μ, ε), the error left and the interval of μ, all trials in one call.  The
rivals minimise the same error, one trial at a time, on a scalar law in plain Python, which is faster
there than any array, and give no interval:

    L-BFGS-B, gradient           one start, both differences from one call in plain Python
    differential evolution       a global search, on a few random trials and scaled up

The required ratio of 100 is for the last, which searches for the global optimum: the error has kinks,
jumps and plateaus, and one start misses its minimum on a quarter to a half of the trials.  "worse": on how many
trials a rival ends above our error, and ours above the rival's, by more than 1e-9 N s; ours never may.

The published drops with x mirrored (docs/log.md has the reason) or as published, else synthetic ones.  One thread,
BLAS included: the pool of SciPy's own linear algebra makes L-BFGS-B up to 50 times slower on a busy machine.
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch
from scipy.optimize import differential_evolution, minimize

from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.laws import find
from speed.harness import drops, header, interleaved, medians, parsed, parser, repeated, row, timed

BAR = 100
BOX = ((0.0, 1.0), (0.0, 1.0))
STEP = 1e-7


def whittaker(w_tt, w_tn, w_nn, v_t, v_n, mu, eps, against_slip=True):
    target, det = -(1 + eps) * v_n, w_tt * w_nn - w_tn * w_tn
    t, n = -(w_nn * v_t + w_tn * target) / det, (w_tt * target + w_tn * v_t) / det
    if abs(t) <= mu * n:
        return t, n
    slope = math.copysign(mu, v_t if against_slip else -t)
    n = target / (w_nn - slope * w_tn)
    return -slope * n, n


def anitescu_potra_newton(*contact):
    return whittaker(*contact, against_slip=False)


def wang_mason(w_tt, w_tn, w_nn, v_t, v_n, mu, eps):
    s = math.copysign(1.0, v_t)
    slope, after = -s * mu, max(-mu, min(mu, -w_tn / w_tt))
    stiff, stiff_after = w_nn + slope * w_tn, w_nn + after * w_tn
    braking = -(w_tn + slope * w_tt) * s
    p_slip = abs(v_t) / braking if braking > 0 else math.inf
    first = braking <= 0 or stiff * p_slip >= -v_n
    p_c = -v_n / stiff if first else p_slip + (-v_n - stiff * p_slip) / stiff_after
    p = (1 + eps) * p_c
    before = min(p, p_slip)
    return slope * before + after * (p - before), p


LAWS = {"whittaker": whittaker, "anitescu_potra_newton": anitescu_potra_newton, "wang_mason": wang_mason}


def squared_error(law, row):
    """(1000 ‖P̂ − P‖)² of one trial at x = (μ, ε): smooth where the error is 0; the scale is kind to tolerances."""
    *contact, P_t, P_n = row

    def value(x):
        t, n = law(*contact, x[0], x[1])
        return 1e6 * ((t - P_t) ** 2 + (n - P_n) ** 2)

    return value


def squared_error_and_gradient(law, row):
    """The same with its gradient by forward differences of P̂, which are as good as exact ones here."""
    *contact, P_t, P_n = row

    def value(x):
        mu, eps = float(x[0]), float(x[1])
        d_mu, d_eps = (STEP if z + STEP <= 1 else -STEP for z in (mu, eps))
        t, n = law(*contact, mu, eps)
        t_mu, n_mu = law(*contact, mu + d_mu, eps)
        t_eps, n_eps = law(*contact, mu, eps + d_eps)
        e_t, e_n = t - P_t, n - P_n
        gradient = (
            2e6 * (e_t * (t_mu - t) + e_n * (n_mu - n)) / d_mu,
            2e6 * (e_t * (t_eps - t) + e_n * (n_eps - n)) / d_eps,
        )
        return 1e6 * (e_t * e_t + e_n * e_n), np.array(gradient)

    return value


def lbfgsb(law, row):
    """Least squared error of an L-BFGS-B run."""
    error, tight = squared_error_and_gradient(law, row), {"ftol": 1e-15, "gtol": 1e-10}
    return minimize(error, (0.1, 0.5), method="L-BFGS-B", jac=True, bounds=BOX, options=tight).fun


GLOBAL = "differential evolution"
RIVALS = {
    "L-BFGS-B, gradient": lbfgsb,
    GLOBAL: lambda law, row: differential_evolution(squared_error(law, row), BOX, rng=0).fun,
}
FEW = {GLOBAL: 40}
"""How many trials a slow rival gets; its time is scaled up to all."""


def loop(rival, law, contacts):
    """Return the errors of a rival on the contacts, N s."""
    return 1e-3 * torch.tensor([rival(law, one) for one in contacts], dtype=torch.float64).clamp_min(0).sqrt()


def compare(name: str, impacts, rounds: int) -> bool:
    """Print one law's rows; return whether ours is worse on no trial."""
    law, total = LAWS[name], len(impacts)
    W, v_c, P = impacts.W, impacts.v_c, impacts.wrench[:, :2]
    contacts = torch.cat((W[:, 0], W[:, 1, 1:], v_c, P), -1).tolist()
    scalar = torch.tensor([law(*one[:5], 0.15, 0.55) for one in contacts], dtype=torch.float64)
    torch.testing.assert_close(scalar, find(name).at(0.15, 0.55).impulse(W, v_c), rtol=1e-12, atol=1e-12)
    order = torch.randperm(total, generator=torch.Generator().manual_seed(0))
    subsets = {rival: order[: FEW.get(rival, total)].tolist() for rival in RIVALS}
    errors, fit = {}, fit_trials(impacts, find(name))

    def clock(rival):
        errors[rival], seconds = timed(loop, RIVALS[rival], law, [contacts[i] for i in subsets[rival]])
        return seconds * total / len(subsets[rival])

    clocks = {}
    for rival in RIVALS:
        clocks["ours", rival] = repeated(lambda: fit_trials(impacts, find(name)), 3)
        clocks[rival] = lambda rival=rival: clock(rival)
    times = interleaved(clocks, rounds)
    ours = medians({"ours": [value for rival in RIVALS for value in times["ours", rival]]})["ours"]
    row(name, "ours", f"{1e3 * ours:.0f}", "1", f"{1e3 * fit.error.mean():.3f}", "", "")
    right = True
    for rival, error in errors.items():
        best, ratio = fit.error[subsets[rival]], medians(times)[rival] / ours
        worse, better = (error > best + 1e-9).sum().item(), (best > error + 1e-9).sum().item()
        right &= better == 0
        bar = f" (required {BAR})" if rival == GLOBAL else ""
        count = f"{worse} of {len(error)}" + (", time scaled up" if len(error) < total else "")
        row(name, rival, f"{1e3 * ratio * ours:.0f}", f"{ratio:.0f}{bar}", f"{1e3 * error.mean():.3f}", count, better)
    return right


def main() -> int:
    options = parser(__doc__, rounds=3)
    options.add_argument("--published", action="store_true", help="the drops as published, x not mirrored")
    options = parsed(options)
    impacts = drops("published" if options.published else "mirrored")[: 60 if options.quick else None]
    print(f"{impacts}; median of {options.rounds} rounds, one thread")
    header("law", "method", "ms", "ratio", "mean error, mN s", "rival worse on", "ours worse on")
    return 0 if all([compare(name, impacts, options.rounds) for name in LAWS]) else 1


if __name__ == "__main__":
    sys.exit(main())
