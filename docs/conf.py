"""Settings of the documentation site: `make docs` builds it from the pages as they lie in the repository.

The source folder is the repository, so that a link that works between two files there works on the site, and a broken
one ends the build.  Nothing is loaded from elsewhere: no web fonts, no scripts of others; search works from the disk.
"""

import gc
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import contactlearn

# The trees of all pages are kept: looking through them for garbage took a tenth of the time.
gc.set_threshold(100_000, 20, 50)

project = "contactlearn"
copyright = "the contactlearn authors, MIT licence"
version = release = contactlearn.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
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

templates_path = [
    str(Path(__file__).parent / "_templates")
]  # a page for each module below those that docs/api.md names

myst_heading_anchors = 4
myst_enable_extensions = ["deflist", "dollarmath"]
# MathJax comes from a package, so that equations are typeset from a disk too.
(MATHJAX,) = (path for path in map(Path, sys.path) if (path / "sphinx-mathjax-offline" / "static").is_dir())
MATHJAX = MATHJAX / "sphinx-mathjax-offline" / "static" / "mathjax" / "tex-svg.js"
mathjax_path = "tex-svg.js"
copybutton_exclude = ".linenos, .gp, .c1"  # comments behind a command are not copied
suppress_warnings = ["misc.highlighting_failure", "ref.python"]  # a `console` block is a shell with comments

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
html_search_scorer = str(Path(__file__).parent / "_static" / "scorer.js")  # guides before modules
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


def as_index(app: Any, error: Exception | None) -> None:
    """The site opens at its root, and has its MathJax."""
    if error is None and app.builder.name == "html":
        shutil.copyfile(MATHJAX, Path(app.outdir, "_static", MATHJAX.name))
        page = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=docs/index.html">'
        Path(app.outdir, "index.html").write_text(page, encoding="utf-8")


def setup(app: Any) -> None:
    """Connect them to Sphinx, the first before napoleon reads the sections of a docstring."""
    app.connect("autodoc-process-docstring", as_restructured_text, priority=400)
    app.connect("build-finished", as_index)
