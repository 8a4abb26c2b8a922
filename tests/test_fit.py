"""Shared identification: planted parameters, brute force over the box, flat directions, and what is refused."""

import math

import numpy as np
import pytest
import torch
from contacts import DIFFER, DISTINCT, impulse
from drops import drops_of, seeded
from pairings import paired
from refusals import refused

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.inference.identification.shared import Box, cost_surface, fit_subsets
from contactlearn.laws import find
from contactlearn.mechanics.impacts import IMPULSE_TARGETS, measured_impulse
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

PLANTED = 1e-4  # of μ and ε found again: the search ends at steps of 1e-6 of the box
NOT_BEATEN = 1e-7  # of the cost: no grid over the box may find less
MISSED = 2e-2  # of the cost: what may be missed with many sizes at once or with few trials (module docstring)
ROUNDING = 1e-12  # relative
NOISY = {"velocity_noise": 0.05, "spin_noise": 2.0, "seed": 5}

# Laws whose impulse in stick does not depend on μ at all; on Routh's path it does, by way of p_c.
PATHS = ("wang_mason", "wang_mason_newton", "mirtich", "spring_dashpot")
STICKY = [case for case in DISTINCT if case.values[0] not in PATHS]


def orders(n: int, size: int, repetitions: int, seed: int) -> list[torch.Tensor]:
    """The subsets that `fit_subsets` is documented to draw: the first trials of random orders."""
    generator = seeded(seed)
    return [torch.randperm(n, generator=generator)[:size] for _ in range(repetitions)]


@pytest.mark.parametrize(("law", "variant", "mu", "eps"), paired(DISTINCT, [(0.12, 0.55), (0.03, 0.9), (0.2, 0.1)]))
def test_noiseless_drops_give_back_their_parameters(law, variant, mu, eps):
    drops = synthetic.load(100, law, mu, eps, velocity_noise=0, spin_noise=0, variant=variant)
    fit = fit_subsets(drops, find(law, variant), sizes=(60,), repetitions=3)
    torch.testing.assert_close(fit.mu, torch.full_like(fit.mu, mu), rtol=0, atol=PLANTED)
    torch.testing.assert_close(fit.eps, torch.full_like(fit.eps, eps), rtol=0, atol=PLANTED)
    assert fit.cost.max() < PLANTED * drops.wrench[:, :2].norm(dim=-1).mean()
    assert not fit.mu_flat.any()
    assert fit.mean() == pytest.approx((mu, eps), abs=PLANTED)
    assert all(math.isnan(std) or std < PLANTED for std in fit.std())  # nan where rounding alone tells them apart
    found = fit.to_law()
    assert (found.name, found.variant, found.mu, found.eps) == (law, variant, *fit.mean())
    assert str(ContactModel(found)) == f"{law} ({variant}): μ = {mu:.3f}, ε = {eps:.3f}"


def test_scatter_falls_as_one_over_root_k():
    sizes = (8, 16, 32, 64)
    drops = synthetic.load(1000, "wang_mason", 0.12, 0.55)
    fit = fit_subsets(drops, find("wang_mason"), sizes=sizes, repetitions=60, generator=seeded(1))
    for values, truth in ((fit.mu, 0.12), (fit.eps, 0.55)):
        slope = np.polyfit(np.log(sizes), values.std(0).log().numpy(), 1)[0]
        assert -0.75 < slope < -0.3  # −1/2, and 60 repetitions know a deviation to a tenth
        assert abs(values[:, -1].mean().item() - truth) < 0.02


def brute_force(law: str, variant: str, impacts, subsets: list[torch.Tensor], nodes: int) -> torch.Tensor:
    """Least mean distance of each subset over a grid of the box."""
    member = torch.zeros((len(impacts), len(subsets)), dtype=torch.float64)
    for column, rows in enumerate(subsets):
        member[rows, column] = 1 / len(rows)
    P = impacts.wrench[:, :2]
    axis = torch.linspace(0, 1, nodes, dtype=torch.float64)
    best = torch.full((len(subsets),), torch.inf, dtype=torch.float64)
    for mu in axis:
        error = impulse(law, impacts.W, impacts.v_c, mu, axis[:, None], variant=variant) - P
        best = torch.minimum(best, ((error[..., 0] ** 2 + error[..., 1] ** 2).sqrt() @ member).amin(0))
    return best


SLOW = ("mirtich", "fazeli2017"), ("spring_dashpot", "textbook")  # Newton's iterations


@pytest.mark.parametrize(("law", "variant", "source"), paired(DISTINCT, ["published", "synthetic", "x mirrored"]))
def test_no_grid_beats_the_cost(law, variant, source, request):
    slow = (law, variant) in SLOW
    drops = drops_of(source, 24 if slow else 80, law, variant, request, 2, **NOISY)
    sizes = (3, 8, 20) if slow else (3, 8, 20, 60)
    subsets = orders(len(drops), sizes[-1], 4, seed=3)
    nested = [order[:k] for order in subsets for k in sizes]
    grid = brute_force(law, variant, drops, nested, 80 if slow else 400).view(4, len(sizes))
    for size, least in zip(sizes, grid.T, strict=True):
        allowed = NOT_BEATEN if size >= 20 else MISSED
        fit = fit_subsets(drops, find(law, variant), sizes=(size,), repetitions=4, generator=seeded(3))
        assert (fit.cost[:, 0] <= least * (1 + allowed) + 1e-6).all()
    fit = fit_subsets(drops, find(law, variant), sizes=sizes, repetitions=4, generator=seeded(3))
    assert (fit.cost <= grid * (1 + MISSED) + 1e-6).all()


@pytest.mark.parametrize(("law", "source"), paired(sorted(DIFFER), ["published", "x mirrored"]))
def test_no_grid_beats_the_papers_convention(law, source, request):
    """Eq. (3.1) with the unweighted least-squares impulse and the authors' variants, as for its Table 1."""
    drops = drops_of(source, 80, law, "fazeli2017", request, 2, **NOISY)
    options = {"target": "least_squares"}
    fit = fit_subsets(drops, find(law, "fazeli2017"), sizes=(20,), repetitions=4, generator=seeded(3), **options)
    axis = torch.linspace(0, 1, 60 if law == "mirtich" else 300, dtype=torch.float64)
    for cost, order in zip(fit.cost[:, 0], orders(len(drops), 20, 4, seed=3), strict=True):
        assert (
            cost <= (1 + NOT_BEATEN) * cost_surface(find(law, "fazeli2017"), drops[order], axis, axis, **options).min()
        )


def test_costs_are_those_of_nested_subsets():
    """Repetition i at size k is the mean over the first k of the i-th random order, at the parameters found."""
    drops = synthetic.load(90, velocity_noise=0.05)
    sizes = (1, 4, 17, 50)
    fit = fit_subsets(drops, find("wang_mason"), sizes=sizes, repetitions=5, generator=seeded(8))
    assert fit.sizes == sizes
    assert fit.mu.shape == fit.eps.shape == fit.cost.shape == fit.mu_flat.shape == (5, 4)
    assert fit.mu_range.shape == fit.eps_range.shape == (5, 4, 2)
    for i, order in enumerate(orders(90, 50, 5, seed=8)):
        for j, k in enumerate(sizes):
            cost = cost_surface(find("wang_mason"), drops[order[:k]], fit.mu[i, j, None], fit.eps[i, j, None])
            assert fit.cost[i, j].item() == pytest.approx(cost.item(), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("law", ["anitescu_potra_newton", "wang_mason", "drumwright_shell"])
def test_a_single_size_is_the_last_of_many(law):
    drops = synthetic.load(200, law, velocity_noise=0.05, spin_noise=2.0)
    many = fit_subsets(drops, find(law), sizes=(5, 30, 120), repetitions=4, generator=seeded(4))
    one = fit_subsets(drops, find(law), sizes=(120,), repetitions=4, generator=seeded(4))
    torch.testing.assert_close(one.cost[:, 0], many.cost[:, -1], rtol=1e-5, atol=0)
    torch.testing.assert_close(one.mu[:, 0], many.mu[:, -1], rtol=0, atol=1e-3)
    torch.testing.assert_close(one.eps[:, 0], many.eps[:, -1], rtol=0, atol=1e-3)


def test_scale_and_mirror_change_nothing_else():
    """Masses four times as large give four times the cost, and a mirrored world the same parameters, to the digit."""
    drops = synthetic.load(60, velocity_noise=0.05)
    flip = torch.tensor((-1.0, 1.0, -1.0), dtype=torch.float64)  # x and the sense of rotation
    fields = {"r": drops.r * flip[:2], "q": drops.q * flip, "v_pre": drops.v_pre * flip, "v_post": drops.v_post * flip}
    base, heavy, mirror = (
        fit_subsets(impacts, find("wang_mason"), sizes=(5, 40), repetitions=3, generator=seeded(6))
        for impacts in (drops, drops.replace(mass=4 * drops.mass, inertia=4 * drops.inertia), drops.replace(**fields))
    )
    for other, scale in ((heavy, 4), (mirror, 1)):
        torch.testing.assert_close(other.mu, base.mu, rtol=ROUNDING, atol=ROUNDING)
        torch.testing.assert_close(other.eps, base.eps, rtol=ROUNDING, atol=ROUNDING)
        torch.testing.assert_close(other.cost, scale * base.cost, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize(("law", "variant"), STICKY)
def test_where_all_trials_stick_mu_is_flat(law, variant):
    drops = synthetic.load(400, law, 5.0, 0.55, velocity_noise=0, spin_noise=0, variant=variant)
    slope = drops.wrench[:, 0].abs() / drops.wrench[:, 1]
    drops = drops[slope < 0.3]
    assert len(drops) > 40
    fit = fit_subsets(drops, find(law, variant), sizes=(10, 40), repetitions=3)
    assert fit.mu_flat.all()
    assert (fit.mu_range[..., 1] == 1.0).all()
    assert (fit.mu_range[..., 0] < 0.7).all()
    torch.testing.assert_close(fit.eps, torch.full_like(fit.eps, 0.55), rtol=0, atol=PLANTED)
    assert (fit.eps_range[..., 1] - fit.eps_range[..., 0] < 0.02).all()


def test_of_equal_mu_the_least_is_taken():
    """Of small subsets that stick, not the μ that rounding decides, which another device decides otherwise."""
    drops = synthetic.load(200, seed=3)
    fit = fit_subsets(drops, "whittaker", sizes=(3,), repetitions=40)
    above = (fit.mu - fit.mu_range[..., 0])[fit.mu_flat]
    assert len(above) >= 5
    assert above.max() < 0.05  # three spacings of the grid


def test_mu_is_bounded_below_by_what_sticking_needs():
    """The lower end of the range is the largest |P_t| / P_n of the subset, to a node of the grid."""
    drops = synthetic.load(400, "anitescu_potra_newton", 5.0, 0.55, velocity_noise=0, spin_noise=0)
    slope = drops.wrench[:, 0].abs() / drops.wrench[:, 1]
    drops, slope = drops[slope < 0.3], slope[slope < 0.3]
    fit = fit_subsets(drops, find("anitescu_potra_newton"), sizes=(12,), repetitions=6, generator=seeded(2))
    needed = torch.stack([slope[order].max() for order in orders(len(drops), 12, 6, seed=2)])
    assert ((fit.mu_range[:, 0, 0] - needed).abs() < 1 / (Box().nodes - 1) + PLANTED).all()


@pytest.mark.parametrize("law", ["anitescu_potra_newton", "wang_mason", "drumwright_shell"])
def test_ranges_are_where_the_profiled_cost_stays_low(law):
    """Node by node: the least cost over the other parameter's nodes, or at its optimum, within 0.1 %."""
    drops = synthetic.load(60, law, 0.4, 0.55, velocity_noise=0.01, spin_noise=0.5)  # most of them stick
    box, sizes = Box(nodes=32), (4, 25)
    fit = fit_subsets(drops, find(law), sizes=sizes, repetitions=3, box=box, generator=seeded(5))
    axes = box.axes()
    for i, order in enumerate(orders(len(drops), 25, 3, seed=5)):
        for j, k in enumerate(sizes):
            subset, optimum = drops[order[:k]], (fit.mu[i, j, None], fit.eps[i, j, None])
            surface = cost_surface(find(law), subset, *axes)
            for own, found in enumerate((fit.mu_range[i, j], fit.eps_range[i, j])):
                line = [axes[own] if axis == own else optimum[axis] for axis in (0, 1)]
                profile = torch.minimum(surface.amin(1 - own), cost_surface(find(law), subset, *line).flatten())
                near = torch.cat((axes[own][profile <= 1.001 * fit.cost[i, j]], optimum[own]))
                torch.testing.assert_close(found, torch.stack((near.min(), near.max())), rtol=0, atol=ROUNDING)
            wide = fit.mu_range[i, j].diff().item() > 0.1
            assert fit.mu_flat[i, j].item() == wide
    assert (fit.mu_range.diff() > 0.05).any()


@pytest.mark.parametrize(("law", "variant"), DISTINCT)
def test_ranges_hold_the_optimum_and_the_box_holds_both(law, variant):
    drops = synthetic.load(60, law, 0.12, 0.55, velocity_noise=0.1, spin_noise=5.0, variant=variant)
    box = Box(mu=(0.05, 0.1), eps=(0.3, 0.6), nodes=16)
    fit = fit_subsets(drops, find(law, variant), sizes=(2, 30), repetitions=3, box=box)
    for values, ends, (low, high) in ((fit.mu, fit.mu_range, box.mu), (fit.eps, fit.eps_range, box.eps)):
        assert (low <= ends[..., 0]).all()
        assert (ends[..., 0] <= values).all()
        assert (values <= ends[..., 1]).all()
        assert (ends[..., 1] <= high).all()


def test_reproducible_from_the_generator_alone():
    drops = synthetic.load(60)

    def run(generator=None):
        return fit_subsets(drops, find("whittaker"), sizes=(5, 10), repetitions=4, generator=generator)

    torch.manual_seed(1)
    before = torch.get_rng_state()
    first = run(seeded(3))
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(2)
    second = run(seeded(3))
    for name in ("mu", "eps", "cost", "mu_range", "eps_range"):
        assert torch.equal(getattr(first, name), getattr(second, name))
    assert torch.equal(run().mu, run(seeded(0)).mu)
    assert not torch.equal(first.mu, run(seeded(4)).mu)
    fit = fit_subsets(synthetic.load(20), find("whittaker"), sizes=(10,), repetitions=1)
    assert all(math.isnan(x) for x in fit.std())
    assert fit.mean() == (fit.mu.item(), fit.eps.item())
    seen = []

    def progress(blocks):
        for block in blocks:
            seen.append(block)
            yield block

    drops = synthetic.load(30)
    fit = fit_subsets(drops, find("whittaker"), sizes=range(1, 31), repetitions=9, progress=progress)
    assert torch.equal(torch.cat(seen), torch.stack(orders(30, 30, 9, seed=0)))
    assert len(fit.mu) == 9


def test_orders_may_be_given():
    """The random ones give what they give when they are drawn; what is beyond the largest size is not looked at."""
    drops, sizes = synthetic.load(60), (5, 20)
    drawn = fit_subsets(drops, find("wang_mason"), sizes=sizes, repetitions=4, generator=seeded(3))
    for width in (60, 25, 20):
        given = fit_subsets(drops, find("wang_mason"), sizes=sizes, orders=torch.stack(orders(60, width, 4, seed=3)))
        for name in ("mu", "eps", "cost", "mu_range", "eps_range", "mu_flat"):
            assert torch.equal(getattr(given, name), getattr(drawn, name))
    # As if there were no other trials: whatever these are, and one order or three.
    drops, rows = synthetic.load(60, velocity_noise=0.05), torch.stack(orders(60, 20, 3, seed=7))
    options = {"sizes": (5, 20), "generator": seeded(1)}
    every = fit_subsets(drops, find("whittaker"), orders=rows, **options)
    assert every.mu.shape == (3, 2)
    for i, order in enumerate(rows):
        alone = fit_subsets(drops[order], find("whittaker"), orders=torch.arange(20)[None], **options)
        torch.testing.assert_close(every.cost[i], alone.cost[0], rtol=NOT_BEATEN, atol=0)
        for name in ("mu", "eps", "mu_range", "eps_range"):
            torch.testing.assert_close(getattr(every, name)[i], getattr(alone, name)[0], rtol=0, atol=PLANTED)
    outside = torch.ones(60, 1, dtype=torch.bool).index_fill(0, rows.flatten(), False)
    other = drops.replace(v_post=drops.v_post + outside, q=drops.q + outside)
    assert torch.equal(fit_subsets(other, find("whittaker"), orders=rows, **options).mu, every.mu)


def test_targets_agree_where_the_moment_is_zero():
    drops = synthetic.load(50, velocity_noise=0, spin_noise=0)
    assert drops.wrench[:, 2].abs().max() < 1e-15
    for target in IMPULSE_TARGETS:
        torch.testing.assert_close(measured_impulse(drops, target), drops.wrench[:, :2], rtol=1e-10, atol=1e-14)
    drops = synthetic.load(5)
    dv = drops.v_post - drops.v_pre
    torch.testing.assert_close(measured_impulse(drops), drops.mass[:, None] * dv[:, :2], rtol=ROUNDING, atol=0)
    mu, eps = Box(mu=(0.1, 0.7), eps=(0.2, 0.9), nodes=5).axes()
    np.testing.assert_allclose(mu, np.linspace(0.1, 0.7, 5), rtol=ROUNDING)
    np.testing.assert_allclose(eps, np.linspace(0.2, 0.9, 5), rtol=ROUNDING)
    assert mu.dtype == eps.dtype == torch.float64


@pytest.mark.parametrize("target", ["least_squares", "contact"])
def test_targets_are_least_squares_solutions(target):
    """Δv = M⁻¹JᵀP over (v_x, v_y, ω), unweighted and weighted by M, against torch.linalg.lstsq."""
    drops = synthetic.load(50, velocity_noise=0.1, spin_noise=5.0)
    M = torch.stack((drops.mass, drops.mass, drops.inertia), -1)
    zero, one = torch.zeros_like(drops.mass), torch.ones_like(drops.mass)
    J = torch.stack((torch.stack((one, zero, -drops.r[:, 1]), -1), torch.stack((zero, one, drops.r[:, 0]), -1)), -2)
    A, b = J.mT / M[..., None], (drops.v_post - drops.v_pre)[..., None]
    weight = M.sqrt()[..., None] if target == "contact" else 1.0
    P = torch.linalg.lstsq(weight * A, weight * b).solution[..., 0]
    torch.testing.assert_close(measured_impulse(drops, target), P, rtol=1e-9, atol=1e-14)
    assert (P - drops.wrench[:, :2]).norm(dim=-1).min() > 1e-6  # with a moment, not the momentum


@pytest.mark.parametrize("target", IMPULSE_TARGETS)
@pytest.mark.parametrize(("law", "variant"), DISTINCT)
def test_cost_surface_is_the_mean_distance(law, variant, target):
    drops = synthetic.load(7, velocity_noise=0.1, spin_noise=3.0)
    mus, epses = (torch.tensor(x, dtype=torch.float64) for x in ((0.0, 0.13, 0.6), (0.0, 0.4, 1.0, 0.7)))
    P = measured_impulse(drops, target)
    surface = cost_surface(find(law, variant), drops, mus, epses, target=target)
    assert surface.shape == (3, 4)
    for i, mu in enumerate(mus.tolist()):
        for j, eps in enumerate(epses.tolist()):
            distances = [
                math.hypot(*(impulse(law, drops.W[n], drops.v_c[n], mu, eps, variant=variant) - P[n]).tolist())
                for n in range(7)
            ]
            assert surface[i, j].item() == pytest.approx(sum(distances) / 7, rel=1e-9)


@pytest.mark.parametrize("target", IMPULSE_TARGETS)
def test_identify_fits_the_target(target):
    drops = synthetic.load(40, velocity_noise=0.05, spin_noise=5.0)
    fit = fit_subsets(drops, find("wang_mason"), sizes=(40,), repetitions=1, target=target)
    cost = cost_surface(find("wang_mason"), drops, fit.mu[0], fit.eps[0], target=target)
    assert fit.cost.item() == pytest.approx(cost.item(), rel=1e-9)


REFUSED = {
    "too few trials": (lambda d: fit_subsets(d, find("whittaker"), sizes=(5, 21)), DataError, ["21", "20", "seed 0"]),
    "sizes that fall": (lambda d: fit_subsets(d, find("whittaker"), sizes=(5, 3)), DataError, ["increasing", "[5, 3]"]),
    "sizes that repeat": (lambda d: fit_subsets(d, find("mirtich"), sizes=(5, 5)), DataError, ["increasing", "[5, 5]"]),
    "size zero": (lambda d: fit_subsets(d, find("whittaker"), sizes=(0, 3)), DataError, ["positive", "[0, 3]"]),
    "no sizes": (lambda d: fit_subsets(d, find("whittaker"), sizes=()), DataError, ["sizes", "[]"]),
    "no repetitions": (lambda d: fit_subsets(d, find("whittaker"), sizes=(3,), repetitions=0), DataError,
        ["at least 1", "got 0"]),
    "box upside down": (lambda d: Box(mu=(0.5, 0.5)), DataError, ["mu", "low < high", "[0.5, 0.5]"]),
    "box below zero": (lambda d: Box(eps=(-0.1, 1.0)), DataError, ["eps", "0 ≤ low", "[-0.1, 1.0]"]),
    "box above one": (lambda d: Box(eps=(0.0, 1.2)), DataError, ["eps", "1 or below", "[0.0, 1.2]"]),
    "box not a number": (lambda d: Box(mu=(0.0, math.nan)), DataError, ["mu", "nan"]),
    "few nodes": (lambda d: Box(nodes=2), DataError, ["3 nodes", "got 2"]),
    "law": (lambda d: fit_subsets(d, find("witaker"), sizes=(3,)), UnknownNameError,
        ["witaker", "did you mean 'whittaker'?"]),
    "variant": (lambda d: fit_subsets(d, find("whittaker", "fazeli"), sizes=(3,)), UnknownNameError,
        ["fazeli", "did you mean 'fazeli2017'?"]),
    "target": (lambda d: fit_subsets(d, find("whittaker"), sizes=(3,), target="momentun"), UnknownNameError,
        ["momentun", "did you mean 'momentum'?"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "error", "fragments"), REFUSED.values(), ids=REFUSED)
def test_refused(call, error, fragments):
    with refused(fragments, error):
        call(synthetic.load(20))
