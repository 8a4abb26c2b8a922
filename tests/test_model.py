"""ContactModel: one equation of motion for every kind of model, and a covariance that is what it says.

The learned part is a stand-in of known mean and variance, so that nothing here depends on training.
"""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from contacts import impulse
from torch import Tensor
from torch.autograd.functional import jacobian

from contactlearn.laws import find, names
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import RESIDUALS, ContactModel, predict_with, wrench_per_parameter
from contactlearn.simulation import synthetic

ROUNDING = 1e-12
"""Relative to the largest number of a column: exact algebra, a few roundings of double precision."""

CANCELLED = 1e-7
"""Relative: what a difference keeps of its digits when it is a small part of what it is taken of."""

DIFFERENCES = 1e-7
"""Relative: central differences with steps of 1e-6 lose half the digits."""

N = 40
WIDTH = {"velocity": 3, "impulse": 2, "wrench": 3}
SIZE = {"velocity": (0.1, 0.1, 5.0), "impulse": (5e-3, 5e-3), "wrench": (5e-3, 5e-3, 1e-4)}  # of what is learnt
LAW = find("wang_mason").at(0.15, 0.6)
TARGET = pytest.mark.parametrize("target", RESIDUALS)


@dataclass(frozen=True)
class Known:
    """In the place of a regressor: mean and variance [..., N, O]."""

    mean: Tensor
    variance: Tensor

    def predict(self, impacts: Impacts) -> tuple[Tensor, Tensor]:
        return self.mean, self.variance


@pytest.fixture(scope="module")
def drops() -> Impacts:
    return synthetic.load(N, seed=3)


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def learned(target: str, *batch: int, seed: int = 0) -> Known:
    """A residual of plausible size and its variance."""
    size = torch.tensor(SIZE[target], dtype=torch.float64)
    shape = (*batch, N, WIDTH[target])
    return Known(size * draw(*shape, seed=seed), (0.3 * size * draw(*shape, seed=seed + 100)).square())


def learned_parameters(*batch: int, seed: int = 0, variance: float = 0.02**2) -> Known:
    """(μ, ε) within (0.02, 0.4) and (0.2, 0.9)."""
    share = torch.rand((*batch, N, 2), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    mean = torch.tensor([0.02, 0.2]) + torch.tensor([0.38, 0.7]) * share
    return Known(mean, variance * (0.5 + share))


def noise(*batch: int) -> Tensor:
    root = 0.01 * torch.eye(3, dtype=torch.float64) + 0.003 * draw(*batch, 3, 3, seed=9)
    return root @ root.mT


BASES = {
    "nothing": None,
    "a law": LAW,
    "laws": find("whittaker").at(torch.tensor([[0.1], [0.2]]).double(), torch.tensor([[0.5], [0.6]]).double()),
    "a model": ContactModel(LAW, learned("wrench", seed=5), "wrench"),
    "models": ContactModel(LAW, learned("velocity", 2, seed=6), "velocity"),
}


def kinds() -> dict[str, ContactModel]:
    """Models of every kind; those of a batch have two members."""
    found = {f"law {name}": ContactModel(base) for name, base in BASES.items()}
    for name, base in BASES.items():
        for target in RESIDUALS:
            found[f"{target} on {name}"] = ContactModel(base, learned(target), target, noise=noise())
            found[f"{target}s on {name}"] = ContactModel(base, learned(target, 2), target, noise=noise(2))
    found["parameters"] = ContactModel(LAW, parameters=learned_parameters(), noise=noise())
    found["parameters of two"] = ContactModel(LAW, parameters=learned_parameters(2), noise=noise(2))
    return found


KINDS = kinds()
KIND = pytest.mark.parametrize("model", KINDS.values(), ids=KINDS)
SURE = pytest.mark.parametrize(
    "model",
    [m for m in KINDS.values() if m.noise is not None],
    ids=[k for k, m in KINDS.items() if m.noise is not None],
)


def assert_close(one: Tensor, two: Tensor, rtol: float = ROUNDING):
    """Equal to a share of the largest number in each of the last axis' columns."""
    size = torch.maximum(one.abs().amax(-2, keepdim=True), two.abs().amax(-2, keepdim=True))
    assert one.shape == two.shape
    assert ((one - two).abs() <= rtol * size).all()


def assert_same(one: Prediction, two: Prediction):
    assert_close(one.v_post, two.v_post)
    # Of a wrench that was measured from velocities P_t loses the digits of P_n, and τ those of r × P.
    assert ((one.wrench - two.wrench).abs() <= ROUNDING * one.wrench.abs().amax()).all()


@pytest.mark.parametrize("law", names())
def test_a_law_alone(law, drops):
    """In NumPy: P from the law, v⁺ from M Δv = Jᵀ P."""
    prediction = ContactModel(find(law).at(0.12, 0.55)).predict(drops)
    P = impulse(law, drops.W, drops.v_c, 0.12, 0.55)
    assert torch.equal(prediction.wrench[:, :2], P)
    assert (prediction.wrench[:, 2] == 0).all()
    assert prediction.covariance is None
    for i in range(N):
        r_x, r_y = drops.r[i].tolist()
        M = np.diag([drops.mass[i], drops.mass[i], drops.inertia[i]])
        J = np.array([[1, 0, -r_y], [0, 1, r_x]])
        v_post = drops.v_pre[i].numpy() + np.linalg.solve(M, J.T @ P[i].numpy())
        np.testing.assert_allclose(prediction.v_post[i], v_post, rtol=ROUNDING, atol=ROUNDING)


def test_a_law_with_parameters_of_each_subset(drops):
    mu, eps = torch.tensor([[0.05], [0.2], [0.4]]).double(), torch.tensor([[0.4], [0.5], [0.9]]).double()
    prediction = ContactModel(find("mirtich").at(mu, eps)).predict(drops)
    assert prediction.v_post.shape == prediction.wrench.shape == (3, N, 3)
    for i in range(3):
        one = ContactModel(find("mirtich").at(mu[i].item(), eps[i].item())).predict(drops)
        assert_same(Prediction(prediction.v_post[i], prediction.wrench[i]), one)
    prediction = ContactModel().predict(drops)
    assert torch.equal(prediction.v_post, drops.v_pre)
    assert (prediction.wrench == 0).all()
    # Impulses add up in any order, and so do the velocities that they make.
    wrench, velocity = learned("wrench"), learned("velocity", seed=1)
    first = ContactModel(ContactModel(LAW, wrench, "wrench"), velocity, "velocity")
    second = ContactModel(ContactModel(LAW, velocity, "velocity"), wrench, "wrench")
    assert_same(first.predict(drops), second.predict(drops))
    assert ContactModel(LAW, learned("wrench"), "wrench").predict(drops).covariance is None
    assert ContactModel(LAW, parameters=learned_parameters()).predict(drops).covariance is None


@KIND
def test_velocity_and_wrench_obey_the_equation_of_motion(model, drops):
    """Each is the other's, whichever of them was learnt."""
    prediction = model.predict(drops)
    body = drops.mass, drops.inertia, drops.r, drops.v_pre
    assert_same(prediction, Prediction.from_wrench(drops, prediction.wrench))
    assert_same(prediction, Prediction(prediction.v_post, rigid_body.measured_wrench(*body, prediction.v_post)))
    # In the contact's own frame: v_c⁺ = v_c + W P, but for what τ turns.
    v_c = rigid_body.contact_velocity(drops.r, prediction.v_post)
    lever = torch.stack((-drops.r[:, 1], drops.r[:, 0]), -1) / drops.inertia[:, None]
    W_P = (drops.W @ prediction.wrench[..., :2, None])[..., 0] + lever * prediction.wrench[..., 2:]
    assert_close(v_c, drops.v_c + W_P)
    part = model.parameters or model.residual
    if part is None:
        assert_same(model.predict(drops), model.base_prediction(drops))
    else:
        assert_same(model.predict(drops), model.complete(drops, part.mean))


@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
@TARGET
def test_a_residual_adds_to_its_base(target, base, drops):
    """A base is a law, a model or nothing: what is learnt comes on top of what it predicts."""
    part = learned(target, 2)
    below, found = ContactModel(base).predict(drops), ContactModel(base, part, target).predict(drops)
    if isinstance(base, ContactModel):
        assert_same(below, base.predict(drops))
    one, other = (p.v_post if target == "velocity" else p.wrench[..., : WIDTH[target]] for p in (found, below))
    assert_close(one - other, part.mean, rtol=CANCELLED)
    if target == "impulse":
        assert torch.equal(found.wrench[..., 2], below.wrench[..., 2].expand(2, N))


def test_batched_equals_looped(drops):
    for target in RESIDUALS:
        part, extra = learned(target, 3), noise(3)
        every = ContactModel(LAW, part, target, noise=extra).predict(drops)
        for i in range(3):
            one = ContactModel(LAW, Known(part.mean[i], part.variance[i]), target, noise=extra[i]).predict(drops)
            assert_same(one, Prediction(every.v_post[i], every.wrench[i]))
            assert_close(one.covariance.flatten(1), every.covariance[i].flatten(1))
    part = learned_parameters(3)
    every = ContactModel(LAW, parameters=part, noise=noise()).predict(drops)
    for i in range(3):
        one = ContactModel(LAW, parameters=Known(part.mean[i], part.variance[i]), noise=noise()).predict(drops)
        assert_same(one, Prediction(every.v_post[i], every.wrench[i]))
        assert_close(one.covariance.flatten(1), every.covariance[i].flatten(1))


@pytest.mark.parametrize("law", names())
def test_parameters_of_each_impact(law, drops):
    """One law an impact, each with its own numbers."""
    mean = learned_parameters().mean
    found = ContactModel(find(law).at(9.0, 0.0), parameters=Known(mean, mean)).predict(drops)
    P = torch.cat([find(law).at(*mean[i].tolist()).impulse(drops.W[i : i + 1], drops.v_c[i : i + 1]) for i in range(N)])
    assert_close(found.wrench[:, :2], P)
    assert (found.wrench[:, 2] == 0).all()


CLAMPED = {
    "no friction": ((-0.3, 0.5), (0.0, 0.5)), "no restitution": ((0.2, -0.1), (0.2, 0.0)),
    "elastic": ((0.2, 1.7), (0.2, 1.0)), "all": ((-1.0, 2.0), (0.0, 1.0)), "none": ((3.0, 1.0), (3.0, 1.0)),
}  # fmt: skip


@pytest.mark.parametrize(("given", "counted"), CLAMPED.values(), ids=CLAMPED)
def test_parameters_are_clamped_to_what_they_can_be(given, counted, drops):
    given, counted = (torch.tensor(x, dtype=torch.float64).expand(N, 2) for x in (given, counted))
    assert torch.equal(predict_with(LAW, drops, given).v_post, predict_with(LAW, drops, counted).v_post)
    assert torch.equal(wrench_per_parameter(LAW, drops, given), wrench_per_parameter(LAW, drops, counted))
    P = find(LAW.name).at(*counted[0].tolist()).impulse(drops.W, drops.v_c)
    assert_close(predict_with(LAW, drops, given).wrench[:, :2], P)


@pytest.mark.parametrize("variant", ["textbook", "fazeli2017"])
@pytest.mark.parametrize("law", names())
def test_wrench_per_parameter_against_differences(law, variant, drops):
    """On the nineteen in twenty contacts whose mode does not change within the step."""
    theta, h = learned_parameters(3).mean, 1e-6
    law = find(law, variant).at(0.1, 0.5)
    G = wrench_per_parameter(law, drops, theta)
    assert G.shape == (3, N, 3, 2)
    assert not G.requires_grad
    for k in range(2):
        step = h * torch.eye(2, dtype=torch.float64)[k]
        up, down = (predict_with(law, drops, theta + s).wrench for s in (step, -step))
        error = ((up - down) / (2 * h) - G[..., k]).norm(dim=-1)
        assert (error <= DIFFERENCES * drops.mass[0] * 3).double().mean() > 0.95  # impulses are of size m · 3 m/s


@SURE
def test_covariance_is_symmetric_and_positive_definite(model, drops):
    prediction = model.predict(drops)
    C = prediction.covariance
    assert C.shape[:-2] == (model.parameters or model.residual).mean.shape[:-1]
    assert C.shape[-2:] == (3, 3)
    assert_close(C.flatten(-2), C.mT.flatten(-2))
    floor = torch.linalg.eigvalsh(model.noise)[..., :1]
    # No direction is surer than the noise lets it be.
    assert (torch.linalg.eigvalsh(C)[..., 0] >= floor * (1 - CANCELLED)).all()
    part = model.parameters or model.residual
    C, spread = model.predict(drops).covariance, model.spread(drops, part.mean, part.variance)
    assert_close((C - model.noise[..., None, :, :]).flatten(-2), spread.flatten(-2), rtol=CANCELLED)
    nothing = model.spread(drops, part.mean, torch.zeros_like(part.variance))
    assert (nothing == 0).all()
    assert_close(model.spread(drops, part.mean, 4 * part.variance).flatten(-2), 4 * spread.flatten(-2))


def autograd_spread(model: ContactModel, drops: Impacts, part: Known) -> Tensor:
    """D Σ Dᵀ trial by trial, with D the derivative of the completed v_post by autograd."""
    found = []
    for i in range(N):
        one = drops[[i]]
        D = jacobian(lambda value, one=one: model.complete(one, value[None]).v_post[0], part.mean[i])
        found.append(D @ part.variance[i].diag() @ D.T)
    return torch.stack(found)


@pytest.mark.parametrize("base", [None, LAW], ids=["nothing", "a law"])
@TARGET
def test_spread_of_a_residual_against_autograd(target, base, drops):
    part, model = learned(target), ContactModel(base, learned(target), target)
    assert_close(
        model.spread(drops, part.mean, part.variance).flatten(-2), autograd_spread(model, drops, part).flatten(-2)
    )


@pytest.mark.parametrize("law", names())
def test_spread_of_parameters_against_autograd(law, drops):
    part = learned_parameters()
    model = ContactModel(find(law).at(0.1, 0.5), parameters=part)
    assert_close(
        model.spread(drops, part.mean, part.variance).flatten(-2), autograd_spread(model, drops, part).flatten(-2)
    )


def test_sure_parameters_of_a_rigid_law_leave_one_direction_sure(drops):
    """Two numbers move v_post in a plane: along M⁻¹Jᵀ, and the noise of τ alone is left across it."""
    part = learned_parameters()
    spread = ContactModel(LAW, parameters=part).spread(drops, part.mean, part.variance)
    across = torch.stack((drops.mass * drops.r[:, 1], -drops.mass * drops.r[:, 0], drops.inertia), -1)
    along = (spread * across[:, None] * across[..., None]).sum((-1, -2))
    size = (spread.abs() * (across[:, None] * across[..., None]).abs()).sum((-1, -2))
    assert (along.abs() <= ROUNDING * size).all()
