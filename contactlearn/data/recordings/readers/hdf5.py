"""HDF5: data sets by name in groups, at any depth, with their attributes, see `arrays`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py  # pyright: ignore[reportMissingImports]  (an extra)
import numpy as np

from contactlearn.data.packed import for_library
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.readers.arrays import recordings_of
from contactlearn.data.recordings.track import Recording


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of an HDF5 file."""
    with h5py.File(for_library(path), "r") as file:
        yield from recordings_of(path, _content(file), layout)


def _content(group: Any) -> dict[str, Any]:
    """Groups as mappings, data sets of numbers or of names as arrays, and attributes of both beside them."""
    found: dict[str, Any] = {}
    for name, one in group.items():
        if isinstance(one, h5py.Group):
            found[name] = _content(one)
        elif one.dtype.kind in "fiuS":
            found[name] = one[()]
            _add(found, one.attrs)
    _add(found, group.attrs)
    return found


def _add(found: dict[str, Any], attributes: Any) -> None:
    """Add numbers and texts of attributes whose names are free."""
    for name, value in attributes.items():
        if np.ndim(value) == 0 or np.size(value) == 1:
            one = np.ravel(value)[0]
            found.setdefault(name, one.decode(errors="replace") if isinstance(one, bytes) else one)
