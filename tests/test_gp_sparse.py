"""Sparse processes: the bound and what follows from it, against the exact processes and GPyTorch's own routes."""

import gpytorch
import pytest
import torch
from packaging.version import Version

from contactlearn.models.gp import sparse
from contactlearn.models.gp.evidence import LogEvidence
from contactlearn.models.gp.exact import ExactGPs
from contactlearn.models.gp.sparse import SparseGPs

JITTER = {"rtol": 1e-6, "atol": 1e-7}  # 1e-10 of s² on the diagonal of K_zz, over σ² of 0.01 and more
OPTIMA = {"rtol": 1e-5, "atol": 1e-6}  # where a batch of searches and each alone may part: in the last digits
WEIGHTED = pytest.mark.parametrize("weighted", [False, True], ids=["equal", "weighted"])


def problem(*lead: int, n: int = 60, noise: float = 0.2, weighted: bool = False, seed: int = 0):
    """x [*lead, n, 3], y [*lead, 2, n] = sines with noise of deviation `noise` / w, and w [*lead, 2, n] or None."""
    generator = torch.Generator().manual_seed(seed)
    shapes = (*lead, n, 3), (*lead, 2, n), (*lead, 2, n)
    x, e, w = (torch.randn(shape, generator=generator, dtype=torch.float64) for shape in shapes)
    slopes = torch.tensor([[1.5, 0.5, 0.0], [-1.0, 0.3, 2.0]], dtype=torch.float64)
    w = (0.3 * w).exp() if weighted else None
    return x, (slopes @ x.mT).sin() + noise * e / (1 if w is None else w), w


def set_hyperparameters(gps: ExactGPs | SparseGPs, seed: int = 1) -> torch.Tensor:
    """Give each process of the model other hyperparameters; they are returned too."""
    kernel = gps.covar_module if isinstance(gps, ExactGPs) else gps.covar_module.base_kernel
    shape = (*gps.train_targets.shape[:-1], gps.train_inputs[0].shape[-1] + 2)
    theta = (0.3 * torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)).exp()
    theta[..., -1] *= 0.05
    kernel.base_kernel.lengthscale, kernel.outputscale = theta[..., None, :-2], theta[..., -2]
    gps.likelihood.noise = theta[..., -1:]
    return gps.eval().hyperparameters()


def losses(gps: SparseGPs, weight: torch.Tensor | None) -> torch.Tensor:
    """−bound per point [O] of a model without leading axes."""
    (x,), y, z = gps.train_inputs, gps.train_targets, gps.covar_module.inducing_points
    weight = torch.ones_like(y) if weight is None else weight
    pairs = zip(gps.hyperparameters().log(), z, x, y, weight, strict=True)
    return torch.stack([sparse._loss_and_gradient(*process)[0] for process in pairs])


@WEIGHTED
def test_with_all_points_inducing_the_bound_is_the_evidence(weighted, monkeypatch):
    x, y, w = problem(weighted=weighted)
    gps = SparseGPs(x, y, w)
    theta = set_hyperparameters(gps)
    exact = LogEvidence(*gps.train_inputs, y, w)(theta.log(), torch.arange(2))[0]
    torch.testing.assert_close(losses(gps, w), exact, **JITTER)
    bounds = []
    for M in (5, 15, 30, 60):
        monkeypatch.setattr(sparse, "INDUCING", M)
        gps = SparseGPs(x, y, w)
        set_hyperparameters(gps)
        bounds.append(-losses(gps, w))
    assert (torch.stack(bounds).diff(dim=0) > 1e-3).all()
    monkeypatch.setattr(sparse, "INDUCING", 12)
    gps = SparseGPs(x, y, w)
    set_hyperparameters(gps)
    gps.train()
    own = gpytorch.mlls.ExactMarginalLogLikelihood(gps.likelihood, gps)(gps(*gps.train_inputs), y)
    torch.testing.assert_close(losses(gps, w), -own, **JITTER)


def test_predictions_are_gpytorchs_own(monkeypatch):
    monkeypatch.setattr(sparse, "INDUCING", 12)
    x, y, _ = problem()
    gps, new = SparseGPs(x, y), problem(n=20, seed=3)[0]
    set_hyperparameters(gps)
    with torch.no_grad(), gpytorch.settings.sgpr_diagonal_correction(False):  # it would be FITC's posterior
        own = gps(new.expand(2, -1, -1))
    mean, inside, outside = gps._posterior(new.unsqueeze(-3))
    torch.testing.assert_close(mean, own.mean, **JITTER)
    # Whatever the setting, GPyTorch before 1.15.2 adds what Q does not reach.
    reached = inside if Version(gpytorch.__version__) >= Version("1.15.2") else inside + outside
    torch.testing.assert_close(reached, own.variance, **JITTER)
    torch.testing.assert_close(gps.predict(new), (mean, inside + outside))
    assert (outside > 0).all()


@WEIGHTED
def test_with_all_points_inducing_everything_is_exact(weighted):
    x, y, w = problem(2, weighted=weighted)
    models = SparseGPs(x, y, w), ExactGPs(x, y, w)
    torch.testing.assert_close(*map(set_hyperparameters, models))
    new = problem(2, n=20, seed=3)[0]
    for call in (lambda gps: gps.predict(new), lambda gps: gps.leave_one_out()):
        for found, expected in zip(*map(call, models), strict=True):
            torch.testing.assert_close(found, expected, **JITTER)


@WEIGHTED
def test_leaving_a_trial_out_is_to_train_without_it(weighted, monkeypatch):
    monkeypatch.setattr(sparse, "INDUCING", 12)
    x, y, w = problem(weighted=weighted)
    gps = SparseGPs(x, y, w)
    set_hyperparameters(gps)
    error, variance = gps.leave_one_out()
    for i in (0, 33):  # one is an inducing point, one is not
        rest = torch.arange(60) != i
        without = SparseGPs(x[rest], y[:, rest], None if w is None else w[:, rest])
        set_hyperparameters(without)
        without.covar_module.inducing_points.data = gps.covar_module.inducing_points.data
        mean, expected = without.predict(x[i, None])
        torch.testing.assert_close(error[:, i], y[:, i] - mean[:, 0], rtol=1e-8, atol=1e-8)
        torch.testing.assert_close(variance[:, i], expected[:, 0], rtol=1e-8, atol=1e-8)


@pytest.fixture(scope="module")
def fitted():
    """A weighted problem of 700 trials, its model and how the training ended."""
    data = problem(n=700, weighted=True)
    gps = SparseGPs(*data)
    return data, gps, gps.fit()


def test_training_ends_at_the_maximum(fitted):
    (_, y, w), gps, fit = fitted
    assert fit.converged.all()
    assert fit.loss.shape == fit.evaluations.shape == (2,)
    torch.testing.assert_close(fit.loss, losses(gps, w))
    torch.testing.assert_close(fit.history[-1], fit.loss)
    theta, z = gps.hyperparameters(), gps.covar_module.inducing_points
    for p, *process, loss in zip(theta.log(), z, *gps.train_inputs, y, w, fit.loss, strict=True):
        for step in (*0.3 * torch.eye(5).double(), *-0.3 * torch.eye(5).double()):
            assert sparse._loss_and_gradient(p + step, *process)[0] > loss - 1e-4
    assert (gps.likelihood.noise[:, 0].sqrt() / 0.2 - 1).abs().max() < 0.1
    data, gps, _ = fitted
    exact = ExactGPs(*data)
    exact.fit(prior=False)
    new, truth, _ = problem(n=300, noise=0, seed=3)
    ours, theirs = ((model.predict(new)[0] - truth).square().mean(-1).sqrt() for model in (gps, exact))
    assert (ours < 1.05 * theirs).all()
    assert (theirs < 0.15).all()
    data, gps, fit = fitted
    again = SparseGPs(*data).fit(gps)
    torch.testing.assert_close(again.loss, fit.loss, rtol=0, atol=1e-3)  # other inducing points
    assert (again.evaluations <= fit.evaluations).all()
    data, gps, _ = fitted
    other, new = SparseGPs(*data), problem(n=20, seed=3)[0]
    other.load_state_dict(gps.state_dict())
    for call in (lambda model: model.predict(new), lambda model: model.leave_one_out()):
        for found, expected in zip(call(other), call(gps), strict=True):
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)


def test_a_batch_is_trained_as_each_alone(monkeypatch):
    monkeypatch.setattr(sparse, "INDUCING", 15)
    x, y, w = problem(3, n=80, weighted=True)
    batch, new = SparseGPs(x, y, w), problem(n=10, seed=3)[0]
    fit, together = batch.fit(), batch.predict(new.expand(3, -1, -1))
    for i in range(3):
        alone = SparseGPs(x[i], y[i], w[i])
        torch.testing.assert_close(alone.fit().loss, fit.loss[i], **OPTIMA)
        for found, expected in zip(alone.predict(new), together, strict=True):
            torch.testing.assert_close(found, expected[i], **OPTIMA)
        for found, expected in zip(alone.leave_one_out(), batch.leave_one_out(), strict=True):
            torch.testing.assert_close(found, expected[i], **OPTIMA)


@pytest.mark.parametrize("signal", ["sines", "constant", "free of noise"])
def test_duplicate_trials_and_constant_columns_do_no_harm(signal):
    x, y, _ = problem(n=150, noise=0 if signal == "free of noise" else 0.2)
    x, y = x.repeat(2, 1), y.repeat(1, 2)
    x[:, 1] = 0
    if signal == "constant":
        y = torch.zeros_like(y)
    gps = SparseGPs(x, y)
    fit = gps.fit()
    for part in (fit.loss, *gps.predict(x), *gps.leave_one_out()):
        assert part.isfinite().all()
    assert all((variance >= 0).all() for _, variance in (gps.predict(x), gps.leave_one_out()))


def test_inducing_points_are_spread():
    """Less variance is left than by a random choice, none is chosen twice, and heavy points come first."""
    x, _, _ = problem(n=400)
    theta, ones = torch.tensor([0.7, 0.7, 0.7, 1.0, 0.1], dtype=torch.float64), torch.ones(400, dtype=torch.float64)
    chosen = sparse._spread(x, ones, theta)
    assert len(chosen.unique(dim=0)) == len(chosen) == sparse.INDUCING

    def left(z: torch.Tensor) -> float:
        return float((1 - sparse._project(x, z, theta).square().sum(0)).sum())

    assert left(chosen) < 0.5 * left(x[: sparse.INDUCING])
    heavy = ones.clone()
    heavy[7] = 3
    torch.testing.assert_close(sparse._spread(x, heavy, theta)[0], x[7])


@WEIGHTED
def test_sums_over_blocks_change_nothing(weighted, monkeypatch):
    """The loss, its derivative, predictions and left-out errors are those of all points at once."""
    monkeypatch.setattr(sparse, "INDUCING", 12)
    x, y, w = problem(weighted=weighted)
    found = []
    for block in (100, 13):
        monkeypatch.setattr(sparse, "_BLOCK", block)
        gps = SparseGPs(x, y, w)
        theta, weight = set_hyperparameters(gps), torch.ones_like(y) if w is None else w
        process = theta[0].log(), gps.covar_module.inducing_points[0], x, y[0], weight[0]
        found.append((*sparse._loss_and_gradient(*process), *gps.predict(x + 0.1), *gps.leave_one_out()))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


@WEIGHTED
def test_the_derivative_is_that_of_the_loss(weighted):
    x, y, w = problem(weighted=weighted)
    weight = torch.ones_like(y) if w is None else w
    phi, data = torch.tensor([0.1, 0.2, -0.3, 0.4, -2.0]).double(), (x[:12], x, y[0], weight[0])
    _, gradient = sparse._loss_and_gradient(phi, *data)
    for place, step in enumerate(1e-5 * torch.eye(5).double()):
        up, down = (sparse._loss_and_gradient(phi + sign * step, *data)[0] for sign in (1, -1))
        torch.testing.assert_close(gradient[place], (up - down) / 2e-5, rtol=1e-5, atol=1e-7)


def test_a_search_that_begins_on_a_sample_ends_at_the_maximum_of_all(monkeypatch):
    monkeypatch.setattr(sparse, "INDUCING", 12)
    monkeypatch.setattr(sparse, "_FEW", 30)
    monkeypatch.setattr(sparse, "_SAMPLE", 60)
    x, y, w = problem(n=150, weighted=True)
    gps = SparseGPs(x, y, w)
    fit = gps.fit()
    z = gps.covar_module.inducing_points
    for p, *process in zip(gps.hyperparameters().log(), z, *gps.train_inputs, y, w, strict=True):
        _, gradient = sparse._loss_and_gradient(p, *process)
        assert gradient.abs().max() < 0.02
    assert fit.converged.all()
