"""Covariances of the velocities: what is one, through tables, corrections, fits and the noise floor."""

import pytest
import torch
from refusals import refused

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.error_budget import noise_floor
from contactlearn.diagnosis.result import NoiseSource
from contactlearn.diagnosis.unexplained.remainder import Processes
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.noise_weight import noise_weight
from contactlearn.mechanics.rigid_body import measured_wrench
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

V, OMEGA = 0.01, 0.5


def covariances(n: int, seed: int = 0) -> torch.Tensor:
    """Covariances [n, 3, 3] in units of laboratory noise, all of their entries filled."""
    scale = torch.tensor((V, V, OMEGA), dtype=torch.float64)
    root = torch.randn(n, 3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return scale[:, None] * (root @ root.mT / 3) * scale


def drops(n: int = 30, **changes) -> Impacts:
    fields = {"v_pre_cov": covariances(n), "v_post_cov": covariances(n, 1)} | changes
    return synthetic.load(size=n).replace(**fields)


def test_they_are_indexed_replaced_and_part_of_the_fingerprint():
    impacts, rows = drops(), [3, 1]
    for name in PLANE.covariances:
        assert torch.equal(getattr(impacts[rows], name), getattr(impacts, name)[rows])
        without = impacts.replace(**{name: None})
        assert getattr(without[rows], name) is None
        assert without.fingerprint() != impacts.fingerprint()
    exact = torch.zeros(30, 3, 3)
    exact[:, 2, 2] = 1e-300
    assert torch.equal(drops(v_pre_cov=exact).v_pre_cov, exact.double())
    impacts = drops(validate=False, v_post_cov=None)
    swapped = correct(impacts, ["swapped_pre_post"])
    assert swapped.v_pre_cov is None
    assert torch.equal(swapped.v_post_cov, impacts.v_pre_cov)


@pytest.mark.parametrize(
    ("change", "fragments"),
    [
        (lambda c: c[:, :2], ["v_pre_cov must have shape (30, 3, 3), got (30, 2, 3)"]),
        (lambda c: c[0], ["v_pre_cov must have shape"]),
        (lambda c: c.index_put((torch.tensor(4), torch.tensor(0), torch.tensor(2)), torch.tensor(1.0).double()),
         ["row 5", "column cov_vx_omega", "symmetric"]),
        (lambda c: c.index_put((torch.tensor(2), torch.tensor(1), torch.tensor(1)), torch.tensor(torch.nan).double()),
         ["row 3", "cov_", "finite", "nan"]),
        (lambda c: -c, ["row 1", "column cov_vx_vx", "variance", "negative", "29 more"]),
        (lambda c: c * torch.tensor([[1, 3.0, 1], [3, 1, 1], [1, 1, 1]]), ["positive semi-definite"]),
        (lambda c: c * torch.tensor([[0, 1.0, 1], [1, 1, 1], [1, 1, 1]]), ["row 1"]),
    ],
    ids=["size", "one for all", "halves differ", "nan", "negative", "indefinite", "no variance"],
)  # fmt: skip
def test_what_is_no_covariance_is_refused(change, fragments):
    with refused(fragments):
        drops(v_pre_cov=change(covariances(30)))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("left_out", [(), ("v_pre_cov",), ("v_post_cov",)])
def test_tables_keep_every_bit(tmp_path, suffix, left_out):
    impacts = drops(**dict.fromkeys(left_out))
    back = table.load(table.save(impacts, tmp_path / f"drops{suffix}"))
    for name in PLANE.covariances:
        assert (getattr(back, name) is None) == (name in left_out)
        assert name in left_out or torch.equal(getattr(back, name), getattr(impacts, name))


def test_a_table_with_a_part_of_a_covariance_is_refused(tmp_path):
    path = table.save(drops(), tmp_path / "drops.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    k = rows[0].index("cov_vx_omega_post")
    path.write_text("".join(",".join(row[:k] + row[k + 1 :]) + "\n" for row in rows))
    with pytest.raises(DataError, match="six or none; missing: cov_vx_omega_post"):
        table.load(path)


@pytest.mark.parametrize(("name", "change"), [
    ("mirrored_x", torch.diag(torch.tensor((-1.0, 1, 1)))),
    ("degrees", torch.diag(torch.tensor((1.0, 1, torch.pi / 180)))),
    ("millimetres_velocity", torch.diag(torch.tensor((1e-3, 1e-3, 1)))),
    ("swapped_axes", torch.tensor([[0, 1.0, 0], [1, 0, 0], [0, 0, 1]])),
    ("averaged_vy", torch.diag(torch.tensor((1.0, 0, 1)))),
    ("millimetres", torch.eye(3)),
])  # fmt: skip
def test_corrections_carry_them_as_they_carry_velocities(name, change):
    impacts, change = drops(validate=False), change.double()
    corrected = correct(impacts, [name])
    torch.testing.assert_close(corrected.v_pre_cov, change @ impacts.v_pre_cov @ change.T)
    if not name.startswith("averaged"):
        torch.testing.assert_close(corrected.v_post_cov, change @ impacts.v_post_cov @ change.T)


def test_a_fit_takes_them_for_the_stated_noise():
    """And one that states its noise does not."""
    law, size = find("wang_mason"), 120
    sigma = torch.tensor((V, V, OMEGA), dtype=torch.float64)
    before, after = ((k * sigma).square().diag().expand(size, 3, 3) for k in (0.5, 1.0))
    impacts = synthetic.load(size=size, seed=3).replace(v_pre_cov=before, v_post_cov=after)
    stated = FitOptions(noise=(V, V, OMEGA), noise_before=(V / 2, V / 2, OMEGA / 2), starts=2)
    found = joint.fit(impacts, law, options=FitOptions(starts=2))
    bare = impacts.replace(v_pre_cov=None, v_post_cov=None)
    torch.testing.assert_close(found.values, joint.fit(bare, law, options=stated).values)
    assert stated.with_noise_of(impacts) is stated
    assert FitOptions().with_noise_of(bare) == FitOptions()
    one = FitOptions().with_noise_of(impacts.replace(v_post_cov=None))
    assert one.noise == one.noise_before
    assert one.noise == pytest.approx((V / 2, V / 2, OMEGA / 2))
    assert FitOptions().with_noise_of(impacts.replace(v_post_cov=torch.zeros(size, 3, 3))).noise is None


def test_the_noise_floor_is_that_of_the_covariances():
    law, size = find("wang_mason").at(0.12, 0.55), 200
    impacts = synthetic.load(size=size, seed=5)
    sigma = torch.tensor((V, V, OMEGA), dtype=torch.float64).square().diag().expand(size, 3, 3)
    known = impacts.replace(v_pre_cov=sigma, v_post_cov=sigma)
    floors = [
        noise_floor(data, ContactModel(law), generator=torch.Generator().manual_seed(0), noise=noise)
        for data, noise in ((known, None), (impacts, (V, V, OMEGA)))
    ]
    assert [floor.source for floor in floors] == [NoiseSource.MEASURED, NoiseSource.STATED]
    assert floors[0].error.mean == pytest.approx(floors[1].error.mean, rel=1e-6)


@pytest.mark.parametrize(("target", "outputs"), [("velocity", 3), ("impulse", 2), ("wrench", 3)])
def test_trials_weigh_less_the_larger_their_stated_noise(target, outputs):
    impacts = drops()
    weight = noise_weight(impacts, target)
    assert weight.shape == (30, outputs)
    louder = impacts.v_post_cov.clone()
    louder[4] *= 100
    other = noise_weight(impacts.replace(v_post_cov=louder), target)
    assert (other[4] < weight[4]).all()
    assert weight.square().max() < 2
    assert noise_weight(impacts.replace(v_pre_cov=None, v_post_cov=None), target) is None
    few = torch.where(torch.arange(30)[:, None, None] < 10, impacts.v_post_cov, 0.0)
    assert noise_weight(impacts.replace(v_pre_cov=None, v_post_cov=few), target).min() > 0.1


def test_the_wrench_of_a_trial_has_the_noise_of_its_velocities():
    """The weights follow from the scatter of wrenches over draws of the stated noise."""
    impacts = drops()
    noise = torch.linalg.cholesky(impacts.v_post_cov + impacts.v_pre_cov) @ torch.randn(
        4000, 30, 3, 1, dtype=torch.float64, generator=torch.Generator().manual_seed(0)
    )
    body = impacts.mass, impacts.inertia, impacts.r
    variance = measured_wrench(*body, impacts.v_pre, impacts.v_post + noise[..., 0]).var(0)
    typical = variance.median(0).values
    expected = (2 * typical / (typical + variance)).sqrt()
    assert torch.allclose(noise_weight(impacts, "wrench"), expected, rtol=0.05)


def test_a_process_learns_what_remains_with_the_same_weights():
    impacts, rows = drops(), torch.stack((torch.arange(20), torch.arange(10, 30)))
    residual = torch.randn(30, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    learned = Processes.of(impacts, residual, rows).gps.likelihood.weight
    assert torch.equal(learned, noise_weight(impacts, "wrench")[rows].mT)
    # Half of the trials have twenty times the noise; a process that is told so predicts the others better.
    pool, test = synthetic.load(size=80, seed=1), synthetic.load(size=200, seed=2)
    scale = torch.tensor((V, V, OMEGA), dtype=torch.float64)
    sigma = scale * torch.where(torch.arange(80) % 2 == 0, 1.0, 20.0).double()[:, None]
    noise = torch.randn(80, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    noisy = pool.replace(v_post=pool.v_post + sigma * noise)
    stated = noisy.replace(v_post_cov=torch.diag_embed(sigma.square()))
    recipe = Recipe(features="state", target="velocity")
    error = {
        name: mass_error(test, learn(impacts, recipe, rows=torch.arange(80)).predict(test)).mean().item()
        for name, impacts in (("plain", noisy), ("stated", stated))
    }
    assert error["stated"] < 0.95 * error["plain"]
