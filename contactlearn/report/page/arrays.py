"""The large arrays of a page: whole numbers of a step in two bytes each, in one compressed block."""

import base64
import gzip
from collections.abc import Mapping
from typing import Any

import numpy as np
from torch import Tensor

from contactlearn.report.figures.style import array

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
        step = np.array([steps[name]]) if name in steps else _steps(x)
        whole = np.clip(np.round(x / step), -_LARGEST, _LARGEST)
        parts.append(np.where(np.isnan(whole), _NOTHING, whole).astype("<i2").ravel())
        entries[name] = {"offset": offset, "shape": list(x.shape), "step": step.tolist()}
        offset += x.size
    block = np.concatenate(parts) if parts else np.empty(0, "<i2")
    return {"block": compressed(block.tobytes()), "arrays": entries}


def compressed(content: bytes) -> str:
    """base64 of gzip, the same for the same content."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def _steps(x: np.ndarray) -> np.ndarray:
    largest = np.nanmax(np.abs(x), axis=tuple(range(x.ndim - 1)), initial=0.0)
    return np.where(largest > 0, largest, 1.0) / _LARGEST
