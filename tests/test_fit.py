"""Shared identification: known parameters come back, brute force finds nothing better, flat costs are flagged."""

import numpy as np
import pytest
import torch

from contactlearn import mechanics
from contactlearn.data import synthetic
from contactlearn.errors import DataError, UnknownNameError
from contactlearn.fit import Box, cost_surface, distances, identify, measured_impulse
from contactlearn.laws import PAPER_LAWS, Law, impulse
from contactlearn.model import ContactModel

BRUTE = 1e-3  # relative rise of the cost over brute force: Whittaker's law jumps, and an edge is only neared
FOUND = 1e-4  # of parameters from noiseless drops: the last step of the search is 1e-6 of the box


def drops(law, size=150, mu=0.15, eps=0.6, variant="textbook", **noise):
    noise = {"velocity_noise": 0.0, "spin_noise": 0.0} | noise
    return synthetic.load(size=size, law=law, mu=mu, eps=eps, variant=variant, **noise)


def mirrored(impacts):
    flip = torch.tensor((-1.0, 1.0, 1.0), dtype=torch.float64)
    return impacts.replace(q=impacts.q * flip, v_pre=impacts.v_pre * flip, v_post=impacts.v_post * flip)


@pytest.mark.parametrize("variant", ["textbook", "fazeli2017"])
@pytest.mark.parametrize("law", PAPER_LAWS)
def test_noiseless_drops_give_their_parameters_back(law, variant):
    fit = identify(law, drops(law, variant=variant), sizes=(60,), repetitions=3, variant=variant)
    assert fit.mean() == pytest.approx((0.15, 0.6), abs=FOUND)
    assert fit.cost.max() < 1e-6
    assert not fit.mu_flat.any()


def test_more_trials_spread_less():
    noisy = drops("wang_mason", size=400, velocity_noise=0.02, spin_noise=1.0)
    fit = identify("wang_mason", noisy, sizes=(5, 80), repetitions=20)
    for spread in (fit.mu.std(0), fit.eps.std(0)):
        # Standard errors fall as 1/√k, here by 4; half of that leaves room for 20 repetitions.
        assert spread[1] < spread[0] / 2
    assert fit.mean() == pytest.approx((0.15, 0.6), abs=0.01)


@pytest.mark.parametrize("law", ["whittaker", "anitescu_potra_newton", "drumwright_shell", "mirtich"])
@pytest.mark.parametrize("variant", ["textbook", "fazeli2017"])
def test_brute_force_finds_nothing_better_on_the_real_drops(ellipse_drops, law, variant):
    """Both as published and mirrored; 20 trials leave many kinks and more than one basin."""
    mu, eps = torch.linspace(0, 1, 400, dtype=torch.float64), torch.linspace(0, 1, 200, dtype=torch.float64)
    for impacts in (ellipse_drops, mirrored(ellipse_drops)):
        options = {"variant": variant, "target": "least_squares"}
        fit = identify(law, impacts, sizes=(20,), repetitions=4, generator=torch.Generator().manual_seed(3), **options)
        generator = torch.Generator().manual_seed(3)
        for cost in fit.cost[:, 0]:
            subset = impacts[torch.randperm(len(impacts), generator=generator)[:20]]
            assert cost <= (1 + BRUTE) * cost_surface(law, subset, mu, eps, **options).min()


def test_a_single_size_is_the_last_of_many():
    """The same generator draws the same subsets, nested within a repetition."""
    noisy = drops("wang_mason", size=100, velocity_noise=0.02)
    many = identify("wang_mason", noisy, sizes=(3, 10, 30), repetitions=5)
    one = identify("wang_mason", noisy, sizes=(30,), repetitions=5)
    torch.testing.assert_close(one.cost[:, 0], many.cost[:, -1], rtol=1e-5, atol=0)
    torch.testing.assert_close(one.mu[:, 0], many.mu[:, -1], rtol=0, atol=1e-4)


def test_reproducible_and_untouched_by_the_global_state():
    noisy = drops("whittaker", size=60, velocity_noise=0.02)
    torch.manual_seed(1)
    first = identify("whittaker", noisy, sizes=(20,), repetitions=3)
    torch.manual_seed(2)
    again = identify("whittaker", noisy, sizes=(20,), repetitions=3)
    assert (first.mu == again.mu).all()
    other = identify("whittaker", noisy, sizes=(20,), repetitions=3, generator=torch.Generator().manual_seed(7))
    assert (first.mu != other.mu).any()


def test_sticking_trials_leave_friction_undetermined():
    fit = identify("anitescu_potra_newton", drops("anitescu_potra_newton", mu=5.0), sizes=(30,), repetitions=4)
    assert fit.mu_flat.all()
    assert (fit.mu_range[..., 1] == 1).all()  # up to the bound: only bounded below
    assert (fit.mu_range[..., 0] > 0.05).all()
    assert fit.eps == pytest.approx(np.full((4, 1), 0.6), abs=FOUND)
    assert (fit.eps_range[..., 1] - fit.eps_range[..., 0] < 0.05).all()


def test_measured_impulses():
    """Each convention against its definition; all three agree for a point contact."""
    noisy = drops("mirtich", size=40, velocity_noise=0.02, spin_noise=2.0)
    J = mechanics.contact_jacobian(noisy.r)
    M = torch.diag_embed(torch.stack((noisy.mass, noisy.mass, noisy.inertia), -1))
    dv = (noisy.v_post - noisy.v_pre)[..., None]
    A = torch.linalg.solve(M, J.mT)
    plain = torch.linalg.lstsq(A, dv).solution[..., 0]
    root = M.sqrt()
    weighted = torch.linalg.lstsq(root @ A, root @ dv).solution[..., 0]
    scale = plain.abs().max().item()
    torch.testing.assert_close(measured_impulse(noisy, "least_squares"), plain, rtol=0, atol=1e-12 * scale)
    torch.testing.assert_close(measured_impulse(noisy, "contact"), weighted, rtol=0, atol=1e-12 * scale)
    momentum = noisy.mass[:, None] * (noisy.v_post - noisy.v_pre)[:, :2]
    torch.testing.assert_close(measured_impulse(noisy), momentum, rtol=0, atol=0)
    exact = drops("mirtich", size=40)
    for target in ("least_squares", "contact"):
        torch.testing.assert_close(measured_impulse(exact, target), measured_impulse(exact), rtol=0, atol=1e-12)


def test_cost_surface_is_a_mean_over_trials():
    noisy = drops("whittaker", size=7, velocity_noise=0.05)
    mu, eps = torch.tensor((0.0, 0.3), dtype=torch.float64), torch.tensor((0.2, 0.5, 0.9), dtype=torch.float64)
    surface = cost_surface("whittaker", noisy, mu, eps)
    for i, m in enumerate(mu):
        for j, e in enumerate(eps):
            P = impulse("whittaker", noisy.W, noisy.v_c, m, e)
            expected = np.mean([np.hypot(*row) for row in (P - noisy.wrench[:, :2]).numpy()])
            assert surface[i, j].item() == pytest.approx(expected, rel=1e-12)
    single = distances("whittaker", noisy, mu[0], eps[0], variant="textbook", target="momentum")
    assert single.mean().item() == pytest.approx(surface[0, 0].item(), rel=1e-12)


def test_fit_to_law_is_the_mean():
    fit = identify("mirtich", drops("mirtich", size=40, velocity_noise=0.05), sizes=(10,), repetitions=4)
    law = fit.to_law()
    assert isinstance(law, Law)
    assert (law.mu, law.eps) == (fit.mu.mean().item(), fit.eps.mean().item())
    assert "mirtich (textbook): μ = " in str(ContactModel(law))


def test_one_repetition_has_no_spread():
    fit = identify("mirtich", drops("mirtich", size=20), sizes=(10,), repetitions=1)
    assert np.isnan(fit.std()).all()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"sizes": (30,)}, DataError, "30 trials asked for, but only 20 are there"),
        ({"sizes": (10, 10)}, DataError, "increasing"),
        ({"sizes": ()}, DataError, "increasing"),
        ({"sizes": (0,)}, DataError, "positive"),
        ({"repetitions": 0}, DataError, "at least 1"),
        ({"law": "mirtch"}, UnknownNameError, "did you mean 'mirtich'"),
        ({"variant": "text"}, UnknownNameError, "did you mean 'textbook'"),
        ({"target": "momentun"}, UnknownNameError, "did you mean 'momentum'"),
    ],
)
def test_errors(changes, error, message):
    options = {"law": "mirtich", "sizes": (10,), "repetitions": 1} | changes
    law = options.pop("law")
    with pytest.raises(error, match=message):
        identify(law, drops("mirtich", size=20), **options)


@pytest.mark.parametrize("box", [{"mu": (1.0, 0.5)}, {"mu": (-0.1, 1.0)}, {"eps": (0.0, 1.2)}, {"nodes": 2}])
def test_box_errors(box):
    with pytest.raises(DataError, match=r"bounds|nodes"):
        Box(**box)
