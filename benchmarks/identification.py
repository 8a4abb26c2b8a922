"""Per-trial identification of every trial, against loops over scipy.optimize.

    python benchmarks/identification.py [--quick]

Ours gives every trial its best (μ, ε), the error left and the interval of μ, all trials in one call.  The
rivals minimise the same error, one trial at a time, on a scalar law in plain Python, which is faster
there than any array: L-BFGS-B and Nelder-Mead from one start, and L-BFGS-B from eight.  The published
drops with x mirrored where they can be had (docs/log.md says why), else synthetic ones.  One thread,
interleaved rounds, medians.  "worse": on how many trials a rival ends above our error, and ours above its,
by more than 1e-9 N s.
"""

import argparse
import math
import statistics
import time

import torch
from scipy.optimize import minimize

from contactlearn.data import ellipse_drops, synthetic
from contactlearn.errors import DataError
from contactlearn.fit_trials import identify_trials
from contactlearn.laws import impulse

BAR = 100
BOX = ((0.0, 1.0), (0.0, 1.0))
STARTS = [(mu, eps) for mu in (0.02, 0.1, 0.3, 0.8) for eps in (0.35, 0.65)]


def whittaker(w_tt, w_tn, w_nn, v_t, v_n, mu, eps):
    target, det = -(1 + eps) * v_n, w_tt * w_nn - w_tn * w_tn
    t, n = -(w_nn * v_t + w_tn * target) / det, (w_tt * target + w_tn * v_t) / det
    if abs(t) <= mu * n:
        return t, n
    slope = math.copysign(mu, v_t)
    n = target / (w_nn - slope * w_tn)
    return -slope * n, n


def anitescu_potra_newton(w_tt, w_tn, w_nn, v_t, v_n, mu, eps):
    target, det = -(1 + eps) * v_n, w_tt * w_nn - w_tn * w_tn
    t, n = -(w_nn * v_t + w_tn * target) / det, (w_tt * target + w_tn * v_t) / det
    if abs(t) <= mu * n:
        return t, n
    slope = math.copysign(mu, -t)
    n = target / (w_nn - slope * w_tn)
    return -slope * n, n


def wang_mason(w_tt, w_tn, w_nn, v_t, v_n, mu, eps):
    s = math.copysign(1.0, v_t)
    slope, after = -s * mu, max(-mu, min(mu, -w_tn / w_tt))
    stiff, stiff_after = w_nn + slope * w_tn, w_nn + after * w_tn
    braking = -(w_tn + slope * w_tt) * s
    p_slip = abs(v_t) / braking if braking > 0 else math.inf
    if stiff * p_slip >= -v_n if braking > 0 else True:
        p_c = -v_n / stiff
    else:
        p_c = p_slip + (-v_n - stiff * p_slip) / stiff_after
    p = (1 + eps) * p_c
    before = min(p, p_slip)
    return slope * before + after * (p - before), p


LAWS = {"whittaker": whittaker, "anitescu_potra_newton": anitescu_potra_newton, "wang_mason": wang_mason}


def load():
    try:
        drops = ellipse_drops.load()
    except DataError as error:
        print(f"synthetic drops, since the published ones cannot be had: {error}\n")
        return synthetic.load(size=1718)
    mirror = torch.tensor((-1.0, 1.0, 1.0), dtype=torch.float64)
    return drops.replace(q=drops.q * mirror, v_pre=drops.v_pre * mirror, v_post=drops.v_post * mirror)


def loop(law, rows, method, starts):
    """Errors of a rival on every trial, N s, and its time in s."""
    begin, errors = time.perf_counter(), []
    for *contact, P_t, P_n in rows:

        def error(x, contact=contact, P_t=P_t, P_n=P_n):
            t, n = law(*contact, x[0], x[1])
            # The square is what a gradient method likes; the scale of 1e3 is kind to its tolerances.
            return 1e6 * ((t - P_t) ** 2 + (n - P_n) ** 2)

        found = min(minimize(error, start, method=method, bounds=BOX).fun for start in starts)
        errors.append(1e-3 * math.sqrt(max(found, 0.0)))
    return torch.tensor(errors, dtype=torch.float64), time.perf_counter() - begin


RIVALS = {
    "L-BFGS-B, one start": ("L-BFGS-B", [(0.1, 0.5)]),
    "Nelder-Mead, one start": ("Nelder-Mead", [(0.1, 0.5)]),
    "L-BFGS-B, eight starts": ("L-BFGS-B", STARTS),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="60 trials: does it run?")
    torch.set_num_threads(1)
    impacts = load()
    if parser.parse_args().quick:
        impacts = impacts[:60]
    W, v_c, P = impacts.W, impacts.v_c, impacts.wrench[:, :2]
    columns = torch.stack((W[:, 0, 0], W[:, 0, 1], W[:, 1, 1], v_c[:, 0], v_c[:, 1], P[:, 0], P[:, 1]), -1)
    rows = columns.tolist()
    print(impacts)
    for name, law in LAWS.items():
        scalar = torch.tensor([law(*row[:5], 0.15, 0.55) for row in rows], dtype=torch.float64)
        torch.testing.assert_close(scalar, impulse(name, W, v_c, 0.15, 0.55))
        identify_trials(name, impacts)  # warm up
        times = {}
        ours = []
        for rival, (method, starts) in RIVALS.items():
            for _ in range(3):
                begin = time.perf_counter()
                fit = identify_trials(name, impacts)
                ours.append(time.perf_counter() - begin)
            times[rival] = loop(law, rows, method, starts)
        mine = statistics.median(ours)
        print(f"\n{name:32s}{1e3 * mine:9.0f} ms   mean error {1e3 * fit.error.mean():.3f} mN s")
        for rival, (errors, seconds) in times.items():
            worse, better = int((errors > fit.error + 1e-9).sum()), int((fit.error > errors + 1e-9).sum())
            print(
                f"  {rival:30s}{1e3 * seconds:9.0f} ms   {seconds / mine:5.0f} x (bar {BAR})   mean error "
                f"{1e3 * errors.mean():.3f} mN s   worse on {worse} trials, better on {better}"
            )


if __name__ == "__main__":
    main()
