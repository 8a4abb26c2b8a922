"""A contact with a duration: its limit, an independent integration, and the engine's soft contacts."""

import math

import numpy as np
import pytest
import scipy
import torch
from scipy.spatial.transform import Rotation
from spatial import box_tosses, in_space, velocities

from contactlearn.diagnosis.search.frontier import Search
from contactlearn.diagnosis.search.pool import Pool, Spec, identities
from contactlearn.effects import EffectId, State, contact_duration, find_effect
from contactlearn.effects.impulse_path import contact_of
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import find
from contactlearn.laws.wang_mason import routh_path
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Polygon
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import mujoco, synthetic

MU, EPS = 0.2, 0.6
SQUARE = Polygon(((0.03, 0.02), (-0.03, 0.02), (-0.03, -0.02), (0.03, -0.02)))
CLOSE = 0.05  # of the change that a duration makes: twenty steps, against an exact path


def state_of(shape=None, size=100):
    drops = synthetic.load(size=size, shape=shape, velocity_noise=0, spin_noise=0, seed=5)
    return State.of(drops).replace(mu=torch.tensor(MU).double(), eps=torch.tensor(EPS).double())


def after(state, duration, monkeypatch=None, steps=12):
    if monkeypatch:
        monkeypatch.setattr(contact_duration, "_STEPS", steps)
        monkeypatch.setattr(contact_duration, "_MOST", 2 * steps)
    return contact_duration._after(state, torch.full_like(state.mass, duration))


def test_its_limit_is_the_spring_and_dashpot_on_rouths_path(monkeypatch):
    """Second order: with twice the steps a quarter of the error."""
    state = state_of()
    P = find("spring_dashpot").at(MU, EPS).impulse(state.W, state.v_c)
    expected = state.v_after(torch.nn.functional.pad(P, (0, 1)))
    coarse, fine = ((after(state, 0.0, monkeypatch, n) - expected).norm(dim=-1) for n in (24, 96))
    assert 8 < (coarse.median() / fine.median()).item() < 32
    change = after(state, 0.0, monkeypatch, 400)[:, :2] - state.v_pre[:, :2]
    P_t, P_n = (state.mass[:, None] * change).unbind(-1)
    path = routh_path(contact_of(state), state.coefficients[0])
    torch.testing.assert_close(path.impulse(P_n)[0], P_t, rtol=0, atol=2e-3 * P_n.max().item())


def followed(body, duration):
    """Velocity after the contact of a corner: forces at a point in half the depth, friction with a steep slope at 0."""
    mass, inertia, r_x, r_y, *v = body
    angle = scipy.optimize.brentq(lambda b: math.exp(-2 * b / math.tan(b)) - EPS, 0.1, math.pi / 2 - 1e-9)
    omega, softness = 2 * angle / (math.sin(angle) * duration), 1 / mass + r_x**2 / inertia
    stiffness, damping = omega**2 / softness, 2 * math.cos(angle) * omega / softness

    def forces(s):
        height, turn, v_x, v_y, spin = s
        x = r_x * math.cos(turn) - r_y * math.sin(turn)
        lowest = r_x * math.sin(turn) + r_y * math.cos(turn)
        depth = -(height + lowest)
        y = lowest + depth / 2
        normal = max(stiffness * depth - damping * (v_y + x * spin), 0.0)
        return normal, -MU * normal * math.tanh((v_x - y * spin) / 1e-4), x, y

    def motion(_, s):
        normal, tangential, x, y = forces(s)
        return [s[3], s[4], tangential / mass, normal / mass - GRAVITY, (x * normal - y * tangential) / inertia]

    def ended(time, s):
        return forces(s)[0] - 1e-9 if time > 0 else 1.0

    ended.terminal = True
    start = [-r_y, 0.0, *v]
    options = {"rtol": 1e-7, "atol": 1e-10, "events": ended}
    return scipy.integrate.solve_ivp(motion, (0, 5 * duration), start, "LSODA", **options).y[2:, -1]


def test_it_agrees_with_an_integration_in_time():
    state, duration = state_of(SQUARE, 16), 4e-3
    bodies = torch.cat((torch.stack((state.mass, state.inertia), -1), state.r, state.v_pre), -1).tolist()
    found = after(state, duration) - after(state, 0.0)
    expected = np.array([followed(body, duration) - followed(body, 1e-6) for body in bodies])
    error = (found.numpy() - expected) / np.sqrt((expected**2).mean(0))
    assert np.median(np.abs(error)) < CLOSE / 2
    assert np.sqrt((error**2).mean()) < CLOSE


@pytest.mark.parametrize("kind", ["ellipse", "box"])
def test_the_duration_of_soft_contacts_of_an_engine_is_found(kind):
    """MuJoCo's contact time is half a period without damping; with it the force vanishes at 2β/sin β."""
    pytest.importorskip("mujoco")
    drops = mujoco.load(size=200, kind=kind, contact_time=4e-3, velocity_noise=1e-3, spin_noise=0.05)
    start = torch.tensor((0.2, 0.6, 1e-3), dtype=torch.float64)
    fit = joint.fit(drops, find("spring_dashpot"), {"lasts": find_effect("contact_duration")()}, start=start)
    expected = 4e-3 * 2.772 / math.pi  # 2β/sin β for ε = 0.55
    assert fit.values[2].item() == pytest.approx(expected, rel=CLOSE)


def test_duration_and_tangential_ratio_are_determined_together():
    """Noise is 0.01 m/s and 0.5 rad/s, before and after contact; the ratio is that of the tangential spring."""
    spring = find_effect("tangential_restitution", "spring")
    planted = {"contact_duration": find_effect("contact_duration")(T=3.5e-3), spring.name: spring(s=0.6, c=1.2)}
    states = synthetic.load(size=400, velocity_noise=0, spin_noise=0, seed=5)
    outcome = ContactModel(find("spring_dashpot").at(MU, EPS), effects=planted).predict(states).v_post
    sigma = torch.tensor([0.01, 0.01, 0.5]).double()
    noise = sigma * torch.randn(2, 400, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    impacts = states.replace(v_pre=states.v_pre + noise[0], v_post=outcome + noise[1], validate=False)
    fit = joint.fit(impacts, "spring_dashpot", {name: type(one)() for name, one in planted.items()})
    off = (fit.values - torch.tensor([MU, EPS, 3.5e-3, 0.6, 1.2])) / fit.standard_errors
    assert off.abs().max() < 3
    assert fit.correlation[2, 3:].abs().max() < 0.3
    assert (fit.standard_errors[[2, 4]] / fit.values[[2, 4]]).max() < 0.04


def followed_in_space(state, k, duration, hysteretic):
    """The same of the corner of one body in space: its angular momentum changes by the moment of the forces."""
    mass, W = state.mass[k].item(), state.W[k].numpy()
    inertia, r = state.world_inertia[k].numpy(), state.r[k].numpy()
    softness = W[2, 2]
    if hysteretic:
        time = duration / math.sqrt(mass * softness) / (0.5 * math.pi * (1 + EPS))
        stiffness, damping, share = 1 / (softness * time**2), 0.0, 0.0
    else:
        angle = scipy.optimize.brentq(lambda b: math.exp(-2 * b / math.tan(b)) - EPS, 0.1, math.pi / 2 - 1e-9)
        omega = 2 * angle / (math.sin(angle) * duration)
        stiffness, damping, share = omega**2 / softness, 2 * math.cos(angle) * omega / softness, 0.5

    def forces(s):
        turn = Rotation.from_rotvec(s[:3])
        arm = turn.apply(r)
        depth, deepest = -(s[3] + arm[2]), max(s[10], -(s[3] + arm[2]))
        spin = turn.apply(np.linalg.solve(inertia, turn.inv().apply(s[7:10])))
        arm[2] += share * depth
        v = s[4:7] + np.cross(spin, arm)
        normal = stiffness * (depth + (1 - EPS**-2) * (deepest - depth) if hysteretic else depth) - damping * v[2]
        slip = max(np.hypot(*v[:2]), 1e-12)
        along = v[:2] / slip * math.tanh(slip / 1e-4)
        return np.array([*(-MU * max(normal, 0.0) * along), max(normal, 0.0)]), arm, spin, v

    def motion(s):
        force, arm, spin, v = forces(s)
        sinks = max(-v[2], 0.0) if -(s[3] + arm[2]) >= s[10] else 0.0
        return np.array([*spin, s[6], *(force / mass - [0, 0, GRAVITY]), *np.cross(arm, force), sinks])

    spin, step = state.v_pre[k, 3:].numpy(), duration / 300
    s = np.array([0, 0, 0, -r[2], *state.v_pre[k, :3].tolist(), *(inertia @ spin), 0.0])
    s = s + step * motion(s)
    while forces(s)[0][2] > 0:
        one = motion(s)
        two = motion(s + 0.5 * step * one)
        three = motion(s + 0.5 * step * two)
        s = s + step / 6 * (one + 2 * two + 2 * three + motion(s + step * three))
    return np.concatenate((s[4:7], forces(s)[2]))


@pytest.mark.parametrize("hysteretic", [False, True], ids=["dashpot", "hysteretic"])
def test_it_agrees_with_an_integration_in_time_in_space(hysteretic, monkeypatch):
    tossed = box_tosses(MU, EPS, noise=0, count=8)
    state = State.of(tossed).replace(mu=torch.tensor(MU).double(), eps=torch.tensor(EPS).double())

    def change(follow):
        return follow(3e-3) - follow(3e-6)

    expected = change(lambda T: np.stack([followed_in_space(state, k, T, hysteretic) for k in range(len(tossed))]))

    def off(steps):
        monkeypatch.setattr(contact_duration, "_STEPS", steps)
        monkeypatch.setattr(contact_duration, "_MOST", 2 * steps)
        found = change(
            lambda T: contact_duration._after_in_space(state, torch.full_like(state.mass, T), hysteretic=hysteretic)
        )
        return np.sqrt((((found.numpy() - expected) / np.sqrt((expected**2).mean(0))) ** 2).mean())

    assert off(12) < 2 * CLOSE
    assert off(96) < min(CLOSE / 2, 0.5 * off(12))


@pytest.mark.parametrize("hysteretic", [False, True], ids=["dashpot", "hysteretic"])
def test_the_plane_is_a_case_of_space(hysteretic):
    drops = synthetic.load(size=60, velocity_noise=0, spin_noise=0, seed=5)
    options = {"mu": torch.tensor(MU).double(), "eps": torch.tensor(EPS).double()}
    plane, space = State.of(drops).replace(**options), State.of(in_space(drops)).replace(**options)
    for duration, size in ((0.0, 1e-9), (3e-3, 5e-3)):
        T = torch.full_like(plane.mass, duration)
        there = contact_duration._after_in_space(space, T, hysteretic=hysteretic)
        here = velocities(contact_duration._after(plane, T, hysteretic=hysteretic))
        change = (here - velocities(plane.v_pre)).square().mean(0).sqrt().max()
        assert (there - here).abs().max() < size * change


@pytest.mark.nightly
def test_a_duration_in_space_is_told_from_a_late_frame():
    """A late frame stands for much of it; beside it none is left."""
    tossed = box_tosses(MU, EPS, noise=0, count=150)
    lasting = find_effect("contact_duration", "hysteretic")
    outcome = ContactModel(find("mirtich").at(MU, EPS), effects={lasting.name: lasting(4e-3)}).predict(tossed).v_post
    sigma = torch.tensor([5e-3] * 3 + [0.1] * 3).double()
    noise = sigma * torch.randn(150, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    impacts = tossed.replace(v_post=outcome + noise)
    kinds = (find_effect("sampling_delay"), find_effect("contact_duration", "dashpot"), lasting)
    candidates = {kind.id: kind().prepare(impacts) for kind in kinds}
    pool = Pool({"mirtich": find("mirtich")}, impacts, candidates, {}, FitOptions())
    pool.fitted(Spec("mirtich"))
    Search(pool, 2).run()
    assert pool.best().spec.effects == {lasting.id}
    assert pool.best().fit.values[2].item() == pytest.approx(4e-3, rel=CLOSE)


def test_it_is_tried_where_a_late_frame_stands_for_it():
    late, lasting = EffectId("sampling_delay"), EffectId("contact_duration", "dashpot")
    model = ContactModel(
        find("mirtich").at(MU, EPS), effects={"contact_duration": find_effect("contact_duration")(4e-3)}
    )
    states = synthetic.load(size=200, seed=3)
    noise = 0.003 * torch.randn(200, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    impacts = states.replace(v_post=model.predict(states).v_post + noise)
    candidates = {key: find_effect(key.name, key.form)().prepare(impacts) for key in (late, lasting)}
    pool = Pool({"mirtich": find("mirtich")}, impacts, candidates, {}, FitOptions())
    assert lasting not in identities(frozenset(pool.quadratics([pool.fitted(Spec("mirtich"))])[0].groups))
    Search(pool, 1).run()
    assert pool.best().spec.effects == {lasting}
    assert pool.best().fit.values[2].item() == pytest.approx(4e-3, rel=CLOSE)
