"""The impact laws: what must hold on random contacts, and independent references (tests/contacts.py)."""

import dataclasses
import functools
import itertools

import contacts
import numpy as np
import pytest
import scipy
import torch
from contacts import DIFFER, DISTINCT, VARIANTS, Contacts, impulse, random_contacts, shared
from hypothesis import given, settings, strategies as st
from pairings import paired

from contactlearn.core.errors import UnknownNameError
from contactlearn.laws import PAPER_LAWS, catalogue, find, names
from contactlearn.mechanics import rigid_body
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic
from contactlearn.testing import LawContract

ROUNDING = 1e-9  # relative to |M_c v_c|, |v_c| and the incident energy: W is nearly singular for some
SOLVER = 2e-5  # of |P^c|: a gap of 1e-13 of the energy, whose square root is the error in P
STEP = 3.0  # of |P| / steps: where a path turns, the integration is wrong by a few of its steps
DIFFERENCE = 1e-5  # of |P|, relative to the largest derivative: central differences of step 1e-6
EXACT = {"rtol": 1e-13, "atol": 0}  # one contact and a batch may differ in how a last digit is rounded

NEWTON = ("whittaker", "anitescu_potra_newton", "wang_mason_newton")
POISSON = ("anitescu_potra_poisson", "drumwright_shell", "wang_mason")
PROFILE = settings(derandomize=True, deadline=None, database=None, max_examples=30)

N = 100_000
CONTACTS = random_contacts(N, seed=0)


def evaluate(name: str, c: Contacts, variant: str = "textbook", e_t: float = 0.3) -> torch.Tensor:
    """P [..., 2] of a law; e_t is only Chatterjee and Ruina's."""
    return impulse(name, *c, variant=variant, e_t=e_t)


@functools.cache
def on_all(name: str, variant: str = "textbook") -> torch.Tensor:
    """P of a law on all of CONTACTS."""
    return evaluate(name, CONTACTS, variant)


def after(c: Contacts, P: torch.Tensor) -> torch.Tensor:
    """(v_t⁺, v_n⁺) [..., 2]."""
    return c.v_c + (c.W @ P[..., None])[..., 0]


def momentum(c: Contacts) -> torch.Tensor:
    """|M_c v_c| [...]: the size of the impulse that would stop the contact point."""
    return (rigid_body.effective_inertia(c.W) @ c.v_c[..., None])[..., 0].norm(dim=-1)


def gain(c: Contacts, P: torch.Tensor) -> torch.Tensor:
    """Energy gained [...] relative to the incident one that the contact can reach, ½ v_cᵀ M_c v_c."""
    incident = 0.5 * (c.v_c * (rigid_body.effective_inertia(c.W) @ c.v_c[..., None])[..., 0]).sum(-1)
    return rigid_body.energy_excess(c.W, c.v_c, P) / incident


def cone_excess(c: Contacts, P: torch.Tensor) -> torch.Tensor:
    return (P[..., 0].abs() - c.mu * P[..., 1]) / momentum(c)


def one_contact(r: tuple, v_c: tuple, mu: float, eps: float, inertia: float = 1.0) -> Contacts:
    """One body of 1 kg, for examples in round numbers."""
    mass, inertia, r, v_c, mu, eps = (torch.tensor([x], dtype=torch.float64) for x in (1.0, inertia, r, v_c, mu, eps))
    return Contacts(rigid_body.inverse_inertia(mass, inertia, r), v_c, mu, eps)


def assert_close(P: torch.Tensor, Q: torch.Tensor, c: Contacts, tolerance: float = ROUNDING) -> None:
    error = (P - Q).norm(dim=-1) / momentum(c).maximum(Q.norm(dim=-1))
    assert error.max() <= tolerance


def relative_error(P: torch.Tensor, reference: np.ndarray) -> np.ndarray:
    return np.linalg.norm(P.numpy() - reference, axis=-1) / np.linalg.norm(reference, axis=-1)


SHIPPED = [kind() for family in catalogue().values() for kind in family.values()]
SHIPPED += [find("chatterjee_ruina", e_t=e_t) for e_t in (-1.0, 0.3, 1.0)]


@pytest.mark.parametrize(
    "law", SHIPPED, ids=lambda law: "-".join(map(str, (law.name, law.variant, *law.options.values())))
)
class TestShipped(LawContract):
    @pytest.fixture(autouse=True)
    def _chosen(self, law):
        self.law = law

    def test_it_declares_no_more_than_is_seen(self):
        assert self.differences() == {name: getattr(self.law, name) for name in self.differences()}


def test_frictionless_elastic_impact_keeps_the_energy():
    c = shared(CONTACTS, 0.0, 1.0)
    for name in names():
        assert gain(c, evaluate(name, c)).abs().max() <= ROUNDING


@pytest.mark.parametrize("name", NEWTON)
def test_restitution_that_gains_energy(name):
    share = (gain(CONTACTS, on_all(name)) > ROUNDING).double().mean()
    assert 0.001 <= share <= 0.1
    P = evaluate(name, KANE[name])
    torch.testing.assert_close(P, torch.tensor([[7 / 17, 10 / 17]], dtype=torch.float64))
    assert gain(KANE[name], P).item() == pytest.approx(3.5)


KANE = {
    # W = [[9, −8], [−8, 9]], a rod-like body that slips at 1 m/s: it leaves with 4.5 times the energy.
    name: one_contact(r=(-2.0, -2.0), v_c=(1.0, -1.0), mu=1.0, eps=1.0, inertia=0.5)
    for name in NEWTON
}


PAPER_GAINS = {  # law: contact, its impulse in N s, energy gained over the incident one
    "anitescu_potra_poisson": (one_contact((-2.0, -2.0), (-1.0, -1.0), 1.0, 1.0, 0.5), (1.0, 2.0), 3.5),
    "drumwright_shell": (one_contact((-2.0, -2.0), (-1.0, -1.0), 1.0, 1.0, 0.5), (1.0, 2.0), 3.5),
    "whittaker": (one_contact((-2.0, -2.0), (1.0, -1.0), 0.5, 1.0, 0.5), (5 / 17, 10 / 17), 325 / 34 - 5),
}


@pytest.mark.parametrize("name", PAPER_GAINS)
def test_paper_variant_gains_energy(name):
    c, P, energy = PAPER_GAINS[name]
    torch.testing.assert_close(evaluate(name, c, "fazeli2017"), torch.tensor([P], dtype=torch.float64))
    assert gain(c, evaluate(name, c, "fazeli2017")).item() == pytest.approx(energy)
    assert (gain(CONTACTS, on_all(name, "fazeli2017")) > ROUNDING).double().mean() > 0.01
    assert not rigid_body.admissible(c.W, c.v_c, evaluate(name, c, "fazeli2017")).any()


def test_paper_whittaker_leaves_the_cone_and_penetrates():
    assert {n for n in names() if not torch.equal(on_all(n), on_all(n, "fazeli2017"))} == DIFFER
    # Sticking with v_n⁺ = −ε v_n would need the floor to pull: P_n = (9 · 1.5 − 8 · 4) / 17 N s.
    c = one_contact((-2.0, -2.0), (4.0, -1.0), 1.0, 0.5, 0.5)
    P = evaluate("whittaker", c, "fazeli2017")
    torch.testing.assert_close(P, torch.tensor([[18.5 / 17, -18.5 / 17]], dtype=torch.float64))
    assert cone_excess(c, P) > 0.1
    assert after(c, P)[0, 1].item() == pytest.approx(-19.5)
    everywhere = on_all("whittaker", "fazeli2017")
    assert (cone_excess(CONTACTS, everywhere) > ROUNDING).any()
    assert (after(CONTACTS, everywhere)[:, 1] < -0.01).any()
    P, textbook = on_all("whittaker", "fazeli2017"), on_all("whittaker")
    target = -(1 + CONTACTS.eps) * CONTACTS.v_c[:, 1]
    sticking = torch.linalg.solve(CONTACTS.W, torch.stack((-CONTACTS.v_c[:, 0], target), -1))
    slides = sticking[:, 0].abs() > CONTACTS.mu * sticking[:, 1]
    torch.testing.assert_close(P[:, 1], sticking[:, 1], rtol=1e-7, atol=1e-9)
    torch.testing.assert_close(P[slides, 0].abs(), (CONTACTS.mu * P[:, 1]).abs()[slides])
    torch.testing.assert_close(P[~slides], textbook[~slides])
    pushes = slides & (P[:, 1] > 0)
    assert (P[:, 0] * after(CONTACTS, P)[:, 0])[pushes].max() <= ROUNDING  # against the final slip


@pytest.mark.parametrize("name", [*NEWTON, "chatterjee_ruina"])
def test_newton_restitution(name):
    v_n = after(CONTACTS, on_all(name))[:, 1]
    assert ((v_n + CONTACTS.eps * CONTACTS.v_c[:, 1]) / CONTACTS.v_c.norm(dim=-1)).abs().max() <= ROUNDING


@pytest.mark.parametrize("name", POISSON)
def test_poisson_restitution(name):
    compression = evaluate(name, CONTACTS._replace(eps=torch.zeros(N, dtype=torch.float64)))
    torch.testing.assert_close(on_all(name)[:, 1], (1 + CONTACTS.eps) * compression[:, 1], rtol=ROUNDING, atol=0)
    if name in ("anitescu_potra_poisson", "drumwright_shell"):
        scale = torch.stack((torch.ones(N), 1 + CONTACTS.eps), -1)
        torch.testing.assert_close(on_all(name, "fazeli2017"), scale * compression, rtol=ROUNDING, atol=0)
    if name != "drumwright_shell":  # compression ends where the approach does
        assert (after(CONTACTS, compression)[:, 1] / CONTACTS.v_c.norm(dim=-1)).abs().max() <= ROUNDING


def test_impulses_are_complementary_or_optimal():
    P = on_all("anitescu_potra_newton")
    slip = after(CONTACTS, P)[:, 0] / CONTACTS.v_c.norm(dim=-1)
    assert (slip * P[:, 0] / momentum(CONTACTS)).max() <= ROUNDING
    assert (slip * cone_excess(CONTACTS, P)).abs().max() <= ROUNDING
    P = on_all("whittaker")
    slides = (cone_excess(CONTACTS, P).abs() <= ROUNDING) & (CONTACTS.v_c[:, 0] != 0) & (CONTACTS.mu > 0)
    sticks = (after(CONTACTS, P)[:, 0] / CONTACTS.v_c.norm(dim=-1)).abs() <= ROUNDING
    assert (P[:, 0] * CONTACTS.v_c[:, 0])[slides & ~sticks].max() < 0
    assert (slides | sticks | (CONTACTS.v_c[:, 0] == 0) | (CONTACTS.mu == 0)).all()
    assert min(slides.sum(), sticks.sum()) > N / 10
    # Optimality in the cone {N (±μ, 1)}: v_c⁺ makes no obtuse angle with either edge, and none with P^c
    # but a right one.  v_n⁺ ≥ 0 follows, so that constraint never acts.
    P = on_all("drumwright_shell") / (1 + CONTACTS.eps[:, None])
    v_t, v_n = (after(CONTACTS, P) / CONTACTS.v_c.norm(dim=-1, keepdim=True)).unbind(-1)
    assert (v_n - CONTACTS.mu * v_t.abs()).min() >= -ROUNDING
    assert ((v_t * P[:, 0] + v_n * P[:, 1]) / P.norm(dim=-1)).abs().max() <= ROUNDING


def test_plastic_impact_makes_pairs_agree():
    uncoupled = CONTACTS._replace(W=CONTACTS.W * torch.eye(2, dtype=torch.float64))
    reference = evaluate("whittaker", uncoupled)
    for name in ("anitescu_potra_newton", "anitescu_potra_poisson", "wang_mason", "mirtich", "wang_mason_newton"):
        assert_close(evaluate(name, uncoupled), reference, uncoupled)
    reference = on_all("wang_mason")
    lasting = CONTACTS.v_c[:, 0] * after(CONTACTS, reference)[:, 0] > ROUNDING * CONTACTS.v_c.norm(dim=-1) ** 2
    assert lasting.sum() > N / 10
    for name in ("whittaker", "anitescu_potra_newton", "anitescu_potra_poisson", "mirtich", "wang_mason_newton"):
        assert_close(on_all(name)[lasting], reference[lasting], CONTACTS[lasting])
    plastic = shared(CONTACTS, 0.0, 0.0)._replace(mu=CONTACTS.mu)
    paths = ("wang_mason", "mirtich"), ("wang_mason", "wang_mason_newton")
    for one, other in (("anitescu_potra_newton", "anitescu_potra_poisson"), *paths):
        assert_close(evaluate(one, plastic), evaluate(other, plastic), plastic)
        assert not torch.allclose(on_all(one), on_all(other), rtol=1e-3)


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
def test_without_friction(name, variant):
    c = CONTACTS._replace(mu=torch.zeros(N, dtype=torch.float64))
    P = evaluate(name, c, variant)
    assert (P[:, 0] == 0).all()
    if (name, variant) != ("whittaker", "fazeli2017"):  # which keeps the P_n of sticking
        torch.testing.assert_close(P[:, 1], -(1 + c.eps) * c.v_c[:, 1] / c.W[:, 1, 1], rtol=ROUNDING, atol=0)


def number(low: float, high: float, *special: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False) | st.sampled_from((low, high, *special))


@PROFILE
@given(
    r=st.tuples(number(-2, 2, 0.0, 1.0), number(-2, -0.01, -1.0)),
    v_c=st.tuples(number(-10, 10, 0.0, 1e-9, -1.0), number(-10, -0.01, -1.0)), mu=number(0, 2, 1.0, 1e-9),
    eps=number(0, 1, 0.5, 1e-9), inertia=number(0.1, 10, 1.0),
)  # fmt: skip
def test_any_contact(r, v_c, mu, eps, inertia):
    """Round numbers and edges, which random draws miss: admissible, mirrored, finite with its gradients."""
    c = one_contact(r, v_c, mu, eps, inertia)
    mirrored = one_contact((-r[0], r[1]), (-v_c[0], v_c[1]), mu, eps, inertia)
    for name in names():
        P = evaluate(name, c)
        assert P[0, 1] > 0
        assert cone_excess(c, P) <= ROUNDING
        assert after(c, P)[0, 1] / c.v_c.norm() >= -ROUNDING
        assert name in NEWTON or gain(c, P) <= ROUNDING
        for variant in VARIANTS if name in DIFFER else VARIANTS[:1]:
            P = evaluate(name, c, variant)
            assert_close(evaluate(name, mirrored, variant) * torch.tensor([-1.0, 1.0]), P, c)
            assert all(g.isfinite().all() for g in gradients(name, variant, c))


@pytest.mark.parametrize("e_t", [-1.0, 0.0, 0.5, 1.0])
def test_chatterjee_ruina_rebounds_tangentially(e_t):
    # Within the cone e_t acts on the slip u that the plastic frictionless impulse P_I leaves; what
    # normal restitution adds to the slip after that stays.
    c = CONTACTS._replace(mu=torch.full((N,), 1e3, dtype=torch.float64))
    P = evaluate("chatterjee_ruina", c, e_t=e_t)
    inside = cone_excess(c, P) < -ROUNDING
    rebound = -c.v_c[:, 1] / c.W[:, 1, 1]
    u = c.v_c[:, 0] + c.W[:, 0, 1] * rebound
    slip = after(c, P)[:, 0] - c.eps * c.W[:, 0, 1] * rebound
    assert ((slip + e_t * u) / c.v_c.norm(dim=-1))[inside].abs().max() <= ROUNDING
    assert inside.double().mean() > 0.3


def test_chatterjee_ruina_on_the_cone_keeps_its_line():
    c = one_contact((0.0, -1.0), (2.0, -1.0), mu=1e3, eps=0.6)
    assert after(c, evaluate("chatterjee_ruina", c, e_t=0.0))[0, 0].abs() < ROUNDING
    assert after(c, evaluate("chatterjee_ruina", c, e_t=1.0))[0, 0].item() == pytest.approx(-2.0)
    # Where the cone stops it, P lies on the line of e_t and on the cone.
    c = c._replace(mu=torch.tensor([0.1], dtype=torch.float64))
    torch.testing.assert_close(evaluate("chatterjee_ruina", c, e_t=1.0), torch.tensor([[-0.16, 1.6]]).double())
    c, P = CONTACTS, on_all("chatterjee_ruina")
    stop = torch.linalg.solve(c.W, -c.v_c)
    start = torch.stack((torch.zeros(N), -c.v_c[:, 1] / c.W[:, 1, 1]), -1)
    line, offset = stop - start, P - (1 + c.eps[:, None]) * start
    size = momentum(c)
    assert ((line[:, 0] * offset[:, 1] - line[:, 1] * offset[:, 0]) / size**2).abs().max() <= ROUNDING
    stuck = line.norm(dim=-1) <= 1e-6 * size  # hardly any slip or coupling: nothing to restore
    factor = torch.where(stuck, 1.3, (line * offset).sum(-1) / torch.where(stuck, 1.0, (line * line).sum(-1)))
    on_cone = cone_excess(c, P).abs() <= ROUNDING
    assert factor.min() >= -ROUNDING
    assert factor.max() <= 1.3 + ROUNDING
    assert (on_cone | ((factor - 1.3).abs() <= 1e-6)).all()
    assert min(on_cone.sum(), (~on_cone).sum()) > N / 10


@pytest.mark.parametrize("restitution", ["newton", "poisson"])
def test_anitescu_potra_against_complementarity(restitution):
    c = random_contacts(500, seed=1)
    reference, extra = contacts.anitescu_potra(c, restitution)
    assert relative_error(evaluate(f"anitescu_potra_{restitution}", c), reference).max() < 1e-9
    if restitution == "poisson":  # decompression never needs more than ε P_n^c
        assert extra.max() < 1e-9


def test_drumwright_shell_against_a_convex_solver():
    c = random_contacts(400, seed=2)
    P = evaluate("drumwright_shell", c) / (1 + c.eps[:, None])
    assert relative_error(P, contacts.drumwright_shell_compression(c)).max() < SOLVER


MODES = {  # phase in which the slip ends, and whether it reverses
    "sliding": (2, False),
    "C-sticking": (0, False),
    "R-sticking": (1, False),
    "C-reversed": (0, True),
    "R-reversed": (1, True),
}
PATHS = {"wang_mason": "poisson", "wang_mason_newton": "newton", "mirtich": "stronge"}


@functools.cache
def by_mode(name: str) -> tuple[Contacts, contacts.Integrated]:
    c = random_contacts(6000, seed=3)
    return c, contacts.integrate(c, PATHS[name], "coulomb", 300)


@pytest.mark.parametrize(("name", "mode"), paired([*PATHS], [*MODES]))
def test_coulomb_path_against_integration(name, mode):
    c, coarse = by_mode(name)
    ended, turned = MODES[mode]
    c = c[torch.from_numpy(np.flatnonzero((coarse.slip_ended == ended) & (coarse.reversed == turned))[:80])]
    assert len(c.mu) >= 20
    P, error = evaluate(name, c), {}
    for steps in (250, 4000):
        error[steps] = relative_error(P, contacts.integrate(c, PATHS[name], "coulomb", steps).P)
        assert error[steps].max() < STEP / steps
    if mode == "sliding":  # without a turn the steps are exact
        assert error[4000].max() < ROUNDING
    elif turned:  # first order: sixteen times the steps, a sixteenth of the error
        assert 8 < error[250].mean() / error[4000].mean() < 32
    else:  # the step that ends the slip is not cut, and errs only in its work: second order
        assert error[4000].max() < 1e-5
        assert name != "mirtich" or 100 < error[250].mean() / error[4000].mean() < 500


def sprung(c: Contacts) -> list[float]:
    """P of one contact with ε ≥ 0.05, from its motion in time with a rigid tangent until the force vanishes."""
    (w_tt, w_tn), (_, w_nn) = c.W.tolist()
    (v_t, v_n), mu, eps = c.v_c.tolist(), c.mu.item(), c.eps.item()

    def loss(zeta: float) -> float:
        angle = np.arccos(zeta) if zeta < 1 else np.arccosh(zeta)
        return np.log(eps) + 2 * zeta * angle / np.sqrt(abs(1 - zeta**2))

    zeta = scipy.optimize.brentq(loss, 1e-12, 5.0)
    state, held = [0.0, v_t, v_n, 0.0, 0.0], float(np.clip(-w_tn / w_tt, -mu, mu))
    for slope in (-np.sign(v_t) * mu, held):

        def force(x: float, v_n: float) -> float:
            return (x - 2 * zeta * v_n) / w_nn

        def motion(_: float, s: np.ndarray, slope: float = slope) -> list[float]:
            f = force(s[0], s[2])
            t = slope * f
            return [-s[2], w_tt * t + w_tn * f, w_tn * t + w_nn * f, t, f]

        def separated(time: float, s: np.ndarray) -> float:
            return force(s[0], s[2]) if time > 0 else 1.0

        def gripped(_: float, s: np.ndarray) -> float:
            return s[1] * np.sign(v_t)

        separated.terminal, separated.direction = True, -1
        gripped.terminal, gripped.direction = True, -1
        events = (separated, gripped) if slope is not held else (separated,)
        path = scipy.integrate.solve_ivp(motion, (0, 1e3), state, "DOP853", events=events, rtol=1e-10, atol=1e-13)
        state = path.y[:, -1]
        if len(path.t_events[0]):
            break
    return state[3:].tolist()


def test_spring_and_dashpot_against_integration_in_time():
    c = random_contacts(200, seed=6)
    c = c[(c.eps > 0.05) & (c.eps < 1) & (c.v_c[:, 0] != 0) & (c.mu > 0)][:60]
    expected = np.array([sprung(c[k]) for k in range(len(c.mu))])
    assert relative_error(evaluate("spring_dashpot", c), expected).max() < 1e-8
    assert not torch.allclose(evaluate("spring_dashpot", c), evaluate("mirtich", c), rtol=1e-2)


def test_viscous_path_against_integration():
    c = random_contacts(400, seed=4)
    P = evaluate("mirtich", c, "fazeli2017")
    coarse, fine = (contacts.integrate(c, "stronge", "viscous", steps).P for steps in (1000, 4000))
    errors = [relative_error(P, x) for x in (coarse, fine)]
    assert errors[1].max() < 1e-7
    assert 8 < np.median(errors[0]) / np.median(errors[1]) < 32  # second order
    c = random_contacts(3000, seed=5)
    start, end = (evaluate("mirtich", x, "fazeli2017") for x in (c._replace(eps=torch.zeros_like(c.eps)), c))
    for p, P_t in ((start[:, 1], start[:, 0]), (end[:, 1], end[:, 0])):
        assert ((viscous_path(c, p)[0] - P_t) / momentum(c)).abs().max() <= ROUNDING
    assert (after(c, start)[:, 1] / c.v_c.norm(dim=-1)).abs().max() <= ROUNDING
    work_c, work = viscous_work(c, start[:, 1]), viscous_work(c, end[:, 1])
    assert ((work - (1 - c.eps**2) * work_c) / work_c).abs().max() <= ROUNDING


def viscous_path(c: Contacts, p: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """(P_t, v_n) at p [n] or [n, k] on dP_t/dp = −μ v_t, whose slip decays as e^−z with z = μ W_tt p."""
    w_tt, w_tn, w_nn, v_t, v_n, mu = (
        x.reshape(-1, *[1] * (p.ndim - 1)) for x in (c.W[:, 0, 0], c.W[:, 0, 1], c.W[:, 1, 1], *c.v_c.unbind(-1), c.mu)
    )
    z = mu * w_tt * p
    share = torch.where(z > 0, -torch.expm1(-z) / torch.where(z > 0, z, 1.0), 1.0)  # (1 − e^−z) / z
    # v_t = v_t⁻ e^−z + W_tn p share, and the same v_t = v_t⁻ + W_tt P_t + W_tn p.
    P_t = torch.where(mu > 0, (v_t * torch.expm1(-z) - w_tn * p * (1 - share)) / w_tt, 0.0)
    return P_t, v_n + w_tn * P_t + w_nn * p


def viscous_work(c: Contacts, p: torch.Tensor) -> torch.Tensor:
    """∫ v_n dp from 0 to p [n] by 16-point Gauss–Legendre on parts that get longer as the slip decays."""
    nodes, weights = (torch.from_numpy(x) for x in np.polynomial.legendre.leggauss(16))
    edges = torch.linspace(0, 1, 33, dtype=torch.float64) ** 4
    work = torch.zeros_like(p)
    for low, high in itertools.pairwise(edges):
        _, v_n = viscous_path(c, p[:, None] * (low + (high - low) * (nodes + 1) / 2))
        work += p * (high - low) / 2 * (v_n * weights).sum(-1)
    return work


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
def test_broadcasting(name, variant):
    W, v_c, mu, eps = random_contacts(30, seed=7)
    call = functools.partial(impulse, name, W, v_c, variant=variant)
    mus, epses, e_ts = (torch.linspace(0, b, k, dtype=torch.float64) for b, k in ((1.2, 4), (1.0, 5), (0.8, 3)))

    def loop(*grids):
        return torch.stack([call(*map(float, values)) for values in torch.cartesian_prod(*grids)])

    def check(P, reference, *shape):
        assert P.shape == (*shape, 30, 2)
        torch.testing.assert_close(P, reference.reshape(P.shape), **EXACT)

    check(call(0.3, 0.6), call(*(torch.full((30,), x, dtype=torch.float64) for x in (0.3, 0.6))))
    check(call(mus[:, None], 0.6), torch.stack([call(m, 0.6) for m in mus.tolist()]), 4)
    check(call(0.3, epses[:, None]), torch.stack([call(0.3, e) for e in epses.tolist()]), 5)
    check(call(mus[:, None, None], epses[None, :, None]), loop(mus, epses), 4, 5)
    check(call(mus[:, None], eps), torch.stack([call(m, eps) for m in mus.tolist()]), 4)
    if name == "chatterjee_ruina":
        P = call(mus[:, None, None, None], epses[:, None, None], e_t=e_ts[:, None])
        parts = [call(float(m), float(e), e_t=float(t)) for m, e, t in torch.cartesian_prod(mus, epses, e_ts)]
        check(P, torch.stack(parts), 4, 5, 3)
    else:  # the others ignore it
        torch.testing.assert_close(call(mu, eps, e_t=0.7), call(mu, eps), rtol=0, atol=0)
    pair = impulse(name, torch.stack((W, W.flip(0))), torch.stack((v_c, v_c.flip(0))), mu, eps, variant=variant)
    assert pair.shape == (2, 30, 2)
    torch.testing.assert_close(pair[1], impulse(name, W.flip(0), v_c.flip(0), mu, eps, variant=variant), **EXACT)


def gradients(name: str, variant: str, c: Contacts) -> tuple[torch.Tensor, ...]:
    inputs = [x.clone().requires_grad_() for x in (*c, torch.full_like(c.mu, 0.3))]
    P = impulse(name, *inputs[:4], variant=variant, e_t=inputs[4])
    return torch.autograd.grad(P.sum(), inputs if name == "chatterjee_ruina" else inputs[:4])


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
def test_gradients_are_finite_at_round_numbers(name, variant):
    # Quantities that cancel exactly: W_nn − σ μ W_tn = 0, no coupling, no slip, slip that ends with compression.
    values = [[-1.0, -0.5, 0, 0.5, 1.0], [-0.5, 0, 0.5], [0, 0.5, 1, 2], [0, 0.5, 1.0]]
    v_t, w_tn, mu, eps = torch.cartesian_prod(*(torch.tensor(v, dtype=torch.float64) for v in values)).unbind(-1)
    one = torch.ones_like(mu)
    W = torch.stack((one, w_tn, w_tn, one), -1).unflatten(-1, (2, 2))
    c = Contacts(W, torch.stack((v_t, -one), -1), mu, eps)
    assert all(g.isfinite().all() for g in gradients(name, variant, c))


def relative(name: str, variant: str, c: Contacts, x: torch.Tensor) -> torch.Tensor:
    """P / |P(0)| with inputs (W_tt, W_tn, W_nn, v_t, v_n, μ, ε, e_t) times 1 + x, x [..., 8]."""
    w_tt, w_tn, w_nn, v_t, v_n, mu, eps, e_t = (
        (1 + y) * z
        for y, z in zip(
            x.unbind(-1),
            (c.W[:, 0, 0], c.W[:, 0, 1], c.W[:, 1, 1], *c.v_c.unbind(-1), c.mu, c.eps, torch.tensor(0.3)),
            strict=True,
        )
    )
    W = torch.stack((w_tt, w_tn, w_tn, w_nn), -1).unflatten(-1, (2, 2))
    P = impulse(name, W, torch.stack((v_t, v_n), -1), mu, eps, variant=variant, e_t=e_t)
    return P / evaluate(name, c, variant).norm(dim=-1, keepdim=True)


def differences(function, n: int, h: float) -> torch.Tensor:
    """Central differences [n, 2, 8] of step h."""
    steps = h * torch.eye(8, dtype=torch.float64)[:, None].expand(8, n, 8)
    return ((function(steps) - function(-steps)) / (2 * h)).movedim(0, -1)


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
def test_gradients(name, variant):
    n = 2000
    c = random_contacts(n, seed=9)
    function = functools.partial(relative, name, variant, c)
    numeric = [differences(function, n, h) for h in (1e-6, 1e-5)]
    size = 1 + numeric[0].abs().amax((1, 2), keepdim=True)
    # Away from the modes' boundaries: two steps of differencing agree.
    away = ((numeric[0] - numeric[1]).abs() / size).amax((1, 2)) < 0.3 * DIFFERENCE
    assert away.double().mean() > 0.9
    x = torch.zeros(n, 8, dtype=torch.float64, requires_grad=True)
    P = function(x)
    rows = [torch.autograd.grad(P[:, k].sum(), x, retain_graph=True)[0] for k in (0, 1)]
    error = ((torch.stack(rows, 1) - numeric[0]).abs() / size).amax((1, 2))
    assert error[away].max() < DIFFERENCE


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
def test_gradients_broadcast(name, variant):
    """In grids of μ and ε over the contacts."""
    c = moderate(name, variant)
    grids = [torch.tensor(g, dtype=torch.float64, requires_grad=True) for g in ([[[0.31]], [[0.82]]], [[0.23], [0.64]])]
    assert torch.autograd.gradcheck(
        lambda mu, eps: impulse(name, c.W, c.v_c, mu, eps, variant=variant), grids, atol=1e-6
    )


def moderate(name: str, variant: str) -> Contacts:
    """Three contacts away from the modes' boundaries, with numbers near 1."""
    c = random_contacts(300, seed=10)
    c = c[(c.W.abs().amax((1, 2)) < 20) & (c.W.diagonal(dim1=1, dim2=2).amin(-1) > 0.1) & (c.v_c.abs().amax(-1) < 10)]
    n = len(c.mu)
    function = functools.partial(relative, name, variant, c)
    grid = [impulse(name, c.W, c.v_c, m, e, variant=variant) for m in (0.31, 0.82) for e in (0.23, 0.64)]
    near = [impulse(name, c.W, c.v_c, m + 1e-4, e, variant=variant) for m in (0.31, 0.82) for e in (0.23, 0.64)]
    jump = (torch.stack(near) - torch.stack(grid)).norm(dim=-1).amax(0) / torch.stack(grid).norm(dim=-1).amax(0)
    away = (differences(function, n, 1e-6) - differences(function, n, 1e-4)).abs().amax((1, 2)) < 1e-5
    return c[away & (jump < 1e-2)][:3]


@pytest.mark.parametrize(("name", "variant"), DISTINCT)
@pytest.mark.parametrize("end", ["mu = 0", "eps = 0"])
def test_gradients_at_the_ends_are_one_sided(name, variant, end):
    # An optimiser that starts at ε = 0 or μ = 0 must be able to leave it.
    c = random_contacts(2000, seed=11)
    c = c[c.v_c[:, 0].abs() > 0.05 * c.v_c[:, 1].abs()]
    zero, h = torch.zeros_like(c.mu), 1e-6

    def function(x):
        return evaluate(name, c._replace(mu=x) if end == "mu = 0" else c._replace(eps=x), variant)

    x = zero.clone().requires_grad_()
    P = function(x)
    slopes = [(-3 * P + 4 * function(zero + s) - function(zero + 2 * s)).detach() / (2 * s) for s in (h, 2 * h)]
    size = P.detach().norm(dim=-1, keepdim=True) + slopes[0].abs()
    away = ((slopes[0] - slopes[1]).abs() / size).amax(-1) < DIFFERENCE
    assert away.double().mean() > 0.9
    rows = torch.stack([torch.autograd.grad(P[:, k].sum(), x, retain_graph=True)[0] for k in (0, 1)], -1)
    assert ((rows - slopes[0]).abs() / size)[away].max() < 10 * DIFFERENCE


def test_names():
    assert len(PAPER_LAWS) == 6
    assert names() == (*PAPER_LAWS, "chatterjee_ruina", "spring_dashpot", "wang_mason_newton")
    c = random_contacts(1, seed=0)
    with pytest.raises(UnknownNameError, match=r"unknown law 'mirtic', did you mean 'mirtich'\?"):
        impulse("mirtic", *c)
    with pytest.raises(UnknownNameError, match=r"unknown variant 'textbok', did you mean 'textbook'\?"):
        impulse("mirtich", *c, variant="textbok")
    with pytest.raises(UnknownNameError, match="did you mean 'whittaker'"):
        find("Whitaker").at(0.2, 0.5)
    with pytest.raises(UnknownNameError, match="known: textbook, fazeli2017"):
        find("mirtich", "qqq").at(0.2, 0.5)
    c = random_contacts(20, seed=12)
    held = find("chatterjee_ruina", e_t=0.4).at(c.mu, 0.5)
    assert torch.equal(held.impulse(c.W, c.v_c), impulse("chatterjee_ruina", c.W, c.v_c, c.mu, 0.5, e_t=0.4))
    held = find("mirtich", "fazeli2017").at(0.2, 0.5)
    assert torch.equal(held.impulse(c.W, c.v_c), impulse("mirtich", c.W, c.v_c, 0.2, 0.5, variant="fazeli2017"))
    with pytest.raises(dataclasses.FrozenInstanceError):
        held.mu = 0.3


@pytest.mark.parametrize("name", names())
def test_a_contact_without_slip_has_the_derivative_of_one_that_sticks(name):
    """A ball that falls straight down: control begins there."""
    drops = synthetic.load(20, shape={"kind": "disc", "radius": 0.03})
    model, found = ContactModel(find(name).at(0.3, 0.6)), []
    for v_t in (0.0, 1e-6):
        v_pre = torch.tensor((v_t, -2.0, 0.0), dtype=torch.float64).expand(20, 3).clone().requires_grad_()
        v_post = model.outcome(drops.replace(v_pre=v_pre, validate=False)).v_post
        found.append(torch.autograd.grad(v_post[:, 0].sum(), v_pre)[0])
    torch.testing.assert_close(found[0], found[1], rtol=1e-6, atol=1e-9)
    assert (found[0][:, 0] < 0.9).all()
