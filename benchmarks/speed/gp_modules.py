"""Training with a kernel of GPyTorch's, against GPyTorch used by hand: processor time and the loss that is reached.

    python benchmarks/speed/gp_modules.py [--rounds 5] [--quick]

A scaled Matérn 3/2 kernel with a length scale for each feature, without priors, from the features X1 of 150 drops to
their wrenches: ten subsets and three outputs as one batch.  By hand: Adam, learning rate 0.1, 50 steps.  "ours" is
`ExactGPs.fit` with the same optimiser, steps and one start; "ours, BFGS" the default search over the same objective,
from one start.  Required: ours within 1.2 times of by hand.  One thread.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gpytorch
import torch
from gpytorch.kernels import MaternKernel, ScaleKernel
from torch import Tensor

from contactlearn.models.gp.exact import ExactGPs, checked_options
from contactlearn.models.process_options import ProcessOptions
from speed.gp_evidence import ZeroMeanGP
from speed.gp_fits import draw
from speed.harness import drops, header, interleaved, medians, parser, row

REQUIRED = 1.2
KERNEL = {"_target_": "gpytorch.kernels.MaternKernel", "nu": 1.5}


def by_hand(x: Tensor, y: Tensor, steps: int) -> float:
    """Mean loss per point after so many steps."""
    model = ZeroMeanGP(x[:, None].expand(*y.shape, x.shape[-1]), y)
    batch = y.shape[:-1]
    model.covar_module = ScaleKernel(MaternKernel(1.5, ard_num_dims=x.shape[-1], batch_shape=batch), batch_shape=batch)
    model = model.double().train()
    mll = gpytorch.mlls.ExactMarginalLogLikelihood(model.likelihood, model)
    optimiser = torch.optim.Adam(model.parameters(), lr=0.1)
    for _ in range(steps):
        optimiser.zero_grad()
        loss = -mll(model(*model.train_inputs), y)
        loss.sum().backward()
        optimiser.step()
    return loss.mean().item()


def ours(x: Tensor, y: Tensor, **optimiser: object) -> float:
    """Mean loss per point of the fit."""
    options = ProcessOptions(kernel=KERNEL, optimiser={"starts": 1, **optimiser}, prior=False)
    return ExactGPs(x, y, options=checked_options(options, "abcde")).fit().loss.mean().item()


def main() -> None:
    options = parser(__doc__, rounds=5).parse_args()
    torch.set_num_threads(1)
    n, steps = (20, 5) if options.quick else (150, 50)
    x, y, *_ = draw(drops(), n)
    methods: dict[str, Callable[[], float]] = {
        "by hand": lambda: by_hand(x, y, steps),
        "ours": lambda: ours(x, y, _target_="torch.optim.Adam", lr=0.1, iterations=steps),
        "ours, BFGS": lambda: ours(x, y),
    }
    losses = {}

    def clock(name: str) -> float:
        start = time.process_time()
        losses[name] = methods[name]()
        return time.process_time() - start

    seconds = medians(interleaved({name: lambda name=name: clock(name) for name in methods}, options.rounds))
    header("", "s", "ratio", "nats a point")
    for name, time_ in seconds.items():
        ratio = time_ / seconds["by hand"]
        missed = "!" * (name == "ours" and ratio > REQUIRED)
        row(name, f"{time_:.2f}", f"{ratio:.2f}{missed}", f"{losses[name]:.4f}")


if __name__ == "__main__":
    main()
