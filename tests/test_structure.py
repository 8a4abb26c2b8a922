"""The house: imports run one way, a name means one thing, options are types, importing is cheap.

The sets of exceptions only shrink: one that no longer applies fails.
"""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest
from importlinter.cli import lint_imports
from quick import third_of

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "contactlearn"

Function = ast.FunctionDef | ast.AsyncFunctionDef
PATHS = sorted(PACKAGE.rglob("*.py"))


def _name(path: Path) -> str:
    """`contactlearn.room.module` of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _functions(path: Path) -> Iterator[tuple[str, Function, bool]]:
    """Qualified name of each function, the function, and whether it is public: neither nested nor private."""

    def visit(node: ast.AST, prefix: str, public: bool) -> Iterator[tuple[str, Function, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, Function):
                open_ = public and (not child.name.startswith("_"))
                yield f"{prefix}{child.name}", child, open_
                yield from visit(child, f"{prefix}{child.name}.", False)
            elif isinstance(child, ast.ClassDef):
                yield from visit(child, f"{prefix}{child.name}.", public and not child.name.startswith("_"))
            else:
                yield from visit(child, prefix, public)

    yield from visit(_tree(path), "", True)


def _only(found: set[str], excepted: set[str], rule: str) -> None:
    assert not found - excepted, f"{rule}: {sorted(found - excepted)}"
    assert not excepted - found, f"exceptions that are none any more ({rule}): {sorted(excepted - found)}"


def test_imports_run_one_way_and_in_no_circle():
    """The layers and circles of `[tool.importlinter]` in pyproject.toml."""
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), is_debug_mode=False) == 0


HOMONYMS = {
    "diagnose",  # one act: the library's on impacts, the command's on what its settings name
    "Fit", "fit", "compare",  # verbs of the front door, and steps inside the processes, the flights and the audit
}  # fmt: skip
PATTERNS = {
    r"os\.replace": "files are written by numerics.atomic_write",
    r"\b1\.4826\b": "numerics.MAD_SCALE",
    r"\b1\.959964\b": "numerics.Z_95",
    r"partition\(\":\"\)": "an effect is named by an EffectId",
    r"split\(\" \+ \"\)": "a set of effects is a tuple of EffectId",
}


def test_a_public_name_means_one_thing():
    homes = defaultdict(set)
    for path in PATHS:
        for node in _tree(path).body:
            if (
                isinstance(node, ast.ClassDef | Function)
                and not node.name.startswith("_")
                and path.name != "hydra_main.py"
            ):
                homes[node.name].add(_name(path))  # a door is called as the job behind it
    shared = {"load", "save", "read", "catalogue", "find"}  # each file format has its pair, each registry too
    found = {name for name, modules in homes.items() if len(modules) > 1} - shared
    _only(found, HOMONYMS, "a name means one thing in the package")


@pytest.mark.parametrize("pattern", PATTERNS)
def test_what_is_written_elsewhere(pattern):
    found = {str(p.relative_to(PACKAGE)) for p in PATHS if re.search(pattern, p.read_text("utf-8"))}
    _only(found - {"core/numerics.py", "effects/identity.py"}, set(), PATTERNS[pattern])


# A registry passes the arguments of a class on, a copy those of its fields, an override those of its base, a source of
# impacts those of the function that also tells how they were found, or those of the camera that simulates recordings.
KEYWORDS = {
    "contactlearn.data.audit.moments.Columns.replace",
    "contactlearn.simulation.hidden_effects.effects._form",
    "contactlearn.data.tracks.find",
    "contactlearn.data.tracks.load",
    "contactlearn.simulation.recordings_mujoco.find",
    "contactlearn.simulation.recordings_mujoco.load",
    "contactlearn.simulation.recordings.find",
    "contactlearn.simulation.recordings.load",
    "contactlearn.effects.state.State.replace",
    "contactlearn.mechanics.impacts.Impacts.replace",
    "contactlearn.laws.find",
    "contactlearn.models.gp.processes.WeightedNoise._shaped_noise_covar",
    "contactlearn.core.workers.WorkerPool.submit",
}
OPTIONS = {"contactlearn.effects.formula.effect.formula"}


def test_options_are_types():
    found = {f"{_name(path)}.{name}" for path in PATHS for name, node, _ in _functions(path) if node.args.kwarg}
    _only(found, KEYWORDS | OPTIONS, "keyword arguments are named, or the fields of a dataclass")


@pytest.mark.parametrize("statement", ["import contactlearn", "from contactlearn import cli"])
def test_importing_is_cheap(statement):
    """Neither torch nor anything as heavy is loaded before it is needed."""
    heavy = "{'torch', 'gpytorch', 'pandas', 'matplotlib', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", f"{statement}\nimport sys\nassert not {heavy}"], check=True, cwd=ROOT)


def test_importing_diagnose_is_quiet_and_loads_no_more_than_it_needs():
    """Beside torch; SciPy, pandas and GPyTorch are loaded where something is computed with them."""
    heavy = "{'scipy', 'pandas', 'pyarrow', 'gpytorch', 'sympy', 'omegaconf', 'matplotlib', 'rich'} & set(sys.modules)"
    words = f"from contactlearn import diagnose\nimport sys\nassert not {heavy}, {heavy}"
    quiet = ("-W", "error::DeprecationWarning", "-W", "error::FutureWarning")  # of what other packages warn each other
    subprocess.run([sys.executable, *quiet, "-c", words], check=True, cwd=ROOT)


def test_public_names_exist():
    import contactlearn

    for name in contactlearn.__all__:
        assert getattr(contactlearn, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Impact'"):
        contactlearn.Impact  # noqa: B018
    # The imports that only a type checker follows are those that `__getattr__` makes.
    tree = _tree(PACKAGE / "__init__.py")
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    seen = {one.asname: f"{node.module}:{one.name}" for node in imports for one in node.names if one.asname}
    seen |= {"read_recordings": "contactlearn.data.tracks:find", "read_table": "contactlearn.data.table:load"}
    homes = {name: home if ":" in home else f"{home}:{name}" for name, home in contactlearn._HOME.items()}
    made = {name: f"contactlearn.{home}" for name, home in homes.items()}
    assert seen == made | {name: f"contactlearn:{name}" for name in contactlearn._ROOMS}
    assert {*contactlearn.__all__} <= {*made, *contactlearn._ROOMS, "__version__"}
    assert (PACKAGE / "py.typed").exists()


def test_three_commits_that_follow_each_other_try_every_case():
    """And each of them at least one of each test."""
    names = [
        f"{test}{case}"
        for test, count in (("a", 0), ("b", 1), ("c", 2), ("d", 4), ("e", 9))
        for case in ([f"[{k}]" for k in range(count)] or [""])
    ]
    tried = [[one.nodeid for one in third_of([SimpleNamespace(nodeid=name) for name in names], k)] for k in (7, 8, 9)]
    assert {name for some in tried for name in some} == {*names}
    for some in tried:
        assert {name[0] for name in some} == {*"abcde"}
    assert [sum(name[0] == "e" for name in some) for some in tried] == [3, 3, 3]
