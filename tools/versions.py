"""The package in environments of its own, with other packages than those of the lock file: `make versions`.

    python tools/versions.py                      oldest, newest and pre, with every Python that is found
    python tools/versions.py oldest python3.11    one of them
    python tools/versions.py fresh                what `pip install` gives a new user, a part of `make test`

`fresh` installs nothing but the package, and runs the Python of the README; without a package index it is skipped.
The others run the whole suite.  `oldest` holds every package that contactlearn itself needs to its lower bound, and
leaves those of the tests to pip; `newest` lets pip choose all, and downloads what it then needs: for torch that may be
gigabytes.  `pre` adds the pre-releases of NumPy and pandas, and only warns: they may be at fault themselves.
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

NIGHTLY = ["oldest", "newest", "pre"]
KINDS = ["fresh", *NIGHTLY]
EARLY = ["numpy", "pandas"]
ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def lower_bounds():
    """`name==version` for each requirement of the package that has a lower bound."""
    found = (re.match(r"([\w.-]+)>=([\w.]+)", line) for line in PROJECT["dependencies"])
    return [f"{match[1]}=={match[2]}" for match in found if match]


def locked(name):
    """`name==version` of the lock file."""
    return re.search(rf"^{name}==[\w.]+", (ROOT / "requirements.lock").read_text("utf-8"), re.MULTILINE)[0]


def pythons():
    """Commands of supported Pythons that run on this machine; 3.11 is the oldest."""
    names = (f"python3.{minor}" for minor in range(11, 30))
    there = [name for name in names if shutil.which(name)]  # a version manager may have names alone
    return [name for name in there if not subprocess.run([name, "-c", ""], capture_output=True, check=False).returncode]


def snippet():
    """The Python of the README."""
    return "\n".join(re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL))


def ran(*command, cwd=ROOT, home=None):
    """Whether a command succeeds; with a home it knows nothing of this process's environment but the PATH."""
    alone = None if home is None else {"PATH": os.environ["PATH"], "HOME": str(home), "OMP_NUM_THREADS": "1"}
    return subprocess.run(list(map(str, command)), cwd=cwd, env=alone, check=False).returncode == 0


def tested(which, python):
    """Whether a fresh environment of this kind passes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if not ran(python, "-m", "venv", folder / "venv"):
            return False
        own = folder / "venv/bin/python"
        pip = (own, "-m", "pip", "--disable-pip-version-check", "-qq")
        if which == "fresh":
            quickly = ("--retries", "1", "--timeout", "15")
            if not ran(*pip, *quickly, "download", "--no-deps", "--no-cache-dir", "-d", folder, locked("filelock")):
                print("A fresh install was not tried: no package index can be reached.")
                return True
            # The torch of the lock file, which pip has in its cache: a newer one may be a download of gigabytes.
            install = ran(*pip, "install", "--no-compile", ROOT, locked("torch"))  # Python compiles what it imports
            return install and ran(own, "-c", snippet(), cwd=folder, home=folder)
        (folder / "bounds.txt").write_text("\n".join(lower_bounds() if which == "oldest" else ()))
        if not ran(*pip, "install", "-e", f"{ROOT}[test]", "-c", folder / "bounds.txt"):
            return False
        if which == "pre" and not ran(*pip, "install", "--pre", "--upgrade", *EARLY):
            return False
        ran(*pip, "list")
        suite = (own, "-m", "pytest", "-n", "3", "--dist", "worksteal")
        return ran(*suite, home=os.environ.get("HOME", name))


def asked(words):
    """The kinds of versions and the Pythons of the command line; the command ends where there are none."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=KINDS, help="of versions (default: all but fresh)")
    parser.add_argument("python", nargs="*", help="a command or a path (default: every python3.11 and later on PATH)")
    said = parser.parse_args(words)
    commands = said.python or ([sys.executable] if said.kind == "fresh" else pythons())
    for python in commands:
        if not shutil.which(python):
            parser.error(f"{python}: no such command")
    if not commands:
        parser.error("no Python 3.11 or later is found; name one: versions.py oldest /path/to/python3.12")
    return [said.kind] if said.kind else NIGHTLY, commands


if __name__ == "__main__":
    kinds, commands = asked(sys.argv[1:])
    results = {(kind, python): tested(kind, python) for python in commands for kind in kinds}
    for (kind, python), good in results.items():
        word = "pass" if good else "warn" if kind == "pre" else "FAIL"
        print(f"{word}  {python} with the {kind} packages")
    sys.exit(not all(good or kind == "pre" for (kind, _), good in results.items()))
