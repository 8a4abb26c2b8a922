"""Joint identification where v_pre is as noisy as v_post: no dilution, honest intervals, Deming's line."""

import math
from dataclasses import replace

import pytest
import torch

from contactlearn.core.errors import DataError
from contactlearn.effects import find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions, assemble, linearise
from contactlearn.inference.identification.shared import Box
from contactlearn.laws import find
from contactlearn.simulation import synthetic

NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)  # that of `data.synthetic`
SEEDS, TRIALS = 20, 600
CASES = {
    "law alone": ("wang_mason", {}),
    "spin damping": ("mirtich", {"spin_damping": 0.1}),
    "restitution": ("anitescu_potra_newton", {"velocity_dependent_restitution": 0.2}),
}


def planted(law, names, noise, size, seed=0):
    """Drops from both sides under a law (μ = 0.15, ε = 0.6) and effects, with noise before and after."""
    exact = synthetic.load(size=size, velocity_noise=0, spin_noise=0, seed=seed)
    v = exact.v_pre.clone()
    v[::2, 0] *= -1
    exact = exact.replace(v_pre=v)
    chosen = {name: find_effect(name)().prepare(exact) for name in names}
    theta = torch.tensor((0.15, 0.6, *names.values()), dtype=torch.float64)
    truth = assemble(find(law), chosen, theta).predict(exact).v_post
    generator = torch.Generator().manual_seed(100 + seed)
    before, after = noise * torch.randn(2, size, 3, generator=generator, dtype=torch.float64)
    return exact.replace(v_pre=exact.v_pre + before, v_post=truth + after, validate=False), chosen, theta


def options(noise, before=None, **others):
    return FitOptions(noise=tuple(noise.tolist()), noise_before=before, **others)


EXACT = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("times", [1, 4])
@pytest.mark.parametrize("case", CASES)
def test_the_mean_is_the_truth(case, times):
    """Twenty tables; at four times the noise, a fit that takes v_pre for exact is wrong about a slope."""
    law, names = CASES[case]
    noise = times * NOISE
    drops, chosen, theta = planted(law, names, noise, SEEDS * TRIALS)
    rows = torch.arange(SEEDS * TRIALS).view(SEEDS, TRIALS)
    fit = joint.fit(drops, find(law), chosen, rows=rows, options=options(noise), start=theta)
    assert fit.converged.all()
    error = (fit.values.mean(0) - theta) / (fit.values.std(0) / math.sqrt(SEEDS))
    assert (error.abs() < 3).all(), error
    covered = ((fit.values - theta).abs() <= 1.96 * fit.standard_errors).sum(0)
    assert (covered >= 16).all(), covered  # of 20; at 95 % fewer happen once in 400
    if "velocity_dependent_restitution" in names and times == 4:
        old = joint.fit(drops, find(law), chosen, rows=rows, options=options(noise, EXACT), start=theta).values
        bias = (old.mean(0) - theta) / (old.std(0) / math.sqrt(SEEDS))
        assert bias[2] > 3, bias


def test_it_is_deming_regression_where_the_outcome_is_linear():
    """Without a lever and friction v_y⁺ = −ε v_y: the weighted orthogonal line through the origin, in closed form."""
    noise = 4 * NOISE
    drops, _, _ = planted("wang_mason", {}, noise, 200)
    r = drops.r.clone()
    r[:, 0] = 0
    generator = torch.Generator().manual_seed(1)
    v = torch.tensor((0.3, -1.0, 5.0), dtype=torch.float64) * torch.randn(200, 3, generator=generator).double()
    v[:, 1] = -0.1 - v[:, 1].abs()
    before, after = noise * torch.randn(2, 200, 3, generator=generator, dtype=torch.float64)
    v_post = v * torch.tensor((1.0, -0.6, 1.0)) + after
    drops = drops.replace(r=r, v_pre=v + before, v_post=v_post, validate=False)
    box = Box(mu=(0.0, 1e-9))
    fit = joint.fit(drops, find("wang_mason"), options=options(noise, box=box))
    x, y, w = -drops.v_pre[:, 1], v_post[:, 1], fit.weight
    xx, xy, yy = ((w * a * b).sum() for a, b in ((x, x), (x, y), (y, y)))
    deming = (yy - xx + ((yy - xx).square() + 4 * xy.square()).sqrt()) / (2 * xy)
    assert fit.values[1].item() == pytest.approx(deming.item(), rel=1e-5)
    least_squares = joint.fit(drops, find("wang_mason"), options=options(noise, EXACT, box=box)).values[1]
    dilution = (noise[1] ** 2 / x.square().mean()).item()
    assert (1 - least_squares / deming).item() == pytest.approx(dilution, rel=0.4)


def test_gross_outliers_have_little_influence():
    drops, chosen, theta = planted(*CASES["spin damping"], NOISE, 400)
    clean = joint.fit(drops, find("mirtich"), chosen, options=options(NOISE), start=theta)
    v_post = drops.v_post.clone()
    v_post[::25] = v_post[::25].flip(0) * -3
    wild = drops.replace(v_post=v_post, validate=False)
    fit = joint.fit(wild, find("mirtich"), chosen, options=options(NOISE, starts=2))
    assert ((fit.values - clean.values).abs() <= 1.5 * clean.standard_errors).all()
    assert (fit.weight[::25] < 0.05).all()
    assert fit.outliers == 16


def test_only_the_ratio_of_the_noises_counts():
    drops, chosen, theta = planted(*CASES["spin damping"], NOISE, 200)
    one, ten = (
        joint.fit(drops, find("mirtich"), chosen, options=options(scale * NOISE), start=theta) for scale in (1.0, 10.0)
    )
    torch.testing.assert_close(one.values, ten.values, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(one.standard_errors, ten.standard_errors, rtol=1e-4, atol=1e-8)


def test_subsets_are_a_batch_and_targets_are_one():
    drops, chosen, theta = planted(*CASES["restitution"], NOISE, 300)
    rows = torch.arange(300).view(2, 150)
    batch, wrench = (
        joint.fit(drops, find("mirtich"), chosen, rows=rows, options=options(NOISE, target=target), start=theta).values
        for target in ("velocity", "wrench")
    )
    torch.testing.assert_close(batch, wrench, rtol=0, atol=0)
    for one, row in zip(batch, rows, strict=True):
        alone = joint.fit(drops, find("mirtich"), chosen, rows=row, options=options(NOISE), start=theta).values
        torch.testing.assert_close(one, alone, rtol=1e-4, atol=1e-5)


def test_an_averaged_component_counts_as_exact():
    """All drops fall from one height: their mean v_y is as good as exact."""
    drops, chosen, theta = planted(*CASES["spin damping"], NOISE, 200)
    v = drops.v_pre.clone()
    v[:, 1] = v[:, 1].mean()
    drops = drops.replace(v_pre=v, validate=False)
    stated, found = (
        joint.fit(drops, find("mirtich"), chosen, options=options(NOISE, before), start=theta).values
        for before in ((0.01, 0.0, 0.5), None)
    )
    torch.testing.assert_close(found, stated, rtol=0, atol=0)


def test_a_linearisation_is_about_the_latent_states():
    """At the fitted parameters the weighted gradient vanishes, as it does not about the measured states."""
    noise = 4 * NOISE
    drops, chosen, theta = planted(*CASES["restitution"], noise, 400)
    fit = joint.fit(drops, find("anitescu_potra_newton"), chosen, options=options(noise), start=theta)

    def gradient(before):
        about = linearise(
            find("anitescu_potra_newton"), chosen, drops, fit.values, fit.scatter, options=options(noise, before)
        )
        each = about.weight[:, None] * (about.slope * about.residual[..., None]).sum(1)
        return (each.sum(0) * fit.standard_errors).abs().max()

    assert gradient(None) < 0.1
    assert gradient(EXACT) > 0.5


@pytest.mark.parametrize(("given", "message"), [
    ({"noise_before": (0.1, 0.1, 0.1)}, "needs noise"),
    ({"noise": (0.1, 0.1, 0.1), "noise_before": (0.1, -0.1, 0.1)}, "three non-negative standard deviations"),
])  # fmt: skip
def test_noise_before_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(DataError, match=message):
        replace(FitOptions(), **given)
