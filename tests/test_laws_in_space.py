"""The impact laws in space against independent references: a cone programme, its conditions, a fine integration."""

from itertools import pairwise

import clarabel
import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.integrate import solve_ivp

from contactlearn.laws import find, names
from contactlearn.laws.contact import SpatialContact
from contactlearn.laws.hodograph import STEPS, Hodograph, after_impulse, after_work, until
from contactlearn.laws.spring_dashpot import LEAST, damping
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.space import SPACE
from contactlearn.testing.laws import Contacts

CONTACTS = Contacts.draw_in_space(20_000, seed=4)
ROUNDING = 1e-9  # of |M_c v_c|, |v_c| and their product
SOLVER = 1e-6  # of |P^c|: a gap of 1e-13 of the energy, whose square root is the error in P
COARSE = 5e-3  # of |P|, of the midpoint steps of a law on nearly all contacts that slide; few turn within one of them


def solved(name, c=CONTACTS):
    return find(name).at(c.mu, c.eps).impulse(c.W, c.v_c)


def after(P, c=CONTACTS):
    return c.v_c + rigid_body.matvec(c.W, P)


def test_complementarity_is_that_of_a_circular_cone():
    """v_n⁺ = −ε v_n, and friction opposes the final slip on the cone or ends it within."""
    P, size = solved("anitescu_potra_newton"), CONTACTS.size() * CONTACTS.v_c.norm(dim=-1)
    v = after(P)
    assert ((v + CONTACTS.eps[:, None] * CONTACTS.v_c)[:, 2].abs() <= ROUNDING * CONTACTS.v_c.norm(dim=-1)).all()
    friction, slip = P[:, :2], v[:, :2]
    across = friction[:, 0] * slip[:, 1] - friction[:, 1] * slip[:, 0]
    assert (across.abs() <= ROUNDING * size).all()
    assert ((friction * slip).sum(-1) <= ROUNDING * size).all()
    slack = (CONTACTS.mu * P[:, 2] - friction.norm(dim=-1)) * slip.norm(dim=-1)
    assert (slack.abs() <= ROUNDING * size).all()


def test_compression_is_the_solution_of_the_cone_programme():
    """P ∈ K, v⁺ ∈ K*, P·v⁺ = 0: necessary and sufficient, for the programme is convex."""
    P = solved("drumwright_shell") / (1 + CONTACTS.eps)[:, None]
    v, size = after(P), CONTACTS.size() * CONTACTS.v_c.norm(dim=-1)
    assert ((P * v).sum(-1).abs() <= ROUNDING * size).all()
    assert (CONTACTS.mu * v[:, :2].norm(dim=-1) - v[:, 2] <= ROUNDING * CONTACTS.v_c.norm(dim=-1)).all()


def slender(count=20_000, seed=6):
    """Contacts whose W has moments apart by up to 100, at friction up to 3."""
    generator = torch.Generator().manual_seed(seed)
    axes = torch.linalg.qr(torch.randn(count, 3, 3, generator=generator, dtype=torch.float64))[0]
    u = torch.rand(count, 5, generator=generator, dtype=torch.float64)
    W = axes @ torch.diag_embed(10 ** (2 * u[:, :3])) @ axes.mT
    c = Contacts.draw_in_space(count, seed)
    return c._replace(W=W, mu=10 ** (4 * u[:, 3] - 3.5))


def test_slender_bodies_have_the_one_solution_and_keep_to_the_cone():
    c = slender()
    P, size = solved("drumwright_shell", c) / (1 + c.eps)[:, None], c.size()
    v, speed = after(P, c), c.v_c.norm(dim=-1)
    assert ((P * v).sum(-1).abs() <= ROUNDING * size * speed).all()
    assert (c.mu * v[:, :2].norm(dim=-1) - v[:, 2] <= ROUNDING * speed).all()
    for name in ("wang_mason", "mirtich", "wang_mason_newton"):
        P = solved(name, c)
        assert (P[:, :2].norm(dim=-1) - c.mu * P[:, 2] <= ROUNDING * size).all()


def test_compression_is_that_of_a_solver():
    c = CONTACTS.part(slice(40))
    P = solved("drumwright_shell", c) / (1 + c.eps)[:, None]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas = False, 1e-13, 1e-13, 1e-13
    for W, v_c, mu, found in zip(*(x.numpy() for x in (c.W, c.v_c, c.mu, P)), strict=True):
        # The cone (μ P_n, P_1, P_2), in units of the impulse that the solution has.
        size = np.linalg.norm(found)
        A = sparse.csc_matrix(np.array([[0, 0, -mu], [-1, 0, 0], [0, -1, 0]]))
        H, g = sparse.csc_matrix(np.triu(W)), v_c / size
        cone = [clarabel.SecondOrderConeT(3)]
        solution = clarabel.DefaultSolver(H, g, A, np.zeros(3), cone, settings).solve()
        assert np.linalg.norm(np.array(solution.x) - found / size) <= SOLVER**0.5 if mu == 0 else SOLVER * 100


def reference(W, v_c, mu):
    """P_n, v_c and P_t at the end of compression on Routh's path, if it slides until then."""

    def rates(p, y):
        q = -mu * y[:2] / np.hypot(*y[:2])
        return np.concatenate((W @ np.append(q, 1.0), q))

    def done(p, y):
        return y[2]

    def rests(p, y):
        return np.hypot(*y[:2]) - 1e-6

    done.terminal = rests.terminal = True
    start, size = np.append(v_c, (0.0, 0.0)), np.linalg.norm(v_c) / np.linalg.eigvalsh(W)[0]
    found = solve_ivp(rates, (0, 20 * size), start, "DOP853", events=(done, rests), rtol=1e-11, atol=1e-13)
    return None if len(found.t_events[1]) or not len(found.t_events[0]) else (found.t[-1], found.y[:, -1])


@pytest.fixture(scope="module")
def sliding():
    """Contacts that slide up to the end of compression, and the impulse there by a fine integration."""
    c = Contacts.draw_in_space(60, seed=11)
    rows, impulses = [], []
    for row, (W, v_c, mu) in enumerate(zip(c.W.numpy(), c.v_c.numpy(), c.mu.numpy(), strict=True)):
        if np.hypot(*v_c[:2]) > 1e-3 and (found := reference(W, v_c, mu)):
            p, y = found
            rows.append(row)
            impulses.append((*y[3:], p))
    assert len(rows) > 20
    return Contacts(*(x[rows] for x in c)), torch.tensor(np.array(impulses))


def compressed(c, steps):
    contact, (cos, sin) = SpatialContact.of(c.W, c.v_c)
    P_1, P_2, P_n = Hodograph(contact, c.mu, steps).compressed().impulse
    return torch.stack((cos * P_1 - sin * P_2, sin * P_1 + cos * P_2, P_n), -1)


def test_the_path_is_that_of_a_fine_integration(sliding):
    c, P = sliding
    error = (compressed(c, STEPS) - P).norm(dim=-1) / P.norm(dim=-1)
    assert error.median() < 1e-4
    assert error.quantile(0.9) < COARSE
    finer = (compressed(c, 400) - P).norm(dim=-1) / P.norm(dim=-1)
    assert finer.quantile(0.9) < 1e-6
    assert finer.max() < 1e-3  # a slip that turns within a hundredth of the compression


def test_the_integrator_is_of_second_order(sliding):
    c, P = sliding
    errors = [(compressed(c, steps) - P).norm(dim=-1) for steps in (25, 50, 100)]
    turned = errors[0] > 1e-7 * P.norm(dim=-1)
    assert turned.sum() > 10
    for coarse, fine in pairwise(errors):
        assert (coarse / fine)[turned].median().item() == pytest.approx(4, rel=0.15)


def test_restitutions_are_those_of_the_path(sliding):
    c, _ = sliding
    contact, _ = SpatialContact.of(c.W, c.v_c)
    path = Hodograph(contact, c.mu)
    half = path.compressed()
    torch.testing.assert_close(path.followed(half, until(-0.5 * contact.v_n)).v_n, -0.5 * contact.v_n)
    torch.testing.assert_close(path.followed(half, after_impulse(1.5 * half.P_n)).P_n, 1.5 * half.P_n)
    goal = 0.75 * half.work
    torch.testing.assert_close(path.followed(half, after_work(goal)).work, goal)


@pytest.mark.parametrize("name", ["wang_mason", "wang_mason_newton", "mirtich"])
def test_the_derivative_in_restitution_is_that_of_one_step(name):
    """Also where restitution ends with a step of the path, as ε = 0.6 may: no step counts twice or is left out."""
    c, law, h = Contacts(*(x[:500] for x in CONTACTS)), find(name), 1e-6
    for value in (0.0, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0):
        eps = torch.full_like(c.eps, value).requires_grad_()
        P_n = law.at(c.mu, eps).impulse(c.W, c.v_c)[:, 2]
        slope = torch.autograd.grad(P_n.sum(), eps)[0]
        below, here, above = (
            law.at(c.mu, (eps.detach() + x).clamp(0, 1)).impulse(c.W, c.v_c)[:, 2] for x in (-h, 0, h)
        )
        sides = torch.stack((here - below, above - here)) / h
        apart = (sides - slope).abs().amin(0) / (1e-9 + slope.abs())
        assert (apart < 1e-3).double().mean() > 0.98, value


def pushed(W, v_c, mu, eps):
    """P until a spring and a dashpot no longer push, in their own time, if the contact slides until then."""
    zeta = damping(torch.tensor(eps)).ratio.item()

    def rates(t, y):
        dp = max(y[6], 0.0) / W[2, 2] * np.append(-mu * y[:2] / np.hypot(*y[:2]), 1.0)
        dv = W @ dp
        return np.concatenate((dv, dp, [-y[2] + 2 * zeta * -dv[2]]))

    def ends(t, y):
        return y[6]

    def rests(t, y):
        return np.hypot(*y[:2]) - 1e-4

    ends.terminal = rests.terminal = True
    ends.direction = -1
    start = np.concatenate((v_c, np.zeros(3), [-2 * zeta * v_c[2]]))
    found = solve_ivp(rates, (0, 40), start, "DOP853", events=(ends, rests), rtol=1e-10, atol=1e-12)
    return None if len(found.t_events[1]) or not len(found.t_events[0]) else found.y[3:6, -1]


def test_a_spring_and_a_dashpot_are_those_of_a_fine_integration_in_time():
    c = Contacts.draw_in_space(80, seed=12)
    errors = []
    for W, v_c, mu, eps, P in zip(*(x.numpy() for x in (*c, solved("spring_dashpot", c))), strict=True):
        if eps > LEAST and np.hypot(*v_c[:2]) > 1e-3 and (found := pushed(W, v_c, mu, eps)) is not None:
            errors.append(np.linalg.norm(P - found) / np.linalg.norm(found))
    assert len(errors) > 15
    assert np.median(errors) < 1e-4
    assert np.quantile(errors, 0.9) < COARSE


def test_without_restitution_or_coupling_the_laws_agree():
    c = CONTACTS._replace(eps=torch.zeros_like(CONTACTS.eps))
    close = dict(rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(solved("anitescu_potra_newton", c), solved("anitescu_potra_poisson", c), **close)
    torch.testing.assert_close(solved("wang_mason", c), solved("mirtich", c), **close)
    balanced = torch.diag_embed(torch.stack((c.W[:, 0, 0], c.W[:, 0, 0], c.W[:, 2, 2]), -1))
    balanced = CONTACTS._replace(W=balanced)
    P = [solved(name, balanced) for name in ("whittaker", "anitescu_potra_newton", "wang_mason", "mirtich")]
    for other in P[1:]:
        torch.testing.assert_close(other, P[0], **close)


def test_the_slip_turns_in_space():
    """What the plane cannot tell apart: the laws differ by their path where friction is not along the first slip."""
    P = torch.stack([solved(name) for name in ("whittaker", "anitescu_potra_newton", "wang_mason")])
    apart = (P - P[2]).norm(dim=-1) / P[2].norm(dim=-1)
    assert apart[:2].median() > 1e-3


@pytest.mark.parametrize("name", [name for name in names() if SPACE in find(name).spaces])
def test_a_contact_without_slip_has_its_derivatives(name):
    """A box that falls straight down, where control begins; against differences where those of both sides agree."""
    W, mu = CONTACTS.W[:300], torch.ones(300, dtype=torch.float64)
    v_c, h = CONTACTS.v_c[:300] * torch.tensor((0.0, 0.0, 1.0)), 1e-7
    law = find(name).at(mu, 0.6)
    slopes = torch.autograd.functional.jacobian(lambda v: law.impulse(W, v).sum(0), v_c).permute(1, 0, 2)
    here, steps = law.impulse(W, v_c), h * torch.eye(3, dtype=torch.float64)
    before, after = (
        (sign * torch.stack([law.impulse(W, v_c + sign * step) - here for step in steps], -1) / h) for sign in (-1, 1)
    )
    size = slopes.norm(dim=(-2, -1))
    smooth = (after - before).norm(dim=(-2, -1)) < 1e-4 * size
    assert smooth.sum() > 100
    difference = (slopes - (before + after) / 2).norm(dim=(-2, -1))
    assert (difference < 1e-6 * size)[smooth].all()
