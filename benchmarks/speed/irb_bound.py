"""Time and agreement of the IRB bound against a solver called once a trial: python benchmarks/speed/irb_bound.py

Rivals: SciPy's SLSQP with gradients, and Clarabel called directly with a cone programme that keeps one
sparsity pattern.  Both get the problem in the coordinates that suit them best, in which the energy
ellipse is the unit disc, prepared for all trials at once, and start from its centre.  Every method is
timed from the impacts to v_post, on the published drops where they can be loaded.

On a busy machine use --threads 1: nothing here is large enough to share, and threads that wait for
each other only add to the time.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import clarabel
import numpy as np
import torch
from scipy.optimize import minimize
from scipy.sparse import csc_matrix

from contactlearn.inference.evaluation.bounds import NORMS, distance, irb
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts, Prediction
from speed.harness import drops, header, interleaved, medians, parsed, parser, repeated, row, seconds

BARS = {"irb": 1, "Clarabel, a trial": 60, "SLSQP, a trial": 250}
"""Required ratios, at least."""


def main() -> None:
    options = parser(__doc__, rounds=5)
    options.add_argument("--threads", type=int, default=2, help="torch threads")
    options = parsed(options)
    impacts = drops()
    if options.quick:
        impacts = impacts[:60]
    print(impacts)
    header("norm", "method", "ms", "ratio", "required", "distance / irb − 1, lowest and highest")
    for norm in NORMS:
        compare(impacts, norm, options.rounds)
    widths = torch.linspace(0, 0.02, 51, dtype=torch.float64)[:, None]
    irb(impacts, "mass", widths)
    print(f"\ncurve of the bound over {len(widths)} widths: {1e3 * seconds(irb, impacts, 'mass', widths):.0f} ms")


def compare(impacts: Impacts, norm: str, rounds: int) -> None:
    """Print milliseconds for all trials, ratio to irb and agreement in the distance for each method."""
    methods = {
        "irb": lambda: irb(impacts, norm).v_post,
        "Clarabel, a trial": lambda: Problem(impacts, norm).clarabel(),
        "SLSQP, a trial": lambda: Problem(impacts, norm).slsqp(),
    }
    gaps = {name: distance(impacts, method(), norm) for name, method in methods.items()}
    clocks = {name: repeated(method, 20 if name == "irb" else 1) for name, method in methods.items()}
    times = medians(interleaved(clocks, rounds))
    for name, time in times.items():
        off = gaps[name] / gaps["irb"] - 1
        row(
            norm, name, f"{1e3 * time:.2f}", f"{time / times['irb']:.0f}", BARS[name],
            f"{off.min():+.1e}, {off.max():+.1e}",
        )  # fmt: skip


class Problem:
    """All trials as min ‖e − A x‖² over |x| ≤ 1, rows·x ≥ rest, with P = centre + radius L⁻ᵀ x and W = L Lᵀ."""

    def __init__(self, impacts: Impacts, norm: str):
        self.impacts = impacts
        W, v_c = impacts.W, impacts.v_c
        self.centre = -(rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0]
        radius = (-(self.centre * v_c).sum(-1)).sqrt()[:, None, None]
        L = torch.linalg.cholesky(W)
        self.axes = radius * torch.linalg.inv(L).mT
        M = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
        root = M.sqrt() if norm == "mass" else torch.ones_like(M)
        Jt = rigid_body.contact_jacobian(impacts.r).mT / M[..., None]
        A = root[..., None] * (Jt @ self.axes)
        e = root * (impacts.v_post - impacts.v_pre - (Jt @ self.centre[..., None])[..., 0])
        size = (A.square().sum((-1, -2)) / 2)[:, None]  # so that the objective has a curvature near 1
        self.H = (A.mT @ A / size[..., None]).numpy()
        self.g = ((A.mT @ e[..., None])[..., 0] / size).numpy()
        # P_n ≥ 0 and v_n⁺ ≥ 0 (which is 0 in the centre), as unit rows.
        rows = torch.stack((self.axes[:, 1], (W @ self.axes)[:, 1]), 1)
        length = rows.norm(dim=-1)
        self.rows = (rows / length[..., None]).numpy()
        self.rest = (torch.stack((-self.centre[:, 1], torch.zeros_like(self.centre[:, 1])), 1) / length).numpy()

    def _v_post(self, x: np.ndarray) -> torch.Tensor:
        P = self.centre + (self.axes @ torch.from_numpy(x)[..., None])[..., 0]
        wrench = torch.cat((P, torch.zeros_like(P[:, :1])), -1)
        return Prediction.from_wrench(self.impacts, wrench).v_post

    def slsqp(self) -> torch.Tensor:
        """v_post [N, 3] by one call of SLSQP a trial, from the impulse that stops the contact point."""
        result = np.empty_like(self.g)
        for i, (H, g, rows, rest) in enumerate(zip(self.H, self.g, self.rows, self.rest, strict=True)):

            def cost(x, H=H, g=g):
                Hx = H @ x
                return x @ (Hx - 2 * g), 2 * (Hx - g)

            def slack(x, rows=rows, rest=rest):
                return np.append(rows @ x - rest, 1 - x @ x)

            def slopes(x, rows=rows):
                return np.vstack((rows, -2 * x))

            constraint = {"type": "ineq", "fun": slack, "jac": slopes}
            options = {"ftol": 1e-12}
            result[i] = minimize(cost, np.zeros(2), jac=True, method="SLSQP", constraints=constraint, options=options).x
        return self._v_post(result)

    def clarabel(self) -> torch.Tensor:
        """v_post [N, 3] by one call of Clarabel a trial, with its default tolerances."""
        n = len(self.g)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        cones = [clarabel.NonnegativeConeT(2), clarabel.SecondOrderConeT(3)]
        # Upper triangle of 2 H, and columns of (−rows; 0; −1) by place, in one pattern.
        upper = 2 * np.stack((self.H[:, 0, 0], self.H[:, 0, 1], self.H[:, 1, 1]), -1)
        ones = -np.ones((n, 1))
        columns = np.concatenate((-self.rows[:, :, 0], ones, -self.rows[:, :, 1], ones), 1)
        b = np.concatenate((-self.rest, np.ones((n, 1)), np.zeros((n, 2))), 1)
        P = csc_matrix((upper[0], [0, 0, 1], [0, 1, 3]), shape=(2, 2))
        A = csc_matrix((columns[0], [0, 1, 3, 0, 1, 4], [0, 3, 6]), shape=(5, 2))
        result = np.empty_like(self.g)
        for i in range(n):
            P.data, A.data = upper[i], columns[i]
            result[i] = clarabel.DefaultSolver(P, -2 * self.g[i], A, b[i], cones, settings).solve().x
        return self._v_post(result)


if __name__ == "__main__":
    main()
