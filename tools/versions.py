"""The oldest and the newest supported versions, tested in environments of their own: `make versions`.

    python tools/versions.py                      oldest and newest packages, with every Python that is found
    python tools/versions.py oldest python3.11    one of them

`oldest` holds every package of pyproject.toml to its lower bound; `newest` lets pip choose, and downloads what it then
needs: for torch that may be gigabytes.  The tests are those of `make quick`.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def lower_bounds():
    """`name==version` for each requirement of the package that has a lower bound."""
    found = (re.match(r"([\w.-]+)>=([\w.]+)", line) for line in PROJECT["dependencies"])
    return [f"{match[1]}=={match[2]}" for match in found if match]


def pythons():
    """Commands of supported Pythons that run on this machine; 3.11 is the oldest."""
    names = (f"python3.{minor}" for minor in range(11, 30))
    there = [name for name in names if shutil.which(name)]  # a version manager may have names alone
    return [name for name in there if not subprocess.run([name, "-c", ""], capture_output=True, check=False).returncode]


def tested(which, python):
    """Whether the tests pass in a fresh environment."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        subprocess.run([python, "-m", "venv", home], check=True)
        install = [
            home / "bin/python",
            "-m",
            "pip",
            "install",
            "-q",
            "--disable-pip-version-check",
            "-e",
            f"{ROOT}[test]",
        ]
        if which == "oldest":
            (home / "oldest.txt").write_text("\n".join(lower_bounds()))
            install += ["-c", home / "oldest.txt"]
        if subprocess.run(install, check=False).returncode:
            return False
        shown = [home / "bin/python", "-m", "pip", "list", "--disable-pip-version-check"]
        print(subprocess.run(shown, capture_output=True, text=True, check=True).stdout, flush=True)
        alone = {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", name), "OMP_NUM_THREADS": "1"}
        return not subprocess.run(
            [home / "bin/python", "-m", "pytest", "--quick"], cwd=ROOT, env=alone, check=False
        ).returncode


if __name__ == "__main__":
    kinds = [sys.argv[1]] if len(sys.argv) > 1 else ["oldest", "newest"]
    results = {(kind, python): tested(kind, python) for python in sys.argv[2:] or pythons() for kind in kinds}
    for (kind, python), good in results.items():
        print(f"{'pass' if good else 'FAIL'}  {python} with the {kind} packages")
    sys.exit(not all(results.values()))
