"""Every example runs, says what it is there to show, and becomes a page with figures; here at small sizes."""

import ast
import gc
import json
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest
from commands import small_search

EXAMPLES = Path(__file__).parent.parent / "examples"
MODULES = ("pages", "cable_torque", "smooth_floor")
SIZES = {
    "paper_figures": ("--trials=80", "--repetitions=2", "--size=30", "--seeds=2", "--largest=20"),
    "find_hidden_effect": ("--trials=80", "--hidden=side_drag"),
    "own_csv": ("--trials=60",),
    "tracks_to_effect": ("--recordings=10",),
    "own_effect_and_law": ("--trials=80",),
    "two_bodies": ("--trials=40",),
    "transfer": ("--trials=24", "--seeds=2"),
    "next_experiment": ("--rounds=2",),
    "planned_drops": ("--budget=40",),
}
LONGEST = (
    "paper_figures",
    "tracks_to_effect",
    "next_experiment",
    "planned_drops",
)  # five others are pages in every run of the tests
SAYS = {
    "paper_figures": r"Wang–Mason +0\.1[12]\d ± .* 0\.5[45]\d ± ",
    "find_hidden_effect": "found:  side_drag, .* hidden indeed",
    "own_csv": r"x points left.*mirrored_x\n(.|\n)*the measurements are consistent(.|\n)*ε = 0\.5[45]",
    "tracks_to_effect": r"verdict=.effects., law=.wang_mason., spin_damping",
    "own_effect_and_law": r"k = 0\.000(19|20)",
    "two_bodies": r"restitution: Δ = -0\.0[23]\d+ ± 0\.00",
    "transfer": r"triangle, from scratch +(0\.\d+ *){3}",
    "next_experiment": r"round 2: .* nats; with as many usual drops ",
    "planned_drops": r"40 drops: .* with probability 0\.\d+\nstop: ",
}


@pytest.fixture
def pages(monkeypatch):
    """The examples' own tools; the classes that examples define are laws and effects until they are gone."""
    monkeypatch.syspath_prepend(EXAMPLES)
    import pages

    yield pages
    for name in MODULES:
        sys.modules.pop(name, None)
    gc.collect()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly if name in LONGEST else ()) for name in SIZES]
)
def test_an_example_is_a_page(name, pages, tmp_path):
    with small_search():
        text = pages.page(EXAMPLES / f"{name}.py", tmp_path, *SIZES[name])
    assert re.search(SAYS[name], text), text
    figures = re.findall(r"!\[.*\]\((.*\.png)\)", text)
    assert figures
    for figure in figures:
        assert (tmp_path / figure).read_bytes().startswith(b"\x89PNG")
    assert re.match(r"# [A-Z].*\n\n[A-Z]", text)
    assert text.count("```python") == text.count("\n```\n") - text.count("```text")


@pytest.mark.parametrize("name", SIZES)
def test_the_page_of_the_site_has_the_code_of_the_example(name, pages):
    """If not: `python examples/pages.py examples/as_pages NAME`."""
    text = (EXAMPLES / "as_pages" / name / f"{name}.md").read_text("utf-8")
    _, *cells = pages._cells((EXAMPLES / f"{name}.py").read_text("utf-8"))
    assert re.findall(r"```python\n((?:.|\n)*?)\n```", text) == [code.strip() for _, _, code in cells]
    assert all((EXAMPLES / "as_pages" / name / figure).is_file() for figure in re.findall(r"\((\w+\.png)\)", text))


@pytest.mark.parametrize("name", SIZES)
def test_the_notebook_is_that_of_the_example(name, pages):
    """If not: `python examples/pages.py examples/as_pages NAME`."""
    text = (EXAMPLES / "as_pages" / name / f"{name}.ipynb").read_text("utf-8")
    assert text.rstrip() == pages.notebook(EXAMPLES / f"{name}.py")


@pytest.mark.parametrize("name", ["two_bodies", "own_csv"])
def test_a_notebook_runs_where_nothing_else_is(name, tmp_path, monkeypatch):
    """Its cells, one after the other, at small sizes."""
    monkeypatch.chdir(tmp_path)
    cells = json.loads((EXAMPLES / "as_pages" / name / f"{name}.ipynb").read_text("utf-8"))["cells"]
    shown, module = [], types.ModuleType(name)
    module.display = shown.append
    monkeypatch.setitem(sys.modules, name, module)
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile(re.sub(r"trials=\d+", "trials=60", cell["source"]), name, "exec"), module.__dict__)
    assert shown
    module.__dict__.clear()


def test_examples_import_contactlearn_alone():
    """Whoever copies an example sees the public names, and no module behind them."""
    imports = [
        (path.name, alias.name if isinstance(node, ast.Import) else node.module)
        for path in EXAMPLES.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    ]
    assert {name for name, module in imports if module == "contactlearn"} >= {f"{name}.py" for name in SIZES}
    assert [(name, module) for name, module in imports if module.startswith("contactlearn.")] == []


BARE = """
import os, sys
import contactlearn as cl
for chain in sys.argv[1:]:
    try:
        eval(chain)  # loads what is not ours once, for time
    except AttributeError:
        pass
for name in [name for name in sys.modules if name.partition(".")[0] == "contactlearn"]:
    del sys.modules[name]
import contactlearn as cl
for chain in sys.argv[1:]:
    if os.fork() == 0:
        try:
            eval(chain)
        except AttributeError as error:
            print(chain, error, flush=True)
        os._exit(0)
    os.wait()
"""


def test_what_examples_and_pages_name_is_there_after_a_bare_import():
    """In a process that has loaded nothing else of ours, as that of whoever copies a line."""
    pages = [*EXAMPLES.glob("*.py"), *(EXAMPLES.parent / "docs").glob("*.md"), EXAMPLES.parent / "README.md"]
    chains = {chain for page in pages for chain in re.findall(r"\bcl(?:\.[a-z_]+){2,}", page.read_text("utf-8"))}
    chains = {chain for chain in chains if not any(longer.startswith(f"{chain}.") for longer in chains)}
    assert len(chains) > 20
    done = subprocess.run([sys.executable, "-c", BARE, *sorted(chains)], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_every_example_is_tested(pages):
    scripts = {path.stem for path in EXAMPLES.glob("*.py")} - set(MODULES)
    assert scripts == set(SIZES) == set(pages.NAMES)
