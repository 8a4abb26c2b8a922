"""The release checklist, walked through up to the upload: `make release` after `make test`.

Each step says what it found; the first that fails ends the walk with what to do.  Nothing is tagged or uploaded here:
the last lines say how.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
OWNED = ("pyproject.toml", "README.md", "CITATION.cff", "paper.md")
SMALL = ("data.size=60", "train.size=20", "train.repetitions=2", "bootstrap=20")


def said(*command, cwd=ROOT):
    """The output of a command; the walk ends where it fails."""
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}\nstop: {' '.join(map(str, command))}")
    return done.stdout.strip()


def step(good, finding, otherwise):
    """Print a finding, or end the walk with what to do."""
    if not good:
        sys.exit(f"stop: {otherwise}")
    print(f"ok    {finding}", flush=True)


def check_words(version):
    """The tree is committed, and all places say this version."""
    step(not said("git", "status", "--porcelain"), "everything is committed", "commit or remove what git status shows")
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    step(cited and cited[1] == version, f"CITATION.cff says {version}", f"write version: {version} into CITATION.cff")
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    step(
        f"\n## {version}" in changes,
        f"CHANGELOG.md has {version}",
        f"head what is unreleased with '## {version} (date)'",
    )
    unreleased = re.search(r"^## Unreleased\n(.*?)^## ", changes, re.MULTILINE | re.DOTALL)
    step(not (unreleased and unreleased[1].strip()), "nothing is unreleased", f"move it below '## {version}'")
    left = [
        name
        for name in OWNED
        if re.search(r"OWNER|<URL of this repository>|the contactlearn authors", (ROOT / name).read_text("utf-8"))
    ]
    step(
        not left, "authors and addresses are filled in", f"a person must fill in owner and authors in {', '.join(left)}"
    )
    tags = said("git", "tag", "--list", f"v{version}"), said("git", "tag", "--points-at", "HEAD").split()
    step(
        not tags[0] or tags[0] in tags[1],
        f"v{version} is free, or is here",
        f"v{version} is another commit: raise __version__",
    )


def build(folder):
    """Sdist and wheel, which the tests hold to each other; the path of the wheel."""
    for target in ("sdist", "wheel"):
        said(sys.executable, "-m", "hatchling", "build", "-t", target, "-d", folder)
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    step(True, f"{sdist.name} and {wheel.name} are built in {folder}", "")
    return wheel


def try_out(wheel, extras):
    """Install the wheel where no checkout is, and use it; resolve each extra beside it."""
    with tempfile.TemporaryDirectory() as name:
        empty = Path(name)
        venv.create(empty / "venv", with_pip=True)
        python, pip = empty / "venv/bin/python", ("-m", "pip", "--disable-pip-version-check", "install", "-q")
        said(python, *pip, "-c", ROOT / "requirements.lock", wheel, cwd=empty)
        step(True, "it installs in a clean environment", "")
        for word in ("train", "evaluate", "diagnose"):
            said(empty / f"venv/bin/contactlearn-{word}", "--help", cwd=empty)
        said(empty / "venv/bin/contactlearn", "train", *SMALL, cwd=empty)
        said(empty / "venv/bin/contactlearn", "train", "-m", *SMALL, "seed=0,1", cwd=empty)
        step(True, "its commands find their configurations, and run and sweep in an empty folder", "")
        for extra in extras:
            said(python, *pip, "--dry-run", f"contactlearn[{extra}] @ {wheel.as_uri()}", cwd=empty)
            step(True, f"contactlearn[{extra}] can be installed", "")


if __name__ == "__main__":
    number = re.search(r'__version__ = "(.*)"', (ROOT / "contactlearn" / "core" / "__init__.py").read_text("utf-8"))[1]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    print(f"contactlearn {number}")
    check_words(number)
    with tempfile.TemporaryDirectory() as made:
        built = build(Path(made))
        try_out(built, project["optional-dependencies"])
    said(sys.executable, "-m", "hatchling", "build", "-d", ROOT / "dist", "--clean")
    print(f"""
Left to do by hand:
  make test-all && make versions       on an idle machine
  git tag -a v{number} -m 'contactlearn {number}' && git push --follow-tags
  python -m pip install twine && python -m twine upload dist/contactlearn-{number}*
  raise __version__ in contactlearn/core/__init__.py, and begin '## Unreleased' in CHANGELOG.md""")
