"""Outliers of a fitted model: planted ones are named, heavy tails and clean data are not."""

import pytest
import torch

from contactlearn.data.audit.model_checks import find_model_outliers
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

SIZE = torch.tensor([0.02, 0.02, 0.5], dtype=torch.float64)  # of the noise, m/s, m/s, rad/s
TRUTH = find("mirtich").at(0.15, 0.6)


def truth(impacts: Impacts):
    return ContactModel(TRUTH).predict(impacts).v_post


def measured(n: int, seed: int, freedom: float = 0.0) -> Impacts:
    """Drops by a law, with Gaussian noise or that of Student's t."""
    generator = torch.Generator().manual_seed(seed)
    drops = synthetic.load(size=n, seed=seed, velocity_noise=0, spin_noise=0)
    noise = torch.randn(n, 3, generator=generator, dtype=torch.float64)
    if freedom:
        chi = torch.randn(n, int(freedom), generator=generator, dtype=torch.float64).square().mean(-1, keepdim=True)
        noise = noise / chi.sqrt()
    return drops.replace(v_post=truth(drops) + SIZE * noise)


@pytest.mark.parametrize("freedom", [0, 3, 6])
def test_false_alarms_over_the_whole_table(freedom):
    """One in twenty tables is expected to have one: of forty, no more than six."""
    found = [find_model_outliers(measured(200, seed, freedom), truth) for seed in range(40)]
    assert sum(one is not None for one in found) <= 6


@pytest.mark.parametrize("freedom", [0, 6])
def test_planted_outliers_are_named(freedom):
    impacts = measured(300, 1, freedom)
    v_pre, v_post = impacts.v_pre.clone(), impacts.v_post.clone()
    after, before = (v[:, 2].abs().argmax().item() for v in (v_post, v_pre))
    v_post[after, 2] *= -1
    v_pre[before, 2] *= -1
    v_post[7, 0] += 3.0
    finding = find_model_outliers(impacts.replace(v_pre=v_pre, v_post=v_post, validate=False), truth)
    assert finding is not None
    assert not finding.mistake
    assert set(finding.value("rows").split(", ")) == {"8", str(after + 1), str(before + 1)}
    assert set(finding.value("wrong_sign").split(", ")) == {str(after + 1), str(before + 1)}
    assert f"the spin of row {after + 1} (trial '{after + 1}') after impact" in finding.sentence
    assert f"the spin of row {before + 1} (trial '{before + 1}') before impact" in finding.sentence
    assert "row 8 (trial '8') is off by (+2.9" in finding.sentence


def test_stated_covariances_are_the_yardstick():
    """What is an outlier of a precise trial is none of one whose noise is ten times as large, and stated."""
    drops = synthetic.load(size=200, seed=3, velocity_noise=0, spin_noise=0)
    sigma = SIZE * torch.where(torch.arange(200) % 2 == 0, 0.1, 1.0).double()[:, None]
    noise = torch.randn(200, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    v_post = truth(drops) + sigma * noise
    v_post[10, 0] += 10 * sigma[10, 0]
    v_post[11, 0] += 10 * sigma[10, 0]
    plain = drops.replace(v_post=v_post)
    finding = find_model_outliers(plain.replace(v_post_cov=torch.diag_embed(sigma.square())), truth)
    assert finding is not None
    assert finding.value("rows") == "11"
    assert find_model_outliers(plain, truth) is None


def test_a_stricter_table_has_fewer():
    impacts = measured(200, 2)
    v_post = impacts.v_post.clone()
    v_post[7, 0] += 10 * SIZE[0]
    spoilt = impacts.replace(v_post=v_post)
    assert find_model_outliers(spoilt, truth) is not None
    assert find_model_outliers(spoilt, truth, AuditThresholds(false_outliers=1e-9)) is None


def test_published_drops_have_a_spin_of_the_wrong_sign(ellipse_drops):
    flip = torch.tensor((-1.0, 1.0, 1.0), dtype=torch.float64)
    drops = ellipse_drops.replace(
        q=ellipse_drops.q * flip, v_pre=ellipse_drops.v_pre * flip, v_post=ellipse_drops.v_post * flip
    )
    fit = joint.fit(drops, find("wang_mason"))
    finding = find_model_outliers(drops, lambda impacts: fit.model.predict(impacts).v_post)
    assert finding is not None
    assert finding.value("trials") <= 5
    assert f"row {drops.trial.index('1097') + 1} (trial '1097') after impact, -50.6 rad/s, has" in finding.sentence
    assert "trial '1655'" in finding.sentence
