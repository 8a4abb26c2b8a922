"""Arrays by name: files of NumPy, PyTorch and MATLAB, and what groups of HDF5 hold.

    time [T], position [T, 2 or 3], angle [T] or quaternion [T, 4]      names of the layout
    pose [T, 7 or more]                                                 position, quaternion, and perhaps velocities
    transforms [T, 4, 4] or [4, 4, T]                                   of homogeneous coordinates
    Trajectories, RigidBodies, FrameRate                                Qualisys

An array of one more axis holds a recording each.  `x`, `y` … a coordinate are taken where there is no `position`.
Arrays alone are read, never objects, so that no file runs code.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.track import Recording

_TIMES = ("time", "times", "t", "timestamp", "timestamps")
_POSITIONS = ("position", "positions", "pos", "translation")
_QUATERNIONS = ("quaternion", "quaternions", "quat", "orientation", "orientations", "rotation")
_UNIT = 0.01  # by which the length of a quaternion in a pose may differ from 1


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of a file of NumPy (.npy, .npz), PyTorch (.pt) or MATLAB (.mat)."""
    yield from recordings_of(path, _loaded(path), layout)


def _loaded(path: Path) -> Any:
    if path.suffix.lower() == ".pt":
        return torch.load(path, map_location="cpu", weights_only=True)
    if path.suffix.lower() == ".mat":
        from scipy.io import loadmat

        try:
            return {name: one for name, one in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
        except NotImplementedError:
            raise DataError(f"{path}: is of MATLAB's version 7.3; save it with -v7, or rename it .h5") from None
    found = np.load(path, allow_pickle=False)
    return {name: found[name] for name in found.files} if isinstance(found, np.lib.npyio.NpzFile) else found


def recordings_of(path: Path, content: Any, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of nested mappings and lists of arrays.

    Raises:
        DataError: there are none, or it is not stated which of several bodies.
    """
    found = [(names, one) for names, one in _leaves((), content, layout)]
    every = ", ".join(dict.fromkeys(name for names, _ in found for name in names))
    if layout.body is not None and any(names for names, _ in found):
        found = [(names, one) for names, one in found if layout.body in names]
        if not found:
            raise DataError(f"{path}: holds no group {layout.body!r}{f'; it has {every}' if every else ''}")
    if not found:
        seen = ", ".join(content) if isinstance(content, Mapping) else _shape(content)
        raise DataError(
            f"{path}: holds no position with angle or quaternion; it has {seen or 'nothing'} "
            "('data.columns={time: t, position: pos, quaternion: quat}' says which are which)"
        )
    together = [names[:1] for names, _ in found if len(names) > 1]
    if len({*together}) < len(together):
        first = [names for names, _ in found if names[:1] == together[0]]
        bodies = [name for names in first for name in names[1:] if sum(name in other for other in first) == 1]
        choices = " or ".join(f"data.body={name}" for name in bodies) or "data.body"
        raise DataError(f"{path}: has {len(first)} bodies in {together[0][0]!r}; state {choices}")
    for names, arrays in found:
        yield _recording(path, names[0] if names else path.stem, arrays, layout)


def _shape(content: Any) -> str:
    shape = getattr(content, "shape", None)
    return type(content).__name__ if shape is None else f"an array {tuple(shape)}"


def _leaves(names: tuple[str, ...], content: Any, layout: Layout) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Names of groups and arrays of every recording, from the outermost group on."""
    if isinstance(content, Mapping):
        if "Trajectories" in content or "RigidBodies" in content:
            yield from _qualisys(names, content)
            return
        arrays = {str(name): one for name, one in content.items() if not isinstance(one, Mapping | list | tuple)}
        poses = [name for name, one in arrays.items() if _pose(one) is not None]
        if _place(arrays, layout) is not None or len(poses) == 1:
            yield names, arrays
            return
        for name, one in sorted(content.items(), key=lambda item: str(item[0])):
            yield from _leaves((*names, str(name)), one, layout)
    elif isinstance(content, list | tuple):
        for k, one in enumerate(content):
            yield from _leaves((*names, str(k)), one, layout)
    elif len(np.shape(content)) == 3 and _pose(content) is None:
        yield from ((*leaf,) for k, one in enumerate(content) for leaf in _leaves((*names, str(k)), one, layout))
    elif _pose(content) is not None:
        yield names, {"pose": content}


def _pose(values: Any) -> tuple[Array, Array] | None:
    """Position and orientation of poses or of homogeneous transforms; None of anything else."""
    shape = np.shape(values)
    if len(shape) == 3 and 4 in shape and shape.count(4) >= 2:
        whole = np.asarray(values, dtype=np.float64)
        whole = whole if shape[1:] == (4, 4) else np.moveaxis(whole, 2, 0)
        if whole.shape[1:] == (4, 4) and np.allclose(whole[:, 3], (0, 0, 0, 1), equal_nan=True):
            return whole[:, :3, 3], whole[:, :3, :3].reshape(-1, 9)
    if len(shape) == 2 and shape[1] >= 7:
        whole = np.asarray(values, dtype=np.float64)
        length = np.linalg.norm(whole[:, 3:7], axis=1)
        if np.nanmedian(np.abs(length - 1)) < _UNIT:
            return whole[:, :3], whole[:, 3:7]
    return None


def _qualisys(names: tuple[str, ...], content: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Rigid bodies of Qualisys's file, or else its labelled markers."""
    rate, own = float(content["FrameRate"]), {"unit": "mm"}
    outer = names or ("",)
    if bodies := content.get("RigidBodies"):
        labels = np.atleast_1d(bodies["Name"])
        place, turned = (np.asarray(bodies[name]) for name in ("Positions", "Rotations"))
        place, turned = place.reshape(len(labels), 3, -1), turned.reshape(len(labels), 9, -1)
        for label, position, matrix in zip(labels, place, turned, strict=True):
            rows = matrix.T.reshape(-1, 3, 3).transpose(0, 2, 1).reshape(-1, 9)  # written column by column
            yield (*outer, str(label)), {"position": position.T, "quaternion": rows, "rate": rate, **own}
    else:
        labelled = content["Trajectories"]["Labeled"]
        data = np.asarray(labelled["Data"]).reshape(len(np.atleast_1d(labelled["Labels"])), 4, -1)
        yield outer, {"markers": data[:, :3].transpose(2, 0, 1), "rate": rate, **own}


def _place(arrays: Mapping[str, Any], layout: Layout) -> tuple[Array, Array | None, Array | None] | None:
    """Position, quaternion and angle of named arrays; None where there is no position with one of them."""
    if "markers" in arrays:
        return arrays["markers"], None, None
    position = _values(arrays, _POSITIONS, layout.position[:3])
    quaternion = _values(arrays, _QUATERNIONS, layout.quaternion)
    angle = _values(arrays, (layout.angle or "angle", "angle", "theta"), ())
    return None if position is None or (quaternion is None and angle is None) else (position, quaternion, angle)


def _recording(path: Path, name: str, arrays: Mapping[str, Any], layout: Layout) -> Recording:
    name, source = name or path.stem, str(path)
    named = _place(arrays, layout)
    if named is None:
        pose = next(pose for one in arrays.values() if (pose := _pose(one)) is not None)
        named = (*pose, None)
    position, quaternion, angle = named
    rate = layout.rate or arrays.get("rate")
    time = None if layout.time is None else _values(arrays, (layout.time, *_TIMES), ())
    if rate is not None and time is None:
        time = np.arange(len(position)) / rate
    time = layout.times(len(position), source) if time is None else layout.checked(time, f"{path}: {name}")
    unit = arrays.get("unit")
    if "markers" in arrays:
        return pose_of_markers(position, time, layout.places, name=name, source=source, unit=unit)
    by_parts = quaternion is not None and not {*_QUATERNIONS} & {*arrays} and quaternion.shape[1] == 4
    return Recording(
        name=name,
        source=source,
        time=time,
        position=position,
        angle=None if quaternion is not None else angle,
        quaternion=quaternion,
        unit=unit,
        order=layout.order if by_parts and {*layout.quaternion} <= {*arrays} else None,
    )


def _values(arrays: Mapping[str, Any], names: Sequence[str], parts: Sequence[str]) -> Array | None:
    """An array of the first name that there is, or those of its parts side by side."""
    if (name := next((name for name in names if name in arrays), None)) is not None:
        return np.asarray(arrays[name], dtype=np.float64)
    there = [part for part in parts if part in arrays]
    if len(there) == 1 and np.ndim(arrays[there[0]]) == 2:
        return np.asarray(arrays[there[0]], dtype=np.float64)
    return np.stack([np.asarray(arrays[part], dtype=np.float64) for part in there], 1) if len(there) > 1 else None
