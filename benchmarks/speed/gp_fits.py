"""Whole fits of Gaussian processes, against other libraries: time and what they miss of the optimum.

    python benchmarks/speed/gp_fits.py [--data published | mirrored | synthetic] [--rounds 3] [--quick]

10 seeds × 3 outputs: from the features X1 of n random drops to their wrenches, all standardised.  Every
method fits the same model (zero mean, scaled ARD squared exponential, Gaussian noise, no priors), within
our bounds where it takes bounds and with noise ≥ 1e-6 everywhere, and starts and stops as its library
does by default unless stated:

    ours               `ExactGPs.fit`, all processes at once, two starts
    BoTorch            `fit_gpytorch_mll` on logarithms with bounds, one process at a time
    scikit-learn       `GaussianProcessRegressor`, one start
    GPy                `GPRegression.optimize`
    Adam, 100 steps    GPyTorch's usual loop with learning rate 0.1

At n = 450 the rivals get the first two seeds, and are compared with ours on the same.  All attained
likelihoods are evaluated with the same code.  "gap": nats a point above the best that any method or ten
random starts of ours with a tight tolerance find; "close": share of fits with a gap below 1e-3.  "error":
of the mean, root mean square over 500 other drops.  "!" marks a missed requirement, of which "close" has
97 %, for ours.  One thread.

Then a scaled Matérn 3/2 kernel of GPyTorch's: by hand, Adam with learning rate 0.1 and 50 steps, against `ExactGPs.fit`
with the same optimiser, steps and one start, and with its own search from one start; ten subsets of 150 drops and three
outputs as one batch.  Required: within 1.2 times of by hand.
"""

import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import MaternKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.mlls import ExactMarginalLogLikelihood
from torch import Tensor

from contactlearn.mechanics.features import Features
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.gp.bfgs import minimise
from contactlearn.models.gp.evidence import LogEvidence
from contactlearn.models.gp.exact import ExactGPs, checked_options
from contactlearn.models.gp.processes import LENGTH, NOISE, SCALE
from contactlearn.models.process_options import ProcessOptions
from contactlearn.models.standardisation import Standardisation
from speed.gp_evidence import ZeroMeanGP, adam, covariance, set_parameters, single_task
from speed.harness import compared, drops, header, parsed, parser, row

SEEDS, HELD_OUT, MORE_STARTS = 10, 500, 10
RIVAL_SEEDS = {100: SEEDS, 450: 2}
BARS = {100: {"BoTorch": 20, "scikit-learn": 5, "GPy": 5}, 450: {"BoTorch": 9, "scikit-learn": 6, "GPy": 6}}
"""Least ratios of times, by size and method."""
CLOSE, SHARE = 1e-3, 0.97
"""Nats a point, and the share of our fits that must come so close to the best."""

REQUIRED = 1.2
KERNEL = {"_target_": "gpytorch.kernels.MaternKernel", "nu": 1.5}

Method = Callable[[Tensor, Tensor], Tensor]
"""φ [S, O, D + 2] from x [S, n, D] and y [S, O, n]; φ is logarithms of length scales, output scale, noise."""


def box(inputs: int) -> Tensor:
    """Bounds [D + 2, 2] of φ."""
    return torch.tensor([LENGTH] * inputs + [SCALE, NOISE], dtype=torch.float64).log()


def parameters(model: gpytorch.models.ExactGP) -> Tensor:
    """φ [..., D + 2] of a GPyTorch model."""
    kernel = model.covar_module
    parts = kernel.base_kernel.lengthscale[..., 0, :], kernel.outputscale[..., None], model.likelihood.noise
    return torch.cat(parts, -1).detach().log()


def one_by_one(fit: Callable[[Tensor, Tensor], Tensor]) -> Method:
    """From a fit of one process, φ [D + 2] from x [n, D] and y [n]."""

    def fit_all(x: Tensor, y: Tensor) -> Tensor:
        return torch.stack(
            [torch.stack([fit(inputs, one) for one in outputs]) for inputs, outputs in zip(x, y, strict=True)]
        )

    return fit_all


def ours(x: Tensor, y: Tensor) -> Tensor:
    gps = ExactGPs(x, y, options=ProcessOptions(prior=False))
    gps.fit()
    return parameters(gps)


def botorch(x: Tensor, y: Tensor) -> Tensor:
    from botorch.fit import fit_gpytorch_mll
    from botorch.utils.constraints import LogTransformedInterval

    kernel = covariance(x.shape[-1], torch.Size())
    likelihood = GaussianLikelihood(noise_constraint=GreaterThan(NOISE[0]))
    kernel.base_kernel.register_constraint("raw_lengthscale", LogTransformedInterval(*LENGTH, initial_value=1.0))
    kernel.register_constraint("raw_outputscale", LogTransformedInterval(*SCALE, initial_value=1.0))
    likelihood.noise_covar.register_constraint("raw_noise", LogTransformedInterval(*NOISE, initial_value=0.1))
    model = single_task(x, y, kernel, likelihood)
    fit_gpytorch_mll(ExactMarginalLogLikelihood(likelihood, model))
    return parameters(model)


def scikit_learn(x: Tensor, y: Tensor) -> Tensor:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0, SCALE) * RBF(np.ones(x.shape[1]), LENGTH) + WhiteKernel(0.1, NOISE)
    theta = GaussianProcessRegressor(kernel, alpha=0).fit(x.numpy(), y.numpy()).kernel_.theta
    return torch.from_numpy(np.append(theta[1:-1], (theta[0], theta[-1])))


def gpy(x: Tensor, y: Tensor) -> Tensor:
    import GPy

    kernel = GPy.kern.RBF(x.shape[1], ARD=True)
    model = GPy.models.GPRegression(x.numpy(), y[:, None].numpy(), kernel, noise_var=0.1)
    model.likelihood.variance.constrain_bounded(*NOISE, warning=False)
    model.optimize()
    return torch.from_numpy(np.concatenate((kernel.lengthscale, kernel.variance, model.likelihood.variance))).log()


def adam_fit(x: Tensor, y: Tensor) -> Tensor:
    adam(model := ZeroMeanGP(x, y))
    return parameters(model)


METHODS: dict[str, Method] = {
    "ours": ours,
    "BoTorch": one_by_one(botorch),
    "scikit-learn": one_by_one(scikit_learn),
    "GPy": one_by_one(gpy),
    "Adam, 100 steps": one_by_one(adam_fit),
}


def draw(impacts: Impacts, n: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Standardised x [S, n, D] and y [S, O, n] of random subsets, and of held-out drops."""
    orders = [torch.randperm(len(impacts), generator=torch.Generator().manual_seed(seed)) for seed in range(SEEDS)]
    rows = torch.stack(orders)[:, : n + HELD_OUT]
    x, y = Features.of(impacts, "x1").values[rows], impacts.wrench[rows]
    x, y = (Standardisation.of(part[:, :n]).apply(part) for part in (x, y))
    return x[:, :n], y[:, :n].mT, x[:, n:], y[:, n:].mT


class Judge:
    """Evaluates any method's φ [S, O, D + 2] on the first S seeds with the same code."""

    def __init__(self, x: Tensor, y: Tensor, x_new: Tensor, y_new: Tensor):
        self.y, self.x_new, self.y_new = y, x_new, y_new
        self.x = x[:, None].expand(-1, y.shape[1], -1, -1)
        self.evidence = LogEvidence(self.x.flatten(0, 1), y.flatten(0, 1))

    def loss(self, phi: Tensor) -> Tensor:
        """−log p a point [S, O]."""
        flat = phi.flatten(0, 1)
        return self.evidence(flat, torch.arange(len(flat)))[0].view(phi.shape[:2])

    def best(self) -> Tensor:
        """The least found from many starts [S, O]."""
        rows, D, generator = self.y.shape[:2].numel(), self.x.shape[-1], torch.Generator().manual_seed(0)
        near = torch.tensor([-1.0] * D + [-1.0, -6.0], dtype=torch.float64)
        far = torch.tensor([4.0] * D + [2.0, 0.0], dtype=torch.float64)
        draws = torch.rand(MORE_STARTS * rows, D + 2, generator=generator, dtype=torch.float64)
        found = minimise(
            lambda phi, which, curvature: self.evidence(phi, which % rows, curvature),
            near + (far - near) * draws,
            *box(D).T,
            tolerance=2e-6,
        )
        return found.value.nan_to_num(torch.inf).view(-1, *self.y.shape[:2]).amin(0)

    def error(self, phi: Tensor) -> Tensor:
        """Held-out root mean square error [S, O]."""
        seeds = len(phi)
        gps = ExactGPs(self.x[:seeds, 0], self.y[:seeds])
        set_parameters(gps, phi)
        mean, _ = gps.predict(self.x_new[:seeds])
        return (mean - self.y_new[:seeds]).square().mean(-1).sqrt()


def measure(impacts: Impacts, n: int, seeds: int, rounds: int) -> tuple[dict[str, float], dict[str, Tensor], Judge]:
    """Return the median seconds a process and φ by method; rivals are compared on the first seeds of "ours"."""
    x, y, *held_out = draw(impacts, n)
    jobs = {"ours, all seeds": partial(fit, ours, x, y)}
    for name, method in METHODS.items():
        try:
            fit(method, x[:1, :20], y[:1, :, :20])  # warm up
            jobs[name] = partial(fit, method, x[:seeds], y[:seeds])
        except ImportError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
    phi, seconds = compared(jobs, rounds)
    return {name: seconds[name] / phi[name].shape[:2].numel() for name in jobs}, phi, Judge(x, y, *held_out)


def fit(method: Method, x: Tensor, y: Tensor) -> Tensor:
    with warnings.catch_warnings(action="ignore"):  # rivals warn of bounds
        return method(x, y)


def report(impacts: Impacts, n: int, seeds: int, rounds: int) -> None:
    """Print one size's table; a missed requirement is marked."""
    seconds, phi, judge = measure(impacts, n, seeds, rounds)
    losses, best = {name: judge.loss(every) for name, every in phi.items()}, judge.best()
    for loss in losses.values():
        best[: len(loss)] = best[: len(loss)].minimum(loss.nan_to_num(torch.inf))
    error = judge.error(phi["ours, all seeds"])
    header(f"n = {n}", "GPs", "ms a GP", "ratio", "required", "mean gap", "largest", "close", "error / ours")
    for name, time in seconds.items():
        ratio, bar = time / seconds["ours"], BARS.get(n, {}).get(name)
        gap = losses[name] - best[: len(losses[name])]
        close = (gap < CLOSE).double().mean()
        missed = "!" * (name == "ours, all seeds" and bool(close < SHARE))
        worse = (judge.error(phi[name]) / error[: len(gap)]).mean()
        row(
            name, gap.numel(), f"{1e3 * time:.1f}", f"{ratio:.1f}", f"{bar}{'!' * (ratio < bar)}" if bar else "",
            f"{gap.mean():.5f}", f"{gap.max():.4f}", f"{close:.1%}{missed}", f"{worse:.3f}",
        )  # fmt: skip


def by_hand(x: Tensor, y: Tensor, steps: int) -> float:
    """Mean loss per point after so many steps of Adam."""
    model = ZeroMeanGP(x[:, None].expand(*y.shape, x.shape[-1]), y)
    batch = y.shape[:-1]
    model.covar_module = ScaleKernel(MaternKernel(1.5, ard_num_dims=x.shape[-1], batch_shape=batch), batch_shape=batch)
    return adam(model.double(), steps).mean().item()


def module_fit(x: Tensor, y: Tensor, **optimiser: object) -> float:
    """Mean loss per point of the fit."""
    options = ProcessOptions(kernel=KERNEL, optimiser={"starts": 1, **optimiser}, prior=False)
    return ExactGPs(x, y, options=checked_options(options, "abcde")).fit().loss.mean().item()


def modules(impacts: Impacts, rounds: int, quick: bool) -> None:
    """Print the table of the kernel."""
    n, steps = (20, 5) if quick else (150, 50)
    x, y, *_ = draw(impacts, n)
    methods = {
        "by hand": partial(by_hand, x, y, steps),
        "ours": partial(module_fit, x, y, _target_="torch.optim.Adam", lr=0.1, iterations=steps),
        "ours, BFGS": partial(module_fit, x, y),
    }
    losses, seconds = compared(methods, rounds)
    header("Matérn 3/2", "s", "ratio", "nats a point")
    for name, time in seconds.items():
        ratio = time / seconds["by hand"]
        row(name, f"{time:.2f}", f"{ratio:.2f}{'!' * (name == 'ours' and ratio > REQUIRED)}", f"{losses[name]:.4f}")


def main() -> None:
    options = parser(__doc__, rounds=3)
    options.add_argument("--data", choices=("published", "mirrored", "synthetic"), default="published")
    options = parsed(options)
    impacts = drops(options.data)
    print(f"{impacts}; one thread")
    sizes = {30: 1} if options.quick else RIVAL_SEEDS
    with gpytorch.settings.max_cholesky_size(10**6):
        for n, seeds in sizes.items():
            report(impacts, n, seeds, options.rounds)
    modules(impacts, options.rounds, options.quick)


if __name__ == "__main__":
    main()
