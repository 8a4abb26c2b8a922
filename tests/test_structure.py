"""The data flow runs one way: no module imports one that comes after it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "contactlearn"

# From the measurements to what is shown.  A module may import those on its own or an earlier line.
ORDER = (
    ("errors",),
    ("numerics", "serialisation"),
    ("shapes", "mechanics"),
    ("impacts",),
    ("laws", "effects"),
    ("regression",),
    ("model",),
    ("citation",),
    ("checkpoint", "evaluation"),
    ("identification",),
    ("data",),
    ("audit",),
    ("learning", "testing"),
    ("diagnosis",),
    ("results",),
    ("report",),
    ("app",),
    ("cli",),
    ("__main__",),
)
RANK = {name: rank for rank, names in enumerate(ORDER) for name in names}


def _part(module: str) -> str:
    return module.split(".")[1]


def _imports(path: Path) -> set[str]:
    """Parts of the package that a file imports at its top level."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module == "contactlearn":
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("contactlearn."):
            found.add(_part(node.module))
        elif isinstance(node, ast.Import):
            found |= {_part(alias.name) for alias in node.names if alias.name.startswith("contactlearn.")}
    return found


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_run_one_way(path):
    part = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if part == "__init__":
        assert not _imports(path)  # public names are loaded when they are used
        return
    late = {name for name in _imports(path) if RANK[name] > RANK[part]}
    assert not late, f"{part} imports {late}, which come after it"


def test_files_are_short():
    long = {path.name: n for path in PACKAGE.rglob("*.py") if (n := len(path.read_text().splitlines())) > 350}
    assert not long


@pytest.mark.parametrize("statement", ["import contactlearn", "from contactlearn import cli"])
def test_importing_is_cheap(statement):
    """Neither torch nor anything as heavy is loaded before it is needed."""
    heavy = "{'torch', 'gpytorch', 'pandas', 'matplotlib', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", f"{statement}\nimport sys\nassert not {heavy}"], check=True, cwd=ROOT)


def test_public_names_exist():
    import contactlearn

    for name in contactlearn.__all__:
        assert getattr(contactlearn, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Impact'"):
        contactlearn.Impact  # noqa: B018


def test_type_checkers_see_the_public_names():
    """The imports that only a type checker follows are those that `__getattr__` makes."""
    import contactlearn

    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    seen = {alias.name: node.module for node in block.body for alias in node.names}
    made = {name: f"contactlearn.{home}" for name, home in contactlearn._HOME.items()}
    modules = {name: "contactlearn" for name in contactlearn.__all__ if name not in {*made, "__version__"}}
    assert seen == made | modules
    assert (PACKAGE / "py.typed").exists()
