"""Places on a floor and sides of a body in space: each is found from nothing, and told from the others."""

import math

import pytest
import torch
from spatial import box_tosses

from contactlearn.diagnosis.search.frontier import Search
from contactlearn.diagnosis.search.pool import Pool, Spec
from contactlearn.effects import EffectId, catalogue, find_effect
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import in_body
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

FLOOR, BODY = "location_dependent_{}", "orientation_dependent_{}"


def chosen(impacts: Impacts, family: str) -> tuple[EffectId | None, dict[str, float]]:
    """The form of a family that a search takes, with its values."""
    candidates = {kind.id: kind().prepare(impacts) for kind in catalogue()[family] if impacts.space in kind.spaces}
    pool = Pool({"wang_mason": find("wang_mason")}, impacts, candidates, {}, FitOptions())
    pool.all_fitted({Spec("wang_mason"): None})
    Search(pool, 1).run()
    best = pool.best()
    for effect, values in best.values.items():
        return effect, dict(zip([p.name for p in candidates[effect].parameters], values.tolist(), strict=True))
    return None, {}


@pytest.mark.parametrize(("form", "values", "expected"), [
    ("spot", {"a": 0.1, "u_0": 0.5, "w_0": -0.5, "b": 0.2, "n": 3.0},
     {"a": 0.1, "u_0": 1.2, "w_0": 1.8, "b": 0.08, "n": 3.0}),
    ("strip", {"a": 0.1, "phi": math.pi / 2, "d": 0.5, "b": 0.2, "n": 3.0},
     {"a": 0.1, "phi": math.pi / 2, "d": 2.2, "b": 0.08, "n": 3.0}),
    ("stretch", {"a": 0.1, "d": 0.5, "b": 0.2, "n": 3.0}, {"a": 0.1, "d": 1.2, "b": 0.08, "n": 3.0}),
])  # fmt: skip
def test_places_are_said_in_metres(form, values, expected):
    """On a floor whose measured part reaches 0.4 m from its middle (1, 2) m, or x = 1 m."""
    kind = find_effect(FLOOR.format("friction"), form)
    effect = kind(**values, **({"span": (0.6, 1.4)} if form == "stretch" else {"square": (1.0, 2.0, 0.4)}))
    said = {name: (effect.in_metres(name) or (1.0, 0.0)) for name in values}
    assert {name: scale * values[name] + zero for name, (scale, zero) in said.items()} == pytest.approx(expected)


def place(impacts):
    return impacts.q[:, :2] - 0.5


def border(impacts):
    return 0.7 - 0.2 * (place(impacts) @ torch.tensor((0.6, 0.8), dtype=torch.float64) > 0.1)


def spot(impacts):
    return 0.15 + 0.2 * ((place(impacts) - torch.tensor((0.15, -0.1))).norm(dim=-1) < 0.25)


def hollow(impacts):
    away = (place(impacts) - torch.tensor((0.15, -0.1), dtype=torch.float64)).norm(dim=-1)
    return 0.7 - 0.3 * (-0.5 * (away / 0.12).square()).exp()


def strip(impacts):
    return 0.7 - 0.2 * ((place(impacts) @ torch.tensor((0.8, -0.6), dtype=torch.float64) - 0.1).abs() < 0.12)


def test_a_border_of_any_bearing_is_found():
    found, values = chosen(box_tosses(0.2, border, noise=0.003), FLOOR.format("restitution"))
    assert found == EffectId("location_dependent_restitution", "border")
    turn = values["phi"] - math.atan2(0.8, 0.6) + (math.pi if values["a"] > 0 else 0)  # or the other half, softer
    assert abs(math.remainder(turn, 2 * math.pi)) < 0.1
    assert abs(values["a"]) == pytest.approx(0.2, abs=0.02)


def test_a_rough_spot_is_found():
    found, values = chosen(box_tosses(spot, 0.6, noise=0.003), FLOOR.format("friction"))
    assert found == EffectId("location_dependent_friction", "spot")
    assert values["a"] == pytest.approx(0.2, abs=0.04)
    assert values["u_0"] == pytest.approx(0.3, abs=0.1)


def test_a_spot_without_an_edge_has_its_depth():
    """With a sharp edge alone its depth was half of what it is."""
    found, values = chosen(box_tosses(0.2, hollow, noise=0.003), FLOOR.format("restitution"))
    assert found == EffectId("location_dependent_restitution", "spot")
    assert values["a"] == pytest.approx(-0.3, abs=0.03)
    assert values["n"] < 1.5


def test_a_stretch_of_a_planar_floor_is_found():
    """Five polynomials along a floor of 60 cm have no place for 5 cm of it."""
    drops = synthetic.load(250, velocity_noise=0, spin_noise=0, seed=6)
    u = torch.linspace(-1, 1, len(drops), dtype=torch.float64)[
        torch.randperm(len(drops), generator=torch.Generator().manual_seed(1))
    ]
    drops = drops.replace(q=torch.cat((0.3 * u[:, None], drops.q[:, 1:]), 1))
    soft = 0.6 - 0.2 * (-0.5 * ((drops.q[:, 0] - 0.12) / 0.04).square()).exp()
    after = ContactModel(find("wang_mason").at(0.2, soft)).predict(drops).v_post
    noise = torch.tensor((0.005, 0.005, 0.1)) * torch.randn(len(drops), 3, generator=torch.Generator().manual_seed(2))
    found, values = chosen(drops.replace(v_post=after + noise), FLOOR.format("restitution"))
    assert found == EffectId("location_dependent_restitution", "stretch")
    assert values["a"] == pytest.approx(-0.2, abs=0.02)
    assert values["d"] * 0.285 == pytest.approx(0.12, abs=0.01)  # nine tenths of 0.6 m are the span
    (stretch,) = (kind for kind in catalogue()[found.name] if kind.form == "stretch")
    assert stretch(span=(-0.2, 0.4)).equation.endswith(", lengths in 0.3 m about 0.1 m")


def test_a_model_prints_places_in_metres():
    """Half a span is 0.3 m here, its middle at 0.1 m."""
    (stretch,) = (kind for kind in catalogue()[FLOOR.format("restitution")] if kind.form == "stretch")
    effect = stretch(span=(-0.2, 0.4), a=-0.2, d=0.5, b=0.2)
    printed = str(ContactModel(find("wang_mason"), effects={effect.name: effect}))
    assert "ε ← ε + a exp(−((x − d)/b)²ⁿ), a = −0.2, d = 0.25 m, b = 0.06 m, n = 3" in printed


def test_a_strip_is_found():
    found, values = chosen(box_tosses(0.2, strip, noise=0.003), FLOOR.format("restitution"))
    assert found == EffectId("location_dependent_restitution", "strip")
    assert values["a"] == pytest.approx(-0.2, abs=0.03)


def test_a_soft_corner_is_found():
    def soft(impacts):
        return 0.6 - 0.25 * (in_body(impacts.r, impacts.q) > 0).all(-1)

    found, _ = chosen(box_tosses(0.2, soft, noise=0.003), BODY.format("restitution"))
    assert found is not None
    assert found.name == "orientation_dependent_restitution"
    assert found.form in ("contact", "corners")


@pytest.mark.parametrize("family", [FLOOR.format("friction"), BODY.format("restitution"), "anisotropic_friction"])
def test_nothing_is_taken_where_nothing_depends(family):
    assert chosen(box_tosses(0.2, 0.6, noise=0.003), family) == (None, {})


def test_one_moment_of_inertia_that_is_wrong_is_named():
    impacts = box_tosses(0.2, 0.6, noise=0.003)
    wrong = impacts.replace(inertia=impacts.inertia * torch.tensor((1.0, 1 / 1.05, 1.0), dtype=torch.float64))
    found, values = chosen(wrong, "inertia_error")
    assert found == EffectId("inertia_error", "y")
    assert values["kappa_y"] == pytest.approx(math.log(1.05), abs=0.01)


def test_an_elliptic_cone_is_that_of_stretched_axes():
    """Along either axis of the ellipse a ball is rubbed by that axis's μ, and elsewhere by friction inside the cone."""
    s, beta, mu = 0.3, 0.4, 0.1
    effect = find_effect("anisotropic_friction")(p=s * math.cos(2 * beta), q=s * math.sin(2 * beta))
    for heading, expected in ((beta, mu * math.exp(s)), (beta + math.pi / 2, mu * math.exp(-s))):
        v = torch.tensor([[3 * math.cos(heading), 3 * math.sin(heading), -1, 0, 0, 0]], dtype=torch.float64)
        columns = (torch.tensor([0.1]), torch.full((1, 3), 1.6e-5), torch.tensor([[0, 0, -0.02]]))
        ball = Impacts(*columns, torch.tensor([[0, 0, 0.02, 1, 0, 0, 0]]), v, v, validate=False)
        model = ContactModel(base=find("wang_mason").at(mu, 0.5), effects={"it": effect})
        P = model.predict(ball).wrench[0, :3]
        assert P[:2].norm().item() == pytest.approx(expected * P[2].item(), rel=1e-9)
        assert (P[:2] @ v[0, :2]).item() == pytest.approx(-P[:2].norm().item() * 3, rel=1e-9)


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_a_ball_on_springs_leaves_as_its_tangent_swings(heading):
    """Without a dashpot v_t⁺ = v_t cos((1 + ε) π/2 √(W_tt/(c W_nn))) along the slip, whatever its heading."""
    mass, radius, eps, c = 0.1, 0.02, 0.8, 1.3
    slip = 0.05 * torch.tensor((math.cos(heading), math.sin(heading)), dtype=torch.float64)
    v = torch.cat((slip, torch.tensor((-2.0, 0, 0, 0), dtype=torch.float64)))[None]
    inertia = torch.full((1, 3), 0.4 * mass * radius**2, dtype=torch.float64)
    pose = torch.tensor([[0, 0, radius, 1, 0, 0, 0]], dtype=torch.float64)
    r = torch.tensor([[0, 0, -radius]], dtype=torch.float64)
    ball = Impacts(torch.tensor([mass]), inertia, r, pose, v, v, validate=False)
    effect = find_effect("tangential_restitution", "spring")(s=1 - 1e-9, c=c)
    model = find("mirtich").at(5.0, eps)
    after = ContactModel(base=model, effects={"it": effect}).predict(ball).v_post[0]
    leaves = after[:2] + torch.linalg.cross(after[3:], r[0])[:2]
    expected = slip * math.cos((1 + eps) * math.pi / 2 * math.sqrt(3.5 / c))
    torch.testing.assert_close(leaves, expected, rtol=0, atol=0.05 * slip.norm().item())
