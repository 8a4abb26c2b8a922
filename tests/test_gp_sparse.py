"""Sparse processes: the bound and what follows from it, against the exact processes and GPyTorch's posterior."""

import gpytorch
import pytest
import torch
from packaging.version import Version

from contactlearn.models.gp import sparse
from contactlearn.models.gp.evidence import LogEvidence
from contactlearn.models.gp.exact import ExactGPs
from contactlearn.models.gp.sparse import SparseGPs
from contactlearn.models.gp.training import losses
from contactlearn.models.process_options import ProcessOptions

JITTER = {"rtol": 1e-6, "atol": 1e-7}  # 1e-10 of s² on the diagonal of K_zz, over σ² of 0.01 and more
OPTIMA = {"rtol": 1e-5, "atol": 1e-6}  # where a batch of searches and each alone may part: in the last digits
LIKELIHOOD = ProcessOptions(prior=False)
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
    shape = (*gps.train_targets.shape[:-1], gps.train_inputs[0].shape[-1] + 2)
    theta = (0.3 * torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)).exp()
    theta[..., -1] *= 0.05
    gps.kernel.base_kernel.lengthscale, gps.kernel.outputscale = theta[..., None, :-2], theta[..., -2]
    gps.likelihood.noise = theta[..., -1:]
    return gps.eval().hyperparameters()


def bound(gps: SparseGPs) -> torch.Tensor:
    """The bound per point [*batch, O]."""
    with torch.no_grad():
        found = -losses(gps.train())
    gps.eval()
    return found


@WEIGHTED
def test_with_all_points_inducing_the_bound_is_the_evidence(weighted, monkeypatch):
    x, y, w = problem(weighted=weighted)
    gps = SparseGPs(x, y, w, LIKELIHOOD)
    theta = set_hyperparameters(gps)
    exact = LogEvidence(*gps.train_inputs, y, w)(theta.log(), torch.arange(2))[0]
    torch.testing.assert_close(-bound(gps), exact, **JITTER)
    bounds = []
    for M in (5, 15, 30, 60):
        monkeypatch.setattr(sparse, "INDUCING", M)
        gps = SparseGPs(x, y, w)
        set_hyperparameters(gps)
        bounds.append(bound(gps))
    assert (torch.stack(bounds).diff(dim=0) > 1e-3).all()


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
    """A weighted problem of 400 trials, its model and how the training ended."""
    data = problem(n=400, weighted=True)
    gps = SparseGPs(*data)
    return data, gps, gps.fit()


def test_training_ends_at_the_maximum(fitted):
    data, gps, fit = fitted
    assert fit.converged.all()
    assert fit.loss.shape == fit.evaluations.shape == (2,)
    torch.testing.assert_close(fit.loss, -bound(gps))
    torch.testing.assert_close(fit.history[-1], fit.loss)
    gradients = torch.autograd.grad(losses(gps.train()).sum(), gps.free_parameters())
    gps.eval()
    assert all(gradient.abs().max() < 0.02 for gradient in gradients)
    assert (gps.likelihood.noise[:, 0].sqrt() / 0.2 - 1).abs().max() < 0.1
    exact = ExactGPs(*data)
    exact.fit()
    new, truth, _ = problem(n=300, noise=0, seed=3)
    ours, theirs = ((model.predict(new)[0] - truth).square().mean(-1).sqrt() for model in (gps, exact))
    assert (ours < 1.05 * theirs).all()
    assert (theirs < 0.15).all()
    again = SparseGPs(*data).fit(gps)
    torch.testing.assert_close(again.loss, fit.loss, rtol=0, atol=1e-3)  # other inducing points
    assert (again.evaluations <= fit.evaluations).all()
    other, new = SparseGPs(*data), problem(n=20, seed=3)[0]
    other.load_state_dict(gps.state_dict())
    for call in (lambda model: model.predict(new), lambda model: model.leave_one_out()):
        for found, expected in zip(call(other), call(gps), strict=True):
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-10)  # roundings, times a condition of 1e6


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
    x, y, _ = problem(n=400)
    weight = torch.ones_like(y)
    weight[1, 7] = 3
    gps = SparseGPs(x, y, weight)
    set_hyperparameters(gps)
    with torch.no_grad():
        chosen = sparse._spread(gps)
        left = []
        for z in (chosen, x[: sparse.INDUCING].expand(2, -1, -1)):
            gps.covar_module.inducing_points.data = z
            left.append((gps.kernel(x, diag=True) - gps._projection()(x).square().sum(-2)).sum(-1))
    assert all(len(z.unique(dim=0)) == sparse.INDUCING for z in chosen)
    assert (left[0] < 0.5 * left[1]).all()
    torch.testing.assert_close(chosen[1, 0], x[7])


@WEIGHTED
def test_sums_over_blocks_change_nothing(weighted, monkeypatch):
    """Predictions and left-out errors are those of all points at once."""
    monkeypatch.setattr(sparse, "INDUCING", 12)
    x, y, w = problem(weighted=weighted)
    found = []
    for block in (100, 13):
        monkeypatch.setattr(sparse, "_BLOCK", block)
        gps = SparseGPs(x, y, w)
        set_hyperparameters(gps)
        found.append((*gps.predict(x + 0.1), *gps.leave_one_out()))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


def test_a_sample_has_the_hyperparameters_of_all(monkeypatch):
    """The posterior is that of all points."""
    monkeypatch.setattr(sparse, "INDUCING", 50)
    x, y, _ = problem(n=400)
    new, truth, _ = problem(n=300, noise=0, seed=3)
    whole = SparseGPs(x, y)
    whole.fit()
    monkeypatch.setattr(sparse, "_SAMPLE", 250)
    some = SparseGPs(x, y)
    assert some.fit().converged.all()
    ratio = (some.hyperparameters() / whole.hyperparameters()).log()[..., -2:]
    assert ratio.abs().max() < 0.7
    errors = [(gps.predict(new)[0] - truth).square().mean(-1).sqrt() for gps in (some, whole)]
    assert (errors[0] < 1.2 * errors[1]).all()
