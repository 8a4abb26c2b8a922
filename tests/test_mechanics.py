"""Mechanics: the equation of motion, the measured wrench, the energy ellipse and their identities."""

import math

import pytest
import torch
from contacts import random_bodies, random_contacts
from hypothesis import given, settings, strategies as st

from contactlearn.mechanics import rigid_body

ROUNDING = 1e-9  # relative: W is nearly singular for some of the random bodies
PROFILE = settings(derandomize=True, deadline=None, database=None, max_examples=100)
N = 20_000
BODIES = random_bodies(N, seed=0)
CONTACTS = random_contacts(N, seed=0)
MIRROR = torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64)


def wrenches(seed: int = 1, n: int = N) -> torch.Tensor:
    """Wrenches (P_t, P_n, τ) of the size of the bodies' momenta."""
    drawn = torch.randn(n, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return drawn * BODIES.mass[:n, None]


def weights(bodies=BODIES) -> torch.Tensor:
    """The diagonal of M [n, 3]."""
    return torch.stack((bodies.mass, bodies.mass, bodies.inertia), -1)


def test_jacobian_gives_the_contact_points_velocity():
    J = rigid_body.contact_jacobian(BODIES.r)
    assert J.shape == (N, 2, 3)
    v_c = rigid_body.contact_velocity(BODIES.r, BODIES.v)
    torch.testing.assert_close((J @ BODIES.v[..., None])[..., 0], v_c)
    torch.testing.assert_close(v_c, CONTACTS.v_c, rtol=1e-6, atol=1e-9)
    # The velocity of a point that turns with the body, by differences of its position.
    h, (x, y), omega = 1e-6, BODIES.r.unbind(-1), BODIES.v[:, 2]
    moved = [
        torch.stack((x * (s * omega).cos() - y * (s * omega).sin(), x * (s * omega).sin() + y * (s * omega).cos()), -1)
        for s in (-h, h)
    ]
    torch.testing.assert_close(BODIES.v[:, :2] + (moved[1] - moved[0]) / (2 * h), v_c, rtol=1e-6, atol=1e-6)


def test_inverse_inertia_is_the_jacobians():
    W = rigid_body.inverse_inertia(BODIES.mass, BODIES.inertia, BODIES.r)
    J = rigid_body.contact_jacobian(BODIES.r)
    torch.testing.assert_close(W, J @ (J.mT / weights()[..., None]))
    torch.testing.assert_close(W, CONTACTS.W)
    assert (torch.linalg.eigvalsh(W) > 0).all()
    M_c = rigid_body.effective_inertia(CONTACTS.W)
    identity = torch.eye(2, dtype=torch.float64).expand(N, 2, 2)
    torch.testing.assert_close(M_c @ CONTACTS.W, identity, rtol=0, atol=ROUNDING)
    torch.testing.assert_close(M_c, M_c.mT, rtol=0, atol=0)
    two, r = torch.tensor(2.0, dtype=torch.float64), torch.tensor([0.0, -3.0], dtype=torch.float64)
    W = rigid_body.inverse_inertia(two, 4 * two, r)
    assert torch.equal(W, torch.tensor([[0.5 + 9 / 8, 0], [0, 0.5]], dtype=torch.float64))


def test_measured_wrench_inverts_apply_wrench():
    wrench = wrenches()
    v_post = rigid_body.apply_wrench(*BODIES, wrench)
    measured = rigid_body.measured_wrench(*BODIES, v_post)
    # Differences of velocities and of moments lose digits in proportion to these.
    size = (weights() * (BODIES.v.abs() + v_post.abs())).sum(-1, keepdim=True)
    size = size + BODIES.r.norm(dim=-1, keepdim=True) * wrench.norm(dim=-1, keepdim=True)
    assert ((measured - wrench) / size).abs().max() <= 1e-12
    again = rigid_body.apply_wrench(*BODIES, measured)
    torch.testing.assert_close(again, v_post, rtol=ROUNDING, atol=1e-6)
    change = weights() * (rigid_body.apply_wrench(*BODIES, wrench) - BODIES.v)
    J = rigid_body.contact_jacobian(BODIES.r)
    force = (J.mT @ wrench[:, :2, None])[..., 0] + torch.nn.functional.pad(wrench[:, 2:], (2, 0))
    size = (weights() * BODIES.v.abs()).sum(-1, keepdim=True) + force.norm(dim=-1, keepdim=True)
    assert ((change - force) / size).abs().max() <= 1e-12
    # In contact space, without a moment: v_c⁺ = v_c⁻ + W P.
    point = wrench * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    v_c = rigid_body.contact_velocity(BODIES.r, rigid_body.apply_wrench(*BODIES, point))
    expected = CONTACTS.v_c + (CONTACTS.W @ wrench[:, :2, None])[..., 0]
    assert ((v_c - expected).norm(dim=-1) / (expected.norm(dim=-1) + BODIES.v.norm(dim=-1))).max() <= ROUNDING


def test_velocity_per_wrench_is_the_derivative():
    """Of `apply_wrench`, in which the velocity is linear; its inverse is that of `measured_wrench`."""
    A = rigid_body.velocity_per_wrench(*BODIES[:3])
    assert A.shape == (N, 3, 3)
    # The effect of each component on its own, from rest.
    columns = [rigid_body.apply_wrench(*BODIES[:3], torch.zeros_like(BODIES.v), unit) for unit in torch.eye(3).double()]
    torch.testing.assert_close(A, torch.stack(columns, -1), rtol=ROUNDING, atol=0)
    change = rigid_body.apply_wrench(*BODIES, wrenches()) - BODIES.v
    found = (A @ wrenches()[..., None])[..., 0]
    size = BODIES.v.norm(dim=-1, keepdim=True) + found.norm(dim=-1, keepdim=True)
    assert ((change - found) / size).abs().max() <= ROUNDING
    # The velocity of the contact point per impulse is W, and a moment about it turns the body alone.
    J = rigid_body.contact_jacobian(BODIES.r)
    torch.testing.assert_close(J @ A[..., :2], CONTACTS.W, rtol=1e-6, atol=ROUNDING)
    assert (A[:, :2, 2] == 0).all()
    for i in range(50):
        body = [part[i] for part in BODIES]
        measured = torch.autograd.functional.jacobian(
            lambda v, body=body: rigid_body.measured_wrench(*body, v), body[3]
        )
        torch.testing.assert_close(measured @ A[i], torch.eye(3).double(), rtol=0, atol=ROUNDING)
    bodies = [part[:12].reshape(3, 4, *part.shape[1:]) for part in BODIES[:3]]
    every = rigid_body.velocity_per_wrench(*bodies)
    assert torch.equal(every.flatten(0, 1), rigid_body.velocity_per_wrench(*(part[:12] for part in BODIES[:3])))
    assert torch.equal(every[1, 2], rigid_body.velocity_per_wrench(*(part[6] for part in BODIES[:3])))


def test_energy_ellipse_goes_round_and_through_no_impulse():
    P = wrenches()[:, :2]
    v_post = rigid_body.apply_wrench(*BODIES, torch.nn.functional.pad(P, (0, 1)))
    before, after = (0.5 * (weights() * v**2).sum(-1) for v in (BODIES.v, v_post))
    excess = rigid_body.energy_excess(CONTACTS.W, CONTACTS.v_c, P)
    assert ((excess - (after - before)) / (before + after)).abs().max() <= ROUNDING
    for shape in ((), (50,), (3, 7)):
        index = torch.arange(math.prod(shape)).reshape(shape)
        W, v_c = CONTACTS.W[index], CONTACTS.v_c[index]
        ellipse = rigid_body.energy_ellipse(W, v_c, points=91)
        assert ellipse.shape == (*shape, 91, 2)
        incident = -rigid_body.energy_excess(W, v_c, -(rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0])
        excess = rigid_body.energy_excess(W[..., None, :, :], v_c[..., None, :], ellipse)
        assert (excess / incident[..., None]).abs().max() <= ROUNDING
        torch.testing.assert_close(ellipse[..., 0, :], ellipse[..., -1, :])
    W, v_c = CONTACTS.W[:50], CONTACTS.v_c[:50]
    ellipse = rigid_body.energy_ellipse(W, v_c, points=20_001)
    centre = -(rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0]
    torch.testing.assert_close(ellipse[:, :-1].mean(1), centre, rtol=1e-6, atol=1e-9)
    assert (ellipse.norm(dim=-1).amin(1) / centre.norm(dim=-1)).max() < 0.01
    # Its area is π radius² √det W⁻¹, by the shoelace formula.
    x, y = (ellipse - centre[:, None]).unbind(-1)
    area = 0.5 * (x[:, :-1] * y[:, 1:] - x[:, 1:] * y[:, :-1]).sum(-1).abs()
    radius_2 = -(centre * v_c).sum(-1)
    torch.testing.assert_close(area, math.pi * radius_2 / torch.linalg.det(W).sqrt(), rtol=1e-5, atol=0)


def test_least_squares_impulse_against_lstsq():
    dv = torch.randn(N, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64) * 3
    P = rigid_body.least_squares_impulse(BODIES.mass, BODIES.inertia, BODIES.r, dv)
    A = rigid_body.contact_jacobian(BODIES.r).mT / weights()[..., None]
    # Scaled columns: P / m, so that the reference is not limited by units.
    A = A * BODIES.mass[:, None, None]
    reference = torch.linalg.lstsq(A, dv[..., None], driver="gelsd").solution[..., 0]
    kappa = 1 + BODIES.r.norm(dim=-1, keepdim=True) * (BODIES.mass / BODIES.inertia)[:, None]
    error = (P / BODIES.mass[:, None] - reference).abs() / (kappa * dv.norm(dim=-1, keepdim=True))
    assert error.max() <= ROUNDING
    residual = dv - (A @ (P / BODIES.mass[:, None])[..., None])[..., 0]
    normal = (A.mT @ residual[..., None])[..., 0] / (kappa**2 * dv.norm(dim=-1, keepdim=True))
    assert normal.abs().max() <= ROUNDING


def test_least_squares_impulse_is_the_momentum_only_without_a_moment():
    n = 500
    bodies = type(BODIES)(*(x[:n] for x in BODIES))
    P = wrenches(n=n) * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    for tau in (0.0, 0.1):
        dv = rigid_body.apply_wrench(*bodies, P + torch.tensor([0.0, 0.0, tau])) - bodies.v
        found = rigid_body.least_squares_impulse(bodies.mass, bodies.inertia, bodies.r, dv)
        error = (found - P[:, :2]).norm(dim=-1) / P.norm(dim=-1)
        if tau == 0:
            assert error.max() <= 1e-6
        else:
            assert (error > 1e-3).double().mean() > 0.9


# W = diag(2, 1) and v_c = (0, −1): the ellipse is P_t² + (P_n − 1)²/2 ≤ 1/2, compression ends at P_n = 1.
ADMISSIBLE = {
    "plastic": ((0.0, 1.0), True),
    "elastic": ((0.0, 2.0), True),
    "rub on the ellipse": ((math.sqrt(0.5), 1.0), True),
    "inside": ((0.3, 1.4), True),
    "gains energy": ((0.0, 2.01), False),
    "gains energy by rubbing": ((0.72, 1.0), False),
    "penetrates": ((0.0, 0.99), False),
    "does nothing": ((0.0, 0.0), False),
    "pulls": ((0.0, -0.1), False),
}


@pytest.mark.parametrize(("P", "allowed"), ADMISSIBLE.values(), ids=ADMISSIBLE)
def test_admissible(P, allowed):
    W, v_c = torch.diag(torch.tensor([2.0, 1.0], dtype=torch.float64)), torch.tensor([0.0, -1.0], dtype=torch.float64)
    assert rigid_body.admissible(W, v_c, torch.tensor(P, dtype=torch.float64)).item() is allowed


def test_admissible_is_relative():
    # The tolerance goes with the size of the contact: masses and speeds of any unit.
    for mass, speed in ((1e-9, 1e-6), (1.0, 1.0), (1e9, 1e6)):
        W = torch.diag(torch.tensor([2.0, 1.0], dtype=torch.float64)) / mass
        v_c = torch.tensor([0.0, -speed], dtype=torch.float64)
        P = mass * speed * torch.tensor([[0.0, 2.0], [0.0, 2.01], [0.0, 1.0], [0.0, 0.99]], dtype=torch.float64)
        assert rigid_body.admissible(W, v_c, P).tolist() == [True, False, True, False]
        assert rigid_body.admissible(W, v_c, P, tolerance=0.1).all()
    # Strong coupling: rubbing alone lifts the contact point, so that only P_n < 0 is wrong.
    W = torch.tensor([[9.0, 8.0], [8.0, 9.0]], dtype=torch.float64)
    v_c = torch.tensor([-4.0, -1.0], dtype=torch.float64)
    P = torch.tensor([0.5, -0.1], dtype=torch.float64)
    assert rigid_body.energy_excess(W, v_c, P) < 0
    assert v_c[1] + W[1] @ P > 0
    assert not rigid_body.admissible(W, v_c, P)
    assert rigid_body.admissible(W, v_c, P + torch.tensor([0.0, 0.1], dtype=torch.float64))


def test_mirror():
    bodies, wrench = BODIES, wrenches()
    r, v = bodies.r * MIRROR[:2], bodies.v * MIRROR
    W = rigid_body.inverse_inertia(bodies.mass, bodies.inertia, r)
    assert torch.equal(W, MIRROR[:2, None] * rigid_body.inverse_inertia(*bodies[:3]) * MIRROR[:2])
    v_c = rigid_body.contact_velocity(r, v)
    assert torch.equal(v_c, rigid_body.contact_velocity(bodies.r, bodies.v) * MIRROR[:2])
    v_post = rigid_body.apply_wrench(*bodies, wrench)
    assert torch.equal(rigid_body.apply_wrench(bodies.mass, bodies.inertia, r, v, wrench * MIRROR), v_post * MIRROR)
    measured = rigid_body.measured_wrench(bodies.mass, bodies.inertia, r, v, v_post * MIRROR)
    assert torch.equal(measured, rigid_body.measured_wrench(*bodies, v_post) * MIRROR)
    dv = v_post - bodies.v
    found = rigid_body.least_squares_impulse(bodies.mass, bodies.inertia, r, dv * MIRROR)
    assert torch.equal(found, rigid_body.least_squares_impulse(*bodies[:3], dv) * MIRROR[:2])
    excess = rigid_body.energy_excess(W, v_c, (wrench * MIRROR)[:, :2])
    torch.testing.assert_close(
        excess, rigid_body.energy_excess(CONTACTS.W, CONTACTS.v_c, wrench[:, :2]), rtol=1e-6, atol=1e-6
    )


numbers = st.floats(-3, 3)


@PROFILE
@given(
    mass=st.floats(0.1, 10), inertia=st.floats(0.1, 10), r=st.tuples(numbers, numbers),
    v=st.tuples(numbers, numbers, numbers), wrench=st.tuples(numbers, numbers, numbers),
)  # fmt: skip
def test_any_body(mass, inertia, r, v, wrench):
    """Zeros and equal numbers, which random draws miss: the wrench comes back, the energies balance."""
    mass, inertia, r, v, wrench = (torch.tensor(x, dtype=torch.float64) for x in (mass, inertia, r, v, wrench))
    v_post = rigid_body.apply_wrench(mass, inertia, r, v, wrench)
    measured = rigid_body.measured_wrench(mass, inertia, r, v, v_post)
    torch.testing.assert_close(measured, wrench, rtol=0, atol=1e-11)
    # ΔT = wrench · mean of the contact point's velocities (v_t, v_n, ω).
    twist = [torch.cat((rigid_body.contact_velocity(r, u), u[2:])) for u in (v, v_post)]
    gained = 0.5 * (torch.stack((mass, mass, inertia)) * (v_post**2 - v**2)).sum()
    torch.testing.assert_close(gained, wrench @ (twist[0] + twist[1]) / 2, rtol=1e-9, atol=1e-9)
