"""The same work on the CPU and on a GPU: seconds, their ratio, and the difference of the results.

    python benchmarks/speed/devices.py [--device cuda] [--threads 1] [--rounds 5] [--quick]

Rows are the work of other benchmarks, without rivals: laws on a grid of (μ, ε) (`law_rates.py`), μ and ε of single
trials (`identification.py`), joint fits (`joint_fit.py`), exact processes (`gp_fits.py`) and sparse ones
(`large_tables.py`).  Data lie on the device before the clock starts, and it stops once the device has finished.  The
first call of each is not counted.  Without a GPU the table has the column of the CPU alone.
"""

import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from torch import Tensor

from contactlearn.core import devices
from contactlearn.core.devices import moved
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.models.gp.sparse import SparseGPs
from contactlearn.simulation import synthetic
from speed.gp_fits import draw, ours
from speed.harness import drops as load, header, interleaved, medians, parsed, parser, row, timed
from speed.joint_fit import measured
from speed.law_rates import ellipse_contacts

Work = tuple[Callable[..., Tensor], tuple]
"""A function and its arguments; its results on both devices are compared."""


def laws_on_grid(W: Tensor, v_c: Tensor, mu: Tensor, eps: Tensor, out: Tensor) -> Tensor:
    """Compute the impulses of the six laws at all (μ, ε), and return some of the last law's."""
    for name in PAPER_LAWS:
        find(name).at(mu[:, None, None], eps[:, None]).impulse(W, v_c, out=out)
    return out[-1, -1]


def sparse(x: Tensor, y: Tensor) -> Tensor:
    gps = SparseGPs(x, y)
    gps.fit()
    return gps.predict(x[:500])[0]


def works(quick: bool) -> dict[str, Work]:
    """Make the work of every row."""
    trials, grid, many = (60, 8, 3000) if quick else (1718, 64, 100_000)
    W, v_c = ellipse_contacts(trials, seed=0)
    mu, eps = (torch.linspace(0, high, grid, dtype=torch.float64) for high in (1.2, 1.0))
    drops, effects, _ = measured()
    drops, law, generator = drops[:trials], find("wang_mason"), torch.Generator().manual_seed(0)
    subsets = torch.stack([torch.randperm(trials, generator=generator)[: min(100, trials)] for _ in range(20)])
    found: dict[str, Work] = {
        f"six laws, {trials} contacts x {grid} x {grid}": (
            laws_on_grid,
            (W, v_c, mu, eps, torch.empty((grid, grid, trials, 2), dtype=torch.float64)),
        ),
        f"shared μ and ε, 100 subsets of {trials}": (
            lambda drops: fit_subsets(drops, law, sizes=(min(120, trials),)).mu,
            (drops,),
        ),
        f"μ and ε of {trials} single trials": (lambda drops: fit_trials(drops, law).error, (drops,)),
        f"a law with five effects, {trials} trials": (
            lambda drops: joint.fit(drops, law, effects).values,
            (drops,),
        ),
        f"the same, 20 subsets of {subsets.shape[1]}": (
            lambda impacts, rows: joint.fit(impacts, law, effects, rows=rows).values,
            (drops, subsets),
        ),
        f"IRB bound of {many} trials": (lambda drops: bounds.irb(drops).v_post, (synthetic.load(size=many),)),
    }
    for n in (30,) if quick else (100, 450):
        found[f"30 exact processes, n = {n}"] = ours, draw(load("synthetic"), n)[:2]
    size = 500 if quick else 5000
    x = torch.randn(size, 5, generator=generator, dtype=torch.float64)
    y = torch.stack([x.sin().sum(-1), x.square().sum(-1) / 5, x[:, 0]])
    y = y + 0.1 * torch.randn(3, size, generator=generator, dtype=torch.float64)
    return found | {f"three sparse processes, n = {size}": (sparse, (x, y))}


def clock(work: Work, device: torch.device) -> tuple[Tensor, float]:
    """Return the result and the seconds until the device has computed it; data are moved before."""
    function, arguments = work
    there = moved(arguments, device)

    def compute() -> Tensor:
        result = function(*there)
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        return result

    if device.type == "cuda":
        torch.cuda.synchronize(device)
    result, seconds = timed(compute)
    return result.cpu(), seconds


def main() -> None:
    options = parser(__doc__, rounds=5)
    options.add_argument("--device", choices=devices.NAMES, default="auto")
    options.add_argument("--threads", type=int, default=1, help="of the CPU")
    options = parsed(options)
    cpu, other = torch.device("cpu"), devices.find(options.device)
    both = [cpu] if other.type == "cpu" else [cpu, other]
    print(f"torch {torch.__version__}, {options.threads} thread(s), {' and '.join(map(devices.described, both))}")
    if len(both) == 1:
        print("no GPU that PyTorch sees: the CPU alone")
    header("work", *(f"{device.type}, s" for device in both), *("ratio", "relative difference")[: 2 * len(both) - 2])
    for name, work in works(options.quick).items():
        results = {device: clock(work, device)[0] for device in both}  # warm up
        clocks = {device: lambda work=work, device=device: clock(work, device)[1] for device in both}
        times = medians(interleaved(clocks, options.rounds))
        cells = [f"{time:.4f}" for time in times.values()]
        if len(both) > 1:
            difference = (results[other] - results[cpu]).abs().max() / results[cpu].abs().max()
            cells += [f"{times[cpu] / times[other]:.2f}", f"{difference:.1e}"]
        row(name, *cells)


if __name__ == "__main__":
    main()
