"""A model in NumPy, JAX, PyTorch and C is the model, to rounding, at the ends of what a contact can be."""

import importlib.util
import json
import re
import shutil
import subprocess
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from spatial import tossed

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import State, find_effect
from contactlearn.effects.formula.effect import formula
from contactlearn.laws import catalogue, find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Cuboid, Polygon, contact_point
from contactlearn.mechanics.space import BOTH, PLANE, SPACE
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel, resolve
from contactlearn.models.export import onnx, source
from contactlearn.results.types import DataSource, Provenance
from contactlearn.scatter import ContactPoint, Friction, Normal, Restitution
from contactlearn.simulation import synthetic

ROUNDING = 1e-12
"""Relative to 1 m/s and 1 rad/s, and to the values: the order of a few operations, and other cosines."""

BOX = Cuboid((0.06, 0.05, 0.04))
SQUARE = Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)))
EFFECTS = ("com_offset", "surface_tilt", "corner_radius", "velocity_dependent_friction:curve", "spin_damping:during")
EFFECTS += (
    "parameter_drift:settling_friction",
    "body_dependent_restitution",
    "tangential_restitution:slip",
    "side_drag",
)


IN_SPACE = ("com_offset", "surface_tilt", "corner_radius", "load_dependent_friction:curve", "spin_damping")
IN_SPACE += ("parameter_drift:settling_friction", "body_dependent_restitution", "torsional_friction", "side_drag")


def contacts(space=PLANE, count=2000):
    """Random bodies and contacts with μ and ε; an eighth each at each end and border."""
    generator = torch.Generator().manual_seed(8)

    def uniform(low, high):
        return low + (high - low) * torch.rand(count, generator=generator, dtype=torch.float64)

    if space is SPACE:
        impacts = tossed(count, seed=8)
    else:
        mass, radius, omega = 10 ** uniform(-2, 1), 10 ** uniform(-2, 0), uniform(-10, 10)
        r = radius[:, None] * torch.stack((uniform(-2, 2), uniform(-2, -0.01)), -1)
        v_t, v_n = uniform(-5, 5), -(10 ** uniform(-1, 1))
        v = torch.stack((v_t + r[:, 1] * omega, v_n - r[:, 0] * omega, omega), -1)
        q = torch.stack((uniform(-0.3, 0.3), -r[:, 1], uniform(-3, 3)), -1)
        impacts = Impacts(mass, mass * radius**2, r, q, v, v)
    t = space.d - 1
    r, still = impacts.r.clone(), impacts.v_pre.clone()
    for x in (r, still):
        x[::8] = (1024 * x[::8]).round() / 1024  # products are exact, and so is a slip of 0
    still[::8, :t] = -rigid_body.swept(r, still[:, space.d :])[::8, :t]
    impacts = impacts.replace(r=r, v_pre=still)
    mu, eps = uniform(0, 1.5), uniform(0, 1)
    mu[1::8], eps[2::8], eps[3::8] = 0.0, 0.0, 1.0
    W, v_c = impacts.W, impacts.v_c
    mu[4::8] = torch.linalg.solve(W[:, :t, :t], W[:, :t, t:])[4::8, :, 0].norm(dim=-1)  # sticks barely, once it does
    goal = torch.cat((-v_c[:, :t], -(1 + eps[:, None]) * v_c[:, t:]), -1)
    stuck = torch.linalg.solve(W, goal[..., None])[5::8, :, 0]
    mu[5::8] = stuck[:, :t].norm(dim=-1) / stuck[:, t].clamp_min(1e-3)  # the slip barely ends, by Newton's restitution
    for kind in (4, 5):  # to either side, since laws may jump there; rougher contacts jam, and amplify rounding
        mu[kind::8].clamp_(max=1.0)
        mu[kind::16] *= 1 - 1e-6
        mu[kind + 8 :: 16] *= 1 + 1e-6
    return impacts, mu, eps


def with_effects(space=PLANE):
    """Impacts of three bodies and a model with effects of all places, away from where they vanish."""
    if space is PLANE:
        drops, names = synthetic.load(size=200, shape=SQUARE), EFFECTS
    else:
        drops, names = tossed(200).replace(shape=BOX), IN_SPACE
        drops = drops.replace(r=contact_point(BOX, drops.q[:, 3:]), validate=False)
        drops = drops[drops.v_c[:, 2] < -0.1].replace(validate=True)
    drops = drops.replace(object=tuple(("first", "second", "third")[k % 3] for k in range(len(drops))))
    effects = {}
    for words in names:
        name, _, form = words.partition(":")
        one = find_effect(name, form or None)().prepare(drops)
        effects[name] = one.at(
            [0.6 * p.low + 0.4 * p.high if p.low < 0 else p.low + p.high / 3 for p in one.parameters]
        )
    if space is SPACE:
        own = formula(P1="-a*m*slip", taun="-b*rho*Pn*sign(twist)", parameters={"a": [-1, 1], "b": [-1, 1]})
        effects["mine"] = own.at([0.1, 0.05])
    return ContactModel(find("mirtich").at(0.2, 0.5), effects=effects), drops


def arguments(impacts, names):
    every = {"mass": impacts.mass, "inertia": impacts.inertia, "r": impacts.r, "pose": impacts.q}
    every |= {"velocity": impacts.v_pre, "order": impacts.order, "body": impacts.body}
    return [every[name].double() for name in names]


def differs(found, model, impacts):
    expected = model.predict(impacts)
    return max(
        ((a - b).abs() / (1 + b.abs())).max().item()
        for a, b in zip(map(torch.tensor, map(np.asarray, found)), (expected.v_post, expected.wrench), strict=True)
    )


def run_python(text, impacts, names, **constants):
    """What a Python file returns for impacts, with other values of its constants."""
    module = {"__name__": "exported"}
    exec(text, module)
    assert module["self_test"]() < ROUNDING
    module.update(constants)
    return module["impact"](*(x.numpy() for x in arguments(impacts, names)))


LAWS = [
    pytest.param(name, variant, space, id=f"{name}-{variant}-{space}")
    for name, family in catalogue().items()
    for variant in family
    for space in find(name, variant).spaces
]


@pytest.mark.parametrize(("name", "variant", "space"), LAWS)
def test_every_law_in_numpy(name, variant, space):
    impacts, mu, eps = contacts(space)
    model = ContactModel(find(name, variant).at(0.2, 0.5))
    text = source.source_code(model, "numpy", impacts[:10])
    found = run_python(text, impacts, source.trace(model, space=space).arguments, MU=mu.numpy(), EPS=eps.numpy())
    assert differs(found, model.at((mu, eps)), impacts) < ROUNDING


@pytest.mark.parametrize("space", BOTH, ids=str)
def test_a_law_alone_in_torch(space):
    impacts, *_ = contacts(space, 100)
    model = ContactModel(find("wang_mason").at(0.2, 0.5))
    names = source.trace(model, space=space).arguments
    assert (
        differs(run_python(source.source_code(model, "torch", impacts[:10]), impacts, names), model, impacts) < ROUNDING
    )


@pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="JAX is not installed")
@pytest.mark.parametrize("space", BOTH, ids=str)
def test_effects_in_jax_compiled_mapped_and_derived(space):
    import jax

    model, drops = with_effects(space)
    names = source.trace(model, drops.shape, space).arguments
    module = {"__name__": "exported"}
    exec(source.source_code(model, "jax", drops[:10]), module)
    assert module["self_test"]() < ROUNDING
    given = [x.numpy() for x in arguments(drops, names)]
    for impact in (module["impact"], jax.jit(module["impact"]), jax.vmap(module["impact"])):
        assert differs(impact(*given), model, drops) < ROUNDING
    place = [*names].index("velocity")
    found = jax.grad(lambda *one: module["impact"](*one)[0].sum(), place)(*given)
    v_pre = drops.v_pre.clone().requires_grad_()
    state = State.of(drops).replace(v_pre=v_pre)
    (expected,) = torch.autograd.grad(
        resolve(model.law, model.effects, state, *model.law.coefficients).v_post.sum(), v_pre
    )
    assert ((torch.tensor(np.asarray(found)) - expected).abs() / (1 + expected.abs())).max() < ROUNDING


def test_graphs_of_onnx(tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    for space in BOTH:
        model, drops = with_effects(space)
        lacking = {"incidence_dependent_friction", "parameter_drift", "spin_damping"}  # atan2 and expm1
        has = {name: one for name, one in model.effects.items() if name not in lacking}
        for one in (ContactModel(find("wang_mason").at(0.2, 0.5)), replace(model, effects=has)):
            session = runtime.InferenceSession(onnx.graph(one, drops), providers=["CPUExecutionProvider"])
            names = source.trace(one, drops.shape, space).arguments
            given = {
                name: x.reshape(len(drops), -1).numpy() for name, x in zip(names, arguments(drops, names), strict=True)
            }
            assert differs(session.run(None, given), one, drops) < ROUNDING
    with pytest.raises(ContactLearnError, match="no expm1 in float64"):
        onnx.graph(with_effects(SPACE)[0], drops)


MAIN = """
#define _GNU_SOURCE
#include <fenv.h>
#include <stdio.h>
int main(void)
{
    double in[%d], out[%d];
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        %s
        contact_impact(%s out, out + %d);
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


def called(names, impacts, *extra):
    """Arguments of a call in C, and the columns that it reads."""
    sizes = [len(parts) for parts in names.values()]
    starts = [sum(sizes[:k]) for k in range(len(sizes))]
    call = "".join(f"in[{k}], " if size == 1 else f"in + {k}, " for k, size in zip(starts, sizes, strict=True))
    return call, torch.cat([x.reshape(len(impacts), -1) for x in (*arguments(impacts, names), *extra)], 1)


def run_c(text, folder, impacts, names, *extra):
    """What the C file returns for impacts, with μ and ε as further columns if given; warnings and traps are errors."""
    call, columns = called(names, impacts, *extra)
    (folder / "impact.c").write_text(re.sub(r"static const (double (MU|EPS) =)", r"static \1", text) if extra else text)
    set_own = "".join(f"{name} = in[{columns.shape[1] - 2 + k}]; " for k, name in enumerate(("MU", "EPS")) if extra)
    define, main = MAIN.lstrip().split("\n", 1)
    size = impacts.space.D
    main = main % (columns.shape[1], 2 * size, set_own, call, size)
    (folder / "main.c").write_text(f'{define}\n#include "impact.c"\n{main}')
    flags = ["-O2", "-std=gnu99", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["gcc", *flags, "-DSELF_TEST", "impact.c", "-o", "test", "-lm"], cwd=folder, check=True)
    subprocess.run(["gcc", *flags, "main.c", "-o", "main", "-lm"], cwd=folder, check=True)
    subprocess.run(["./test"], cwd=folder, check=not extra, capture_output=True)
    done = subprocess.run(["./main"], cwd=folder, input=columns.numpy().tobytes(), capture_output=True, check=True)
    return torch.from_numpy(np.frombuffer(done.stdout).reshape(-1, 2 * size).copy()).split(size, -1)


needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")


@needs_compiler
@pytest.mark.parametrize(
    ("name", "space"),
    [
        *((name, PLANE) for name in ("anitescu_potra_poisson", "mirtich", "spring_dashpot")),
        *((name, SPACE) for name in ("whittaker", "drumwright_shell", "mirtich")),
    ],
    ids=str,
)
def test_laws_in_c(name, space, tmp_path):
    impacts, mu, eps = contacts(space)
    model = ContactModel(find(name).at(0.2, 0.5))
    text = source.source_code(model, "c", impacts[:10])
    found = run_c(text, tmp_path, impacts, source.trace(model, space=space).arguments, mu, eps)
    assert differs(found, model.at((mu, eps)), impacts) < ROUNDING


@pytest.mark.parametrize("space", BOTH, ids=str)
@pytest.mark.parametrize("to", ["numpy", "torch", pytest.param("c", marks=needs_compiler)])
def test_effects_of_all_places(to, space, tmp_path):
    model, drops = with_effects(space)
    names = source.trace(model, drops.shape, space).arguments
    assert [*names][-2:] == ["order", "body"]
    text = source.source_code(model, to, drops[:10])
    found = run_c(text, tmp_path, drops, names) if to == "c" else run_python(text, drops, names)
    assert differs(found, model, drops) < ROUNDING


# --- Scatter --------------------------------------------------------------------------------------


def scattering(space):
    """Impacts of bodies, and a law whose contact scatters, away from its borders."""
    drops = synthetic.load(size=20) if space is PLANE else tossed(20)
    components = Restitution(sigma=0.05), Friction(sigma=0.03), Normal(sigma=0.03), ContactPoint(sigma=0.001)
    model = ContactModel(find("mirtich").at(0.3, 0.5), scatter={one.name: one for one in components})
    return model, drops


def agrees_in_moments(drawn, model, drops):
    """Means and covariances [N, D] of draws [S, N, D] are those of the model's own draws: five standard errors."""
    own = model.scattered(drops, torch.Generator().manual_seed(5), len(drawn)).v_post
    (mean, covariance), (wanted, expected) = (
        (x.mean(0), torch.einsum("sni,snj->nij", x - x.mean(0), x - x.mean(0)) / len(x)) for x in (drawn, own)
    )
    size = expected.diagonal(dim1=-2, dim2=-1).sqrt()
    assert ((mean - wanted).abs() <= 5 * (2 / len(drawn)) ** 0.5 * size + ROUNDING).all()
    unit = size[:, :, None] * size[:, None] + ROUNDING
    assert ((covariance - expected) / unit).abs().max() < 5 * (6 / len(drawn)) ** 0.5  # kurtosis: modes change


@pytest.mark.parametrize("space", BOTH, ids=str)
@pytest.mark.parametrize("to", ["numpy", "torch", "jax"])
def test_python_draws_as_the_model_does(to, space):
    if to == "jax":
        jax = pytest.importorskip("jax")
    model, drops = scattering(space)
    module = {"__name__": "exported"}
    exec(source.source_code(model, to, drops[:10]), module)
    assert module["self_test"]() < ROUNDING  # with deviations
    names = [*source.trace(model, space=space).arguments]
    assert differs(module["impact"](*(x.numpy() for x in arguments(drops, names))), model, drops) < ROUNDING
    many = [np.repeat(x.numpy()[None], 4000, 0) for x in arguments(drops, names)]
    draw = {
        "numpy": lambda seed: np.random.default_rng(seed),
        "torch": lambda seed: torch.Generator().manual_seed(seed),
        "jax": lambda seed: jax.random.key(seed),
    }[to]
    first, again, other = (np.asarray(module["sample"](draw(seed), *many)[0]) for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()
    agrees_in_moments(torch.from_numpy(first.copy()), model, drops)


DRAWS = """
#include <stdio.h>
#include "impact.c"
int main(void)
{
    double in[%d], out[%d];
    uint64_t state = 1;
    while (fread(in, sizeof in, 1, stdin) == 1) {
        contact_sample(%s &state, out, out + %d);
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("space", BOTH, ids=str)
def test_c_draws_as_the_model_does(space, tmp_path):
    model, drops = scattering(space)
    names = source.trace(model, space=space).arguments
    text = source.source_code(model, "c", drops[:10])
    assert differs(run_c(text, tmp_path, drops, names), model, drops) < ROUNDING
    call, columns = called(names, drops)
    size = drops.space.D
    (tmp_path / "draws.c").write_text(DRAWS % (columns.shape[1], 2 * size, call, size))
    subprocess.run(["gcc", "-O2", "-std=gnu99", "-Werror", "draws.c", "-o", "draws", "-lm"], cwd=tmp_path, check=True)
    given = columns.repeat(4000, 1).numpy().tobytes()
    done = subprocess.run(["./draws"], cwd=tmp_path, input=given, capture_output=True, check=True)
    drawn = torch.from_numpy(np.frombuffer(done.stdout).copy()).reshape(4000, len(drops), -1)
    agrees_in_moments(drawn[..., :size], model, drops)


def test_what_no_file_can_hold_is_refused():
    model, drops = with_effects()
    with pytest.raises(ContactLearnError, match="needs the body's shape"):
        source.source_code(model, "c", drops[:2].replace(shape=None))
    with pytest.raises(ContactLearnError, match=r"one value for each parameter .* got 3"):
        source.source_code(ContactModel(find("mirtich").at(torch.ones(3), 0.5)), "c", drops)
    with pytest.raises(ContactLearnError, match="without its Gaussian processes this model has no law"):
        source.without_residual(ContactModel(residual=object()))


def test_the_command_writes_a_file_or_says_why_not(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model, _ = with_effects()
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    checkpoint.save(ContactModel(model.base), tmp_path / "base.pt", provenance={})  # as in the folder of a diagnosis
    assert main(["export", ".", "--to", "json"]) == 0
    assert json.loads((tmp_path / "impact.json").read_text()) == json.loads(json.dumps(model.constants()))
    assert main(["export", "base.pt", "--to", "torch", "-o", "law.py"]) == 0
    assert "EPS = torch.tensor(0.5" in (tmp_path / "law.py").read_text()
    capsys.readouterr()
    refused = {
        (".", "--to", "c"): "needs the body's shape",
        (".", "--to", "nunpy"): "did you mean 'numpy'",
        ("base.pt", "--to", "c", "-o", "law.py"): "writes a .c file",
        ("nothing", "--to", "c"): "no such file",
        (".", "--to", "json"): "impact.json is there already",
        ("law.py",): "law.py is there already",
    }
    for words, reason in refused.items():
        assert main(["export", *words]) == 2
        assert reason in capsys.readouterr().err
    before = (tmp_path / "law.py").read_text()
    assert main(["export", "base.pt", "--to", "numpy", "-o", "law.py", "--force"]) == 0
    assert (tmp_path / "law.py").read_text() != before


def test_a_scene_has_the_mass_of_the_training(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, mass in (("one", (0.05, 0.05)), ("several", (0.05, 0.07)), ("unknown", None)):
        data = DataSource(source="drops.csv", trials=9, sha256="", mass=mass, inertia=(3e-5, 3e-5))
        config = {"data": {"shape": {"kind": "ellipse", "semi_axes": [0.04, 0.025]}}}
        provenance = asdict(Provenance(data=data, config=config))
        checkpoint.save(ContactModel(find("wang_mason").at(0.2, 0.5)), tmp_path / f"{name}.pt", provenance=provenance)
        done = main(["export", f"{name}.pt", "--to", "mujoco"])
        assert done == 0 if name == "one" else "give its data" in capsys.readouterr().err
    assert 'mass="0.05" diaginertia="3e-05' in (tmp_path / "impact.xml").read_text()
