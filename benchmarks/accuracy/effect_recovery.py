"""Are planted effects found again?  Every effect of the catalogue, in each of its forms, alone.

    python benchmarks/accuracy/effect_recovery.py [--seeds 40] [--trials 500] [--only spin_damping …]

An ellipse is dropped under Wang & Mason's law with one effect around it, whose size is such that it
carries a third of the held-out error: the law without it, at its best parameters, has 1.5 times the error
of the true model.  Velocities have noise of 0.01 m/s and spins of 0.5 rad/s, before and after.  For each
seed law and effect are fitted jointly to new trials and tested on 2000 others.

    recovered   share of the seeds with every parameter within three of its standard errors
    se ratio    standard deviation of the estimates over the seeds, over the mean standard error; the
                parameter farthest from 1
    excess      held-out error above that of the true model, mean over the seeds
"""

import argparse

import torch
from torch import Tensor

from contactlearn.effects import Effect, catalogue, find_effect
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions, assemble
from contactlearn.inference.learning.curves import run
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE
from contactlearn.simulation import synthetic

MU, EPS, LAW = 0.15, 0.55, "wang_mason"
NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)
SHARE = 1 / 3


def drops(effect: Effect, theta: Tensor, size: int, seed: int) -> Impacts:
    """Drops from left and right and from different heights, under the law and the effect at θ, as measured."""
    generator = torch.Generator().manual_seed(seed)
    exact = synthetic.load(size=2 * size, velocity_noise=0, spin_noise=0, seed=seed)
    scale = 0.5 + torch.rand(2 * size, 1, generator=generator, dtype=torch.float64).expand(-1, 3).clone()
    scale[:, 0] *= torch.rand(2 * size, generator=generator, dtype=torch.float64).sub(0.5).sign()
    v = scale * exact.v_pre
    steep = (v[:, 1] + exact.r[:, 0] * v[:, 2] < -0.1).nonzero()[:size, 0]
    exact = exact[steep].replace(v_pre=v[steep], order=torch.arange(1, size + 1))
    truth = assemble(find(LAW), {effect.name: effect.prepare(exact)}, theta).predict(exact).v_post
    before, after = (NOISE * torch.randn(size, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    return exact.replace(v_pre=exact.v_pre + before, v_post=truth + after)


def sized(effect: Effect) -> tuple[Effect, Tensor, float]:
    """The effect with its constants fixed, the true θ, and the share of the error that it carries.

    Its parameters grow together, in proportion to their ranges, in alternating directions where they may have
    both; the least such factor is found by doubling and bisection, and is 1 where the whole range does not do.
    """
    start, low, high = (
        torch.tensor([getattr(p, end) for p in effect.parameters], dtype=torch.float64)
        for end in ("start", "low", "high")
    )
    up = torch.arange(len(start)) % 2 == 0
    ends = torch.where(up | (low == start), high, low)
    ends = torch.where(torch.tensor([p.vanishing is None for p in effect.parameters]), start, ends)
    law = torch.tensor((MU, EPS), dtype=torch.float64)
    effect = effect.prepare(drops(find_effect("surface_tilt")(), torch.cat((law, torch.zeros(1))), 4000, 999))

    def share(factor: float) -> float:
        theta = torch.cat((law, start + factor * (ends - start)))
        impacts = drops(effect, theta, 4000, 999)
        without = mass_error(
            impacts, joint.fit(impacts, find(LAW), options=FitOptions(starts=2)).model.predict(impacts)
        ).mean()
        return 1 - (mass_error(impacts, _true(effect, theta).predict(impacts)).mean() / without).item()

    many = next((2.0**-k for k in range(12, 0, -1) if share(2.0**-k) > SHARE), 1.0)
    few = many / 2 if share(many) > SHARE else many
    for _ in range(8):
        middle = 0.5 * (few + many)
        few, many = (few, middle) if share(middle) > SHARE else (middle, many)
    return effect, torch.cat((law, start + many * (ends - start))), share(many)


def _true(effect: Effect, theta: Tensor):
    return assemble(find(LAW), {effect.name: effect}, theta)


def recover(effect: Effect, theta: Tensor, trials: int, seed: int) -> tuple[Tensor, Tensor, float]:
    """Estimates [K], standard errors [K], and the excess of the held-out error over the true model's."""
    impacts = drops(effect, theta, trials + 2000, seed)
    order = torch.randperm(len(impacts), generator=torch.Generator().manual_seed(seed))
    fit = joint.fit(impacts, find(LAW), {effect.name: effect}, rows=order[:trials])
    test = impacts[order[trials:]]
    errors = [mass_error(test, model.predict(test)).mean().item() for model in (fit.model, _true(effect, theta))]
    return fit.values, fit.standard_errors, errors[0] / errors[1] - 1


def table_row(effect: Effect, trials: int, seeds: int) -> str:
    effect, theta, share = sized(effect)
    found, errors, excess = zip(*(recover(effect, theta, trials, seed) for seed in range(seeds)), strict=True)
    found, errors = torch.stack(found)[:, 2:], torch.stack(errors)[:, 2:]
    recovered = ((found - theta[2:]).abs() <= 3 * errors).all(1).double().mean().item()
    ratio = found.std(0) / errors.mean(0)
    worst = ratio[ratio.log().abs().argmax()].item()
    name = effect.name + (f" ({effect.form})" if effect.form else "")
    planted = ", ".join(
        f"{p.symbol} = {value:.3g}" for p, value in zip(effect.parameters, theta[2:].tolist(), strict=True)
    )
    return f"| {name} | {planted} | {share:.0%} | {recovered:.0%} | {worst:.2f} | {sum(excess) / seeds:+.1%} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--only", nargs="*", help="names of effects")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    every = (form() for forms in catalogue().values() for form in forms if PLANE in form.spaces)
    chosen = [effect for effect in every if not options.only or effect.name in options.only]
    print("| effect | planted | share of the error | recovered | se ratio | excess |\n|---|---|---|---|---|---|")
    for row in run(table_row, [(effect, options.trials, options.seeds) for effect in chosen], options.workers):
        print(row, flush=True)


if __name__ == "__main__":
    main()
