"""Dependence along the sequence: false alarms and power on planted residuals, what drifts, and folds of blocks."""

import math

import pytest
import torch

from contactlearn.core.errors import DataError
from contactlearn.diagnosis.drift import blocks, dependence, drift_kind

SIZE = torch.tensor([0.02, 0.03, 1.0], dtype=torch.float64)  # of the noise, m/s, m/s, rad/s


def normal(*shape, generator):
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def rough(n, generator):
    """Independent residuals of Student's t with 4 degrees of freedom, with a scatter that differs by e^0.5."""
    tails = normal(n, 4, generator=generator).square().mean(-1, keepdim=True).sqrt()
    return SIZE * normal(n, 3, generator=generator) / tails * (0.5 * normal(n, 1, generator=generator)).exp()


def wandering(n, rho, columns, generator):
    """An autoregressive sequence of unit variance."""
    steps, state = normal(n, columns, generator=generator), [normal(columns, generator=generator)]
    for step in steps[1:]:
        state.append(rho * state[-1] + math.sqrt(1 - rho**2) * step)
    return torch.stack(state)


def numbered(n):
    return torch.arange(1, n + 1, dtype=torch.float64)


def test_false_alarms():
    """On heavy-tailed residuals of varying scatter the p-value is uniform: three standard deviations of a count."""
    generator = torch.Generator().manual_seed(1)
    runs = 200
    found = [dependence(rough(80, generator), numbered(80), level=1.0) for _ in range(runs)]
    p_values = torch.tensor([one.p_value for one in found])
    for level in (0.01, 0.1, 0.5):
        alarms = (p_values <= level).sum().item()
        assert alarms <= runs * level + 3 * math.sqrt(runs * level * (1 - level)), level


@pytest.mark.parametrize(("n", "share", "runs"), [(60, 0.7, 12), (200, 0.4, 12), (1000, 0.2, 5)])
def test_power_against_autoregression(n, share, runs):
    """Four of five are seen."""
    generator = torch.Generator().manual_seed(2)
    found = []
    for _ in range(runs):
        dependent = math.sqrt(share) * wandering(n, 0.85, 3, generator)
        independent = math.sqrt(1 - share) * normal(n, 3, generator=generator)
        found.append(dependence(SIZE * (dependent + independent), numbered(n)))
    seen = [one for one in found if one is not None]
    assert len(seen) >= 0.8 * runs
    if n == 1000:
        for one in seen:
            assert one.time_scale == pytest.approx(-1 / math.log(0.85), rel=0.8)
            assert one.share == pytest.approx(share, abs=0.1)
            assert torch.tensor(one.size).div(SIZE).mean().item() == pytest.approx(math.sqrt(share), rel=0.35)
            assert one.interval[0] < 0.85 * share < one.interval[1] + 0.05
            assert one.block >= 2 * one.time_scale


@pytest.mark.parametrize("n", [60, 300])
def test_power_against_a_calibration_that_wanders(n):
    generator = torch.Generator().manual_seed(3)
    for phase in range(6):
        slow = math.sqrt(2) * torch.sin(2 * math.pi * numbered(n) / n + phase)[:, None] * SIZE
        assert dependence(rough(n, generator) + slow, numbered(n)) is not None


def test_the_order_counts_and_not_the_rows():
    generator = torch.Generator().manual_seed(4)
    n = 200
    residual = SIZE * (wandering(n, 0.9, 3, generator) + normal(n, 3, generator=generator))
    mixed = torch.randperm(n, generator=generator)
    found = dependence(residual[mixed], numbered(n)[mixed])
    assert found == dependence(residual, numbered(n))
    assert dependence(residual[mixed], numbered(n)) is None
    spiked = residual.clone()
    spiked[50] += 1e3
    inliers = torch.ones(n, dtype=torch.bool)
    inliers[50] = False
    assert dependence(spiked, numbered(n), inliers) == dependence(residual[inliers], numbered(n)[inliers])
    generator = torch.Generator().manual_seed(6)
    n = 300
    slopes = sensitivities(n, generator)
    residual = slopes[..., 1] * torch.linspace(-1.5, 1.5, n)[:, None] + SIZE * normal(n, 3, generator=generator)
    mixed = torch.randperm(n, generator=generator)
    assert drift_kind(residual[mixed], slopes[mixed], numbered(n)[mixed]) == "parameter"


def sensitivities(n, generator):
    """Derivatives that depend on the impact: speeds and signs of slips at random."""
    return SIZE[:, None] * normal(n, 3, 2, generator=generator) * (1 + normal(n, 1, 1, generator=generator).abs())


@pytest.mark.parametrize("n", [100, 400])
@pytest.mark.parametrize("rho", [0.85, 0.99])
def test_parameter_drift_differs_from_measurement_drift(n, rho):
    generator = torch.Generator().manual_seed(5)
    for _ in range(4):
        slopes, noise = sensitivities(n, generator), SIZE * normal(n, 3, generator=generator)
        parameter = (slopes[..., 0] * wandering(n, rho, 1, generator)) + noise
        measurement = SIZE * wandering(n, rho, 3, generator) + noise
        assert drift_kind(parameter, slopes, numbered(n)) in ("parameter", "undecided")
        assert drift_kind(measurement, slopes, numbered(n)) == "measurement"
        assert drift_kind(noise, slopes, numbered(n)) != "measurement"


@pytest.mark.parametrize(("n", "length", "folds"), [(60, 5, 5), (203, 10, 5), (1000, 30, 4), (50, 10, 5)])
def test_blocks_are_contiguous_and_equal(n, length, folds):
    generator = torch.Generator().manual_seed(7)
    order = torch.randperm(n, generator=generator).double()
    held_out = blocks(order, length, folds, generator)
    assert held_out.shape[0] == folds
    assert len(held_out.flatten().unique()) == held_out.numel() > n - folds * (n // (folds * length))
    for rows in held_out:
        places = order[rows].sort().values
        ends = (places.diff() != 1).nonzero()[:, 0].tolist()
        lengths = torch.tensor([-1, *ends, len(places) - 1]).diff()
        assert (lengths >= length).all()


def test_too_few_trials_for_blocks():
    with pytest.raises(DataError, match="5 folds of blocks of 20 trials need at least 100, got 60"):
        blocks(numbered(60), 20, 5, torch.Generator())


def test_a_component_that_is_exact_does_not_drift():
    """Such as v_x of bounces without friction, whose residual is 0 in every trial."""
    residual = rough(80, torch.Generator().manual_seed(1)) * torch.tensor((0.0, 1.0, 1.0), dtype=torch.float64)
    assert dependence(residual, numbered(80)) is None
    assert dependence(0 * residual, numbered(80)) is None
    found = dependence(residual + torch.linspace(0, 3, 80)[:, None] * residual.std(0), numbered(80))
    assert found.size[0] == 0.0
    assert 0 < found.share < 1
