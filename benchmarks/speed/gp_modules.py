"""Training with a kernel of GPyTorch's, against GPyTorch used by hand: time and the loss that is reached.

    python benchmarks/speed/gp_modules.py [--rounds 5] [--quick]

A scaled Matérn 3/2 kernel with a length scale for each feature, without priors, from the features X1 of 150 drops to
their wrenches: ten subsets and three outputs as one batch.  By hand: Adam, learning rate 0.1, 50 steps.  "ours" is
`ExactGPs.fit` with the same optimiser, steps and one start; "ours, BFGS" the default search over the same objective,
from one start.  Required: ours within 1.2 times of by hand.  One thread.
"""

import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gpytorch.kernels import MaternKernel, ScaleKernel
from torch import Tensor

from contactlearn.models.gp.exact import ExactGPs, checked_options
from contactlearn.models.process_options import ProcessOptions
from speed.gp_evidence import ZeroMeanGP, adam
from speed.gp_fits import draw
from speed.harness import compared, drops, header, parsed, parser, row

REQUIRED = 1.2
KERNEL = {"_target_": "gpytorch.kernels.MaternKernel", "nu": 1.5}


def by_hand(x: Tensor, y: Tensor, steps: int) -> float:
    """Mean loss per point after so many steps of Adam."""
    model = ZeroMeanGP(x[:, None].expand(*y.shape, x.shape[-1]), y)
    batch = y.shape[:-1]
    model.covar_module = ScaleKernel(MaternKernel(1.5, ard_num_dims=x.shape[-1], batch_shape=batch), batch_shape=batch)
    return adam(model.double(), steps).mean().item()


def ours(x: Tensor, y: Tensor, **optimiser: object) -> float:
    """Mean loss per point of the fit."""
    options = ProcessOptions(kernel=KERNEL, optimiser={"starts": 1, **optimiser}, prior=False)
    return ExactGPs(x, y, options=checked_options(options, "abcde")).fit().loss.mean().item()


def main() -> None:
    options = parsed(parser(__doc__, rounds=5))
    n, steps = (20, 5) if options.quick else (150, 50)
    x, y, *_ = draw(drops(), n)
    methods = {
        "by hand": partial(by_hand, x, y, steps),
        "ours": partial(ours, x, y, _target_="torch.optim.Adam", lr=0.1, iterations=steps),
        "ours, BFGS": partial(ours, x, y),
    }
    losses, seconds = compared(methods, options.rounds)
    header("", "s", "ratio", "nats a point")
    for name, time_ in seconds.items():
        ratio = time_ / seconds["by hand"]
        missed = "!" * (name == "ours" and ratio > REQUIRED)
        row(name, f"{time_:.2f}", f"{ratio:.2f}{missed}", f"{losses[name]:.4f}")


if __name__ == "__main__":
    main()
