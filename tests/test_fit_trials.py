"""Per-trial identification: brute force over the box finds nothing better, and the interval of μ is what it says."""

import pytest
import torch
from contacts import DISTINCT, impulse, random_bodies
from drops import drops_of, seeded
from pairings import paired

from contactlearn.core.errors import UnknownNameError
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.identification.shared import Box, distances
from contactlearn.laws import find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation import synthetic

BEATEN = 1e-9  # N s: a grid may find less than this below ours
EXACT = 1e-9  # of |P|: error left on drops that obey the law; searches stop at 1e-10
INTERVAL = 1e-6  # of μ; the ends are bisected to 1e-7
ALLOWED = 1e-7  # of |P|: within the interval the error may rise by this
NOISY = {"velocity_noise": 0.1, "spin_noise": 4.0, "seed": 9}

# Where these stick, the impulse does not depend on μ and the cone |P_t| ≤ μ P_n is all that μ must satisfy.
NEWTON = [("whittaker", "textbook"), ("whittaker", "fazeli2017"), ("anitescu_potra_newton", "textbook")]
VISCOUS = ("mirtich", "fazeli2017")  # Newton's iterations: thirty times as slow, and no sticking
SLOW = (VISCOUS, ("spring_dashpot", "textbook"))  # on a grid
SOURCES = ["published", "x mirrored", "synthetic"]
SLIDES = [case for case in DISTINCT if case.values != VISCOUS]


def size(impacts: Impacts) -> torch.Tensor:
    """|P| [N] in N s."""
    return impacts.wrench[:, :2].norm(dim=-1)


def exact_drops(n: int, law: str, variant: str = "textbook", mu: float = 0.12, eps: float = 0.55) -> Impacts:
    return synthetic.load(n, law, mu, eps, velocity_noise=0, spin_noise=0, variant=variant, seed=4)


def brute_force(law: str, variant: str, impacts: Impacts, box: Box, nodes: tuple[int, int, int]) -> torch.Tensor:
    """Least error of each trial over a grid, with most nodes of μ in the lower two fifths."""
    low, high = box.mu
    bend = low + 0.4 * (high - low)
    lower, upper = (
        torch.linspace(*ends, n, dtype=torch.float64) for *ends, n in ((low, bend, nodes[0]), (bend, high, nodes[1]))
    )
    mus = torch.cat((lower, upper))
    eps = torch.linspace(*box.eps, nodes[2], dtype=torch.float64)[:, None]
    best = torch.full((len(impacts),), torch.inf, dtype=torch.float64)
    for mu in mus:
        e_t, e_n = (impulse(law, impacts.W, impacts.v_c, mu, eps, variant=variant) - impacts.wrench[:, :2]).unbind(-1)
        best = torch.minimum(best, (e_t**2 + e_n**2).amin(0))
    return best.sqrt()


def best_in_eps(law: str, variant: str, impacts: Impacts, mu: torch.Tensor) -> torch.Tensor:
    """Least error [N] over all ε at μ [N]: a fine grid, then grids that shrink about its best node."""
    centre, half = torch.full_like(mu, 0.5), 0.5
    while half > 1e-10:
        eps = (centre + half * torch.linspace(-1, 1, 201, dtype=torch.float64)[:, None]).clamp(0, 1)
        error, which = distances(find(law, variant), impacts, mu, eps, target="momentum").min(0)
        centre, half = eps.gather(0, which[None])[0], half * 0.05
    return error


@pytest.mark.parametrize(("law", "variant", "source"), paired(DISTINCT, SOURCES))
def test_no_grid_beats_any_trial(law, variant, source, request):
    slow = (law, variant) in SLOW
    drops = drops_of(source, 60 if slow else 300, law, variant, request, 1, **NOISY)
    fit = fit_trials(drops, find(law, variant))
    grid = brute_force(law, variant, drops, Box(), (60, 30, 60) if slow else (110, 50, 160))
    assert (fit.error <= grid + BEATEN).all()
    attained = distances(find(law, variant), drops, fit.mu, fit.eps, target="momentum")
    torch.testing.assert_close(fit.error, attained, rtol=0, atol=1e-9 * size(drops).max().item())


@pytest.mark.parametrize(("law", "variant"), DISTINCT)
def test_no_grid_beats_any_trial_in_a_smaller_box(law, variant):
    drops = synthetic.load(80, law, 0.15, 0.5, velocity_noise=0.1, spin_noise=4.0, variant=variant)
    box = Box(mu=(0.05, 0.3), eps=(0.35, 0.6))
    fit = fit_trials(drops, find(law, variant), box=box)
    assert (fit.error <= brute_force(law, variant, drops, box, (40, 20, 60)) + BEATEN).all()
    for values, (low, high) in ((fit.mu, box.mu), (fit.mu_low, box.mu), (fit.mu_high, box.mu), (fit.eps, box.eps)):
        assert (low <= values).all()
        assert (values <= high).all()
    if (law, variant) != VISCOUS:
        assert (fit.mu_high == 0.3).any()  # the bound itself, not a single-precision neighbour


def test_grids_rarely_win_on_extreme_bodies():
    """|r| up to thirty radii of gyration, and impulses far from the law: basins a thousandth of the box wide."""
    n, generator = 1500, seeded(7)
    mass, inertia, r, v = random_bodies(n, seed=7)
    W, v_c = rigid_body.inverse_inertia(mass, inertia, r), rigid_body.contact_velocity(r, v)
    mu, eps = torch.rand((2, n), generator=generator, dtype=torch.float64)
    P = impulse("wang_mason", W, v_c, mu**2, eps)
    noise = torch.tensor((0.0, 0.01, 0.1, 0.5), dtype=torch.float64).repeat(n // 4 + 1)[:n, None]
    P += noise * P.norm(dim=-1, keepdim=True) * torch.randn((n, 2), generator=generator, dtype=torch.float64)
    P[::5, 0] *= -1  # friction along the slip, as in the published drops
    v_post = rigid_body.apply_wrench(mass, inertia, r, v, torch.nn.functional.pad(P, (0, 1)))
    impacts = Impacts(mass, inertia, r, torch.zeros_like(v), v, v_post)
    fit = fit_trials(impacts, find("wang_mason"))
    lost = fit.error - brute_force("wang_mason", "textbook", impacts, Box(), (80, 40, 100)) > 1e-9 * size(impacts)
    assert lost.sum() <= 1


@pytest.mark.parametrize(("law", "variant"), DISTINCT)
def test_drops_that_obey_the_law_are_fitted_exactly(law, variant):
    drops = exact_drops(200, law, variant)
    fit = fit_trials(drops, find(law, variant))
    assert (fit.error <= EXACT * size(drops)).all()


@pytest.mark.parametrize("target", ["least_squares", "contact"])
def test_error_is_against_the_target(target):
    drops = synthetic.load(50, velocity_noise=0.05, spin_noise=5.0)
    fit = fit_trials(drops, find("wang_mason"), target=target)
    attained = distances(find("wang_mason"), drops, fit.mu, fit.eps, target=target)
    torch.testing.assert_close(fit.error, attained, rtol=0, atol=1e-9 * size(drops).max().item())
    assert (fit.error <= 0.2 * size(drops)).all()


@pytest.mark.parametrize(("law", "variant"), NEWTON)
def test_a_sticking_trial_bounds_mu_below_only(law, variant):
    """By |P_t| / P_n, what the cone needs."""
    drops = exact_drops(300, law, variant)
    v_t = drops.v_c[:, 0] + (drops.W @ drops.wrench[:, :2, None])[:, 0, 0]
    sticks = v_t.abs() < 1e-9
    assert 50 < sticks.sum() < 250
    fit = fit_trials(drops, find(law, variant))
    assert (fit.flat == sticks).all()
    assert (fit.mu_high[sticks] == 1).all()
    cone = drops.wrench[:, 0].abs() / drops.wrench[:, 1]
    torch.testing.assert_close(fit.mu_low[sticks], cone[sticks], rtol=0, atol=INTERVAL)
    torch.testing.assert_close(fit.eps, torch.full_like(fit.eps, 0.55), rtol=0, atol=INTERVAL)


@pytest.mark.parametrize(("law", "variant"), SLIDES)
def test_a_sliding_trial_determines_mu(law, variant):
    drops = exact_drops(300, law, variant)
    # On the edge of the cone, where restitution without friction leaves 1 / (1 + ε) of the slope.
    without_friction = (law, variant) in (("anitescu_potra_poisson", "fazeli2017"), ("drumwright_shell", "fazeli2017"))
    slope = drops.wrench[:, 0].abs() / drops.wrench[:, 1] * (1.55 if without_friction else 1)
    slides = (slope - 0.12).abs() < 1e-9
    fit = fit_trials(drops, find(law, variant))
    assert slides.sum() > 20
    for mu in (fit.mu, fit.mu_low, fit.mu_high):
        torch.testing.assert_close(mu[slides], torch.full_like(mu[slides], 0.12), rtol=0, atol=INTERVAL)
    assert not fit.flat[slides].any()
    torch.testing.assert_close(fit.eps[slides], torch.full_like(fit.eps[slides], 0.55), rtol=0, atol=INTERVAL)


@pytest.mark.parametrize(("law", "variant", "source"), paired(SLIDES, SOURCES))
def test_the_error_is_level_on_the_interval_and_rises_beyond_it(law, variant, source, request):
    drops = drops_of(source, 300, law, variant, request, 1, **NOISY)
    fit = fit_trials(drops, find(law, variant))
    assert (fit.mu_low <= fit.mu).all()
    assert (fit.mu <= fit.mu_high).all()
    rows = fit.flat.nonzero()[:40, 0]
    assert len(rows) > 3
    drops, scale, error = drops[rows], size(drops)[rows], fit.error[rows]
    low, high = fit.mu_low[rows], fit.mu_high[rows]
    for share in (0.0, 0.1, 0.5, 1.0):
        inside = best_in_eps(law, variant, drops, low + share * (high - low))
        assert (inside <= error + 2 * ALLOWED * scale).all()
        assert (inside >= error - 2 * ALLOWED * scale).all()
    for end, step in ((low, -1e-3), (high, 1e-3)):
        outside = (end + step >= 0) & (end + step <= 1)
        if outside.any():
            rows = outside.nonzero()[:, 0]
            beyond = best_in_eps(law, variant, drops[rows], (end + step)[rows])
            assert (beyond > error[rows] + ALLOWED * scale[rows]).all()


@pytest.mark.parametrize(("law", "variant", "source"), paired(SLIDES, SOURCES))
def test_a_smooth_minimum_is_no_interval(law, variant, source, request):
    """Where the error is not 0 it is level to second order; only plateaus count, and these are wide."""
    drops = drops_of(source, 300, law, variant, request, 1, **NOISY)
    fit = fit_trials(drops, find(law, variant))
    width = fit.mu_high - fit.mu_low
    assert not ((width > 1e-6) & (width < 1e-4)).any()
    assert (fit.flat == (width > 1e-6)).all()


@pytest.mark.parametrize(("law", "variant"), DISTINCT)
def test_scale_and_mirror_change_nothing_else(law, variant):
    drops = synthetic.load(60, law, 0.15, 0.5, velocity_noise=0.1, spin_noise=4.0, variant=variant)
    base = fit_trials(drops, find(law, variant))
    flip = torch.tensor((-1.0, 1.0, -1.0), dtype=torch.float64)  # x and the sense of rotation
    fields = {"r": drops.r * flip[:2], "q": drops.q * flip, "v_pre": drops.v_pre * flip, "v_post": drops.v_post * flip}
    heavy = drops.replace(mass=4 * drops.mass, inertia=4 * drops.inertia)
    others = [(heavy, 4), (drops.replace(**fields), 1)]
    if (law, variant) != VISCOUS:  # whose μ is in s/m
        others.append((drops.replace(v_pre=2 * drops.v_pre, v_post=2 * drops.v_post), 2))
    for impacts, scale in others:
        other = fit_trials(impacts, find(law, variant))
        torch.testing.assert_close(
            other.error, scale * base.error, rtol=0, atol=scale * 1e-10 * size(drops).max().item()
        )


def test_trials_are_independent():
    drops = synthetic.load(150, velocity_noise=0.1, spin_noise=4.0)
    rows = torch.tensor((3, 77, 140))
    some, every = fit_trials(drops[rows], find("wang_mason")), fit_trials(drops, find("wang_mason"))
    one = fit_trials(drops[rows[1:2]], find("wang_mason"))
    for name in ("mu", "eps", "error", "mu_low", "mu_high"):
        torch.testing.assert_close(getattr(some, name), getattr(every, name)[rows], rtol=1e-6, atol=1e-9)
        torch.testing.assert_close(getattr(one, name), getattr(every, name)[rows[1:2]], rtol=1e-6, atol=1e-9)
    drops = synthetic.load(40)
    before = torch.get_rng_state()
    first, second = fit_trials(drops, find("mirtich")), fit_trials(drops, find("mirtich"))
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(first.mu, second.mu)
    assert (first.law.name, first.law.variant) == ("mirtich", "textbook")
    drops = synthetic.load(5)
    with pytest.raises(UnknownNameError, match="did you mean 'whittaker'"):
        fit_trials(drops, find("witaker"))
    with pytest.raises(UnknownNameError, match="did you mean 'textbook'"):
        fit_trials(drops, find("whittaker", "textbok"))
    with pytest.raises(UnknownNameError, match="did you mean 'contact'"):
        fit_trials(drops, find("whittaker"), target="contakt")
