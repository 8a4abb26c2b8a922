"""HDF5: data sets of the layout's names in a group a recording, or at the top for one recording.

    time [T], position [T, 2 or 3], angle [T] or quaternion [T, 4]

A data set `x`, `y` … a coordinate is taken where there is no `position`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py  # pyright: ignore[reportMissingImports]  (an extra)
import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.track import Recording


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of an HDF5 file."""
    with h5py.File(path, "r") as file:
        groups = {name: group for name, group in sorted(file.items()) if isinstance(group, h5py.Group)}
        if layout.body is not None:
            groups = {name: group for name, group in groups.items() if name == layout.body}
        if not groups and layout.body is None:
            groups = {path.stem: file}
        if not groups:
            raise DataError(f"{path}: holds no group {layout.body!r}")
        for name, group in groups.items():
            yield _recording(path, name, group, layout)


def _recording(path: Path, name: str, group: Mapping[str, Any], layout: Layout) -> Recording:
    position = _values(group, "position", layout.position[:3])
    quaternion = _values(group, "quaternion", layout.quaternion)
    angle = _values(group, layout.angle or "angle", ())
    angle = _values(group, "angle", ()) if angle is None else angle
    if position is None or (angle is None and quaternion is None):
        raise DataError(f"{path}: {name}: holds no position with angle or quaternion; it has {', '.join(group)}")
    time = None if layout.time is None else _values(group, layout.time, ())
    named = quaternion is not None and "quaternion" not in group
    return Recording(
        name=name,
        source=str(path),
        time=layout.times(len(position), str(path)) if time is None else layout.checked(time, f"{path}: {name}"),
        position=position,
        angle=None if quaternion is not None else angle,
        quaternion=quaternion,
        order=layout.order if named else None,
    )


def _values(group: Mapping[str, Any], name: str, parts: Sequence[str]) -> Array | None:
    """A data set, or those of its parts side by side."""
    if name in group:
        return np.asarray(group[name], dtype=np.float64)
    there = [part for part in parts if part in group]
    return np.stack([np.asarray(group[part], dtype=np.float64) for part in there], 1) if len(there) > 1 else None
