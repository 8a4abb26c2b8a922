"""Settings of the documentation site: `make docs` builds it from the pages as they lie in the repository.

The source folder is the repository, so that a link that works between two files there works on the site, and a broken
one ends the build.  Nothing is loaded from elsewhere: no web fonts, no scripts of others; search works from the disk.
"""

import gc
import re
from pathlib import Path
from typing import Any

import contactlearn
from contactlearn.effects import Effect, catalogue

# The trees of all pages are kept: looking through them for garbage took a tenth of the time.
gc.set_threshold(100_000, 20, 50)

project = "contactlearn"
copyright = "the contactlearn authors, MIT licence"
version = release = contactlearn.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
root_doc = "docs/index"
include_patterns = [
    "docs/**/*.md",
    "docs/*.md",
    "docs/api/*.rst",
    "examples/**/*.md",
    "examples/*.md",
    "benchmarks/*.md",
    "benchmarks/**/*.md",
]
include_patterns += ["CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = [".*", "outputs", "multirun", "site"]

templates_path = ["_templates"]  # a page for each module below those that docs/api.md names

myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]  # a `console` block is a shell with comments

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_mock_imports = ["ezc3d", "h5py", "rosbags"]  # extras that readers of recordings import
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "contactlearn"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_search_summary = False  # summaries are fetched, which no browser does from a disk
html_theme_options = {"navigation_with_keys": True}

TABULAR = re.compile(r"^ {4}|^\S.*? {3,}\S")  # a line of code, or of columns set apart by blanks


def escaped(text: str) -> str:
    """Plain text with `code` as reStructuredText."""
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(f"`{part}`" if part.startswith("`") else re.sub(r"([*|_\\])", r"\\\1", part) for part in parts)


def as_restructured_text(app: Any, what: str, name: str, target: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code`; tables and code at the head of a module stay as they are typed."""
    result: list[str] = []
    literal = False
    for line in lines:
        tabular = what == "module" and bool(TABULAR.match(line) or (literal and not line))
        if tabular and not literal:
            result += ["", "::", ""]
        if literal and not tabular:
            result.append("")
        result.append(f"    {line}" if tabular else escaped(line))
        literal = tabular
    if what in ("attribute", "data", "property"):
        result.insert(0, "")  # or napoleon takes what is before a colon for a type
    lines[:] = result


def formulas(of: Effect) -> str:
    """The row of one form of an effect in the table of docs/effects.md."""
    ranges: dict[str, list[str]] = {}
    for p in of.every_parameter():
        unit = ("" if p.unit == "–" else f" {p.unit}") + (" (in space)" if p not in of.parameters else "")
        ranges.setdefault(f"[{p.low:g}, {p.high:g}]{unit}", []).append(p.symbol)
    parameters = "; ".join(f"{', '.join(symbols)} in {range_}" for range_, symbols in ranges.items())
    name = f"`{of.name}`" if of.form is None else f"`{of.name}`, `form={of.form}`"
    where = " and ".join(space.name for space in of.spaces)
    cells = (name, of.place, where, of.formula, parameters or "one for each further object", of.source)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def with_formulas(app: Any, name: str, source: list[str]) -> None:
    """The table of all effects with their formulas, made from the classes."""
    head = f"| effect | place | bodies in | what it does | parameters | source |\n|{' --- |' * 6}\n"
    if name == "docs/effects":
        rows = "\n".join(formulas(kind()) for forms in catalogue().values() for kind in forms)
        source[0] = source[0].replace("<!-- formulas of the catalogue -->", head + rows)


def as_index(app: Any, error: Exception | None) -> None:
    """The site opens at its root."""
    if error is None and app.builder.name == "html":
        page = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=docs/index.html">'
        Path(app.outdir, "index.html").write_text(page, encoding="utf-8")


def setup(app: Any) -> None:
    """Connect them to Sphinx, the first before napoleon reads the sections of a docstring."""
    app.connect("autodoc-process-docstring", as_restructured_text, priority=400)
    app.connect("source-read", with_formulas)
    app.connect("build-finished", as_index)
