"""`make versions`, as far as it goes without an environment of its own."""

import importlib.util
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def tool(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_package_that_is_needed_has_a_lower_bound_to_be_tested(monkeypatch):
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    assert len(tool("versions").lower_bounds()) == len(needed)
    versions = tool("versions")
    monkeypatch.setattr(versions, "pythons", lambda: ["python3"])
    assert versions.asked([]) == (["oldest", "newest"], ["python3"])
    assert versions.asked(["oldest", "python3"]) == (["oldest"], ["python3"])


@pytest.mark.parametrize(("words", "message"), [
    (["oldst"], "invalid choice: 'oldst'"),
    (["oldest", "python2.99"], "python2.99: no such command"),
    ([], "no Python 3.11 or later is found"),
])  # fmt: skip
def test_versions_that_are_not_there_are_no_success(words, message, capsys, monkeypatch):
    versions = tool("versions")
    monkeypatch.setattr(versions, "pythons", list)
    with pytest.raises(SystemExit, match="2"):
        versions.asked(words)
    assert message in capsys.readouterr().err
