"""Learning curves, transfer, and the scores of models that say how sure they are."""

import math

import pytest
import torch

from contactlearn.core.errors import DataError
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.inference.learning import curves as study
from contactlearn.inference.learning.curves import count_trainings
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Prediction
from contactlearn.simulation import synthetic

EXACT = 1e-12  # the same operations in another process or order
RECIPES = {"wrench": Recipe("x1", "wrench"), "residual": Recipe("x1", "impulse", find("whittaker"))}


def bases(fits):
    """The laws as identified, by size."""
    return {law: {size: study.law_at(fit, size) for size in (10, 30)} for law, fit in fits.items()}


@pytest.fixture(scope="module")
def drops():
    return synthetic.load(size=120).split(0.25, torch.Generator().manual_seed(1))


@pytest.fixture(scope="module")
def curves(drops):
    pool, test = drops
    orders = study.nested_orders(len(pool), 3, torch.Generator().manual_seed(2))
    fits, laws = study.law_curves([find("whittaker")], pool, test, orders, (10, 30))
    return orders, fits, laws, study.learning_curves(RECIPES, pool, test, orders, (10, 30), bases(fits))


def test_a_curve_is_what_training_by_hand_gives(drops, curves):
    pool, test = drops
    orders, fits, laws, learned = curves
    model = learn(pool, RECIPES["residual"], rows=orders[:, :30], base=study.law_at(fits["whittaker"], 30))
    for name, metric in metrics.METRICS.items():
        torch.testing.assert_close(
            learned["residual"].errors[name][1], metric.error(test, model.predict(test)), rtol=EXACT, atol=EXACT
        )
    alone = fit_subsets(pool[orders[1, :10]], find("whittaker"), sizes=(10,), orders=torch.arange(10)[None])
    assert fits["whittaker"].mu[1, 0] == pytest.approx(alone.mu.item(), abs=1e-6)
    assert laws["whittaker"].errors["mass_error"].shape == (2, 3, 30)
    assert laws["whittaker"].density is None
    pair = study.learning_curves(RECIPES, pool, test, orders, (10, 30), bases(fits), work=study.Work(processes=2))
    for name, curve in learned.items():
        assert pair[name].sizes == curve.sizes
        torch.testing.assert_close(pair[name].density.distance, curve.density.distance, rtol=1e-6, atol=1e-9)


def test_curves_that_were_stopped_resume(drops, curves, tmp_path, monkeypatch):
    pool, test = drops
    orders, fits, _, undisturbed = curves
    trained, whole, work = [], study._Training.run, study.Work(cache=tmp_path)

    def counted(training):
        if len(trained) == 3:
            raise KeyboardInterrupt
        trained.append((*training.key, training.size))
        return whole(training)

    def again():
        return study.learning_curves(RECIPES, pool, test, orders, (10, 30), bases(fits), work=work)

    monkeypatch.setattr(study._Training, "run", counted)
    with pytest.raises(KeyboardInterrupt):
        again()
    assert trained == [("wrench", 10), ("residual", 10), ("wrench", 30)]
    del trained[:]
    found = again()
    assert trained == [("residual", 30)]
    for name, curve in undisturbed.items():
        assert (found[name].sizes, found[name].kinds) == (curve.sizes, curve.kinds)
        assert found[name].converged == curve.converged
        assert torch.equal(found[name].density.distance, curve.density.distance)
        assert all(torch.equal(found[name].errors[metric], error) for metric, error in curve.errors.items())
    whole_file = (tmp_path / "wrench" / "10.npz").read_bytes()
    for damaged in (b"half of a file", b"", whole_file[:200], whole_file[:-30]):  # what cannot be read is trained again
        del trained[:]
        (tmp_path / "wrench" / "10.npz").write_bytes(damaged)
        again()
        assert trained == [("wrench", 10)]
    (tmp_path / "wrench" / ".saving-x").mkdir()
    (tmp_path / "wrench" / ".saving-x" / "30.npz").touch()  # of a process that was killed as it wrote
    assert count_trainings(tmp_path) == 4


def test_transfer_learns_the_correction(drops):
    """On the body that it was trained on a trained model is hard to improve on, and far ahead of a new one."""
    pool, test = drops
    other = synthetic.load(size=80, shape={"kind": "disc", "radius": 0.03}, seed=3)
    bodies = {"the same": (pool, test), "disc": other.split(0.5, torch.Generator().manual_seed(4))}
    model, curves = study.transfer_curves(RECIPES["wrench"], pool, bodies, (4, 12), 3, torch.Generator().manual_seed(5))
    mean = {
        (body, way): curve.errors["mass_error"].mean((1, 2))
        for body, ways in curves.items()
        for way, curve in ways.items()
    }
    zero = metrics.mass_error(test, model.predict(test)).mean()
    assert mean["the same", "zero_shot"].item() == pytest.approx(zero.item(), rel=EXACT)
    assert (mean["the same", "prior"] < 1.3 * zero).all()
    assert (mean["the same", "scratch"] > 2 * zero).all()
    assert mean["disc", "prior"][1] < mean["disc", "zero_shot"][0]
    with pytest.raises(DataError, match="disc: 40 trials were requested, but 30 are there"):
        study.transfer_curves(RECIPES["wrench"], pool, {"disc": (pool[:30], pool[30:])}, (4, 40), 1, torch.Generator())


def test_where_a_curve_crosses_and_settles():
    sizes, curve = (10, 20, 50, 100), (0.5, 0.3, 0.21, 0.2)
    assert study.first_below(curve, sizes, (0.6, 0.3, 0.2, 0.3)) == 10
    assert study.first_below(curve, sizes, (0.4, 0.3, 0.22, 0.1)) == 50
    assert study.first_below(curve, sizes, (0.1,) * 4) is None
    assert study.settled(curve, sizes) == 50
    assert study.settled((0.2, 0.3, 0.2), (10, 20, 50)) == 50
    assert study.settled((0.2, 0.2), (10, 20)) == 10
    assert study.settled((0.2, 0.3), (10, 20)) is None


@pytest.fixture(scope="module")
def predicted(drops):
    """Held-out trials and a prediction with a covariance of its own for each."""
    _, test = drops
    generator = torch.Generator().manual_seed(6)
    root = torch.randn(len(test), 3, 3, generator=generator, dtype=torch.float64)
    covariance = root @ root.mT + 0.1 * torch.eye(3, dtype=torch.float64)
    v_post = test.v_post + torch.randn(test.v_post.shape, generator=generator, dtype=torch.float64)
    return test, Prediction(v_post, v_post, covariance)


def test_density_is_that_of_the_normal_distribution(predicted):
    test, prediction = predicted
    normal = torch.distributions.MultivariateNormal(prediction.v_post, prediction.covariance)
    torch.testing.assert_close(metrics.negative_log_density(test, prediction), -normal.log_prob(test.v_post))
    error = test.v_post - prediction.v_post
    distance = (error * torch.linalg.solve(prediction.covariance, error)).sum(-1)
    torch.testing.assert_close(metrics.squared_distance(test, prediction), distance)
    inside = error.abs() / prediction.covariance.diagonal(dim1=-2, dim2=-1).sqrt() <= 1.95996398454
    assert (metrics.covered(test, prediction) == inside).all()
    z = torch.randn(200_000, 3, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    levels, shares = metrics.calibration(z.square().sum(-1))
    assert (levels - shares).abs().max() < 5 * math.sqrt(0.25 / len(z))
    assert (z.square().sum(-1) <= metrics.CHI_SQUARED_95[3]).double().mean().item() == pytest.approx(0.95, abs=0.003)


def test_bootstrap_resamples_subsets_and_trials():
    """Subsets that differ, or trials that differ, each widen the interval; its variance is their sum."""
    generator = torch.Generator().manual_seed(8)
    by_subset = torch.randn(8, 1, generator=generator, dtype=torch.float64).expand(8, 40)
    by_trial = torch.randn(1, 40, generator=generator, dtype=torch.float64).expand(8, 40)
    for errors, variance in (
        (by_subset, by_subset[:, 0].var(correction=0) / 8),
        (by_trial, by_trial[0].var(correction=0) / 40),
    ):
        mean, low, high = metrics.bootstrap(errors, generator, 20_000)
        assert mean == pytest.approx(errors.mean().item(), abs=1e-12)
        assert (high - low) / (2 * 1.96) == pytest.approx(variance.sqrt().item(), rel=0.1)
