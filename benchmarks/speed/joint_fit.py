"""A law with five effects fitted to 1718 drops: time and accuracy against SciPy's robust least squares.

    python benchmarks/speed/joint_fit.py [--rounds 3] [--quick]

Rivals minimise over the same predictions, from as many starts as ours runs to convergence (four), on
residuals that are whitened by the true noise: `scipy.optimize.least_squares` with loss soft_l1, once with
its own finite differences and once with the exact derivatives of this package.  4 % of the trials are
gross outliers.  A learning curve needs many subsets, which SciPy fits one by one.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch
from scipy.optimize import least_squares

from contactlearn.effects import State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import assemble, named_parameters
from contactlearn.inference.identification.shared import Box
from contactlearn.laws import find
from contactlearn.models.contact_model import linearised, resolve
from contactlearn.simulation import synthetic
from speed.harness import compared, header, parsed, parser, row

PLANTED = {
    "surface_tilt": (0.02,),
    "velocity_dependent_restitution": (0.1,),
    "contact_patch": (0.02, 1e-4),
    "spin_damping": (0.05,),
    "com_offset": (3e-4, -3e-4),
}
NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)


def measured():
    exact = synthetic.load(size=1718, velocity_noise=0, spin_noise=0)
    generator = torch.Generator().manual_seed(0)
    effects = {name: find_effect(name)().prepare(exact) for name in PLANTED}
    theta = torch.tensor((0.15, 0.55, *(x for values in PLANTED.values() for x in values)), dtype=torch.float64)
    v_post = assemble(find("wang_mason"), effects, theta).predict(exact).v_post
    before, after = (NOISE * torch.randn(1718, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    v_post = v_post + after
    v_post[::25] = v_post[::25].flip(0) * -3
    return exact.replace(v_pre=exact.v_pre + before, v_post=v_post), effects, theta


def rival(drops, effects, exact: bool):
    """Values from the best of four starts."""
    parameters = named_parameters(effects, Box(), drops)
    low, high, start = np.array([(p.low, p.high, p.start) for p in parameters]).T
    start[:2] = 0.2, 0.5
    state = State.of(drops)

    def predict(*columns):
        model = assemble(find("wang_mason"), effects, torch.stack([c.mean() for c in columns]))
        chosen, at = {}, 2
        for name, effect in effects.items():
            chosen[name] = effect.at(columns[at : at + len(effect.parameters)])
            at += len(effect.parameters)
        return resolve(model.base, chosen, state, columns[0], columns[1]).v_post

    def residual(x):
        with torch.no_grad():
            columns = list(torch.tensor(x))
            return ((drops.v_post - predict(*columns)) / NOISE).flatten().numpy()

    def slopes(x):
        _, slope = linearised(predict, [torch.full((len(drops),), value, dtype=torch.float64) for value in x])
        return -(slope / NOISE[:, None]).flatten(0, 1).numpy()

    rng, best = np.random.default_rng(0), None
    for k in range(4):
        x0 = start.copy()
        if k:
            x0[2:] += (rng.random(len(x0) - 2) - 0.5) * (high - low)[2:] / 3
        x0 = np.clip(x0, low + 1e-9, high - 1e-9)
        found = least_squares(
            residual, x0, slopes if exact else "2-point", bounds=(low, high), loss="soft_l1", x_scale=high - low
        )
        best = found if best is None or found.cost < best.cost else best
    return torch.from_numpy(best.x)


def main():
    options = parsed(parser(__doc__, rounds=3))
    drops, effects, theta = measured()
    drops, count = (drops[:200], 2) if options.quick else (drops, 20)
    orders = [torch.randperm(len(drops), generator=torch.Generator().manual_seed(k))[:100] for k in range(count)]
    subsets = torch.stack(orders)
    tasks = {f"all {len(drops)} trials": None, f"{count} subsets of 100 trials": subsets}
    header("task", "method", "seconds", "ratio", "rms error, in our standard errors")
    for task, rows in tasks.items():
        parts = [drops] if rows is None else [drops[one] for one in rows]
        fit = joint.fit(drops, find("wang_mason"), effects, rows=rows)
        methods = {
            "ours": lambda rows=rows: joint.fit(drops, find("wang_mason"), effects, rows=rows).values,
            "SciPy, exact derivatives": lambda parts=parts: torch.stack([rival(one, effects, True) for one in parts]),
            "SciPy, finite differences": lambda parts=parts: torch.stack([rival(one, effects, False) for one in parts]),
        }
        values, times = compared(methods, options.rounds)
        for name, time in times.items():
            off = ((values[name] - theta) / fit.standard_errors).square().mean().sqrt()
            row(task, name, f"{time:.2f}", f"{time / times['ours']:.1f}", f"{off:.2f}")


if __name__ == "__main__":
    main()
