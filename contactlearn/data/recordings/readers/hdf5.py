"""HDF5: data sets by name in groups, at any depth, see `arrays`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py  # pyright: ignore[reportMissingImports]  (an extra)

from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.readers.arrays import recordings_of
from contactlearn.data.recordings.track import Recording


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of an HDF5 file."""
    with h5py.File(path, "r") as file:
        yield from recordings_of(path, _content(file), layout)


def _content(group: Any) -> dict[str, Any]:
    """Groups as mappings, and data sets of numbers as arrays."""
    return {
        name: _content(one) if isinstance(one, h5py.Group) else one[()]
        for name, one in group.items()
        if isinstance(one, h5py.Group) or one.dtype.kind in "fiu"
    }
