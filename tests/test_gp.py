"""Gaussian processes against dense formulas, autograd, GPyTorch and SciPy.

The evidence is checked against `torch.distributions` with covariances built entry by entry, the
minimiser against problems with known answers, the fitted processes against GPyTorch's own likelihood
and posterior, and their optima against L-BFGS-B from several starts.
"""

import math

import gpytorch
import numpy as np
import pytest
import scipy.optimize
import torch
from gpytorch.mlls import ExactMarginalLogLikelihood
from hypothesis import given, settings, strategies as st
from threadpoolctl import threadpool_limits
from torch import Tensor
from torch.autograd.functional import jacobian
from torch.distributions import MultivariateNormal

from contactlearn.models.gp import evidence as evidence_module
from contactlearn.models.gp.bfgs import minimise
from contactlearn.models.gp.evidence import LogEvidence
from contactlearn.models.gp.exact import ExactGPs
from contactlearn.models.gp.processes import LENGTH, NOISE, SCALE
from contactlearn.models.process_options import ProcessOptions

TOLERANCE = 1e-9
"""Relative and absolute: what two exact routes leave of double precision at the condition numbers here, up to 1e5."""

close = torch.testing.assert_close
CLOSE = {"rtol": TOLERANCE, "atol": TOLERANCE}


def random_data(B: int, n: int, D: int, weighted: bool = False, seed: int = 0):
    """x [B, n, D], y [B, n] and weights [B, n] or None: a smooth function of some of the inputs, and noise."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    x = draw(B, n, D)
    slopes = draw(B, 1, D) * (draw(B, 1, D) > -0.5)
    y = (x * slopes).sum(-1).sin() + 0.3 * draw(B, n)
    return x, y, (0.5 * draw(B, n)).exp() if weighted else None


def random_phi(B: int, D: int, seed: int = 0) -> Tensor:
    """Logarithms of length scales in [0.3, 5], output scales in [0.3, 3] and noise variances in [1e-3, 1]."""
    low, high = torch.tensor([[0.3, 5.0]] * D + [[0.3, 3.0], [1e-3, 1.0]], dtype=torch.float64).log().T
    share = torch.rand(B, D + 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return low + share * (high - low)


def covariance(phi: Tensor, x: Tensor, weight: Tensor | None) -> Tensor:
    """K + noise [n, n] of one process, by the definition."""
    theta = phi.exp()
    distance = ((x[:, None] - x[None]) / theta[:-2]).square().sum(-1)
    noise = theta[-1] * torch.ones_like(x[:, 0])
    return theta[-2] * (-0.5 * distance).exp() + torch.diag(noise if weight is None else noise / weight**2)


def reference(phi: Tensor, x: Tensor, y: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
    """−log p, its gradient and ½ αᵀ ∂_kK K⁻¹ ∂_lK α of one process, all per point, by autograd."""

    def loss(phi):
        return -MultivariateNormal(torch.zeros_like(y), covariance(phi, x, weight)).log_prob(y) / len(y)

    inverse = torch.linalg.inv(covariance(phi, x, weight))
    slopes = jacobian(lambda phi: covariance(phi, x, weight), phi, strategy="forward-mode", vectorize=True)
    slopes = slopes.permute(2, 0, 1) @ (inverse @ y)
    return loss(phi), jacobian(loss, phi), 0.5 * slopes @ inverse @ slopes.T / len(y)


def assert_matches_reference(phi: Tensor, which: Tensor, x: Tensor, y: Tensor, weight: Tensor | None):
    found = LogEvidence(x, y, weight)(phi, which, curvature=True)
    rows = [reference(p, x[i], y[i], None if weight is None else weight[i]) for p, i in zip(phi, which, strict=True)]
    for part, wanted in zip(found, zip(*rows, strict=True), strict=True):
        close(part, torch.stack(wanted), **CLOSE)


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """SciPy's and NumPy's threads spin against each other, and against the suite's other processes."""
    with threadpool_limits(1):
        yield


@pytest.mark.parametrize("weighted", [False, True], ids=["plain", "weighted"])
@pytest.mark.parametrize(("B", "n", "D"), [(4, 1, 2), (4, 2, 1), (3, 3, 5), (5, 30, 3), (2, 130, 10), (2, 400, 2)])
def test_evidence_agrees_with_autograd(B, n, D, weighted):
    data = random_data(B, n, D, weighted)
    assert_matches_reference(random_phi(B, D), torch.arange(B), *data)


@given(
    B=st.integers(1, 4), n=st.integers(1, 12), D=st.integers(1, 4), weighted=st.booleans(), seed=st.integers(0, 2**31),
)  # fmt: skip
@settings(max_examples=30, deadline=None)
def test_evidence_agrees_with_autograd_on_any_shape(B, n, D, weighted, seed):
    assert_matches_reference(random_phi(B, D, seed), torch.arange(B), *random_data(B, n, D, weighted, seed))


@pytest.mark.parametrize("weighted", [False, True], ids=["plain", "weighted"])
def test_evidence_of_several_chunks_and_of_repeated_processes(weighted):
    x, y, weight = random_data(8, 100, 2, weighted)
    which = torch.tensor([7, 0, 0, 3, 7] * 6)
    assert len(which) * y.shape[1] ** 2 > 2 * evidence_module.CHUNK
    assert_matches_reference(random_phi(len(which), 2), which, x, y, weight)


def test_evidence_does_not_depend_on_earlier_calls():
    x, y, _ = random_data(6, 20, 2)
    phi, evidence, every = random_phi(6, 2), LogEvidence(x, y), torch.arange(6)
    first = evidence(phi, every, True)
    evidence(phi[:2] + 1, every[:2])
    for one, two in zip(first, evidence(phi, every, True), strict=True):
        assert torch.equal(one, two)
    plain = evidence(phi, every)
    assert plain[2] is None
    assert torch.equal(plain[0], first[0])
    assert torch.equal(plain[1], first[1])
    # Where every entry off the diagonal vanishes, and where every one is the same.
    x, y, _ = random_data(2, 20, 3)
    phi = torch.tensor([[LENGTH[0]] * 3 + [SCALE[1], NOISE[1]], [LENGTH[1]] * 3 + [1.0, 1e-2]]).double().log()
    assert_matches_reference(phi, torch.arange(2), x, y, None)


@pytest.fixture(params=[True, False], ids=["LAPACK", "torch"])
def lapack(request, monkeypatch):
    """Whether SciPy's LAPACK is used, as on a CPU in double precision, or torch alone, as elsewhere."""
    if not request.param:
        monkeypatch.setattr(evidence_module, "_on_lapack", lambda matrix: False)
    return request.param


@pytest.mark.parametrize("weighted", [False, True], ids=["plain", "weighted"])
def test_torch_and_lapack_agree(weighted, monkeypatch):
    x, y, weight = random_data(30, 80, 3, weighted)
    phi, evidence, every = random_phi(30, 3), LogEvidence(x, y, weight), torch.arange(30)
    lapack = evidence(phi, every, True)
    monkeypatch.setattr(evidence_module, "_on_lapack", lambda matrix: False)
    for one, two in zip(lapack, evidence(phi, every, True), strict=True):
        close(one, two, **CLOSE)


def test_single_precision_does_not_go_through_double_precision_routines():
    x, y, weight = random_data(4, 20, 2, weighted=True)
    phi, every = random_phi(4, 2), torch.arange(4)
    single = LogEvidence(x.float(), y.float(), weight.float())(phi.float(), every, True)
    for one, two in zip(single, LogEvidence(x, y, weight)(phi, every, True), strict=True):
        assert one.dtype == torch.float32
        close(one, two.float(), rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("n", [5, 60])  # of two equal points rounding may leave a matrix positive
def test_evidence_is_nan_where_the_matrix_is_not_positive_definite(lapack, n):
    """Equal points without noise; the neighbours in the batch are not touched."""
    x, y, _ = random_data(3, n, 2)
    x[1] = 1.0
    phi = random_phi(3, 2)
    phi[1] = torch.tensor([0.0, 0.0, 1.0, -60.0])
    found = LogEvidence(x, y)(phi, torch.arange(3), True)
    for part in found:
        assert part[1].isnan().all()
    good = torch.tensor([0, 2])
    for part, wanted in zip(found, LogEvidence(x, y)(phi[good], good, True), strict=True):
        close(part[good], wanted, **CLOSE)


def unbounded(P: int) -> tuple[Tensor, Tensor]:
    return torch.full((P,), -torch.inf, dtype=torch.float64), torch.full((P,), torch.inf, dtype=torch.float64)


def random_quadratics(B: int, P: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """A [B, P, P] and b [B, P] of ½ |A x − b|²."""
    generator = torch.Generator().manual_seed(seed)
    A = torch.randn(B, P, P, generator=generator, dtype=torch.float64) + torch.eye(P)
    return A, torch.randn(B, P, generator=generator, dtype=torch.float64)


def quadratic(A: Tensor, b: Tensor, curved: bool):
    """Its objective; with its curvature or, if not `curved`, with none to speak of."""

    def objective(x, which, curvature):
        rest = (A[which] @ x[..., None])[..., 0] - b[which]
        gradient = (A[which].mT @ rest[..., None])[..., 0]
        hessian = A[which].mT @ A[which] if curved else torch.eye(x.shape[1]).double().expand(len(x), -1, -1)
        return 0.5 * rest.square().sum(-1), gradient, hessian if curvature else None

    return objective


def rosenbrock(x: Tensor, which: Tensor, curvature: bool):
    """(a − x₀)² + 100 (x₁ − x₀²)² with a = 1 + which / 10, and its Gauss-Newton curvature."""
    a = 1 + which / 10
    residual = torch.stack((a - x[:, 0], 10 * (x[:, 1] - x[:, 0] ** 2)), -1)
    zero, one = torch.zeros_like(x[:, 0]), torch.ones_like(x[:, 0])
    J = torch.stack((-one, zero, -20 * x[:, 0], 10 * one), -1).view(-1, 2, 2)
    return residual.square().sum(-1), 2 * (J.mT @ residual[..., None])[..., 0], 2 * J.mT @ J if curvature else None


@pytest.mark.parametrize("curved", [True, False], ids=["curved", "flat"])
@pytest.mark.parametrize("P", [1, 2, 7])
def test_quadratics_reach_their_minimum(P, curved):
    A, b = random_quadratics(40, P)
    found = minimise(quadratic(A, b, curved), torch.zeros_like(b), *unbounded(P), tolerance=1e-10, evaluations=1000)
    assert found.converged.all()
    close(found.value, torch.zeros(40).double(), rtol=0, atol=1e-8)
    if curved:
        # Damped Newton steps, none longer than it may be.
        far = torch.linalg.solve(A, b).abs().amax(-1)
        assert (found.evaluations[far < 1] <= 10).all()


def test_the_limit_of_evaluations():
    start = torch.tensor([-1.2, 1.0]).double().expand(12, 2)
    found = minimise(rosenbrock, start, *unbounded(2), tolerance=1e-14)
    a = 1 + torch.arange(12) / 10
    assert found.converged.all()
    close(found.x, torch.stack((a, a**2), -1).double(), rtol=1e-5, atol=1e-5)
    start = torch.tensor([[-1.2, 1.0], [1.0, 1.0]]).double()
    found = minimise(rosenbrock, start, *unbounded(2), tolerance=1e-14, evaluations=7)
    assert not found.converged[0]
    assert found.evaluations[0] == 7
    assert found.value[0] < rosenbrock(start, torch.arange(2), False)[0][0]
    assert (minimise(rosenbrock, start, *unbounded(2), tolerance=1e-14, evaluations=1).evaluations == 1).all()


@pytest.mark.parametrize("curved", [True, False], ids=["curved", "flat"])
@pytest.mark.parametrize("P", [1, 3, 7])
def test_active_bounds(P, curved):
    A, b = random_quadratics(60, P)
    low, high = torch.full((P,), -0.3).double(), torch.full((P,), 0.4).double()
    start = torch.where(torch.rand(60, P, generator=torch.Generator().manual_seed(1)) < 0.5, low, high)
    found = minimise(quadratic(A, b, curved), start, low, high, tolerance=1e-12, evaluations=500)
    exact = [scipy.optimize.lsq_linear(a, r, (-0.3, 0.4), tol=1e-14) for a, r in zip(A.numpy(), b.numpy(), strict=True)]
    assert ((found.x >= low) & (found.x <= high)).all()
    active = (found.x == low) | (found.x == high)
    assert active.any() and not active.all()  # noqa: PT018
    close(found.value, torch.tensor([one.cost for one in exact]).double(), rtol=1e-7, atol=1e-7)
    assert found.converged.all()


def test_a_region_without_values_is_not_entered():
    """A barrier that is nan outside the unit disc, with a minimum near its edge."""
    pull = torch.tensor([[0.0, 3.0], [30.0, 0.0], [-200.0, 100.0]]).double()

    def objective(x, which, curvature):
        room = 1 - x.square().sum(-1)
        value = -room.log() - (pull[which] * x).sum(-1)  # nan where room < 0
        hessian = (2 / room)[:, None, None] * torch.eye(2) + 4 / room[:, None, None] ** 2 * x[..., None] * x[:, None]
        return value, 2 * x / room[:, None] - pull[which], hessian if curvature else None

    found = minimise(objective, torch.zeros(3, 2).double(), *unbounded(2), tolerance=1e-13)
    size = pull.norm(dim=-1)
    radius = ((1 + size**2).sqrt() - 1) / size  # 2 r / (1 − r²) = |pull|
    assert found.converged.all()
    close(found.x, pull / size[:, None] * radius[:, None], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_a_problem_that_starts_without_a_value_ends_there(broken):
    A, b = random_quadratics(3, 2)
    smooth = quadratic(A, b, True)

    def objective(x, which, curvature):
        value, gradient, hessian = smooth(x, which, curvature)
        bad = which == 1
        gradient = torch.where(bad[:, None], torch.nan, gradient)
        hessian = None if hessian is None else torch.where(bad[:, None, None], torch.nan, hessian)
        return torch.where(bad, broken, value), gradient, hessian

    found = minimise(objective, torch.ones(3, 2).double(), *unbounded(2), tolerance=1e-12)
    assert found.converged.tolist() == [True, False, True]
    assert found.evaluations[1] == 1
    assert not found.value[1].isfinite()
    close(found.value[[0, 2]], torch.zeros(2).double(), rtol=0, atol=1e-10)


def test_batched_problems_equal_looped():
    start = torch.tensor([[-1.2, 1.0], [0.3, 0.1], [3.0, -2.0], [1.0, 1.0]]).double()
    low, high = torch.tensor([-2.0, -3.0]).double(), torch.tensor([1.05, 3.0]).double()
    counted = torch.zeros(4, dtype=torch.long)

    def objective(x, which, curvature):
        counted[which] += 1
        return rosenbrock(x, which, curvature)

    batch = minimise(objective, start, low, high, tolerance=1e-10)
    assert torch.equal(batch.evaluations, counted)  # a finished problem costs nothing
    assert torch.equal(batch.value, rosenbrock(batch.x, torch.arange(4), False)[0])
    for i in range(4):
        alone = minimise(
            lambda x, which, curvature, i=i: rosenbrock(x, which + i, curvature), start[i : i + 1], low, high,
            tolerance=1e-10,
        )  # fmt: skip
        for one, every in zip(alone[:4], (part[i : i + 1] for part in batch[:4]), strict=True):
            close(one, every, **CLOSE)


def processes(x: Tensor, y: Tensor, weight: Tensor | None = None) -> ExactGPs:
    """Processes with random hyperparameters, for what does not depend on how they were found."""
    gps = ExactGPs(x, y, weight)
    phi = random_phi(y.shape[:-1].numel(), x.shape[-1])
    set_hyperparameters(gps, phi.view(*y.shape[:-1], -1))
    return gps


def set_hyperparameters(gps: ExactGPs, phi: Tensor) -> None:
    gps.covar_module.base_kernel.lengthscale = phi[..., None, :-2].exp()
    gps.covar_module.outputscale = phi[..., -2].exp()
    gps.likelihood.noise = phi[..., -1:].exp()
    gps.eval()


def subsets(*batch: int, n: int = 25, D: int = 3, O: int = 2, weighted: bool = False, seed: int = 0):  # noqa: E741
    """x [*batch, n, D], y [*batch, O, n], weights like y or None, and x of 6 more points [*batch, 6, D]."""
    count = math.prod(batch)
    x, y, weight = random_data(count * O, n + 6, D, weighted, seed)
    x, y = x[::O], y[..., :n]
    x, y = x.reshape(*batch, n + 6, D), y.reshape(*batch, O, n)
    return x[..., :n, :], y, None if weight is None else weight[..., :n].reshape(*batch, O, n), x[..., n:, :]


BATCHES = pytest.mark.parametrize("batch", [(), (3,), (2, 2)], ids=str)
PRIORS = pytest.mark.parametrize("prior", [True, False], ids=["prior", "no prior"])
WEIGHTS = pytest.mark.parametrize("weighted", [False, True], ids=["plain", "weighted"])


def gpytorch_likelihood(gps: ExactGPs):
    """GPyTorch's likelihood a point [..., O] of the training data."""
    gps.train()
    with torch.no_grad(), gpytorch.settings.max_cholesky_size(10**4):
        value = ExactMarginalLogLikelihood(gps.likelihood, gps)(gps(*gps.train_inputs), gps.train_targets)
    gps.eval()
    return value


@WEIGHTS
@BATCHES
@PRIORS
def test_the_fitted_objective_is_gpytorchs(batch, weighted, prior):
    x, y, weight, _ = subsets(*batch, weighted=weighted)
    gps = ExactGPs(x, y, weight, ProcessOptions(prior=prior))
    assert gps.has_closed_form
    fit = gps.fit()
    assert fit.converged.all()
    assert fit.loss.shape == fit.evaluations.shape == (*batch, 2)
    close(fit.loss, -gpytorch_likelihood(gps), **CLOSE)


@WEIGHTS
@BATCHES
def test_predictions_are_gpytorchs_posterior(batch, weighted):
    x, y, weight, new = subsets(*batch, weighted=weighted)
    gps = processes(x, y, weight)
    with torch.no_grad(), gpytorch.settings.max_cholesky_size(10**4):
        posterior = gps(new.unsqueeze(-3).expand(*batch, 2, 6, 3))
    mean, variance = gps.predict(new)
    assert mean.shape == variance.shape == (*batch, 2, 6)
    close(mean, posterior.mean, **CLOSE)
    close(variance, posterior.variance, **CLOSE)


@WEIGHTS
def test_leaving_one_out_is_leaving_one_out(weighted):
    x, y, weight, _ = subsets(2, n=12, weighted=weighted)
    gps = processes(x, y, weight)
    error, variance = gps.leave_one_out()
    for i in range(12):
        rest = torch.arange(12) != i
        fewer = ExactGPs(x[:, rest], y[..., rest], None if weight is None else weight[..., rest])
        set_hyperparameters(fewer, random_phi(4, 3).view(2, 2, -1))
        mean, spread = fewer.predict(x[:, i : i + 1])
        close(error[..., i], y[..., i] - mean[..., 0], **CLOSE)
        close(variance[..., i], spread[..., 0], **CLOSE)


@WEIGHTS
def test_a_state_dict_holds_all_that_was_learnt(weighted):
    x, y, weight, new = subsets(3, weighted=weighted)
    gps = ExactGPs(x, y, weight)
    gps.fit()
    again = ExactGPs(x, y, None if weight is None else torch.ones_like(weight))
    again.load_state_dict(gps.state_dict())
    for one, two in zip(gps.predict(new), again.predict(new), strict=True):
        close(one, two, rtol=1e-12, atol=1e-12)


@WEIGHTS
@BATCHES
def test_batched_processes_equal_looped(batch, weighted):
    x, y, weight, new = subsets(*batch, weighted=weighted)
    gps = ExactGPs(x, y, weight)
    fit, (mean, variance) = gps.fit(), gps.predict(new)
    for index in np.ndindex(batch):
        for o in range(2):
            one = ExactGPs(x[index], y[index][o : o + 1], None if weight is None else weight[index][o : o + 1])
            close(one.fit().loss[0], fit.loss[(*index, o)], **CLOSE)
            # Equal to rounding in the loss leaves its root in the hyperparameters.
            for alone, every in zip(one.predict(new[index]), (mean, variance), strict=True):
                close(alone[0], every[(*index, o)], rtol=1e-5, atol=1e-5)


def lbfgsb(x: Tensor, y: Tensor) -> list[float]:
    """−log p a point that SciPy's L-BFGS-B attains from each of eight starts, within the same bounds."""
    evidence, which, D = LogEvidence(x[None], y[None]), torch.zeros(1, dtype=torch.long), x.shape[1]
    bounds = np.log([LENGTH] * D + [SCALE, NOISE])

    def objective(phi):
        value, gradient, _ = evidence(torch.from_numpy(phi)[None], which)
        return value.item(), gradient[0].numpy()

    starts = [[length] * D + [0.0, noise] for length in (-0.5, 0.5, 1.5, 2.5) for noise in (-1.0, -4.0)]
    return [scipy.optimize.minimize(objective, s, jac=True, method="L-BFGS-B", bounds=bounds).fun for s in starts]


def test_the_optimum_is_better_than_from_single_starts():
    """On few points with several optima: nearer to the best of eight starts, and more often, than most of them."""
    x, y, _, _ = subsets(8, n=40)
    y = (y - y.mean(-1, keepdim=True)) / y.std(-1, keepdim=True)
    loss = ExactGPs(x, y, options=ProcessOptions(prior=False)).fit().loss.flatten()
    others = torch.tensor([lbfgsb(x[s], y[s, o]) for s in range(8) for o in range(2)], dtype=torch.float64)
    others = others.nan_to_num(torch.inf)
    near = (others - others.amin(1, keepdim=True) < 1e-3).double().mean(0)
    gaps = (others - others.amin(1, keepdim=True)).mean(0)
    gap = loss - others.amin(1)
    assert (gap < 1e-3).double().mean() > near.median()
    assert gap.mean() < gaps.median()


def assert_in_bounds(gps: ExactGPs) -> None:
    lengths, scale = gps.covar_module.base_kernel.lengthscale, gps.covar_module.outputscale
    for value, (low, high) in zip((lengths, scale, gps.likelihood.noise), (LENGTH, SCALE, NOISE), strict=True):
        assert (value >= low * (1 - 1e-9)).all()
        assert (value <= high * (1 + 1e-9)).all()


def degenerate(case: str, n: int) -> tuple[Tensor, Tensor]:
    x, y, _, _ = subsets(3, n=n)
    x, y = x.clone(), y.clone()
    if case == "constant outputs":
        y = torch.zeros_like(y)
    elif case == "a large constant":
        y = torch.full_like(y, 5.0)
    elif case == "duplicate inputs":
        x[:, 1] = x[:, 0]
    elif case == "equal inputs":
        x = x[:, :1].expand_as(x)
    elif case == "duplicate points":
        x[:, 1], y[..., 1] = x[:, 0], y[..., 0]
    elif case == "a constant column":
        x[..., 1] = 0.0
    elif case == "no noise":
        y = x.sum(-1)[:, None].expand_as(y).contiguous()
    return x, y


CASES = (
    "plain", "constant outputs", "a large constant", "duplicate inputs", "equal inputs", "duplicate points",
    "a constant column", "no noise",
)  # fmt: skip


@PRIORS
@pytest.mark.parametrize("n", [2, 3, 5, 30])
@pytest.mark.parametrize("case", CASES)
def test_degenerate_data(case, n, prior):
    x, y = degenerate(case, n)
    gps = ExactGPs(x, y, options=ProcessOptions(prior=prior))
    fit = gps.fit()
    assert fit.loss.isfinite().all()
    assert_in_bounds(gps)
    mean, variance = gps.predict(x + 0.1)
    assert mean.isfinite().all()
    assert ((variance >= 0) & (variance <= gps.covar_module.outputscale[..., None] * (1 + 1e-9))).all()
    error, variance = gps.leave_one_out()
    assert error.isfinite().all()
    assert (variance >= 0).all()


@given(seed=st.integers(0, 2**31), n=st.integers(2, 15), weighted=st.booleans())
@settings(max_examples=15, deadline=None)
def test_the_order_of_points_and_units_of_weights_do_not_matter(seed, n, weighted):
    """A weight twice as large is a noise variance four times as large."""
    x, y, weight, new = subsets(2, n=n, weighted=weighted, seed=seed)
    gps, phi = processes(x, y, weight), random_phi(4, 3).view(2, 2, -1)
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    other = ExactGPs(x[:, order], y[..., order], 2 * (torch.ones_like(y) if weight is None else weight)[..., order])
    set_hyperparameters(other, phi + torch.tensor([0.0, 0, 0, 0, math.log(4)]))
    # Another order rounds otherwise, and twice: when the matrix is made and when it is factorised.
    for one, two in zip(gps.predict(new), other.predict(new), strict=True):
        close(one, two, rtol=1e-7, atol=1e-7)
    for one, two in zip(gps.leave_one_out(), other.leave_one_out(), strict=True):
        close(one[..., order], two, rtol=1e-7, atol=1e-7)


def test_the_noise_on_new_points_is_not_weighted():
    x, y, weight = random_data(2, 12, 3, weighted=True)
    gps = ExactGPs(x, y[:, None], weight[:, None]).eval()
    new = x[:, None, :5]
    latent = gps(new)
    measured = gps.likelihood(latent)
    assert torch.allclose(measured.variance - latent.variance, gps.likelihood.noise.expand(2, 1, 5))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_function_that_varies_fast_along_one_of_many_inputs_is_found_in_folds(seed):
    """Starts of equal lengths end at noise: among nine inputs no neighbours are near enough."""
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(200, 9, generator=generator, dtype=torch.float64)
    noise = 0.1 * torch.randn(200, generator=generator, dtype=torch.float64)
    y = (7 * x[:, 0]).sin().sign() * (1 + 0.3 * x[:, 1]) + noise
    gps = ExactGPs(x[None, :160], y[None, None, :160])
    gps.fit_folds()
    left = y[160:] - gps.mean()(x[None, 160:])[0, 0]
    assert left.square().mean() < 0.5 * y[160:].square().mean()
