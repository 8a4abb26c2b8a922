"""The package as it is installed: sdist and wheel build, hold what they must, and work where no checkout is."""

import contextlib
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
import quick
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import contactlearn

pytest.importorskip("hatchling", reason="the wheel is built with hatchling: pip install -e '.[test]'")

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def done(*command, cwd, **environment):
    """The output of a command in a process of its own."""
    alone = {"PATH": "/usr/bin:/bin", **environment}
    ended = subprocess.run(list(map(str, command)), cwd=cwd, env=alone, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def built(folder, source, *targets):
    """What hatchling makes of a source tree; it needs nothing but itself."""
    words = [part for target in targets for part in ("-t", target)]
    done(sys.executable, "-m", "hatchling", "build", *words, "-d", folder, cwd=source, PYTHONPATH=":".join(sys.path))
    return folder


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A folder with the sdist and the wheel of this checkout."""
    return built(tmp_path_factory.mktemp("dist"), ROOT, "sdist", "wheel")


@pytest.fixture(scope="module")
def installed(packages, tmp_path_factory):
    """A folder into which the wheel is installed, without its dependencies."""
    folder = tmp_path_factory.mktemp("installed")
    (wheel,) = packages.glob("*.whl")
    pip = ("-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--no-index", "--target", folder)
    done(sys.executable, *pip, wheel, cwd=folder)
    return folder


def names(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_the_wheel_holds_the_package_and_nothing_else(packages):
    (wheel,) = packages.glob("*.whl")
    found = names(wheel)
    for folder, inside in (("contactlearn", "contactlearn"), ("hydra_plugins", "hydra_plugins"), ("configs", None)):
        kept = (path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        start = ROOT if inside else ROOT / "configs"
        wanted = {("" if inside else "contactlearn/configs/") + str(path.relative_to(start)) for path in kept}
        assert wanted <= found
        found -= wanted
    assert not found
    assert wheel.name.split("-")[1] == contactlearn.__version__


def test_the_sdist_gives_the_same_wheel(packages, tmp_path):
    (sdist,) = packages.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    (again,) = built(tmp_path / "dist", source, "wheel").glob("*.whl")
    (wheel,) = packages.glob("*.whl")
    assert names(again) == names(wheel)
    assert {"tests", "examples", "requirements.lock", "Makefile"} <= {path.name for path in source.iterdir()}
    assert not [*source.glob("benchmarks/blind/data/**/*.parquet")]


def test_installed_commands_need_no_checkout(installed, tmp_path):
    """They find their configurations, Hydra's -m finds the sweeper, and runs go where one stands."""
    alone = {"PYTHONPATH": str(installed), "OMP_NUM_THREADS": "1"}
    assert len(list((installed / "bin").iterdir())) == len(PROJECT["scripts"])
    configs = "from contactlearn.cli.hydra_main import CONFIGS; print(CONFIGS)"
    where = done(sys.executable, "-c", configs, cwd=tmp_path, **alone)
    assert where.strip() == str(installed / "contactlearn" / "configs")
    printed = done(sys.executable, installed / "bin" / "contactlearn", "evaluate", "--help", cwd=tmp_path, **alone)
    assert "data=mydata" in printed
    small = ("data.size=60", "train.size=20", "train.repetitions=2", "bootstrap=20", "model=analytical")
    done(sys.executable, installed / "bin" / "contactlearn", "train", "-m", *small, "seed=3", cwd=tmp_path, **alone)
    assert len(list(tmp_path.glob("multirun/*/*/*/results.json"))) == 1


def test_windows_is_refused_in_a_sentence():
    words = "import sys\nsys.platform = 'win32'\nimport contactlearn"
    ended = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "ImportError: contactlearn does not run on Windows itself" in ended.stderr


def test_the_lock_has_what_the_tests_need_and_no_more():
    """Each pinned package is applies for by the package, its tests, or one of those."""
    lines = (ROOT / "requirements.lock").read_text("utf-8").splitlines()
    pinned = {canonicalize_name(line.partition("==")[0]) for line in lines if "==" in line}
    known = set()
    left = [(line, {""}) for line in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"])]
    while left:
        line, extras = left.pop()
        wanted = Requirement(line)
        name = canonicalize_name(wanted.name)
        applies = wanted.marker is None or any(wanted.marker.evaluate({"extra": extra}) for extra in extras)
        if applies and (name, *wanted.extras) not in known:
            known.add((name, *wanted.extras))
            with contextlib.suppress(PackageNotFoundError):  # of another platform
                left += [(more, {"", *wanted.extras}) for more in requires(name) or ()]
    found = {name for name, *_ in known}
    assert not pinned - found, f"nothing needs {sorted(pinned - found)}"


def test_quick_takes_what_changed():
    class Item:
        def __init__(self, name, number):
            self.path, self.number = ROOT / "tests" / name, number

    items = [Item(name, k) for name in ("test_audit.py", "test_shapes.py", "test_sweeps.py") for k in range(8)]
    changed = {"tests/test_shapes.py", "contactlearn/data/audit/findings.py"}
    taken = [(item.path.name, item.number) for item in quick.kept(items, changed)]
    assert taken == [("test_audit.py", k) for k in range(quick.FIRST)] + [("test_shapes.py", k) for k in range(8)]
    assert not [*quick.kept(items, set())]


@pytest.fixture
def versions():
    """The command behind `make versions`."""
    spec = spec_from_file_location("versions", ROOT / "tools" / "versions.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_package_that_is_needed_has_a_lower_bound_to_be_tested(versions, monkeypatch):
    assert len(versions.lower_bounds()) == len(PROJECT["dependencies"])
    monkeypatch.setattr(versions, "pythons", lambda: ["python3"])
    assert versions.asked([]) == (["oldest", "newest", "pre"], ["python3"])
    assert versions.asked(["oldest", "python3"]) == (["oldest"], ["python3"])
    assert versions.asked(["fresh"]) == (["fresh"], [sys.executable])


def test_a_fresh_install_has_the_torch_of_the_lock_and_the_python_of_the_readme(versions):
    assert re.fullmatch(r"torch==\d+\.\d+\.\d+", versions.locked("torch"))
    assert "import contactlearn as cl" in versions.snippet()


@pytest.mark.parametrize(("words", "message"), [
    (["oldst"], "invalid choice: 'oldst'"),
    (["oldest", "python2.99"], "python2.99: no such command"),
    ([], "no Python 3.11 or later is found"),
])  # fmt: skip
def test_versions_that_are_not_there_are_no_success(words, message, versions, capsys, monkeypatch):
    monkeypatch.setattr(versions, "pythons", list)
    with pytest.raises(SystemExit, match="2"):
        versions.asked(words)
    assert message in capsys.readouterr().err


def test_readme_names_the_extras_that_there_are():
    (line,) = [line for line in (ROOT / "README.md").read_text("utf-8").splitlines() if line.startswith("Extras")]
    of_developers = {"docs", "test", "fuzz", "bench"}
    assert {*re.findall(r"`(\w+)`", line)} == {*PROJECT["optional-dependencies"]} - of_developers
