"""The oldest and the newest supported versions, tested in environments of their own: `make versions`.

    python tools/versions.py                      oldest and newest packages, with every Python that is found
    python tools/versions.py oldest python3.11    one of them

`oldest` holds every package that contactlearn itself needs to its lower bound, and leaves those of the tests to pip;
`newest` lets pip choose all, and downloads what it then needs: for torch that may be gigabytes.  The tests are those of
`make quick`.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

KINDS = ["oldest", "newest"]
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
        if subprocess.run([python, "-m", "venv", home], check=False).returncode:
            return False
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


def asked(words):
    """The kinds of versions and the Pythons of the command line; the command ends where there are none."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=KINDS, help="of versions (default: both)")
    parser.add_argument("python", nargs="*", help="a command or a path (default: every python3.11 and later on PATH)")
    said = parser.parse_args(words)
    commands = said.python or pythons()
    for python in commands:
        if not shutil.which(python):
            parser.error(f"{python}: no such command")
    if not commands:
        parser.error("no Python 3.11 or later is found; name one: versions.py oldest /path/to/python3.12")
    return [said.kind] if said.kind else KINDS, commands


if __name__ == "__main__":
    kinds, commands = asked(sys.argv[1:])
    results = {(kind, python): tested(kind, python) for python in commands for kind in kinds}
    for (kind, python), good in results.items():
        print(f"{'pass' if good else 'FAIL'}  {python} with the {kind} packages")
    sys.exit(not all(results.values()))
