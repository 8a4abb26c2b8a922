"""Processes with GPyTorch's modules: equal to GPyTorch by hand, chosen by name, saved and refused as they should be."""

import gpytorch
import pytest
import torch
from gpytorch.kernels import AdditiveKernel, LinearKernel, MaternKernel, RBFKernel, ScaleKernel
from gpytorch.likelihoods import FixedNoiseGaussianLikelihood, GaussianLikelihood
from gpytorch.mlls import ExactMarginalLogLikelihood

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws.mirtich import Mirtich
from contactlearn.models import checkpoint, regressor
from contactlearn.models.gp import modules
from contactlearn.models.gp.exact import ExactGPs, checked_options
from contactlearn.models.gp.sparse import SparseGPs
from contactlearn.models.gp.training import losses, optimise
from contactlearn.models.process_options import ProcessOptions
from contactlearn.simulation import synthetic

close = torch.testing.assert_close
IMPACTS = synthetic.load(size=60)
ROWS = torch.arange(20)
COLUMNS = ["a", "b", "c"]
MATERN = {"_target_": "gpytorch.kernels.MaternKernel", "nu": 1.5}
SUM = {
    "_target_": "gpytorch.kernels.AdditiveKernel",
    "_args_": [
        {"_target_": "gpytorch.kernels.PeriodicKernel", "active_dims": ["c"]},
        {"_target_": "gpytorch.kernels.RBFKernel", "active_dims": [0, 1], "lengthscale_prior": {
            "_target_": "gpytorch.priors.GammaPrior", "concentration": 3.0, "rate": 6.0}},
    ],
}  # fmt: skip
ADAM = {"_target_": "torch.optim.Adam", "lr": 0.1, "starts": 1, "iterations": 5}


def options(**parts) -> ProcessOptions:
    return checked_options(ProcessOptions(**parts), COLUMNS)


def problem(n: int = 12, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """x [2, n, 3] and y [2, 2, n]: two subsets of a function with a kink, and noise."""
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(2, n, 3, generator=generator, dtype=torch.float64)
    slopes = torch.tensor([[1.5, 0.5, 0.0], [-1.0, 0.3, 2.0]], dtype=torch.float64)
    noise = 0.05 * torch.randn(2, 2, n, generator=generator, dtype=torch.float64)
    return x, (slopes @ x.mT).abs() - 1 + noise


class ByHand(gpytorch.models.ExactGP):
    """What a user of GPyTorch writes."""

    def __init__(self, x, y, likelihood, mean, kernel):
        super().__init__(x, y, likelihood)
        self.mean_module, self.covar_module = mean, kernel

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


@pytest.mark.parametrize("which", ["matern", "sum"])
def test_objective_and_gradient_are_those_of_gpytorch_by_hand(which):
    x, y = problem()
    batch, inputs = y.shape[:-1], x[:, None].expand(2, 2, -1, -1)
    if which == "matern":
        kernel = MaternKernel(nu=1.5, ard_num_dims=3, batch_shape=batch)
        ours = options(kernel=MATERN, prior=False)
        mean = gpytorch.means.ZeroMean()
    else:
        kernel = AdditiveKernel(
            RBFKernel(active_dims=[0, 1], ard_num_dims=2, batch_shape=batch),
            LinearKernel(ard_num_dims=3, batch_shape=batch),
        )
        mean = gpytorch.means.LinearMean(3, batch_shape=batch)
        parts = [{"_target_": "gpytorch.kernels.RBFKernel", "active_dims": ["a", "b"]}]
        parts.append({"_target_": "gpytorch.kernels.LinearKernel"})
        ours = options(
            kernel={"_target_": AdditiveKernel, "_args_": parts},
            mean={"_target_": "gpytorch.means.LinearMean"},
            prior=False,
        )
    likelihood = GaussianLikelihood(batch_shape=batch, noise_constraint=gpytorch.constraints.Positive())
    theirs = ByHand(inputs, y, likelihood, mean, ScaleKernel(kernel, batch_shape=batch)).double().train()
    gps = ExactGPs(x, y, options=ours).train()
    generator = torch.Generator().manual_seed(1)
    for a, b in zip(gps.parameters(), theirs.parameters(), strict=True):
        a.data.copy_(torch.randn(a.shape, generator=generator, dtype=torch.float64))
        b.data.copy_(a.data)
    value, expected = losses(gps), -ExactMarginalLogLikelihood(likelihood, theirs)(theirs(inputs), y)
    close(value, expected)
    pairs = (value, gps), (expected, theirs)
    gradients = (torch.autograd.grad(loss.sum(), list(model.parameters())) for loss, model in pairs)
    for a, b in zip(*gradients, strict=True):
        close(a, b)
    for model in (gps, theirs):
        model.eval()
    with torch.no_grad():
        posterior, (mean, variance) = theirs(x[:, None, :4].expand(2, 2, -1, -1) + 0.1), gps.predict(x[:, :4] + 0.1)
    close(mean, posterior.mean, rtol=1e-6, atol=1e-8)
    close(variance, posterior.variance, rtol=1e-6, atol=1e-8)


def test_the_closed_form_and_gpytorch_find_the_same_optimum():
    """By the same search, in nearly the same variables: of a default model, and of one that names its kernel."""
    x, y = problem(n=30)
    ours, named = ExactGPs(x, y), ExactGPs(x, y, options=options(kernel={"_target_": "gpytorch.kernels.RBFKernel"}))
    assert ours.has_closed_form
    assert named.has_closed_form
    close(ours.fit().loss, optimise(named).loss, rtol=0, atol=2e-3)


@pytest.mark.parametrize(
    "parts",
    [
        {"kernel": MATERN},
        {"mean": {"_target_": "gpytorch.means.ConstantMean"}},
        {"kernel": {"_target_": "gpytorch.kernels.RBFKernel", "active_dims": [0, 1, 2]}},
        {"likelihood": {"_target_": "gpytorch.likelihoods.GaussianLikelihood", "noise_constraint": {
            "_target_": "gpytorch.constraints.GreaterThan", "lower_bound": 0.01}}},
        {"optimiser": ADAM},
        {"kernel": SUM},
    ],
    ids=["kernel", "mean", "columns", "constraint", "optimiser", "sum"],
)  # fmt: skip
def test_the_closed_form_is_left_for_what_it_cannot_do(parts):
    """Training settles, and its loss is GPyTorch's on the model that it leaves, priors included."""
    x, y = problem()
    gps = ExactGPs(x, y, options=options(**parts))
    assert not gps.has_closed_form
    rounds = []
    fit = gps.fit(on_round=rounds.append)
    close(losses(gps.train()), fit.loss)
    close(rounds[-1].loss, fit.loss)
    assert (fit.history[0] > fit.loss).all()
    if "constraint" in str(parts):
        assert (gps.likelihood.noise > 0.01).all()


def test_a_matern_kernel_is_better_on_a_rough_function():
    x, y = problem(n=60)
    new, truth = problem(n=200, seed=1)
    densities = []
    for chosen in (options(kernel=MATERN | {"nu": 0.5}), options(kernel=MATERN), ProcessOptions()):
        gps = ExactGPs(x, y, options=chosen)
        gps.fit()
        mean, variance = gps.predict(new)
        spread = (variance + gps.likelihood.noise).sqrt()
        densities.append(torch.distributions.Normal(mean, spread).log_prob(truth).mean())
    assert max(densities[:2]) > densities[2] + 0.05


def test_starts_and_iterations_are_those_of_the_optimiser():
    x, y = problem()
    for kernel in (None, MATERN):
        few = ExactGPs(x, y, options=options(kernel=kernel, optimiser={"starts": 1, "iterations": 3}))
        assert few.fit().evaluations.max() == 3


@pytest.mark.parametrize("limit", [2000, 10], ids=["exact", "sparse"])
def test_a_checkpoint_has_the_modules(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(regressor, "EXACT_LIMIT", limit)
    chosen = ProcessOptions(
        kernel=MATERN | {"active_dims": ["v_t", "v_n"]},
        mean={"_target_": "gpytorch.means.ConstantMean"},
        optimiser={"iterations": 3},
    )
    model = learn(IMPACTS, Recipe("x1", "wrench", processes=chosen), rows=ROWS)
    assert "MaternKernel, ConstantMean" in model.processes.kind
    loaded = checkpoint.load(checkpoint.save(model, tmp_path / "model.pt", provenance={}))
    close(loaded.predict(IMPACTS).v_post, model.predict(IMPACTS).v_post, rtol=1e-9, atol=1e-9)
    gps = loaded.processes.gps.train()
    assert isinstance(gps, SparseGPs if limit == 10 else ExactGPs)
    close(losses(gps), model.processes.training.loss)  # the priors of the file are those of the training
    assert Recipe.of(loaded).processes.kernel == Recipe.of(model).processes.kernel


class Own(RBFKernel):
    """A kernel of the user's own."""


def test_a_checkpoint_executes_no_class_that_is_not_there(tmp_path, monkeypatch):
    own = {"_target_": f"{__name__}.Own"}
    model = learn(
        IMPACTS, Recipe("x2", "impulse", processes=ProcessOptions(kernel=own, optimiser={"iterations": 2})), rows=ROWS
    )
    path = checkpoint.save(model, tmp_path / "model.pt", provenance={})
    assert type(checkpoint.load(path).processes.gps.kernel.base_kernel) is Own
    monkeypatch.setattr(modules, "_subclasses", lambda base: iter(()))  # as if it had not been imported
    with pytest.raises(DataError, match=rf"{__name__}.Own is no module of GPyTorch.*; import {__name__} first"):
        checkpoint.load(path)


BAD = {
    "unknown": ({"kernel": {"_target_": "gpytorch.kernels.MaternKernal"}}, "did you mean 'MaternKernel'"),
    "another part": ({"kernel": {"_target_": "gpytorch.means.ZeroMean"}}, "must be a class of gpytorch.kernels"),
    "no module": ({"mean": {"_target_": "os.system"}}, "os.system is no module of GPyTorch"),
    "hidden": ({"kernel": {"_target_": "gpytorch.kernels.torch"}}, "unknown module of gpytorch.kernels 'torch'"),
    "no class": ({"kernel": {"nu": 1.5}}, "needs a class"),
    "argument": ({"kernel": MATERN | {"nuu": 1.5}}, "unknown argument of MaternKernel 'nuu', did you mean 'nu'"),
    "value": ({"kernel": MATERN | {"nu": 7}}, "kernel: does not fit 3 features: nu expected to be"),
    "feature": ({"kernel": MATERN | {"active_dims": ["d"]}}, "unknown feature 'd'"),
    "column": ({"kernel": MATERN | {"active_dims": [3]}}, "numbers from 0 to 2, of a, b, c; got 3"),
    "length scales": ({"kernel": MATERN | {"ard_num_dims": 2}}, "kernel: does not fit 3 features"),
    "memory": ({"kernel": {"_target_": "gpytorch.kernels.SpectralMixtureKernel", "num_mixtures": 10**9}}, "up to 10"),
    "not Gaussian": ({"likelihood": {"_target_": "gpytorch.likelihoods.StudentTLikelihood"}}, "likelihood: does not"),
    "optimiser": ({"optimiser": {"_target_": "torch.optim.Adm"}}, "did you mean 'torch.optim.Adam'"),
    "its argument": ({"optimiser": ADAM | {"lrr": 1}}, "lrr"),
    "its class": ({"optimiser": {"lr": 0.1}}, "lr needs a class"),
    "starts": ({"optimiser": {"starts": 0}}, "starts must be a whole number, 1 or more, got 0"),
}  # fmt: skip


@pytest.mark.parametrize(("parts", "fragment"), BAD.values(), ids=BAD)
def test_what_does_not_fit_is_refused_in_one_line(parts, fragment):
    with pytest.raises(ContactLearnError) as caught:
        options(**parts)
    assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


K = "gpytorch.kernels."
RBF = {"_target_": f"{K}RBFKernel"}
ARGUMENTS = {
    "AdditiveKernel": {"_args_": [RBF, {"_target_": f"{K}LinearKernel"}]},
    "AdditiveStructureKernel": {"base_kernel": RBF},
    "ArcKernel": {"base_kernel": RBF},
    "ConstantKernel": {},
    "CosineKernel": {"active_dims": ["b"]},
    "LinearKernel": {},
    "MaternKernel": {},
    "PeriodicKernel": {},
    "PiecewisePolynomialKernel": {},
    "PolynomialKernel": {"power": 2},
    "ProductKernel": {"_args_": [RBF, {"_target_": f"{K}LinearKernel"}]},
    "ProductStructureKernel": {"base_kernel": RBF},
    "RBFKernel": {},
    "RFFKernel": {"num_samples": 20},
    "RQKernel": {},
    "ScaleKernel": {"base_kernel": RBF},
    "SpectralDeltaKernel": {"num_deltas": 10},
    "SpectralMixtureKernel": {"num_mixtures": 2},
}
EVERY = [
    name
    for name, kind in vars(gpytorch.kernels).items()
    if isinstance(kind, type) and issubclass(kind, gpytorch.kernels.Kernel)
]
deprecated = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def trained(kernel: dict, **parts) -> ExactGPs:
    """Processes after three rounds, with the derivative of their mean checked against a difference."""
    x, y = problem(n=20)
    gps = ExactGPs(x, y, options=options(kernel=kernel, optimiser={"starts": 1, "iterations": 3}, **parts))
    assert gps.fit().loss.isfinite().all()
    at = (x[:, :1] + 0.1).requires_grad_()
    mean, variance = gps.predict(at)
    assert variance.isfinite().all()
    if not mean.requires_grad:  # the same everywhere
        assert type(gps.kernel.base_kernel) is gpytorch.kernels.ConstantKernel
        return gps
    (slope,) = torch.autograd.grad(mean.sum(), at)
    near, far = ((gps.predict(at.detach() + k)[0] - gps.predict(at.detach() - k)[0]).sum() for k in (1e-5, 2e-5))
    close(slope.sum(), (8 * near - far) / 12e-5, rtol=1e-6, atol=1e-6)
    return gps


@deprecated
@pytest.mark.parametrize("name", EVERY)
def test_every_kernel_of_gpytorch_works_or_says_why_not(name):
    if name in ARGUMENTS:
        trained({"_target_": K + name} | ARGUMENTS[name])
    else:
        with pytest.raises(ContactLearnError, match=f"kernel: {name} {modules.NOT_FOR_FEATURES[name]}"):
            options(kernel={"_target_": K + name})


@deprecated
@pytest.mark.parametrize("around", ["AdditiveKernel", "ProductKernel", "ScaleKernel"])
@pytest.mark.parametrize(
    "name", ["CosineKernel", "PeriodicKernel", "LinearKernel", "RFFKernel", "SpectralMixtureKernel"]
)
def test_kernels_work_in_sums_and_products(name, around):
    inner = {"_target_": K + name} | ARGUMENTS[name]
    parts = (
        {"base_kernel": inner} if around == "ScaleKernel" else {"_args_": [inner, RBF | {"active_dims": ["a", "c"]}]}
    )
    trained({"_target_": K + around} | parts)


@pytest.mark.parametrize(
    "kernel",
    [
        {"_target_": f"{K}CosineKernel"},
        {"_target_": f"{K}AdditiveKernel", "_args_": [{"_target_": f"{K}CosineKernel", "active_dims": [0, 1]}, RBF]},
        {"_target_": f"{K}ProductKernel", "_args_": [{"_target_": f"{K}CosineKernel"}, RBF]},
    ],
    ids=["alone", "sum", "product"],
)
def test_a_cosine_of_distances_among_several_features_is_no_covariance(kernel):
    with pytest.raises(ContactLearnError, match=r"kernel: is no covariance of 3 features: .* an eigenvalue -"):
        options(kernel=kernel)


PRIORS = {
    "GammaPrior": {"concentration": 3.0, "rate": 6.0},
    "HalfCauchyPrior": {"scale": 1.0},
    "HalfNormalPrior": {"scale": 1.0},
    "HorseshoePrior": {"scale": 1.0},
    "LogNormalPrior": {"loc": 0.0, "scale": 1.0},
    "MultivariateNormalPrior": {"loc": [0.0] * 3, "covariance_matrix": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]},
    "NormalPrior": {"loc": 1.0, "scale": 1.0},
    "SmoothedBoxPrior": {"a": 0.1, "b": 10.0},
    "UniformPrior": {"a": 0.0, "b": 2.0},
}


@pytest.mark.parametrize("name", PRIORS)
def test_priors_of_length_scales_are_part_of_the_objective(name):
    prior = {"_target_": f"gpytorch.priors.{name}"} | PRIORS[name]
    gps = trained(RBF | {"lengthscale_prior": prior}, prior=False)
    length = gps.kernel.base_kernel.lengthscale
    density = gps.kernel.base_kernel.lengthscale_prior.log_prob(length).reshape(2, 2, -1).sum(-1)
    plain = ExactGPs(*problem(n=20), options=options(kernel=RBF, prior=False))
    for part in ("raw_lengthscale", "raw_outputscale", "raw_noise"):
        values = (dict(one.named_parameters()) for one in (gps, plain))
        own, others = ({key: v for key, v in each.items() if key.endswith(part)} for each in values)
        for key, value in own.items():
            others[key].data.copy_(value.data)
    close(losses(gps.train()), losses(plain.train()) - density / 20)
    assert name != "UniformPrior" or length.max() < 2


@pytest.mark.parametrize(("rate", "most"), [(0.001, 10), (0.1, 300)], ids=["far", "near"])
def test_an_optimiser_of_pytorch_says_how_far_it_is_from_an_optimum(rate, most):
    adam = {"_target_": "torch.optim.Adam", "lr": rate, "starts": 1, "iterations": most}
    model = learn(IMPACTS, Recipe("x1", "wrench", processes=ProcessOptions(optimiser=adam)), rows=ROWS)
    best = learn(
        IMPACTS, Recipe("x1", "wrench", processes=ProcessOptions(kernel=RBF, optimiser={"starts": 1})), rows=ROWS
    )
    fit, gps = model.processes.training, model.processes.gps
    assert fit.gap is not None
    close(fit.gap, fit.loss - best.processes.training.loss, rtol=0, atol=2e-3)
    close(losses(gps.train()), fit.loss)
    far = rate < 0.01
    assert (fit.gap > 0.1).all() == far
    assert not (far and fit.converged.any())
    assert f"{fit.gap.max().item():.2g} nats a trial short of an optimum" in model.processes.kind


def test_random_features_are_the_same_again_and_in_a_checkpoint(tmp_path):
    recipe = Recipe("x1", "wrench", processes=options_of("RFFKernel"))
    models = [learn(IMPACTS, recipe, rows=ROWS) for _ in range(2)]
    models.append(checkpoint.load(checkpoint.save(models[0], tmp_path / "model.pt", provenance={})))
    for other in models[1:]:
        assert torch.equal(other.predict(IMPACTS).v_post, models[0].predict(IMPACTS).v_post)
    close(losses(models[0].processes.gps.train()), models[0].processes.training.loss)


def options_of(name: str) -> ProcessOptions:
    return ProcessOptions(kernel={"_target_": K + name} | ARGUMENTS[name], optimiser={"starts": 2, "iterations": 3})


def test_fixed_noise_is_that_of_the_covariances():
    fixed = ProcessOptions(likelihood={"_target_": "gpytorch.likelihoods.FixedNoiseGaussianLikelihood"})
    recipe = Recipe("x2", "impulse", processes=fixed)
    spread = torch.tensor([0.01, 0.02, 0.3], dtype=torch.float64)
    stated = IMPACTS.replace(v_post_cov=torch.diag(spread**2).expand(len(IMPACTS), 3, 3))
    parameters = Recipe("x1", "parameters_identified", law=Mirtich(), processes=fixed)
    for one, impacts in ((recipe, IMPACTS), (parameters, stated)):
        with pytest.raises(DataError, match="the target has no stated noise"):
            learn(impacts, one, rows=ROWS, base=one.law)
    processes = learn(stated, recipe, rows=ROWS).processes
    assert isinstance(processes.gps.likelihood, FixedNoiseGaussianLikelihood)
    noise = processes.gps.noise_variance().sqrt() * processes.outputs.spread.mT
    close(noise, (IMPACTS.mass[:20] * spread[:2, None]).expand(2, -1))


def test_a_prior_without_density_at_any_start_is_said():
    """Its loss would be nan, of which no result is written."""
    x, y = problem()
    outside = {"_target_": "gpytorch.priors.UniformPrior", "a": 100.0, "b": 101.0}
    kernel = {**MATERN, "lengthscale_prior": outside}
    with pytest.raises(ContactLearnError, match=r"UniformPrior\(low: 100.0, high: 101.0\)$"):
        options(kernel=kernel)
    gps = ExactGPs(x, y, options=ProcessOptions(kernel=modules.resolved(kernel, COLUMNS, "kernels")))
    with pytest.raises(ContactLearnError, match="no start has a finite likelihood: a prior has no density there"):
        gps.fit()
