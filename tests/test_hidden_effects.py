"""The ground-truth simulator: integrators against the textbook laws, hidden effects, and the truth beside drops."""

import inspect
import json
import math
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import contacts
import pytest
import torch
from contacts import impulse
from hydra.utils import instantiate
from omegaconf import OmegaConf

import contactlearn
from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.data.audit.findings import audit
from contactlearn.mechanics.rigid_body import apply_wrench, contact_velocity, measured_wrench
from contactlearn.mechanics.shapes import Disc, Ellipse
from contactlearn.simulation.hidden_effects import EFFECTS, UNKNOWN, draw, load, reveal
from contactlearn.simulation.hidden_effects.contact import ContactState, collide_compliant, collide_rigid, detach
from contactlearn.simulation.hidden_effects.effects import CONFOUNDED, forms
from contactlearn.simulation.hidden_effects.world import States, World

PACKAGE = Path(contactlearn.__file__).parent
CONFIG = PACKAGE.parent / "configs" / "data" / "mystery.yaml"
ROUNDING = 1e-11  # relative: some hundreds of steps, on contacts with W up to 10⁴ times as long as wide
SPRINGS = 2e-3  # relative: springs in 400 steps a compression are first-order
ALL = EFFECTS + UNKNOWN


def random_contact(n: int, seed: int, energetic: bool) -> tuple[ContactState, torch.Tensor]:
    """Contacts of random bodies, and the textbook law's velocity after them."""
    body, given = contacts.random_bodies(n, seed), contacts.random_contacts(n, seed)
    contact = ContactState(*body, given.eps, energetic, lambda slip: given.mu, torch.zeros_like)
    P = impulse("mirtich" if energetic else "wang_mason", *given)
    wrench = torch.cat((P, torch.zeros_like(P[:, :1])), -1)
    return contact, apply_wrench(*body, wrench)


def one_contact(r=(0.0, -0.03), v=(1.0, -2.0, 0.0), eps=0.7, mu=0.2, energetic=True, mass=0.05, inertia=2e-5):
    m, i, e = (torch.full((1,), x, dtype=torch.float64) for x in (mass, inertia, eps))
    r, v = (torch.tensor([x], dtype=torch.float64) for x in (r, v))
    return ContactState(m, i, r, v, e, energetic, lambda slip: torch.full_like(slip, mu), torch.zeros_like)


def energy(contact: ContactState, v: torch.Tensor) -> torch.Tensor:
    return 0.5 * (contact.mass * (v[:, :2] ** 2).sum(-1) + contact.inertia * v[:, 2] ** 2)


def off(contact: ContactState, v: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    """Relative difference in the mass norm."""
    weight = torch.stack((contact.mass, contact.mass, contact.inertia), -1)
    return ((weight * (v - reference) ** 2).sum(-1) / (weight * reference**2).sum(-1)).sqrt()


def drops(n: int = 50, seed: int = 0) -> States:
    """Drops of an ellipse, as reported."""
    impacts, _ = draw(seed, size=n, effects=[], noise=0)
    age = torch.arange(1, n + 1, dtype=torch.float64) / n
    return States(impacts.mass, impacts.inertia, impacts.q[:, 0], impacts.q[:, 2], impacts.v_pre, age)


WORLD = World(Ellipse((0.04, 0.025)), mu=0.15, eps=0.6, energetic=False)


@pytest.mark.parametrize("steps", [1, 7, 200])
@pytest.mark.parametrize("energetic", [False, True], ids=["poisson", "stronge"])
def test_path_is_the_textbook_law(energetic, steps):
    """Without effects every step is exact, also on contacts that stick, slide back or nearly jam."""
    contact, expected = random_contact(300, 1, energetic)
    assert off(contact, collide_rigid(contact, steps), expected).max() < ROUNDING


def test_rigid_springs_tend_to_the_textbook_law():
    """Walton and Braun's normal spring is Stronge's restitution, whatever the tangent does."""
    contact, _ = random_contact(200, 2, True)
    contact = contact._replace(eps=contact.eps.clamp_min(0.2))
    expected = collide_rigid(contact)
    coarse, fine = (off(contact, collide_compliant(contact, 1.0, 0.0, steps), expected) for steps in (100, 400))
    assert fine.max() < SPRINGS
    assert fine.mean() < 0.4 * coarse.mean()


def test_steps_converge():
    """With friction that follows the slip of the instant the error falls as 1 / steps."""
    world = forms("velocity_dependent_friction")[0].act(WORLD, a=1.0, v_s=0.4, n=1.0)
    world = forms("rolling_resistance")[0].act(world, c=0.002, ω_s=2.0)
    exact = world.outcome(drops(), 1600)
    coarse, fine = ((world.outcome(drops(), steps) - exact).abs().mean() for steps in (25, 100))
    assert 3 < coarse / fine < 5.5
    assert (world.outcome(drops()) - exact).abs().max() < 0.01 * exact.abs().max()


@pytest.mark.parametrize("energetic", [False, True], ids=["poisson", "stronge"])
def test_contacts_never_gain_energy(energetic):
    contact, _ = random_contact(200, 3, energetic)
    before = energy(contact, contact.v)
    assert (energy(contact, collide_rigid(contact, 20)) <= before * (1 + ROUNDING)).all()
    contact = contact._replace(eps=contact.eps.clamp_min(0.05))
    for resilience in (0.0, 0.5, 1.0):
        after = energy(contact, collide_compliant(contact, 1.2, resilience, 200))
        assert (after <= before * (1 + SPRINGS)).all()  # the leapfrog keeps energy to its order only


@pytest.mark.parametrize("resilience", [0.0, 0.6, 1.0])
def test_springs_transmit_a_contact_force(resilience):
    """Momentum balance is exact: no moment about the contact point, and a force within the cone."""
    contact, _ = random_contact(100, 4, True)
    contact = contact._replace(eps=contact.eps.clamp_min(0.05))
    v = collide_compliant(contact, 1.2, resilience, 100)
    P_t, P_n, tau = measured_wrench(*contact[:3], contact.v, v).unbind(-1)
    assert (tau.abs() <= ROUNDING * contact.r.norm(dim=-1) * P_n).all()
    assert (P_n > 0).all()
    assert (P_t.abs() <= contact.friction(P_n) * P_n * (1 + ROUNDING)).all()
    assert (contact_velocity(contact.r, v)[:, 1] > -1e-3).all()


@pytest.mark.parametrize("eps", [0.2, 0.6, 1.0])
def test_central_impact_rebounds_by_its_restitution(eps):
    for v in (collide_rigid(one_contact(eps=eps)), collide_compliant(one_contact(eps=eps), 1.2, 1.0)):
        assert v[0, 1].item() == pytest.approx(2 * eps, rel=1e-4)


@pytest.mark.parametrize("compliance", [1.5, 3.0, 12.0])
def test_superball(compliance):
    """A gripping disc: the slip swings as cos t √(W_tt/(c W_nn)) over the half period π of the normal spring."""
    R, mass = 0.03, 0.05
    contact = one_contact((0.0, -R), (1.0, -2.0, 0.0), 1.0, 1e4, mass=mass, inertia=mass * R**2 / 2)
    slip = contact_velocity(contact.r, collide_compliant(contact, compliance, 1.0))[0, 0].item()
    assert slip == pytest.approx(math.cos(math.pi * math.sqrt(3 / compliance)), abs=0.02)
    stuck = contact_velocity(contact.r, collide_compliant(contact, compliance, 0.0))[0, 0].item()
    assert stuck == pytest.approx(0, abs=ROUNDING)


def test_parting_costs_its_work():
    contact = one_contact((0.01, -0.03))
    v = collide_rigid(contact)
    parted = detach(contact, v, 0.01)
    assert (energy(contact, v) - energy(contact, parted)).item() == pytest.approx(0.01, rel=1e-9)
    stopped = detach(contact, v, 1e3)
    assert contact_velocity(contact.r, stopped)[0, 1].item() == pytest.approx(0, abs=1e-12)
    bad = one_contact()._replace(eps=torch.full((1,), torch.nan, dtype=torch.float64))
    for collide in (collide_rigid, lambda contact, steps: collide_compliant(contact, 1.0, 0.0, steps)):
        with pytest.raises(DataError, match=r"1 simulated contacts do not come to an end"):
            collide(bad, 10)


def test_tilted_floor_is_a_turned_camera():
    """A disc on a floor inclined by φ: the outcome on a level floor, turned by φ."""
    φ = torch.tensor(0.2, dtype=torch.float64)
    turn = torch.eye(3, dtype=torch.float64)
    turn[0, 0] = turn[1, 1] = φ.cos()
    turn[0, 1], turn[1, 0] = -φ.sin(), φ.sin()
    level, states = replace(WORLD, shape=Disc(0.03)), drops()
    tilted = replace(level, tilt=φ.item()).outcome(states._replace(v=states.v @ turn.T))
    torch.testing.assert_close(tilted, level.outcome(states) @ turn.T, rtol=0, atol=1e-10)
    # What the camera sees and the centre of mass differ by ω × d before and after; the contact knows the latter.
    world, states = replace(WORLD, centre=(0.004, -0.003)), drops()
    here = world.touch(states)
    moved = torch.tensor((0.004, -0.003), dtype=torch.float64).norm()
    arm = WORLD.touch(states).r - here.r
    torch.testing.assert_close(arm.norm(dim=-1), moved.expand(len(arm)))
    torch.testing.assert_close(here.v_c, WORLD.touch(states).v_c)  # the same material point
    v = world.outcome(states)
    seen = torch.cat((contact_velocity(arm, v)[:, :2], v[:, 2:]), -1)  # at the centre of mass
    wrench = measured_wrench(here.mass, here.inertia, here.r, here.v, seen)
    assert wrench[:, 2].abs().max() < 1e-10


@cache
def without_effects():
    return draw(5, size=30, effects=[])[0]


@pytest.mark.parametrize("name", ALL)
def test_effects_vanish_at_size_0(name):
    drawn, truth = draw(5, size=30, effects=[name], strength=(0, 0))
    nothing = without_effects()
    assert truth["v_post"] == truth["v_post_without"]
    # From the noisy states it is off by about the noise, as any model would be.
    away = torch.tensor(truth["v_post_from_measured"]) - torch.tensor(truth["v_post"])
    assert 0 < away[:, :2].abs().median() < 3 * truth["noise"]["v"]
    assert truth["effects"][0]["relative_change"] == 0
    if name != "tangential_restitution":  # springs have an error of their own, and always Stronge's restitution
        assert drawn.fingerprint() == nothing.fingerprint()


@pytest.mark.parametrize("name", ALL)
def test_effects_change_the_outcome_by_what_they_say_and_are_no_mistakes(name):
    impacts, truth = draw(6, size=200, effects=[name])
    (effect,) = truth["effects"]
    assert effect["name"] == name
    assert set(effect["parameters"]) == set(effect["units"])
    weight = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    with_it, without = (torch.tensor(truth[key], dtype=torch.float64) for key in ("v_post", "v_post_without"))
    norm = (weight * without**2).sum(-1)
    change = ((weight * (with_it - without) ** 2).sum(-1) / norm).mean().sqrt().item()
    assert effect["relative_change"] == pytest.approx(change, rel=1e-9)
    sigma = torch.tensor([truth["noise"][key] for key in ("v", "v", "omega")], dtype=torch.float64)
    multiple = change / ((weight * sigma**2).sum(-1) / norm).mean().sqrt().item()
    assert 1.7 < multiple < 5.7  # 2 to 5 on the sample that it was sized on
    residual = (impacts.v_post - with_it) / sigma
    assert residual.std().item() == pytest.approx(1, abs=0.1)
    for given in (impacts, impacts.replace(shape=None)):
        assert not [finding for finding in audit(given) if finding.mistake]


def test_each_form_acts():
    """Forms that are not drawn with the seeds above: each acts, and stays finite at its limit."""
    states = drops()
    for name in ALL:
        for form in forms(name):
            world = form.act(WORLD, **form.draw(random.Random(1))(1.0))
            good = world.approaches(states)
            some = States(*(value[good] for value in states))
            change = world.outcome(some) - WORLD.outcome(some)
            assert torch.isfinite(change).all()
            assert change.abs().max() > 0.02, form.text


def test_a_seed_gives_the_same_bits():
    (a, truth_a), (b, truth_b), (c, truth_c) = draw(7, size=40), draw(7, size=40), draw(8, size=40)
    assert a.fingerprint() == b.fingerprint() != c.fingerprint()
    assert truth_a == truth_b != truth_c
    torch.manual_seed(1)
    before = torch.get_rng_state()
    draw(7, size=5)
    assert (torch.get_rng_state() == before).all()
    impacts, truth = draw(9, size=50, effects=[], noise=0)
    P = impulse(truth["law"], impacts.W, impacts.v_c, truth["mu"], truth["eps"])
    expected = apply_wrench(
        impacts.mass, impacts.inertia, impacts.r, impacts.v_pre, torch.cat((P, torch.zeros_like(P[:, :1])), -1)
    )
    torch.testing.assert_close(impacts.v_post, expected, rtol=1e-9, atol=1e-9)
    assert truth["effects"] == []


def test_what_is_drawn_is_plausible():
    names = set()
    for seed in range(6):
        impacts, truth = draw(seed, size=20)
        found = [effect["name"] for effect in truth["effects"]]
        assert 1 <= len(found) <= 3
        assert set(found) <= set(EFFECTS)
        assert all(len(group & set(found)) < 2 for group in CONFOUNDED)
        names |= set(found)
        assert truth["law"] in ("wang_mason", "mirtich")
        assert (impacts.v_pre[:, 0] > 0).any()
        assert (impacts.v_pre[:, 0] < 0).any()
        assert impacts.order.tolist() == list(range(1, 21))
        json.dumps(truth, allow_nan=False)
    assert len(names) > 8
    assert not set(EFFECTS) & set(UNKNOWN)
    assert len(EFFECTS) == 23


REFUSED = {
    "seed": ({"seed": -1}, "seed must be an integer, at least 0, got -1"),
    "seed type": ({"seed": 1.5}, "seed must be an integer"),
    "size": ({"size": 0}, "size must be an integer, at least 1"),
    "noise": ({"noise": math.nan}, "noise must be a finite factor"),
    "much noise": (
        {"noise": 1e4, "size": 3000, "effects": []},
        r"only \d+ of 3000 drops approach the floor clearly; use less noise than 10000",
    ),
    "strength": ({"strength": (3, 2)}, r"strength must be a range \[low, high\]"),
    "name": ({"effects": ["adhesoin"]}, "unknown hidden effect 'adhesoin', did you mean 'adhesion'"),
    "string": ({"effects": "adhesion"}, r"effects must be a list of names, such as \[adhesion\]"),
    "twice": ({"effects": ["adhesion", "adhesion"]}, "each effect can be hidden once"),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_bad_arguments(changes, message):
    with pytest.raises(ContactLearnError, match=message) as error:
        draw(**({"seed": 1, "size": 10} | changes))
    assert isinstance(error.value, UnknownNameError if "unknown" in message else DataError)


def test_drops_and_truth_are_written(tmp_path, monkeypatch):
    impacts = load(7, 30, str(tmp_path / "a"))
    assert json.loads((tmp_path / "a" / "truth.json").read_text("utf-8")) == draw(7, size=30)[1]
    assert table.load(tmp_path / "a" / "drops.csv").fingerprint() == impacts.fingerprint()
    before = {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()}
    assert set(before) == {"drops.csv", "truth.json"}
    load(7, 30, str(tmp_path / "a"))
    assert {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()} == before
    monkeypatch.chdir(tmp_path)
    config = OmegaConf.load(CONFIG)
    assert config.pop("correct") == []
    assert OmegaConf.is_missing(config, "seed")
    assert set(config) == {"_target_", *inspect.signature(load).parameters}
    impacts = instantiate(OmegaConf.merge(config, {"seed": 3, "size": 20}), _convert_="all")
    assert impacts.source == "mystery drops (seed 3)"
    assert "seed 3, 20 drops" in reveal("outputs/mystery/seed_3")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        load(1, 10, str(tmp_path / "b" / "file"))
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["file"]


def test_scatter_differs_from_drop_to_drop_and_changes_no_drop():
    plain, scattered = (draw(3, size=40, effects=[], noise=0, scatter=x) for x in (0.0, 0.1))
    assert torch.equal(plain[0].v_pre, scattered[0].v_pre)
    assert plain[1]["v_post_from_measured"] == scattered[1]["v_post_from_measured"] == plain[1]["v_post"]
    # A factor on ε alone changes v_n⁺ = −ε v_n⁻ by a tenth of itself on impacts that slide throughout.
    ratio = [contact_velocity(drops.r, drops.v_post)[:, 1] / drops.v_c[:, 1] for drops, _ in (plain, scattered)]
    assert (ratio[1] / ratio[0] - 1).std() == pytest.approx(0.1, rel=0.5)
    with pytest.raises(DataError, match=r"scatter must be a share of μ and ε, at least 0 and below 1, got -0\.1"):
        draw(3, scatter=-0.1)


def test_reveal_command(tmp_path, capsys):
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps(draw(3, size=10, effects=["contact_patch", "surface_tilt"])[1]), encoding="utf-8")
    assert main(["reveal", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    for text in (
        "seed 3, 10 drops",
        "μ = ",
        "ε = ",
        "σ = ",
        "contact_patch",
        "h = 0.00",
        "inclined by φ",
        " rad",
        " % (",
    ):
        assert text in printed
    truth.write_text(json.dumps(draw(3, size=10, effects=[])[1]), encoding="utf-8")
    assert main(["reveal", str(tmp_path)]) == 0
    assert "hidden nothing" in capsys.readouterr().out
    assert main(["reveal", str(tmp_path / "nowhere")]) == 2
    assert "no such folder" in capsys.readouterr().err
    truth.unlink()
    assert main(["reveal", str(tmp_path)]) == 2
    assert "holds no truth.json" in capsys.readouterr().err
    (tmp_path / "sealed.bin").write_text("an older version's")
    assert main(["reveal", str(tmp_path)]) == 2
    assert "sealed.bin is of an older version; make the drops again" in capsys.readouterr().err


def truth_with(**changes) -> dict:
    effect = {"name": "a", "form": "b", "parameters": {"c": 1.0}, "units": {"c": "m"}, "relative_change": 0.1}
    truth = {"seed": 1, "size": 1, "law": "mirtich", "mu": 0.1, "eps": 0.5, "noise": {"v": 0.1, "omega": 0.1}}
    return truth | {"effects": [effect | changes]}


DAMAGED = {
    "empty": b"",
    "another file": b"trial,mass\n1,2\n",
    "binary": bytes(range(256)),
    "cut": json.dumps(truth_with()).encode()[:-40],
    "a list": b"[1]",
    "no law": json.dumps({key: value for key, value in truth_with().items() if key != "law"}).encode(),
    "no noise": json.dumps(truth_with() | {"noise": {}}).encode(),
    "an effect": json.dumps(truth_with() | {"effects": [3]}).encode(),
    "a form": json.dumps(truth_with(form=None)).encode(),
    "no unit": json.dumps(truth_with(units={})).encode(),
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_damaged_truth(content, tmp_path, capsys):
    (tmp_path / "truth.json").write_bytes(content)
    assert main(["reveal", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {tmp_path / 'truth.json'}: is damaged (")
    assert "make it again with data=mystery" in said


def test_the_analysis_never_opens_the_truth():
    """Only the command and the workbench reveal it, when a user asks."""
    ours, revealing = PACKAGE / "simulation" / "hidden_effects", {"cli/tools.py", "workbench/files.py"}
    opens = {PACKAGE / name for name in revealing}
    for path in PACKAGE.rglob("*.py"):
        if ours not in path.parents and path not in opens:
            text = path.read_text("utf-8")
            assert "truth.json" not in text, path
            assert "hidden_effects import reveal" not in text, path
            assert "hidden_effects.truth" not in text, path
    paths = [*(PACKAGE / "simulation" / "hidden_effects").glob("*.py")]
    assert len(paths) > 4
    for path in paths:
        for part in ("laws", "effects", "models", "inference"):
            assert f"contactlearn.{part}" not in path.read_text("utf-8"), path
