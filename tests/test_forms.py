"""Forms of effects in limits that are known, and found where a nature of their own has planted them."""

import math

import pytest
import torch
from drops import seeded
from scipy.optimize import linprog

from contactlearn.core.errors import DataError
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.effects import State, catalogue, find_effect
from contactlearn.effects.tangential_restitution import _integrate_springs
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import assemble
from contactlearn.laws import find
from contactlearn.laws.contact import Contact
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Polygon
from contactlearn.mechanics.space import PLANE
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

ROUNDING = 1e-10  # m/s and rad/s
NOISE = torch.tensor((0.005, 0.005, 0.2), dtype=torch.float64)  # m/s and rad/s
SIGMAS = 4.0

LAW = find("wang_mason").at(0.2, 0.6)
HEXAGON = Polygon(((0.04, 0.0), (0.02, 0.025), (-0.02, 0.025), (-0.04, 0.0), (-0.02, -0.025), (0.02, -0.025)))


def drops(shape=None, size=400, seed=0):
    return synthetic.load(size=size, shape=shape, velocity_noise=0, spin_noise=0, seed=seed)


def noisy(impacts, v_post):
    noise = NOISE * torch.randn(len(impacts), 3, generator=seeded(1), dtype=torch.float64)
    return impacts.replace(v_post=v_post + noise)


def predicted(effect, impacts, law=LAW):
    return ContactModel(law, effects={"it": effect}).predict(impacts).v_post


def assert_found(fit, expected):
    assert ((fit.values - expected).abs() <= SIGMAS * fit.standard_errors).all(), (fit.values, fit.standard_errors)


def turned(impacts, phi):
    """The same impacts in a frame that is turned clockwise, so that the floor leans by φ."""
    angle = torch.full((len(impacts),), phi, dtype=torch.float64)

    def world(v):
        return torch.cat((rotate(v[:, :2], angle), v[:, 2:]), -1)

    q = world(impacts.q)
    q[:, 2] += phi
    body = {"r": rotate(impacts.r, angle), "v_pre": world(impacts.v_pre), "v_post": world(impacts.v_post)}
    return impacts.replace(q=q, validate=False, **body)


def test_a_turned_frame_is_a_tilt_with_a_contact_that_was_seen():
    exact = drops()
    exact = turned(exact.replace(v_post=ContactModel(LAW).predict(exact).v_post), 0.04)
    seen, computed = (find_effect("surface_tilt", form)(0.04) for form in ("seen", "computed"))
    torch.testing.assert_close(predicted(seen, exact), exact.v_post, rtol=0, atol=ROUNDING)
    assert (predicted(computed, exact) - exact.v_post).abs().max() > 0.01
    fit = joint.fit(noisy(exact, exact.v_post), find("wang_mason"), {"tilt": seen})
    assert_found(fit, torch.tensor((0.2, 0.6, 0.04), dtype=torch.float64))
    seen, computed = (find_effect("surface_tilt", form)(0.01) for form in ("seen", "computed"))
    with pytest.raises(DataError, match=r"needs the body's shape.*form=seen"):
        computed.prepare(drops().replace(shape=None))
    exact = drops(HEXAGON)
    apart = (predicted(seen, exact) - predicted(computed, exact)).abs().amax(-1)
    assert 0.95 < (apart < ROUNDING).double().mean() < 1  # the others touch with another vertex


def ball(slips):
    """A ball that falls at 2 m/s with slips [N] in m/s."""
    impacts = drops({"kind": "disc", "radius": 0.03}, size=len(slips))
    v = torch.stack((torch.as_tensor(slips), torch.full((len(slips),), -2.0), torch.zeros(len(slips))), -1)
    return impacts.replace(v_pre=v.double())


def test_the_impulse_that_stopped_a_ball_rebounds_within_the_cone():
    """W_tt = 3/m of a disc, and P_n^c = 2 m/s m: it grips in compression up to a slip of 3 · 2 μ = 1.2 m/s."""
    slips = torch.tensor((0.2, 0.6, 1.1, 1.3, 1.9, 2.5), dtype=torch.float64)
    impacts = ball(slips)
    e_t, mu, eps = 0.5, 0.2, 0.6
    after = State.of(impacts).contact_after(
        ContactModel(LAW, effects={"it": find_effect("tangential_restitution", "impulse")(e_t)}).predict(impacts).wrench
    )
    limit = 3 * mu * 2.0
    rebound = torch.minimum(e_t * slips, torch.full_like(slips, eps * limit))
    slides = (slips - (1 + eps) * limit).clamp_min(0)
    torch.testing.assert_close(after[:, 0], torch.where(slips < limit, -rebound, slides), rtol=0, atol=ROUNDING)
    torch.testing.assert_close(after[:, 1], torch.full_like(slips, 0.6 * 2), rtol=0, atol=ROUNDING)
    impacts = ball(torch.linspace(-0.7, 0.7, 15))
    one, other = (find_effect("tangential_restitution", form)(0.4) for form in ("slip", "impulse"))
    torch.testing.assert_close(predicted(one, impacts), predicted(other, impacts), rtol=0, atol=ROUNDING)
    late = ball([1.3])  # grips in restitution
    apart = predicted(one, late) - predicted(other, late)
    assert apart.abs().max() > 0.1


def test_a_ball_on_springs_swings_back():
    """It grips throughout for (1 + ε) times a compression: the slip is a cosine of the tangent's own frequency.

    Sixteen steps of a compression come within a tenth of the slip."""
    slips, eps = torch.linspace(-0.3, 0.3, 5, dtype=torch.float64), 0.6
    impacts = ball(slips)
    W = State.of(impacts).W
    for c in (0.7, 1.2, 2.5):
        effect = find_effect("tangential_restitution", "spring")(1.0, c)
        model = ContactModel(find("mirtich").at(50.0, eps), effects={"it": effect})
        after = State.of(impacts).contact_after(model.predict(impacts).wrench)
        swing = (1 + eps) * math.pi / 2 * (W[:, 0, 0] / (c * W[:, 1, 1])).sqrt()
        torch.testing.assert_close(after[:, 0], slips * swing.cos(), rtol=0, atol=0.1 * 0.3)
        torch.testing.assert_close(after[:, 1], torch.full_like(slips, eps * 2), rtol=0, atol=1e-3)


def test_derivatives_of_springs_are_those_of_differences():
    """Through sticking and sliding, and in every quantity that the contact, the law and the effect are made of."""
    generator = torch.Generator().manual_seed(0)

    def impulses(*given):
        *contact, mu, eps, s, c = given
        return _integrate_springs(Contact(*contact), (mu, eps), s, c)

    ranges = [(3, 5), (-2, 2), (2, 4), (-1, 1), (-2, -1), (0.05, 0.6), (0.3, 0.8), (0.1, 0.9), (0.5, 2)]
    given = [low + (high - low) * torch.rand(6, generator=generator, dtype=torch.float64) for low, high in ranges]
    assert torch.autograd.gradcheck(impulses, [part.requires_grad_() for part in given], eps=1e-8, atol=1e-4, rtol=1e-3)


def test_planted_forms_are_found():
    exact, effect = drops(), find_effect("tangential_restitution", "impulse")
    fit = joint.fit(noisy(exact, predicted(effect(0.4), exact)), find("wang_mason"), {"it": effect()})
    assert_found(fit, torch.tensor((0.2, 0.6, 0.4), dtype=torch.float64))
    sharp = drops(HEXAGON, 300)
    true = sharp.replace(r=lowest_of_rounded(sharp.q[:, 2], 0.003), validate=False)
    v_post = ContactModel(LAW).predict(true).v_post
    fit = joint.fit(noisy(sharp, v_post), find("wang_mason"), {"it": find_effect("corner_radius")()})
    assert_found(fit, torch.tensor((0.2, 0.6, 0.003), dtype=torch.float64))
    assert fit.standard_errors[2] < 5e-4
    impacts = drops(size=300)
    step = find_effect("parameter_drift", "restitution_step")
    made = noisy(impacts, predicted(step(0.15, 0.4, trials=300.0), impacts))
    fit = joint.fit(made, LAW, {"it": step()})
    assert_found(fit, torch.tensor((0.2, 0.6, 0.15, 0.4)))


def lowest_of_rounded(theta, radius):
    """r [N, 2]: of the discs of that radius inside the polygon, the lowest point of the lowest (a linear programme)."""
    corners = torch.tensor(HEXAGON.vertices, dtype=torch.float64)
    side = corners.roll(-1, 0) - corners
    normal = torch.stack((side[:, 1], -side[:, 0]), -1) / side.norm(dim=-1, keepdim=True)
    room = (normal * corners).sum(-1) - radius
    r = []
    for angle in theta.tolist():
        up = rotate(torch.tensor((0.0, 1.0), dtype=torch.float64), torch.tensor(-angle, dtype=torch.float64))
        centre = linprog(up.numpy(), normal.numpy(), room.numpy(), bounds=(None, None)).x
        r.append(rotate(torch.from_numpy(centre), torch.tensor(angle, dtype=torch.float64)))
    return torch.stack(r) - torch.tensor((0.0, radius))


def test_round_corners_are_those_of_discs_inside_the_body():
    state = State.of(drops(HEXAGON, 60))
    rounder = find_effect("corner_radius")(0.004).state(state)
    torch.testing.assert_close(rounder.r, lowest_of_rounded(state.theta, 0.004), rtol=0, atol=1e-9)
    assert ((rounder.r - state.r).norm(dim=-1) > 1e-5).all()
    backwards = drops(Polygon(HEXAGON.vertices[::-1]), 60)
    torch.testing.assert_close(find_effect("corner_radius")(0.004).state(State.of(backwards)).r, rounder.r)
    state = State.of(drops(None, 20))
    assert torch.equal(find_effect("corner_radius")(0.004).state(state).r, state.r)
    # Corners of an ellipse, and a table of one object.
    impacts = drops(size=100)
    assert usable(all_candidates(), impacts).keys() == all_candidates().keys()


NAMES = ("steel", "brass", "oak")


def three(size=300):
    return drops(size=size).replace(object=tuple(NAMES[k % 3] for k in range(size)))


@pytest.mark.parametrize(("name", "index"), [("restitution", 1), ("friction", 0)])
def test_each_object_has_its_own_coefficient(name, index):
    impacts, effect = three(), find_effect(f"body_dependent_{name}")()
    own = torch.tensor((0.0, 0.1, -0.05), dtype=torch.float64)
    coefficients = torch.tensor((0.12, 0.55), dtype=torch.float64).repeat(len(impacts), 1)
    coefficients[:, index] += own[torch.arange(len(impacts)) % 3]
    v_post = ContactModel(find("wang_mason").at(*coefficients.T)).predict(impacts).v_post
    fit = joint.fit(noisy(impacts, v_post), find("wang_mason"), {"it": effect})
    assert [p.symbol for p in fit.parameters[2:]] == ["Δ(brass)", "Δ(oak)"]
    assert_found(fit, torch.tensor((0.12, 0.55, 0.1, -0.05), dtype=torch.float64))
    assert "0 for the first object, steel" in str(fit.model)


def test_objects_are_known_by_name(tmp_path):
    """In any order and subset, and in a file; one that was not there is as the first."""
    impacts = three(30)
    model = assemble(
        find("mirtich"),
        {"it": find_effect("body_dependent_restitution")().prepare(impacts)},
        torch.tensor((0.12, 0.55, 0.1, -0.05), dtype=torch.float64),
    )
    whole = model.predict(impacts).v_post
    some = [8, 1, 5]
    torch.testing.assert_close(model.predict(impacts[some]).v_post, whole[some])
    steel, glass = (model.predict(impacts.replace(object=(name,) * 30)).v_post for name in ("steel", "glass"))
    assert torch.equal(steel, glass)
    assert not torch.equal(steel[1], whole[1])
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    assert torch.equal(checkpoint.load(tmp_path / "model.pt").predict(impacts).v_post, whole)


@pytest.mark.parametrize("count", [1, 7])
def test_one_object_or_many_tell_nothing(count):
    impacts = drops(size=60)
    impacts = impacts.replace(object=tuple(f"body {k % count}" for k in range(60)))
    effect = find_effect("body_dependent_friction")().prepare(impacts)
    assert effect.parameters == ()
    assert f"undetermined with {count} of them" in effect.equation
    fit = joint.fit(impacts, find("wang_mason"), {"it": effect})
    alone = joint.fit(impacts, find("wang_mason"))
    torch.testing.assert_close(fit.values, alone.values)


def test_friction_over_slip_is_that_of_a_ball_whose_slip_is_followed():
    """Of a ball in many steps of its normal impulse, whether it slides to the end or comes to roll."""
    ball = drops(size=60)
    ball = ball.replace(r=torch.tensor((0.0, -0.03)).expand(60, 2), validate=False)
    effect = find_effect("velocity_dependent_friction", "stribeck")(2.0, 0.5)
    steps, w_tt = 4000, (1 / ball.mass + 0.03**2 / ball.inertia)
    first, taken = ball.v_c[:, 0].abs(), torch.zeros(60, dtype=torch.float64)
    h, slip = 1.6 * ball.mass * ball.v_c[:, 1].abs() / steps, first
    for _ in range(steps):
        taken = taken + torch.minimum(0.03 * (1 + 2.0 * (-slip / 0.5).exp()) * h, slip / w_tt)
        slip = (first - w_tt * taken).clamp_min(0)
    slippery = ContactModel(find("wang_mason").at(0.03, 0.6), effects={"it": effect})
    impulse = slippery.predict(ball).wrench[:, 0]
    change = taken - torch.minimum(0.03 * h * steps, first / w_tt)
    assert change.max() > 0.2 * taken.max()
    torch.testing.assert_close(impulse.abs(), taken, atol=0.01 * taken.max().item(), rtol=0.01)


def on_paper(name, impacts, amount):
    """Velocities after impact under Routh's law with a formula added by hand."""
    slip, spin, (x, y) = impacts.v_c[:, 0], impacts.v_pre[:, 2], impacts.r.unbind(-1)
    mu = {
        "velocity_dependent_friction": 0.2 + amount * (slip.abs() - 1.0),
        "directional_friction": 0.2 * (1 + amount * slip.sign()),
    }.get(name, torch.full_like(slip, 0.2))
    P_t, P_n, _ = (
        ContactModel(find("wang_mason").at(mu[None], torch.full_like(mu, 0.6)[None]))
        .predict(impacts)
        .wrench[0]
        .unbind(-1)
    )
    moment = {
        "contact_patch": -amount * x * P_n,
        "rolling_resistance": -amount * P_n * spin / (spin**2 + 1).sqrt(),
    }.get(name, torch.zeros_like(x))
    turn = (x * P_n - y * P_t + moment) / impacts.inertia
    return impacts.v_pre + torch.stack((P_t / impacts.mass, P_n / impacts.mass, turn), -1)


@pytest.mark.parametrize(("name", "form", "amount"), [
    ("velocity_dependent_friction", "initial", 0.05),
    ("directional_friction", "initial", 0.3),
    ("contact_patch", "after", 0.2),
    ("rolling_resistance", "before", 0.0005),
])  # fmt: skip
def test_a_formula_on_paper_has_its_form(name, form, amount):
    """It is met where other forms of its effect leave five times as much or more, and its amount is found."""
    impacts = drops(size=300)
    thrown = torch.tensor((2.0, 0.0, 10.0)) * torch.randn(300, 3, generator=seeded(2), dtype=torch.float64)
    impacts = impacts.replace(v_pre=impacts.v_pre + thrown, validate=False)
    impacts = impacts.replace(v_post=on_paper(name, impacts, amount))
    left = {}
    for kind in (kind for kind in catalogue()[name] if PLANE in kind.spaces):
        fit = joint.fit(impacts, find("wang_mason"), {"it": kind()})
        left[kind.form] = mass_error(impacts, fit.model.predict(impacts)).mean().item()
    assert left.pop(form) < 0.2 * min(left.values()), left
    found = joint.fit(noisy(impacts, impacts.v_post), find("wang_mason"), {"it": find_effect(name, form)()})
    if name != "velocity_dependent_friction":  # whose rises depend on the knots
        assert_found(found, torch.tensor((0.2, 0.6, amount, 0.0)[: len(found.values)], dtype=torch.float64))


def test_large_bodies_have_large_lengths():
    """The range of an arm is in proportion to a body ten times as large, and as declared for a small one."""
    patch = find_effect("contact_patch", "linear")
    small = drops(size=100)
    turn = torch.tensor((1.0, 1.0, 0.1), dtype=torch.float64)
    large = small.replace(
        r=10 * small.r, inertia=100 * small.inertia, v_pre=turn * small.v_pre, v_post=turn * small.v_post
    )
    made = large.replace(v_post=predicted(patch(0.1, 0.03), large))
    fit = joint.fit(made, LAW, {"it": patch()})
    torch.testing.assert_close(fit.values, torch.tensor((0.2, 0.6, 0.1, 0.03), dtype=torch.float64), atol=1e-4, rtol=0)
    assert joint.fit(small, LAW, {"it": patch()}).parameters[-1].high == 0.01


def test_pressure_behind_the_slip():
    """Without friction the normal impulse alone acts, at an arm that the sign of the slip decides."""
    impacts, d, eps = drops(size=50), 0.002, 0.6
    thrown = torch.tensor((2.0, 0.0, 0.0)) * torch.randn(50, 1, generator=seeded(2), dtype=torch.float64).sign()
    impacts = impacts.replace(v_pre=impacts.v_pre + thrown, validate=False)
    patch = find_effect("contact_patch", "slip")(d, v_s=1e-6)
    found = ContactModel(find("wang_mason").at(0.0, eps), effects={"it": patch}).predict(impacts).v_post
    x, (slip, v_n) = impacts.r[:, 0], impacts.v_c.unbind(-1)
    arm = x - d * slip.sign()
    P_n = -(1 + eps) * v_n / (1 / impacts.mass + x * arm / impacts.inertia)
    expected = impacts.v_pre + torch.stack((0 * P_n, P_n / impacts.mass, arm * P_n / impacts.inertia), -1)
    torch.testing.assert_close(found, expected)
    assert slip.sign().unique().tolist() == [-1, 1]
