"""Errors against plain NumPy, and the bootstrap against what it promises."""

import math

import numpy as np
import pytest
import torch

from contactlearn.core.serialisation import from_json, to_json
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.metrics import Interval, bootstrap
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.numbers import brief_interval
from contactlearn.simulation import synthetic

EXACT = 1e-13  # relative: a few roundings
ROUNDING = 1e-9  # of an error of order 1


@pytest.fixture(scope="module")
def case():
    impacts = synthetic.load(size=50)
    return impacts, ContactModel(find("whittaker").at(0.2, 0.4)).predict(impacts)


def test_errors_are_their_formulas(case):
    impacts, prediction = case
    e = (prediction.v_post - impacts.v_post).numpy()
    v = impacts.v_post.numpy()
    velocity = [np.hypot(*row[:2]) for row in e]
    mass = []
    for i in range(len(impacts)):
        M = np.diag([impacts.mass[i], impacts.mass[i], impacts.inertia[i]])
        mass.append(np.sqrt(e[i] @ M @ e[i]) / np.sqrt(v[i] @ M @ v[i]))
    np.testing.assert_allclose(metrics.velocity_error(impacts, prediction), velocity, rtol=EXACT)
    np.testing.assert_allclose(metrics.mass_error(impacts, prediction), mass, rtol=EXACT)
    euclidean = np.linalg.norm(e, axis=1)
    np.testing.assert_allclose(metrics.euclidean_error(impacts, prediction), euclidean, rtol=EXACT)
    ratio = euclidean / np.linalg.norm(v, axis=1)
    np.testing.assert_allclose(metrics.normalised_euclidean_error(impacts, prediction), ratio, rtol=EXACT)
    # Grams for kilograms, and millimetres for metres, change nothing.
    expected = metrics.mass_error(impacts, prediction)
    lengths = torch.tensor((1e3, 1e3, 1.0), dtype=torch.float64)
    changed = impacts.replace(
        mass=1e3 * impacts.mass, inertia=1e9 * impacts.inertia, r=1e3 * impacts.r, v_pre=impacts.v_pre * lengths,
        v_post=impacts.v_post * lengths,
    )  # fmt: skip
    actual = metrics.mass_error(changed, Prediction(prediction.v_post * lengths, prediction.wrench))
    torch.testing.assert_close(actual, expected, rtol=EXACT, atol=0)


@pytest.mark.parametrize("norm", metrics.NORMS)
def test_bounds_are_least_in_the_metrics_of_their_norm(norm):
    """Trial by trial: of the laws, and of the impulses that no law gives but a rigid point contact can."""
    impacts, generator = synthetic.load(size=40), torch.Generator().manual_seed(0)
    rigid = {name: ContactModel(find(name).at(0.2, 0.4)).predict(impacts) for name in PAPER_LAWS}
    best, _ = bounds.best_post_hoc(impacts, rigid, norm)
    wrench = impacts.wrench * torch.tensor((1.0, 1.0, 0.0)) + 2e-3 * torch.randn((200, 40, 3), generator=generator)
    wrench[..., 2] = 0
    drawn = Prediction.from_wrench(impacts, wrench)
    admissible = ~metrics.outside_admissible(impacts, wrench[..., :2])
    assert admissible.double().mean() > 0.05
    for metric in metrics.bounded_metrics(norm):
        error = metrics.METRICS[metric].error
        least = error(impacts, bounds.irb(impacts, norm)) - ROUNDING
        assert (least <= error(impacts, best)).all()
        assert all((error(impacts, best) - ROUNDING <= error(impacts, law)).all() for law in rigid.values())
        assert (least <= error(impacts, drawn))[admissible].all()


def test_every_norm_has_a_headline_of_its_own():
    assert {norm: metrics.headline_metric(norm) for norm in metrics.NORMS} == {
        "mass": "mass_error", "euclidean": "euclidean_error",
    }  # fmt: skip
    bounded = [name for norm in metrics.NORMS for name in metrics.bounded_metrics(norm)]
    assert set(metrics.METRICS) - set(bounded) == {"velocity_error"}
    assert len(bounded) == len(set(bounded))


def test_velocity_error_is_bounded_by_nothing():
    """A moment about the mass centre does not show in it, and the bound of three components exceeds a law in it."""
    impacts = synthetic.load(size=200)
    impacts = impacts.replace(v_post=impacts.v_post + torch.tensor((0.0, 0.0, 5.0), dtype=torch.float64))
    law = ContactModel(find("wang_mason").at(0.12, 0.55)).predict(impacts)
    error = metrics.velocity_error
    for norm in metrics.NORMS:
        assert error(impacts, bounds.irb(impacts, norm)).mean() > error(impacts, law).mean()


def test_bootstrap_interval_covers_as_promised():
    """95 % intervals of the mean of 40 exponential errors hold the true mean nearly that often."""
    generator = torch.Generator().manual_seed(0)
    draws = -torch.rand((300, 40), generator=generator, dtype=torch.float64).log()
    intervals = [metrics.bootstrap(errors, generator, resamples=500) for errors in draws]
    covered = np.mean([interval.low <= 1 <= interval.high for interval in intervals])
    # Percentile intervals of a skewed mean fall short by a few per cent; 300 draws add ± 1.5 %.
    assert 0.88 < covered < 0.98
    assert all(interval.low < interval.mean < interval.high for interval in intervals)
    assert intervals[0].mean == pytest.approx(draws[0].mean().item(), rel=EXACT)
    errors = torch.rand(30, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    first, again = (metrics.bootstrap(errors, torch.Generator().manual_seed(2), 100) for _ in range(2))
    assert first == again


def test_outside_admissible():
    impacts = synthetic.load(size=50)
    for law in PAPER_LAWS[2:]:  # those that never add energy
        P = find(law).at(0.3, 0.6).impulse(impacts.W, impacts.v_c)
        assert not metrics.outside_admissible(impacts, P).any()
        assert metrics.outside_admissible(impacts, 0.5 * P / 1.6).all()  # stops short of the floor's surface
        assert metrics.outside_admissible(impacts, 3 * P).all()  # gains energy


def test_back_spin_is_beyond_the_line_of_sticking():
    """Of a disc, whose friction and restitution are not coupled, only Drumwright and Shell's law reverses the slip."""
    discs = synthetic.load(size=200, shape={"kind": "disc", "radius": 0.03})
    predictions = {name: ContactModel(find(name).at(0.3, 0.6)).predict(discs) for name in PAPER_LAWS}
    reversed_ = metrics.back_spin(discs, predictions["drumwright_shell"].v_post)
    sticks = predictions["wang_mason"].v_post  # ends on the line: neither side
    assert (rigid_body.contact_velocity(discs.r, sticks)[:, 0].abs() < 1e-9).double().mean() > 0.5
    sums = metrics.ErrorSums(predictions)
    sums.add(discs.replace(v_post=predictions["drumwright_shell"].v_post), predictions)
    assert sums.back_spin("drumwright_shell") == sums.back_spin() == reversed_.double().mean() > 0.5
    assert all(sums.back_spin(name) == 0 for name in PAPER_LAWS if name != "drumwright_shell")


def test_trials_of_one_recording_are_held_out_and_resampled_together():
    """Copies of a trial change neither mean nor interval, and no recording is on both sides."""
    generator = torch.Generator().manual_seed(1)
    errors = torch.rand(40, generator=generator, dtype=torch.float64)
    once = metrics.bootstrap(errors, torch.Generator().manual_seed(0))
    rows = torch.arange(40).repeat_interleave(5)
    together = metrics.bootstrap(errors[rows], torch.Generator().manual_seed(0), groups=rows)
    apart = metrics.bootstrap(errors[rows], torch.Generator().manual_seed(0))
    assert tuple(together) == pytest.approx(tuple(once), abs=1e-12)
    assert apart.high - apart.low < 0.6 * (once.high - once.low)
    drops = synthetic.load(60)
    drops = drops.replace(recording=tuple(f"toss {k // 3}" for k in range(60)))
    pool, test = drops.split(0.25, generator)
    assert len(test) == 15
    assert not {*pool.recording} & {*test.recording}


def test_a_single_trial_or_group_has_no_interval():
    """Resampling it gives the same mean again, an interval without width."""
    seed = torch.Generator().manual_seed(0)
    errors, groups = torch.tensor([0.1, 0.2, 0.4], dtype=torch.float64), torch.zeros(3, dtype=torch.int64)
    cases = {
        "a trial": bootstrap(errors[:1], seed),
        "a trial of subsets": bootstrap(errors[:, None], seed),
        "a group": bootstrap(errors, seed, groups=groups),
    }
    for name, one in cases.items():
        assert math.isnan(one.low), name
        assert math.isnan(one.high), name
        assert brief_interval(one).endswith("(one trial: no interval)"), name
    assert bootstrap(errors[:2], seed).low == pytest.approx(0.1)
    assert from_json(Interval, to_json(cases["a trial"])).mean == pytest.approx(0.1)
    assert math.isnan(from_json(Interval, to_json(cases["a trial"])).high)
