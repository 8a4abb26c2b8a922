"""Which tests run: of `pytest --quick` those of what changed since the last commit, of `--third` a third of the cases.

Of the first they are those of the test files that changed, and the first of the files that import a changed module
by its own name.
"""

import itertools
import re
import subprocess
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parent.parent
FIRST = 5  # tests of a file that imports a changed module


def changed():
    """Paths that differ from the last commit, none where there is no git."""
    words = ["git", "-C", str(ROOT), "status", "--porcelain", "--untracked-files=all"]
    try:
        message = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return set()
    return {line[3:].rpartition(" -> ")[2] for line in message.splitlines()}


def _imported(path, modules):
    """Whether a test file imports one of the modules by its own name."""
    text = path.read_text("utf-8")
    names = (module.rpartition(".") for module in modules)
    return any(re.search(rf"from {room}(\.{leaf} import| import .*\b{leaf}\b)", text) for room, _, leaf in names)


def kept(items, paths):
    """The tests of a quick run, given the paths that changed."""
    modules = {
        path[:-3].replace("/", ".").removesuffix(".__init__") for path in paths if path.startswith("contactlearn/")
    }
    files = defaultdict(list)
    for item in items:
        files[item.path].append(item)
    for path, tests in files.items():
        if f"tests/{path.name}" in paths:
            yield from tests
        elif _imported(path, modules):
            yield from tests[:FIRST]


def third_of(items, k):
    """Of each test every third case, or one of two, from the k-th on."""
    for _, cases in itertools.groupby(items, lambda item: item.nodeid.partition("[")[0]):
        cases = [*cases]
        step = min(3, len(cases))
        yield from cases[k % step :: step]
