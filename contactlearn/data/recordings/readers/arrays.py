"""Arrays by name: files of NumPy, PyTorch and MATLAB, and what groups of HDF5 hold.

    time [T] or dt, position [T, 2 or 3], angle [T] or quaternion [T, 4]      names of the layout
    pose [T, 7 or more]                                                 position, quaternion, and perhaps velocities
    transforms [T, 4, 4] or [4, 4, T]                                   of homogeneous coordinates
    Trajectories, RigidBodies, FrameRate                                Qualisys
    tracks, track_occupancy, point_scores                               SLEAP's analysis

An array of one more axis holds a recording each, so do named arrays [recordings, T, …], and so do lists and MATLAB's
arrays of structures, unless their name or a field of theirs says that they are bodies.  `x`, `y` … a coordinate are
taken where there is no `position`; arrays [2 or 3, T] are turned, and said to be.  A rate, unit or times of a group
hold for the groups in it.  Arrays alone are read, never objects, so that no file runs code.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.array_files import loaded
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.readers import LIKELY, RECORDED, Layout, in_seconds
from contactlearn.data.recordings.track import Recording

_TIMES = ("time", "times", "t", "timestamp", "timestamps", "stamp", "stamps")
_POSITIONS = ("position", "positions", "pos", "translation", "translations", "xpos")
_QUATERNIONS = (
    *("quaternion", "quaternions", "quat", "quats", "xquat", "orientation", "orientations", "orn", "ori"),
    *("rotation", "rotations"),
)
_BODY = re.compile(r"^(?:base|root|body|object|obj|com|link|block|cube|box|ball)_|_(?:wxyz|xyzw)$")
"""Around such a name in the logs of simulators: base_pos, root_quat_wxyz."""
_STEP = re.compile(r"dt|(?:time|sim)?steps?(?:ize)?")
_RATE = re.compile(r"fps|fs|hz|(?:frame|sample|sampling|capture|video|camera)?(?:rate|frequency|freq)(?:hz)?")
_UNITS = {"m", "dm", "cm", "mm", "in", "ft"}
_BODIES = re.compile(r"bod(?:y|ies)|objects?|rigid|subjects?", re.IGNORECASE)
_UNIT = 0.01  # by which the length of a quaternion in a pose may differ from 1


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of a file of NumPy (.npy, .npz), PyTorch (.pt) or MATLAB (.mat)."""
    yield from recordings_of(path, loaded(path), layout)


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
        shape = getattr(content, "shape", None)
        alone = type(content).__name__ if shape is None else f"an array {tuple(shape)}"
        seen = ", ".join(content) if isinstance(content, Mapping) else alone
        raise DataError(
            f"{path}: holds no position with angle or quaternion; it has {seen or 'nothing'} "
            "('data.columns={time: t, position: pos, quaternion: quat}' says which are which)"
        )
    found = [(_in_recording(names), one) for names, one in found]
    together = [names[:1] for names, _ in found if len(names) > 1]
    if len({*together}) < len(together):
        first = [names for names, _ in found if names[:1] == together[0]]
        bodies = [name for names in first for name in names[1:] if sum(name in other for other in first) == 1]
        choices = " or ".join(f"data.body={name}" for name in bodies) or "data.body"
        raise DataError(f"{path}: has {len(first)} bodies in {together[0][0]!r}; state {choices}")
    for names, arrays in found:
        yield _recording(path, names[0] if names else path.stem, arrays, layout)


def _in_recording(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of groups of which the first is the recording: session_a/toss_01/box is "session_a toss_01", box."""
    recorded = [k for k, name in enumerate(names) if re.sub(r"[\W\d_]+", "", name).lower() in RECORDED]
    last = recorded[-1] + 1 if recorded else 1
    return (" ".join(names[:last]), *names[last:]) if names else names


_Leaf = tuple[tuple[str, ...], dict[str, Any]]


def _leaves(
    names: tuple[str, ...], content: Any, layout: Layout, above: Mapping[str, Any] = MappingProxyType({})
) -> Iterator[_Leaf]:
    """Names of groups and arrays of every recording, from the outermost group on.

    `above` is the rate, the unit and the times of the groups about it.
    """
    if isinstance(content, Mapping):
        above = {**above, **_common(content, layout)}
        if "tracks" in content and "track_occupancy" in content:
            yield from _sleap(names, content)
            return
        if "Trajectories" in content or "RigidBodies" in content:
            yield from _qualisys(names, content)
            return
        arrays = {str(name): one for name, one in content.items() if not isinstance(one, Mapping | list | tuple)}
        poses = [name for name, one in arrays.items() if _pose(one) is not None]
        if _place(arrays, layout) is not None or len(poses) == 1:
            timed = not {layout.time, *_TIMES}.isdisjoint(arrays)
            shared = {name: one for name, one in above.items() if name != "time" or not timed}
            yield from _split_by_recording(names, {**shared, **arrays}, layout)
            return
        for name, one in sorted(content.items(), key=lambda item: str(item[0])):
            yield from _leaves((*names, str(name)), one, layout, above)
    elif isinstance(content, list | tuple) or (len(np.shape(content)) == 3 and _pose(content) is None):
        for k, one in enumerate(_by_recording(content)):
            body = _body_name(names, one, k)
            own = (*names, body) if body else (" ".join((*names[:1], str(k))), *names[1:])
            yield from _leaves(own, one, layout, above)
    elif _pose(content) is not None:
        yield names, {**above, "pose": content}


def _split_by_recording(names: tuple[str, ...], arrays: dict[str, Any], layout: Layout) -> Iterator[_Leaf]:
    """The recordings of arrays [recordings, T, …], or the one of arrays [T, …]."""
    place = _place(arrays, layout)
    if place is None or "markers" in arrays or np.ndim(place[0]) != 3:
        yield names, arrays
        return
    both = np.shape(place[0])[:2]
    for k in range(both[0]):
        own = {name: one[k] if np.shape(one)[:2] == both else one for name, one in arrays.items()}
        yield (" ".join((*names[:1], str(k))), *names[1:]), own


def _by_recording(content: Any) -> Any:
    """Poses [recordings, T, …] of those that are [T, recordings, …], in which frames, the first axis, change less."""
    if getattr(content, "ndim", 0) != 3 or not 1 < content.shape[1] < content.shape[0]:  # frames are more
        return content
    values = np.asarray(content, dtype=np.float64)[..., :2]
    steps = [np.nanmedian(np.abs(np.diff(values, axis=axis))) for axis in (0, 1)]
    return np.swapaxes(content, 0, 1) if steps[0] < steps[1] else content


def _body_name(names: tuple[str, ...], one: Any, place: int) -> str:
    """The body that an entry of a list is of; empty where entries are recordings."""
    if not isinstance(one, Mapping):
        return ""
    named = next((one[name] for name in ("body", "object", "subject") if isinstance(one.get(name), str)), "")
    if not named and names and _BODIES.search(names[-1]):
        named = next((one[name] for name in ("name", "label") if isinstance(one.get(name), str)), str(place))
    return named


def _common(content: Mapping[str, Any], layout: Layout) -> dict[str, Any]:
    """The rate, unit and times that a group states for the groups in it."""
    found: dict[str, Any] = {}
    for name, one in content.items():
        if _RATE.fullmatch(re.sub(r"[\W_]+", "", str(name)).lower()) and np.size(one) == 1:
            rate = np.asarray(one).ravel()[0]
            found |= {"rate": float(rate)} if np.asarray(one).dtype.kind in "fiu" and 0 < rate < np.inf else {}
        elif _STEP.fullmatch(re.sub(r"[\W_]+", "", str(name)).lower()) and np.size(one) == 1:
            step = np.asarray(one).ravel()[0]
            found |= {"rate": 1 / float(step)} if np.asarray(one).dtype.kind == "f" and 0 < step < 1 else {}
        elif str(name).lower() in ("unit", "units") and str(one) in _UNITS:
            found["unit"] = str(one)
    clocks = [
        content,
        *(one for one in content.values() if isinstance(one, Mapping) and not any(_leaves((), one, layout))),
    ]
    for clock in clocks:
        time = next((clock[name] for name in (layout.time, *_TIMES) if name is not None and name in clock), None)
        if time is not None and np.size(time) > 1 and np.size(time) == max(np.shape(time)):
            found.setdefault("time", np.ravel(time))
    return found


def _sleap(names: tuple[str, ...], content: Mapping[str, Any]) -> Iterator[_Leaf]:
    """Points of each animal of SLEAP's analysis: [tracks, 2, points, T], or [T, points, 2, tracks]."""
    places, scores = np.asarray(content["tracks"], dtype=np.float64), content.get("point_scores")
    if places.shape[0] > places.shape[3]:
        places, scores = places.transpose(), None if scores is None else np.transpose(scores)
    labels = [one.decode() if isinstance(one, bytes) else str(one) for one in content.get("track_names", ())]
    for k, track in enumerate(places):
        markers = track.transpose(2, 1, 0)
        if scores is not None:
            markers = np.where((np.asarray(scores)[k].T < LIKELY)[..., None], np.nan, markers)
        several = len(places) > 1
        label = labels[k] if k < len(labels) else str(k)
        yield (*(names or ("",)), label) if several else names, {"markers": markers}


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
        if np.isfinite(length).any() and np.nanmedian(np.abs(length - 1)) < _UNIT:
            return whole[:, :3], whole[:, 3:7]
    return None


def _qualisys(names: tuple[str, ...], content: Mapping[str, Any]) -> Iterator[_Leaf]:
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
    if "markers" not in arrays:
        position = _rows(position, (2, 3), f"{path}: {name}: position")
        quaternion = None if quaternion is None else _rows(quaternion, (3, 4, 9), f"{path}: {name}: quaternion")
        angle = None if angle is None else np.ravel(angle)
    rate = layout.rate or arrays.get("rate")
    time = None if layout.time is None else _values(arrays, (layout.time, *_TIMES), ())
    time = None if time is None or np.size(time) == 1 else np.ravel(time)
    time = None if rate is not None and time is not None and len(time) != len(position) else time
    if rate is not None and time is None:
        time = np.arange(len(position)) / rate
    stamps = None if time is None else layout.checked(in_seconds(time), f"{path}: {name}")
    time = layout.times(len(position), source) if stamps is None else stamps
    unit = arrays.get("unit")
    if "markers" in arrays and position.shape[1:] == (1, 2):
        none = np.zeros(len(position))
        return Recording(name=name, source=source, time=time, position=position[:, 0], angle=none, unit=unit)
    if "markers" in arrays:
        return pose_of_markers(position, time, layout.places, name=name, source=source, unit=unit)
    by_parts = quaternion is not None and not {*_QUATERNIONS} & {*arrays} and quaternion.shape[1] == 4
    order = layout.order if by_parts and {*layout.quaternion} <= {*arrays} else None
    stated = re.search(r"_(wxyz|xyzw)$", (_name_of(arrays, _QUATERNIONS) or "").lower())
    return Recording(
        name=name,
        source=source,
        time=time,
        position=position,
        angle=None if quaternion is not None else angle,
        quaternion=quaternion,
        unit=unit,
        order=stated[1] if stated else order,
        turned=position is not named[0],
    )


def _rows(values: Array, columns: Sequence[int], place: str) -> Array:
    """An array with a row a frame, of one that may have a column a frame.

    Raises:
        DataError: both may be, of as many frames as components.
    """
    shape = np.shape(values)
    if len(shape) == 2 and shape[0] == shape[1] and shape[0] in columns:
        raise DataError(f"{place} is {shape[0]} × {shape[0]}: its frames may be rows or columns; record more frames")
    return values.T if len(shape) == 2 and shape[1] not in columns and shape[0] in columns else values


def _values(arrays: Mapping[str, Any], names: Sequence[str], parts: Sequence[str]) -> Array | None:
    """An array of the first name that there is, or those of its parts side by side."""
    if (name := _name_of(arrays, names)) is not None:
        return np.asarray(arrays[name], dtype=np.float64)
    there = [part for part in parts if part in arrays]
    if len(there) == 1 and np.ndim(arrays[there[0]]) in (2, 3):
        return np.asarray(arrays[there[0]], dtype=np.float64)
    return np.stack([np.ravel(arrays[part]).astype(np.float64) for part in there], 1) if len(there) > 1 else None


def _name_of(arrays: Mapping[str, Any], names: Sequence[str]) -> str | None:
    """The first name that there is, or the only one that names it with its body: base_pos."""
    of_body = [name for name in arrays if _BODY.sub("", name.lower()) in names]
    return next((name for name in names if name in arrays), of_body[0] if len(of_body) == 1 else None)
