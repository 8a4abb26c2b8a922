"""A new law and a new effect: a file each in the package, or announced by another package."""

import json
import shutil

from commands import ROOT, TRAIN, run_alone

from contactlearn.core.entry_points import announced

LAW = '''
from dataclasses import dataclass

from contactlearn.laws import Law


@dataclass(frozen=True)
class BumpyFloor(Law):
    """Newton restitution, and a tangential impulse that is a share of sticking's.  It is not Coulomb friction."""

    leaves_cone = True
    share: float = 1.0

    def solve(self, contact, mu, eps):
        P_n = -(1 + eps) * contact.v_n / contact.w_nn
        return -self.share * mu * (contact.v_t + contact.w_tn * P_n) / contact.w_tt, P_n
'''
EFFECT = '''
from dataclasses import dataclass

from contactlearn.effects import Effect, columns, parameter


@dataclass(frozen=True, eq=False)
class SpinLoss(Effect):
    """The body leaves with less of its spin.  It is not spin_damping, if only by name."""

    formula = "τ ← τ − c I ω⁺"
    c: float = parameter("c", "–", 0.0, 1.0)

    def wrench(self, state, wrench):
        P_t, P_n, tau = wrench.unbind(-1)
        return columns(P_t, P_n, tau - self.c * state.inertia * state.v_after(wrench)[..., 2])
'''
NEW = {"contactlearn/effects/spin_loss.py": EFFECT, "contactlearn/laws/bumpy_floor.py": LAW}
ENTRIES = "[contactlearn.effects]\nspin_gain = spin_loss:SpinGain\n[contactlearn.laws]\nbumpy = bumpy\n"
CATALOGUES = """
import sys
from contactlearn.cli import hydra_main
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.effects import catalogue

cfg = hydra_main.compose('evaluate', ['laws=[dented_floor,bumpy_floor]', 'law=dented_floor', 'effect=[spin_gain]'])
settings = EvaluateSettings.from_config(cfg)
print(*settings.laws, 'spin_gain' in catalogue(), settings.law.name, type(settings.effects['spin_gain']).__name__)

def train(words):
    sys.argv = ['train.py', *words]
    hydra_main.train()

"""


def test_new_laws_and_effects_are_a_file_each_or_announced_by_another_package(tmp_path, monkeypatch):
    """In a copy of the package that nothing else is changed in, beside a package with entry points."""
    for part in ("contactlearn", "configs"):
        shutil.copytree(ROOT / part, tmp_path / part)
    before = set(_files(tmp_path))
    for path, text in NEW.items():
        (tmp_path / path).write_text(text)
    theirs = tmp_path / "run" / "theirs"
    about = theirs / "theirs-1.0.dist-info"
    about.mkdir(parents=True)
    (theirs / "bumpy.py").write_text(LAW.replace("BumpyFloor", "DentedFloor"))
    (theirs / "spin_loss.py").write_text(EFFECT.replace("SpinLoss", "SpinGain"))
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{theirs}:{ROOT}")
    words = (*TRAIN, "law=bumpy_floor", "law.share=0.5", "effect=[spin_loss]", "hydra.run.dir=run")
    printed = run_alone("-c", CATALOGUES + f"train({words})", cwd=tmp_path)
    assert printed.startswith("dented_floor bumpy_floor True dented_floor SpinGain\n")
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert "bumpy_floor + spin_loss" in results["joint"]
    changed = {path for path in _files(tmp_path) if path not in before and not path.startswith("run/")}
    assert changed == NEW.keys()


def test_a_package_that_is_installed_later_is_announced(tmp_path, monkeypatch):
    """In a notebook, which goes on: entry points are read once as long as no folder of the path changes."""
    monkeypatch.syspath_prepend(tmp_path)
    assert "dented" not in {entry.name for entry in announced("contactlearn.laws")}
    about = tmp_path / "theirs-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[contactlearn.laws]\ndented = bumpy\n")
    assert "dented" in {entry.name for entry in announced("contactlearn.laws")}
    assert announced("contactlearn.laws") is announced("contactlearn.laws")


def _files(folder):
    """Paths within a folder, but for what Python compiles."""
    paths = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return (path.relative_to(folder).as_posix() for path in paths)
