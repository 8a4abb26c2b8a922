"""MuJoCo's drops: the engine's signs and the planar mechanics agree, and hidden effects do what they say."""

import inspect
import sys
from functools import cache
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from pairings import paired

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.identification import shared as fit
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity, energy_excess, rotate
from contactlearn.mechanics.shapes import contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import mujoco

CONFIG = Path(__file__).parents[1] / "configs" / "data" / "mujoco.yaml"
QUIET = {"velocity_noise": 0.0, "spin_noise": 0.0}
BALANCE = 0.008  # moment over ρ P_n: the contact point moves while the body turns and sinks in by 0.2 mm
ROUNDING = 1e-9  # relative; a few hundred steps of float64


@cache
def load(**settings) -> Impacts:
    """Drops without noise; those that several tests look at are simulated once."""
    return mujoco.load(**{"size": 300, **QUIET, **settings})


def imbalance(drops: Impacts) -> torch.Tensor:
    """|τ| / (ρ P_n) [N]: 0 for a point contact where and as the drops say."""
    _, p_n, tau = drops.wrench.unbind(-1)
    return tau.abs() / ((drops.inertia / drops.mass).sqrt() * p_n)


def restitution(drops: Impacts) -> torch.Tensor:
    return -contact_velocity(drops.r, drops.v_post)[:, 1] / drops.v_c[:, 1]


def law_error(law: str, drops: Impacts) -> tuple[tuple[float, float], float]:
    found = fit.fit_subsets(drops, find(law), sizes=(150,), repetitions=3)
    prediction = ContactModel(found.to_law()).predict(drops)
    return found.mean(), metrics.mass_error(drops, prediction).mean().item()


@pytest.fixture(scope="module", params=["ellipse", "box"])
def drops(request):
    return load(kind=request.param)


def test_a_point_contact_explains_the_drops(drops):
    """The wrench balances about r(θ), so the hinge turns as θ does and x, y are MuJoCo's x, z."""
    p_t, p_n, _ = drops.wrench.unbind(-1)
    assert imbalance(drops).max() < BALANCE
    assert (p_t.abs() <= 0.12 * p_n * 1.003).all()  # P_n lacks the weight's impulse, some parts in a thousand
    assert (energy_excess(drops.W, drops.v_c, drops.wrench[:, :2]) < 0).all()
    assert restitution(drops).mean() == pytest.approx(0.55, abs=0.01)
    assert restitution(drops).std() < 0.015
    assert (drops.v_pre[:, 0] < 0).any()
    assert (drops.v_pre[:, 0] > 0).any()
    for law in ("wang_mason", "mirtich"):
        (mu, eps), error = law_error(law, drops)
        assert error < 0.012
        assert (mu, eps) == pytest.approx((0.12, 0.555), abs=0.006)
    assert law_error("whittaker", drops)[1] > 0.05


@pytest.mark.parametrize("eps", [0.2, 0.5, 0.9, 1.0])
def test_a_wheel_without_friction_rebounds_as_the_spring_says(eps):
    wheel = load(semi_axes=(0.03, 0.03), mu=0.0, eps=eps, size=50)
    fall = mujoco.GRAVITY * 3e-4  # m/s, at most, during contact
    torch.testing.assert_close(restitution(wheel), torch.full_like(wheel.mass, eps), rtol=0.005, atol=fall)
    torch.testing.assert_close(wheel.v_post[:, 0], wheel.v_pre[:, 0], rtol=0, atol=1e-4)  # m/s; μ is 10⁻⁵
    torch.testing.assert_close(wheel.v_post[:, 2], wheel.v_pre[:, 2], rtol=0, atol=1e-2)  # rad/s


def test_a_wheel_slides_against_its_slip():
    """Closed form where slip lasts: P_t = −s μ P_n and I Δω = −r_y P_t."""
    wheel = load(semi_axes=(0.03, 0.03), mu=0.05)
    p_t, p_n, _ = wheel.wrench.unbind(-1)
    slip_after = contact_velocity(wheel.r, wheel.v_post)[:, 0]
    sliding = (slip_after * wheel.v_c[:, 0] > 0) & (slip_after.abs() > 0.05)
    assert sliding.sum() > 50
    torch.testing.assert_close(p_t[sliding], (-wheel.v_c[:, 0].sign() * 0.05 * p_n)[sliding], rtol=0.003, atol=0)
    torch.testing.assert_close(wheel.inertia * (wheel.v_post - wheel.v_pre)[:, 2], 0.03 * p_t, rtol=0.005, atol=1e-9)
    rough = load(mu=3.0)
    ratio = contact_velocity(rough.r, rough.v_post)[:, 0].abs() / -rough.v_c[:, 1]
    assert ratio.median() < 0.01


def test_flight_to_a_late_sample():
    """Weight acts on v_y alone, and θ grows with ω."""
    prompt, late = load(), load(delay=0.004)
    assert torch.equal(late.v_pre, prompt.v_pre)
    fall = torch.tensor((0.0, -mujoco.GRAVITY * 0.004, 0.0), dtype=torch.float64)
    torch.testing.assert_close(late.v_post, prompt.v_post + fall, rtol=ROUNDING, atol=ROUNDING)
    moved = 0.004 * (prompt.v_post + fall / 2)
    torch.testing.assert_close(late.q_post - prompt.q_post, moved, rtol=0, atol=1e-5)  # first-order steps of 0.1 ms
    prompt, late = load(damping=20.0), load(damping=20.0, delay=0.005)
    decay, top = torch.exp(torch.tensor(-20.0 * 0.005, dtype=torch.float64)), mujoco.GRAVITY / 20
    terminal = torch.tensor((0.0, -top, 0.0), dtype=torch.float64)
    expected = terminal + (prompt.v_post - terminal) * decay
    torch.testing.assert_close(late.v_post, expected, rtol=0.002, atol=1e-4)  # first-order steps of 0.1 ms
    assert (prompt.v_post - load().v_post).abs().max() > 1e-4  # it acts in contact, too
    plain, noisy = load(), load(velocity_noise=0.01, spin_noise=0.5)
    assert torch.equal(noisy.q, plain.q)
    for name in ("v_pre", "v_post"):
        spread = (getattr(noisy, name) - getattr(plain, name)).std(0)
        expected = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)
        torch.testing.assert_close(spread, expected, rtol=0.15, atol=0)


def test_a_tilted_floor():
    """Seen from the floor, everything balances again; the contact is where the turned body is lowest."""
    tilt = 0.05
    drops = load(tilt=tilt)
    back = torch.tensor(-tilt, dtype=torch.float64)
    turned = drops.replace(
        r=contact_point(drops.shape, drops.q[:, 2] - tilt),
        v_pre=torch.cat((rotate(drops.v_pre[:, :2], back), drops.v_pre[:, 2:]), -1),
        v_post=torch.cat((rotate(drops.v_post[:, :2], back), drops.v_post[:, 2:]), -1),
    )
    assert imbalance(drops).median() > 5 * BALANCE
    assert imbalance(turned).max() < BALANCE
    assert law_error("wang_mason", drops)[1] > 5 * law_error("wang_mason", turned)[1]
    height = rotate(drops.q[:, :2] + rotate(turned.r, -back), back)[:, 1]  # of the point above the tilted floor
    assert height.abs().max() < 1e-12


def test_a_centre_of_mass_beside_the_tracked_centre():
    drops = load(com_offset=(0.002, 0.0))
    shift = torch.tensor((0.002, 0.0), dtype=torch.float64).expand(len(drops), 2)

    def of_the_mass(theta, v):  # v + ω × offset
        offset = rotate(shift, theta)
        return v + torch.stack((-v[:, 2] * offset[:, 1], v[:, 2] * offset[:, 0], torch.zeros_like(theta)), -1)

    true = drops.replace(
        r=drops.r - rotate(shift, drops.q[:, 2]),
        v_pre=of_the_mass(drops.q[:, 2], drops.v_pre),
        v_post=of_the_mass(drops.q_post[:, 2], drops.v_post),
    )
    assert imbalance(drops).median() > 2 * BALANCE
    assert imbalance(true).max() < BALANCE
    assert law_error("wang_mason", drops)[1] > 5 * law_error("wang_mason", true)[1]


def test_an_inertia_that_is_not_the_reported_one():
    drops, plain = load(inertia_error=0.2), load()
    torch.testing.assert_close(drops.inertia, plain.mass * plain.shape.gyration_squared())
    true = drops.replace(inertia=drops.inertia * torch.tensor(0.2, dtype=torch.float64).exp())
    assert imbalance(drops).median() > 2 * BALANCE
    assert imbalance(true).max() < BALANCE


def test_long_boxes_keep_to_one_corner():
    """A rod that lies down on a side, or touches again before the sample, is drawn again."""
    rods = load(kind="box", semi_axes=(0.06, 0.005), delay=0.002)
    assert len(rods) == 300
    assert imbalance(rods).max() < 0.1  # the late sample sees the weight
    body_point = rotate(rods.r, -rods.q[:, 2]).abs()
    torch.testing.assert_close(body_point, torch.tensor((0.06, 0.005), dtype=torch.float64).expand(300, 2))


def test_same_seed_same_bits():
    state = torch.get_rng_state()
    first = mujoco.load(size=40, kind="box", seed=3)
    assert first.fingerprint() == mujoco.load(size=40, kind="box", seed=3).fingerprint()
    assert first.fingerprint() != mujoco.load(size=40, kind="box", seed=4).fingerprint()
    assert torch.equal(torch.get_rng_state(), state)
    assert len(mujoco.load(size=1)) == 1
    assert first.source == "MuJoCo drops (seed 3)"
    config = OmegaConf.load(CONFIG)
    assert config.pop("correct") == []
    defaults = {name: p.default for name, p in inspect.signature(mujoco.load).parameters.items()}
    written = {key: tuple(value) if OmegaConf.is_list(value) else value for key, value in config.items()}
    assert written.pop("_target_") == "contactlearn.simulation.mujoco.load"
    assert written == defaults
    assert instantiate(config, size=3).fingerprint() == mujoco.load(size=3).fingerprint()


ENDS = {
    "thin": {"semi_axes": (10, 0.001), "mass": 1e-6, "inertia_error": -1.0},
    "small": {"semi_axes": (0.001, 0.001), "mass": 1e-6, "mu": 100, "contact_time": 1e-5, "inertia_error": -1.0},
    "large": {"semi_axes": (10, 10), "mass": 1e3, "mu": 100, "inertia_error": 1.0, "tilt": -0.5},
    "lopsided": {"com_offset": (-0.035, 0.025), "contact_time": 1e-3, "tilt": 0.5, "eps": 1},
}


@pytest.mark.parametrize(("settings", "kind"), paired(ENDS, mujoco.KINDS))
def test_the_ends_of_the_ranges_are_simulated(kind, settings, capfd, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # where the engine would write its log
    assert len(load(size=20, kind=kind, **settings)) == 20
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"size": 0}, "size must be an integer, at least 1"),
        ({"semi_axes": (0.03,)}, "semi_axes must be two numbers in m"),
        ({"semi_axes": (0.03, 0.0)}, r"semi_axes must be a finite number in \[0.001, 10\]"),
        ({"mass": -1}, "mass must be"),
        ({"mu": -0.1}, "mu must be"),
        ({"eps": 0.1}, r"eps must be a finite number in \[0.2, 1\]"),
        ({"contact_time": 0.0}, "contact_time must be"),
        ({"tilt": 1.0}, "tilt must be"),
        ({"com_offset": (0.04, 0.0)}, "com_offset must be"),
        ({"inertia_error": 2.0}, "inertia_error must be"),
        ({"damping": float("nan")}, "damping must be"),
        ({"delay": 1.0}, "delay must be"),
        ({"velocity_noise": -1.0}, "velocity_noise must be"),
        ({"spin_noise": "much"}, "spin_noise must be"),
        ({"seed": -1}, "seed must be"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_settings_out_of_range(settings, message):
    with pytest.raises(DataError, match=message):
        mujoco.load(**settings)


def test_hardly_any_single_contacts(monkeypatch):
    """So much drag stops the body in the floor, and no contact ends."""
    with pytest.raises(DataError, match="only 0 of 600 drops are single contacts, 2 are wanted"):
        mujoco.load(size=2, damping=1e6)
    with pytest.raises(UnknownNameError, match="did you mean 'ellipse'"):
        mujoco.load(kind="elipse")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ContactLearnError, match=r"pip install 'contactlearn\[mujoco\]'"):
        mujoco.load(size=1)
