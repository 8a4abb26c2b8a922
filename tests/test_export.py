"""A model in NumPy, JAX, PyTorch and C is the model, to rounding, at the ends of what a contact can be."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
import types

import numpy as np
import pytest
import torch

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import find_effect
from contactlearn.laws import catalogue, find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Polygon
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export import source
from contactlearn.simulation import synthetic

ROUNDING = 1e-12
"""Relative to 1 m/s and 1 rad/s, and to the values: the order of a few operations, and other cosines."""

SQUARE = Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)))
EFFECTS = ("com_offset", "surface_tilt", "corner_radius", "velocity_dependent_friction:curve", "spin_damping:during")
EFFECTS += (
    "parameter_drift:settling_friction",
    "body_dependent_restitution",
    "tangential_restitution:slip",
    "side_drag",
)


def contacts(count=2000):
    """Random bodies and contacts with μ and ε; an eighth each has no slip, no friction, ε = 0 and ε = 1."""
    generator = torch.Generator().manual_seed(8)

    def uniform(low, high):
        return low + (high - low) * torch.rand(count, generator=generator, dtype=torch.float64)

    mass, radius, omega = 10 ** uniform(-2, 1), 10 ** uniform(-2, 0), uniform(-10, 10)
    r = radius[:, None] * torch.stack((uniform(-2, 2), uniform(-2, -0.01)), -1)
    v_t, v_n, mu, eps = uniform(-5, 5), -(10 ** uniform(-1, 1)), uniform(0, 1.5), uniform(0, 1)
    v_t[::8], mu[1::8], eps[2::8], eps[3::8] = 0.0, 0.0, 0.0, 1.0
    inertia = mass * radius**2
    mu[4::8] = (r[:, 0] * r[:, 1] / inertia).abs()[4::8] / (1 / mass + r[:, 1] ** 2 / inertia)[4::8]  # barely sticks
    v = torch.stack((v_t + r[:, 1] * omega, v_n - r[:, 0] * omega, omega), -1)
    q = torch.stack((uniform(-0.3, 0.3), -r[:, 1], uniform(-3, 3)), -1)
    return Impacts(mass, inertia, r, q, v, v), mu, eps


def with_effects():
    """Drops of three squares and a model with effects of all places, away from where they vanish."""
    drops = synthetic.load(size=200, shape=SQUARE)
    drops = drops.replace(object=tuple(("first", "second", "third")[k % 3] for k in range(200)))
    effects = {}
    for words in EFFECTS:
        name, _, form = words.partition(":")
        one = find_effect(name, form or None)().prepare(drops)
        effects[name] = one.at(
            [0.6 * p.low + 0.4 * p.high if p.low < 0 else p.low + p.high / 3 for p in one.parameters]
        )
    return ContactModel(find("mirtich").at(0.2, 0.5), effects=effects), drops


def arguments(impacts, names):
    every = {"mass": impacts.mass, "inertia": impacts.inertia, "r": impacts.r, "pose": impacts.q}
    every |= {"velocity": impacts.v_pre, "order": impacts.order, "body": impacts.body}
    return [every[name].double() for name in names]


def differs(found, model, impacts):
    expected = model.predict(impacts)
    return max(
        ((a - b).abs() / (1 + b.abs())).max().item()
        for a, b in zip(map(torch.as_tensor, found), (expected.v_post, expected.wrench), strict=True)
    )


def run_python(text, impacts, names, **constants):
    """What a Python file returns for impacts, with other values of its constants."""
    module = {"__name__": "exported"}
    exec(text, module)
    assert module["self_test"]() < ROUNDING
    module.update(constants)
    return module["impact"](*(x.numpy() for x in arguments(impacts, names)))


@pytest.mark.parametrize(
    ("name", "variant"), [(name, variant) for name, family in catalogue().items() for variant in family]
)
def test_every_law_in_numpy(name, variant):
    impacts, mu, eps = contacts()
    model = ContactModel(find(name, variant).at(0.2, 0.5))
    text = source.source_code(model, "numpy", impacts[:10])
    found = run_python(text, impacts, source.trace(model).arguments, MU=mu.numpy(), EPS=eps.numpy())
    assert differs(found, model.at((mu, eps)), impacts) < ROUNDING


@pytest.mark.parametrize("to", ["numpy", "torch", "jax"])
def test_effects_of_all_places_in_python(to, monkeypatch):
    if to == "jax" and importlib.util.find_spec("jax") is None:  # its twin: the same names in NumPy
        config = types.SimpleNamespace(update=lambda *_: None)
        for name, twin in (("jax", types.SimpleNamespace(config=config, numpy=np)), ("jax.numpy", np)):
            monkeypatch.setitem(sys.modules, name, twin)
    model, drops = with_effects()
    names = source.trace(model, SQUARE).arguments
    assert [*names][-2:] == ["order", "body"]
    found = run_python(source.source_code(model, to, drops[:10]), drops, names)
    assert differs([torch.as_tensor(np.asarray(x)) for x in found], model, drops) < ROUNDING


MAIN = """
#define _GNU_SOURCE
#include <fenv.h>
#include <stdio.h>
int main(void)
{
    double in[%d], out[6];
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        %s
        contact_impact(%s out, out + 3);
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


def run_c(text, folder, impacts, names, *extra):
    """What the C file returns for impacts, with μ and ε as further columns if given; warnings and traps are errors."""
    sizes = [len(parts) for parts in names.values()]
    starts = [sum(sizes[:k]) for k in range(len(sizes))]
    call = "".join(f"in[{k}], " if size == 1 else f"in + {k}, " for k, size in zip(starts, sizes, strict=True))
    columns = torch.cat([x.reshape(len(impacts), -1) for x in (*arguments(impacts, names), *extra)], 1)
    (folder / "impact.c").write_text(re.sub(r"static const (double (MU|EPS) =)", r"static \1", text) if extra else text)
    set_own = "".join(f"{name} = in[{columns.shape[1] - 2 + k}]; " for k, name in enumerate(("MU", "EPS")) if extra)
    define, main = MAIN.lstrip().split("\n", 1)
    (folder / "main.c").write_text(f'{define}\n#include "impact.c"\n{main % (columns.shape[1], set_own, call)}')
    flags = ["-O2", "-std=gnu99", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["gcc", *flags, "-DSELF_TEST", "impact.c", "-o", "test", "-lm"], cwd=folder, check=True)
    subprocess.run(["gcc", *flags, "main.c", "-o", "main", "-lm"], cwd=folder, check=True)
    subprocess.run(["./test"], cwd=folder, check=not extra, capture_output=True)
    done = subprocess.run(["./main"], cwd=folder, input=columns.numpy().tobytes(), capture_output=True, check=True)
    return torch.from_numpy(np.frombuffer(done.stdout).reshape(-1, 6).copy()).split(3, -1)


needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")


@needs_compiler
@pytest.mark.parametrize("name", ["anitescu_potra_poisson", "mirtich", "spring_dashpot"])
def test_laws_in_c(name, tmp_path):
    impacts, mu, eps = contacts()
    model = ContactModel(find(name).at(0.2, 0.5))
    text = source.source_code(model, "c", impacts[:10])
    found = run_c(text, tmp_path, impacts, source.trace(model).arguments, mu, eps)
    assert differs(found, model.at((mu, eps)), impacts) < ROUNDING


@needs_compiler
def test_effects_of_all_places_in_c(tmp_path):
    model, drops = with_effects()
    found = run_c(source.source_code(model, "c", drops[:10]), tmp_path, drops, source.trace(model, SQUARE).arguments)
    assert differs(found, model, drops) < ROUNDING


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
        (".", "--to", "onnx"): "--to c is one file",
        (".", "--to", "nunpy"): "did you mean 'numpy'",
        ("base.pt", "--to", "c", "-o", "law.py"): "writes a .c file",
        ("nothing", "--to", "c"): "no such file",
    }
    for words, reason in refused.items():
        assert main(["export", *words]) == 2
        assert reason in capsys.readouterr().err
