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
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gpytorch
import torch
from threadpoolctl import threadpool_limits

from contactlearn.data import ellipse_drops
from contactlearn.mechanics.features import Features
from contactlearn.models.standardisation import Standardisation
from speed.gp_evidence import ZeroMeanGP, adam
from speed.harness import seconds

SIZES = (10, 20, 50, 100, 150, 200, 300, 450)
SEEDS = 10
OUTPUTS = 3 + 2 + 2 + 3 + 2 + 3 + 2 + 2  # of the eight models
ROOT = Path(__file__).resolve().parents[2]


def process(x, y, x_test):
    """Train one process with 100 steps of Adam as a tutorial does, and predict."""
    model = ZeroMeanGP(x, y)
    model.mean_module = gpytorch.means.ConstantMean().double()
    adam(model)
    model.eval()
    with torch.no_grad():
        prediction = model.likelihood(model(x_test))
        return prediction.mean, prediction.variance


def usual_way():
    """Seconds of all processes, extrapolated from the outputs of X1 → wrench on one subset of each size."""
    drops = ellipse_drops.load()
    generator = torch.Generator().manual_seed(0)
    pool, test = drops.split(0.25, generator)
    order, total = torch.randperm(len(pool), generator=generator), 0.0
    for size in SIZES:
        x = Features.of(pool, "x1").values[order[:size]]
        scale = Standardisation.of(x)
        y = Standardisation.of(pool.wrench[order[:size]]).apply(pool.wrench[order[:size]])
        x, x_test = scale.apply(x), scale.apply(Features.of(test, "x1").values)
        median = statistics.median(seconds(process, x, column, x_test) for column in y.T)
        total += SEEDS * OUTPUTS * median
        print(f"  {size:4d} trials: {1e3 * median:6.0f} ms a process")
    return total


def ours():
    """Wall seconds of the command."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "evaluate.py", "data=ellipse_drops", f"hydra.run.dir={folder}"]
        return seconds(lambda: subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    threadpool_limits(1)
    runs = [ours() for _ in range(2)]
    print(f"ours: {', '.join(f'{x:.0f}' for x in runs)} s from the shell to the last figure, one process a core")
    print("GPyTorch and Adam, 100 steps, one thread:")
    loop = usual_way()
    count = len(SIZES) * SEEDS * OUTPUTS
    print(f"  {count} processes: {loop:.0f} s extrapolated, {loop / min(runs):.0f} times ours, without figures")
