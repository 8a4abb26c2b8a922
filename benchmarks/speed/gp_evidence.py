"""One marginal likelihood with its gradient, against LAPACK's bare time and other libraries.

    python benchmarks/speed/gp_evidence.py [--rounds 9] [--quick]

The limit is what any method must do that works on one process with the installed LAPACK: factorise the
matrix (potrf) and invert it (potri), through SciPy, in place, in the faster triangle; the copy that
restores the matrix is not counted.  Every method gets the same data, five inputs, the same
hyperparameters and double precision, must give the same value, and is timed a process: "batch"
evaluates 30 at once, the others one.  GPyTorch uses Cholesky at every size here; by default it is
stochastic above 800 points.  A library that is not installed is left out.

One thread; ratios are to the limit, median over median.  A "!" marks a missed requirement.
"""

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.mlls import ExactMarginalLogLikelihood
from scipy.linalg import lapack
from torch import Tensor

from contactlearn.models.gp.evidence import LogEvidence
from speed.harness import header, interleaved, medians, parsed, parser, repeated, row

SIZES = (50, 100, 200, 450, 1000)
BATCH, INPUTS = 30, 5
BARS = {("ours, batch", 100): 2.2, ("ours", 450): 1.6, ("ours", 1000): 1.6}
"""Largest ratios to the limit."""

Evaluation = Callable[[], float]
"""Computes value and gradient, and returns −log p of the first process."""


class Problem(NamedTuple):
    """Data of the processes, x [B, n, D] and y [B, n], and one φ [D + 2] for all."""

    x: Tensor
    y: Tensor
    phi: Tensor

    @classmethod
    def random(cls, n: int) -> "Problem":
        generator = torch.Generator().manual_seed(n)
        x = torch.randn(BATCH, n, INPUTS, generator=generator, dtype=torch.float64)
        y = x.sin().sum(-1) + 0.3 * torch.randn(BATCH, n, generator=generator, dtype=torch.float64)
        phi = torch.tensor([1.5, 2.0, 2.5, 3.0, 3.5, 1.2, 0.1], dtype=torch.float64).log()
        return cls(x, (y - y.mean()) / y.std(), phi)

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x [n, D] and y [n] of the first process, and the hyperparameters [D + 2] themselves."""
        return self.x[0].numpy(), self.y[0].numpy(), self.phi.exp().numpy()


class ZeroMeanGP(gpytorch.models.ExactGP):
    """GPyTorch's own model, of one process or a batch."""

    def __init__(self, x: Tensor, y: Tensor):
        super().__init__(x, y, GaussianLikelihood(batch_shape=y.shape[:-1], noise_constraint=GreaterThan(1e-6)))
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = covariance(x.shape[-1], y.shape[:-1])
        self.double()

    def forward(self, x: Tensor) -> gpytorch.distributions.MultivariateNormal:
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


def covariance(inputs: int, batch: torch.Size) -> ScaleKernel:
    return ScaleKernel(RBFKernel(ard_num_dims=inputs, batch_shape=batch), batch_shape=batch)


def single_task(x: Tensor, y: Tensor, kernel: ScaleKernel, likelihood: GaussianLikelihood) -> gpytorch.models.ExactGP:
    """BoTorch's model of y [n]."""
    from botorch.models import SingleTaskGP

    parts = {"likelihood": likelihood, "covar_module": kernel, "mean_module": gpytorch.means.ZeroMean()}
    return SingleTaskGP(x, y[:, None], **parts, outcome_transform=None)


def adam(model: gpytorch.models.ExactGP, steps: int = 100) -> Tensor:
    """Train by GPyTorch's usual loop with learning rate 0.1; return the last losses a point."""
    mll = ExactMarginalLogLikelihood(model.likelihood, model.train())
    optimiser = torch.optim.Adam(model.parameters(), lr=0.1)
    for _ in range(steps):
        optimiser.zero_grad()
        loss = -mll(model(*model.train_inputs), model.train_targets)
        loss.sum().backward()
        optimiser.step()
    return loss.detach()


def set_parameters(model: gpytorch.models.ExactGP, phi: Tensor) -> None:
    """From φ [..., D + 2]: the logarithms of length scales, output scale and noise variance."""
    theta = phi.exp()
    model.covar_module.base_kernel.lengthscale = theta[..., None, :-2]
    model.covar_module.outputscale = theta[..., -2]
    model.likelihood.noise = theta[..., -1:]


def ours(problem: Problem, rows: int = 1, curvature: bool = False) -> Evaluation:
    x, y, phi = problem
    evidence, which, phi = LogEvidence(x, y), torch.arange(rows), phi.expand(rows, -1).contiguous()
    return lambda: y.shape[1] * evidence(phi, which, curvature)[0][0].item()


def gpytorch_autograd(problem: Problem, rows: int | None = None) -> Evaluation:
    x, y = (part[0] if rows is None else part[:rows] for part in problem[:2])
    model = ZeroMeanGP(x, y).train()
    set_parameters(model, problem.phi)
    mll = ExactMarginalLogLikelihood(model.likelihood, model)

    def evaluate() -> float:
        mll.zero_grad()
        loss = -mll(model(x), y)
        loss.sum().backward()
        return y.shape[-1] * loss.reshape(-1)[0].item()

    return evaluate


def botorch(problem: Problem) -> Evaluation:
    """The function that BoTorch gives to L-BFGS-B."""
    from botorch.optim.closures import get_loss_closure_with_grads
    from botorch.optim.closures.core import NdarrayOptimizationClosure

    x, y = problem.x[0], problem.y[0]
    with warnings.catch_warnings(action="ignore"):  # that y is not exactly standardised
        model = single_task(x, y, covariance(INPUTS, torch.Size()), GaussianLikelihood())
    set_parameters(model, problem.phi)
    mll = ExactMarginalLogLikelihood(model.likelihood, model).train()
    parameters = dict(mll.named_parameters())
    closure = NdarrayOptimizationClosure(get_loss_closure_with_grads(mll, parameters), parameters)
    state = closure.state
    return lambda: len(y) * float(closure(state)[0])


def scikit_learn(problem: Problem) -> Evaluation:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    x, y, theta = problem.arrays()
    kernel = ConstantKernel(theta[-2]) * RBF(theta[:-2]) + WhiteKernel(theta[-1])
    model = GaussianProcessRegressor(kernel, alpha=0, optimizer=None).fit(x, y)
    logs = model.kernel_.theta  # also in the order scale, lengths, noise
    return lambda: -model.log_marginal_likelihood(logs, eval_gradient=True, clone_kernel=False)[0]


def gpy(problem: Problem) -> Evaluation:
    import GPy

    x, y, theta = problem.arrays()
    kernel = GPy.kern.RBF(INPUTS, variance=theta[-2], lengthscale=theta[:-2], ARD=True)
    model = GPy.models.GPRegression(x, y[:, None], kernel, noise_var=theta[-1])
    start = model.optimizer_array.copy()
    return lambda: float(model._objective_grads(start)[0])


METHODS = {
    "ours": ours,
    "ours, with curvature": lambda problem: ours(problem, curvature=True),
    "ours, batch": lambda problem: ours(problem, BATCH),
    "ours, batch with curvature": lambda problem: ours(problem, BATCH, curvature=True),
    "GPyTorch": gpytorch_autograd,
    "GPyTorch, batch": lambda problem: gpytorch_autograd(problem, BATCH),
    "BoTorch": botorch,
    "scikit-learn": scikit_learn,
    "GPy": gpy,
}


def limit(problem: Problem) -> Callable[[], float]:
    """Seconds of one potrf and potri of the first process's matrix."""
    x, _, theta = problem.arrays()
    z = x / theta[:-2]
    squares = (z**2).sum(-1)
    K = theta[-2] * np.exp(z @ z.T - 0.5 * (squares[:, None] + squares)) + theta[-1] * np.eye(len(x))
    work = np.empty_like(K, order="F")

    def seconds(lower: int = 0) -> float:
        work[:] = K
        begin = time.perf_counter()
        factor, _ = lapack.dpotrf(work, lower=lower, clean=0, overwrite_a=1)
        lapack.dpotri(factor, lower=lower, overwrite_c=1)
        return time.perf_counter() - begin

    faster = min((0, 1), key=lambda lower: statistics.median(seconds(lower) for _ in range(15)))
    return lambda: seconds(faster)


def measure(n: int, rounds: int) -> dict[str, float]:
    """Return the median seconds a process by method, the limit first, without methods that are not installed."""
    problem = Problem.random(n)
    evaluations: dict[str, Evaluation] = {}
    for name, method in METHODS.items():
        try:
            evaluations[name] = method(problem)
        except ImportError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
    for name, evaluate in evaluations.items():
        np.testing.assert_allclose(evaluate(), evaluations["ours"](), rtol=1e-6, err_msg=name)
    processes = {name: BATCH if "batch" in name else 1 for name in ("limit", *evaluations)}
    count = {name: max(1 if many > 1 else 5, round(2e4 / n**1.5 / many)) for name, many in processes.items()}
    bare = limit(problem)
    clocks = {"limit": lambda: statistics.median(bare() for _ in range(count["limit"]))}
    clocks |= {name: repeated(evaluate, count[name]) for name, evaluate in evaluations.items()}
    return {name: value / processes[name] for name, value in medians(interleaved(clocks, rounds)).items()}


def main() -> None:
    options = parsed(parser(__doc__, rounds=9))
    sizes = SIZES[:2] if options.quick else SIZES
    with gpytorch.settings.max_cholesky_size(10**6):
        columns = {n: measure(n, options.rounds) for n in sizes}
    header("× the limit", *(f"n = {n}" for n in sizes))
    row("limit, ms", *(f"{1e3 * columns[n]['limit']:.3f}" for n in sizes))
    for name in [name for name in columns[sizes[0]] if name != "limit"]:
        cells = []
        for n in sizes:
            ratio, bar = columns[n][name] / columns[n]["limit"], BARS.get((name, n))
            cells.append(f"{ratio:.2f}" + (f" (≤ {bar})" + "!" * (ratio > bar) if bar else ""))
        row(name, *cells)


if __name__ == "__main__":
    main()
