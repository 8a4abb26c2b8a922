"""The full study of Fig. 4.1 and 4.2 on the published drops: one command against the usual way.

Ours is `python evaluate.py data=ellipse_drops`, from the shell to the last figure: eight learned models at
eight sizes from ten subsets, six laws, both bounds, tables, figures and TensorBoard.  The usual way is a loop
over models, sizes, subsets and outputs with a GPyTorch ExactGP and 100 steps of Adam, single-threaded, and
its predictions of the held-out trials; nothing else of the study.  It is measured for one subset and the
outputs of one model and extrapolated to the 1520 processes of the study.

    CONTACTLEARN_DATA=../shared/data python benchmarks/speed/learning_study.py
"""

import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import gpytorch
import torch
from threadpoolctl import threadpool_limits

from contactlearn.data import ellipse_drops
from contactlearn.models.standardisation import Standardisation

SIZES = (10, 20, 50, 100, 150, 200, 300, 450)
SEEDS = 10
OUTPUTS = 3 + 2 + 2 + 3 + 2 + 3 + 2 + 2  # of the eight models
ROOT = Path(__file__).resolve().parents[2]


class Process(gpytorch.models.ExactGP):
    """What a tutorial writes."""

    def __init__(self, x, y, likelihood):
        super().__init__(x, y, likelihood)
        self.mean_module = gpytorch.means.ConstantMean()
        self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel(ard_num_dims=x.shape[-1]))

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


def adam(x, y, x_test):
    """Seconds to train one process with 100 steps of Adam and to predict."""
    start = time.perf_counter()
    likelihood = gpytorch.likelihoods.GaussianLikelihood()
    model = Process(x, y, likelihood).double()
    optimizer = torch.optim.Adam(model.parameters(), lr=0.1)
    evidence = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
    for _ in range(100):
        optimizer.zero_grad()
        loss = -evidence(model(x), y)
        loss.backward()
        optimizer.step()
    model.eval(), likelihood.eval()
    with torch.no_grad():
        prediction = likelihood(model(x_test))
        _ = prediction.mean, prediction.variance
    return time.perf_counter() - start


def usual_way():
    """Seconds of all processes, extrapolated from the outputs of X1 → wrench on one subset of each size."""
    drops = ellipse_drops.load()
    generator = torch.Generator().manual_seed(0)
    pool, test = drops.split(0.25, generator)
    order, total = torch.randperm(len(pool), generator=generator), 0.0
    for size in SIZES:
        x = pool.features("x1").values[order[:size]]
        scale = Standardisation.of(x)
        y = Standardisation.of(pool.wrench[order[:size]]).apply(pool.wrench[order[:size]])
        seconds = [adam(scale.apply(x), column, scale.apply(test.features("x1").values)) for column in y.T]
        total += SEEDS * OUTPUTS * statistics.median(seconds)
        print(f"  {size:4d} trials: {1e3 * statistics.median(seconds):6.0f} ms a process")
    return total


def ours():
    """Wall seconds of the command."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "evaluate.py", "data=ellipse_drops", f"hydra.run.dir={folder}"]
        start = time.perf_counter()
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        return time.perf_counter() - start


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    threadpool_limits(1)
    seconds = [ours() for _ in range(2)]
    print(f"ours: {', '.join(f'{x:.0f}' for x in seconds)} s from the shell to the last figure, one process a core")
    print("GPyTorch and Adam, 100 steps, one thread:")
    loop = usual_way()
    count = len(SIZES) * SEEDS * OUTPUTS
    print(f"  {count} processes: {loop:.0f} s extrapolated, {loop / min(seconds):.0f} times ours, without figures")
