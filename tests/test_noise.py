"""The noise floor against what is known of the noise."""

import pytest
import torch

from contactlearn.diagnosis.error_budget import noise_floor
from contactlearn.diagnosis.result import NoiseSource
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

TRUE = ContactModel(find("wang_mason").at(0.12, 0.55))
V, OMEGA = 0.01, 0.5


def drops(size, seed=0, **options):
    return synthetic.load(size=size, seed=seed, mu=0.12, eps=0.55, velocity_noise=V, spin_noise=OMEGA, **options)


def floor(impacts, model, seed=0, **options):
    return noise_floor(impacts, model, generator=torch.Generator().manual_seed(seed), **options)


@pytest.mark.parametrize("size", [150, 600])
def test_of_the_true_model_it_is_the_error(size):
    """A true model misses nothing but the noise."""
    impacts = drops(size)
    error = mass_error(impacts, TRUE.predict(impacts)).mean().item()
    found = floor(impacts, TRUE)
    assert found.source is NoiseSource.ESTIMATED
    assert found.error.low < error < found.error.high
    assert found.error.mean == pytest.approx(error, rel=0.08)


def test_a_wrong_model_deceives_it_little():
    """With μ and ε far off the error is eighteen times the floor; the estimate is near the floor, and unsure."""
    impacts = drops(600)
    true = mass_error(impacts, TRUE.predict(impacts)).mean().item()
    wrong = ContactModel(find("wang_mason").at(0.2, 0.45))
    error = mass_error(impacts, wrong.predict(impacts)).mean().item()
    found = floor(impacts, wrong).error
    assert error > 15 * true
    assert found.mean < 2 * true
    assert found.low < true < found.high


def test_repeats_show_the_noise_whatever_the_model():
    """Ten of each drop: what they differ by is the noise after impact, though the model is useless."""
    once = synthetic.load(size=40, mu=0.12, eps=0.55, velocity_noise=0, spin_noise=0)
    rows = torch.arange(400) % 40
    fields = {name: getattr(once, name)[rows] for name in ("mass", "inertia", "r", "q", "v_pre", "v_post")}
    noise = torch.randn(400, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    fields["v_post"] = fields["v_post"] + torch.tensor((V, V, OMEGA)) * noise
    impacts = Impacts(**fields)
    expected = Prediction(once.v_post[rows], once.wrench[rows])
    true = mass_error(impacts, expected).mean().item()
    useless = ContactModel(find("whittaker").at(0.0, 0.9))
    assert mass_error(impacts, useless.predict(impacts)).mean() > 10 * true
    assert floor(impacts, useless).error.mean == pytest.approx(true, rel=0.15)


def test_stated_noise_is_carried_through_the_model():
    """The noise that was planted, before and after impact, gives the error that the true model has."""
    errors = [mass_error(d, TRUE.predict(d)).mean().item() for d in (drops(400, seed) for seed in range(5))]
    found = floor(drops(400), TRUE, noise=(V, V, OMEGA))
    assert found.source is NoiseSource.STATED
    assert found.error.mean == pytest.approx(sum(errors) / 5, rel=0.1)


def test_what_an_outlier_leaves_is_noise_of_its_own():
    """It does not touch the estimate of the others."""
    impacts = drops(300)
    v_post = impacts.v_post.clone()
    v_post[7] += 50.0
    wild = impacts.replace(v_post=v_post)
    fit = joint.fit(wild, find("wang_mason"))
    assert fit.inliers.tolist() == [row != 7 for row in range(300)]
    own = mass_error(wild, fit.model.predict(wild))[7].item() / 300
    spoilt, clean = floor(wild, fit.model, inliers=fit.inliers), floor(impacts, fit.model)
    assert spoilt.error.mean - own == pytest.approx(clean.error.mean, rel=0.02)
