"""The data of a page and the templates to one HTML file."""

import base64
import gzip
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, partial
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from torch import Tensor

from contactlearn.core.numerics import atomic_write, number
from contactlearn.data.recordings import SOURCES
from contactlearn.report.figures.style import array
from contactlearn.report.text.numbers import brief_interval, error, percent
from contactlearn.results.types import Provenance

FILE = "report.html"
RECORDINGS = "recordings.html"
REPLAY = "replay.html"
"""The page's name in a run folder."""
_SCRIPTS = ("data.js", "figures.js", "live.js")
_ESCAPED = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def write(folder: Path, content: dict[str, Any]) -> Path:
    """Write report.html into a folder, whole or not at all."""
    return save(folder / FILE, render(content))


def save(path: Path, text: str) -> Path:
    """Write a page, whole or not at all; characters that UTF-8 cannot hold become "?"."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", errors="replace")
    return path


def render(content: dict[str, Any], template: str = "report.html.j2", *, scripts: tuple[str, ...] = ()) -> str:
    """Return the page as HTML; everything in `content` is escaped.

    Args:
        content: of the template; scripts have it as `page`, but for `block` and the entries that begin with "_".
        template: the page's.
        scripts: that come after those of every page.
    """
    templates = _templates()
    loader = cast(PackageLoader, templates.loader)

    def source(name: str) -> str:
        return loader.get_source(templates, name)[0]

    library, hash_of_library = _library()
    script = "".join(source(name) for name in (*_SCRIPTS, *scripts))
    return templates.get_template(template).render(
        content,
        style=Markup(source("style.css")),
        script=Markup(script),
        hashes=Markup(f"{_hash(script)} {hash_of_library}"),
        data=Markup(embedded({key: value for key, value in content.items() if key != "block" and key[0] != "_"})),
        library=library,
        plotly=version("plotly"),
    )


@cache
def _library() -> tuple[str, str]:
    """The library that draws, compressed, and its hash; both take longer than all else of a page."""
    library = (resources.files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    return compressed(library.encode()), _hash(library)


@cache
def _templates() -> Environment:
    """The templates, with the number formats of `report.text` as filters."""
    templates = Environment(
        loader=PackageLoader("contactlearn.report.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "error": error,
        "number": _number,
        "interval": brief_interval,
        "pretty": partial(json.dumps, indent=2, ensure_ascii=False),
        "percent": percent,
    }
    return templates


def embedded(content: Any) -> str:
    """Return JSON that may stand in a script element."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.translate(str.maketrans(_ESCAPED))


def _hash(script: str) -> str:
    """As a Content-Security-Policy names a script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _number(x: float | None, digits: int = 4) -> str:
    if x is None:
        return "–"
    return number(x, digits) if isinstance(x, float) else str(x)


_LARGEST = 32767
_NOTHING = -32768


def packed(arrays: Mapping[str, Tensor], steps: Mapping[str, float]) -> dict[str, Any]:
    """`block`, base64 of gzip of the arrays one after the other, little-endian; `arrays`, the place of each in it.

    Without a step of its own the last axis [..., D] is resolved to 1/32767 of the largest |value| in each of its D
    columns; `step` then has D numbers, else one.  nan is kept; what is beyond the range ends there.
    """
    entries, parts, offset = {}, [], 0
    for name, values in arrays.items():
        x = array(values)
        largest = np.nanmax(np.abs(x), axis=tuple(range(x.ndim - 1)), initial=0.0)
        step = np.array([steps[name]]) if name in steps else np.where(largest > 0, largest, 1.0) / _LARGEST
        whole = np.clip(np.round(x / step), -_LARGEST, _LARGEST)
        parts.append(np.where(np.isnan(whole), _NOTHING, whole).astype("<i2").ravel())
        entries[name] = {"offset": offset, "shape": list(x.shape), "step": step.tolist()}
        offset += x.size
    block = np.concatenate(parts) if parts else np.empty(0, "<i2")
    return {"block": compressed(block.tobytes()), "arrays": entries}


def compressed(content: bytes) -> str:
    """base64 of gzip, the same for the same content."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def has_recordings(config: Mapping[str, Any]) -> bool:
    """Whether a run with this configuration writes a page of its recordings."""
    data = config.get("data")
    return isinstance(data, Mapping) and data.get("_target_") in SOURCES


def reproduced(provenance: Provenance, use: str = "") -> dict[str, Any]:
    """Return the provenance of a page, and the page of the recordings where the run has written one.

    Args:
        provenance: of the run.
        use: the command that evaluates a model with the missing effects.
    """
    recordings = RECORDINGS if has_recordings(provenance.config) else ""
    return {"use": use, "recordings": recordings, **asdict(provenance)}
