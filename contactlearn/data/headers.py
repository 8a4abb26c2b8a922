"""Settings of `data=table` or `data=tracks` for a file, from the names of its columns.

A name is split into words and, at its end, a unit: "vx [mm/s]", "speed_x_after (mm/s)", "theta_deg", "massKg".  A
column is taken for one of ours if no other has the same words, and its unit is one that the reader knows.  Nothing is
guessed from numbers.  A required setting that the names do not state is left open.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any
from unicodedata import normalize

from contactlearn.core.errors import DataError, suggest
from contactlearn.data import table
from contactlearn.data.recordings.conventions import ANGLES, UNITS
from contactlearn.data.recordings.readers import is_motive, recording_files
from contactlearn.data.table.columns import COLUMNS, COMPUTED, POWERS, REQUIRED, SI, UNIT_FACTORS, Units
from contactlearn.mechanics.space import PLANE

OPEN = "???"
"""The value of a setting that must be stated: OmegaConf's."""

_SHAPE = (
    "lengths in m: {kind: ellipse, semi_axes: [a, b]}, {kind: disc, radius: R} or {kind: polygon, vertices: "
    "[[x, y], …]} about the centre of mass, in space cuboid, ellipsoid, sphere or polyhedron (docs/tables.md); of "
    "several bodies by name: {oak: {kind: …}, beech: {kind: …}}"
)
_BEFORE, _AFTER, _IMPACT = ("pre", "before"), ("post", "after"), ("impact", "contact", "collision")
_WORDS = {"velocity": "v", "speed": "v", "vel": "v", "position": "", "pos": "", "pose": "", "of": ""}
_NAMES = {
    "xv": "vx", "xdot": "vx", "yv": "vy", "ydot": "vy",
    "angle": "theta", "th": "theta", "phi": "theta", "θ": "theta", "orientation": "theta",
    "spin": "omega", "ω": "omega", "w": "omega", "angularv": "omega", "vangular": "omega", "thetadot": "omega",
    "m": "mass", "momentinertia": "inertia", "body": "object",
    "t": "time", "timestamp": "time", "drop": "recording", "take": "recording", "toss": "recording",
    "trial": "recording",
}  # fmt: skip
_QUATERNION = re.compile(r"(?:q|quat|quaternion|orientation|rotation)([wxyz])")
_MARKER = re.compile(r"(?:m|marker)?(\d*)([xyz])(\d*)")
_SPELLED = {
    "per": "", "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad", "sec": "s",
    "second": "s", "seconds": "s", "metre": "m", "metres": "m", "meter": "m", "meters": "m", "inch": "in",
    "inches": "in", "grams": "g",
}  # fmt: skip
_MEANINGS = {
    "x": "of the centre of mass, to the right", "y": "of the centre of mass, up, along the floor's normal",
    "theta": "of the body, counter-clockwise", "vx": "to the right", "vy": "up", "omega": "counter-clockwise",
    "rx": "contact point minus centre of mass, to the right", "ry": "contact point minus centre of mass, up",
}  # fmt: skip
_FRAME = ("time", "x", "y", "z", "theta", "qw", "qx", "qy", "qz", "recording")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A setting of a source of data.

    Args:
        name: dotted, without `data.`.
        value: `OPEN` where it must be stated.
        comment: its unit and rule, or where the value comes from.
    """

    name: str
    value: Any
    comment: str


@dataclass(frozen=True, kw_only=True)
class FileContents:
    """The name of the source, `table` or `tracks`, its settings in order, and the names of unused columns."""

    source: str
    settings: tuple[Setting, ...]
    unused: tuple[str, ...] = ()


Stated = Mapping[str, str]
"""Units by quantity, as the unit of a column states them."""
Vocabulary = Mapping[str, Mapping[str, Stated]]
"""Units by quantity, by our name of a column and each unit that it may have, written without signs."""


@dataclass(frozen=True, kw_only=True)
class _Columns:
    """Names in a file by ours, its other columns, and the columns that state a unit, by quantity and unit."""

    names: Mapping[str, str]
    others: tuple[str, ...]
    units: Mapping[str, Mapping[str, Sequence[str]]]


def propose(path: Path) -> FileContents:
    """Return the settings with which a file or a folder is read.

    Args:
        path: a table of impacts, a recording, or a folder with recordings.

    Raises:
        DataError: it cannot be read, or is neither.
    """
    first = recording_files(path)[0]
    if first.suffix.lower() not in (".csv", ".parquet") or (first.suffix.lower() == ".csv" and is_motive(first)):
        return FileContents(source="tracks", settings=tuple(_body(path, [])))
    header = table.header(first)
    impacts, frames, markers = (
        _recognised(header, _impact_units()),
        _recognised(header, _frame_units()),
        _markers(header),
    )
    if any(column in impacts.names for column in PLANE.components["v_post"]):
        if path.is_dir():
            raise DataError(f"{path}: holds tables of impacts, such as {first.name}; give one of them")
        return FileContents(source="table", settings=tuple(_table(path, impacts)), unused=impacts.others)
    if markers or ("x" in frames.names and {"y", "z"} & {*frames.names}):
        return FileContents(source="tracks", settings=(*_body(path, markers), *_layout(frames, markers)))
    raise DataError(
        f"{first}: is neither a table of impacts, which has velocities after contact such as vx_post (docs/tables.md), "
        f"nor a recording, which has x, y and theta (docs/tracks.md); its columns are {', '.join(map(repr, header))}"
    )


def _impact_units() -> Vocabulary:
    """The columns of a table and their units."""
    units: dict[str, dict[str, Stated]] = {column: {"": {}} for column in COLUMNS}
    for column in COLUMNS:
        quantities = POWERS.get(column.removesuffix("_post"), {})
        for choice in product(*(UNIT_FACTORS[quantity] for quantity in quantities)):
            stated = dict(zip(quantities, choice, strict=True))
            units[column]["".join(_words(Units(stated).text(column)))] = stated
    return units


def _frame_units() -> Vocabulary:
    """The columns of a recording and their units; its times are in s."""
    units: dict[str, dict[str, Stated]] = {column: {"": {}} for column in _FRAME}
    units["time"] |= {"s": {}}
    units["theta"] |= {name: {"angle": name} for name in ANGLES}
    for column in "xyz":
        units[column] |= {name: {"unit": name} for name in UNITS}
    return units


def _words(name: str) -> list[str]:
    """Words, numbers and signs of degree in a name, in small letters."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", normalize("NFKC", name))
    return re.findall(r"[^\W\d_]+|\d+|°", apart.lower())


def _recognised(header: Sequence[str], vocabulary: Vocabulary) -> _Columns:
    """Match each of our columns with the file's column of that name, or with the only other one that names it."""
    matches: dict[str, dict[str, Stated]] = {}
    for name in header:
        ours, stated = (name, {}) if name in vocabulary else _match(_words(name), vocabulary)
        matches.setdefault(ours, {})[name] = stated
    names: dict[str, str] = {}
    units: dict[str, dict[str, list[str]]] = {}
    for ours, candidates in matches.items():
        if ours and (ours in candidates or len(candidates) == 1):
            names[ours] = name = ours if ours in candidates else next(iter(candidates))
            for quantity, unit in candidates[name].items():
                units.setdefault(quantity, {}).setdefault(unit, []).append(name)
    return _Columns(names=names, others=tuple(name for name in header if name not in names.values()), units=units)


def _match(words: Sequence[str], vocabulary: Vocabulary) -> tuple[str, Stated]:
    """Our name of a column with these words, and the units that it states; an empty name if none of ours matches."""
    end = "_post" if any(word in _AFTER for word in words) else ""
    timed = end or any(word in _BEFORE for word in words)
    left_out = (*_BEFORE, *_AFTER, *_IMPACT) if timed else ()
    words = [_WORDS.get(word, word) for word in words if word not in left_out]
    for split in range(len(words), 0, -1):
        name, unit = "".join(words[:split]), "".join(_SPELLED.get(word, word) for word in words[split:])
        unit = re.sub(r"(?<=s)1$", "", unit)  # of s⁻¹
        for ours in (name + end, _NAMES.get(name, "") + end, _QUATERNION.sub(r"q\1", name)):
            if unit in vocabulary.get(ours, {}):
                return ours, vocabulary[ours][unit]
    return "", {}


def _markers(header: Sequence[str]) -> list[list[str]]:
    """The columns of numbered markers, such as x1, y1, x2, y2; none if there are fewer than two of one dimension."""
    numbered: dict[str, dict[str, str]] = {}
    for name in header:
        match = _MARKER.fullmatch("".join(_words(name)))
        if match and (match[1] or match[3]):
            numbered.setdefault(match[1] or match[3], {})[match[2]] = name
    markers = [[axes[axis] for axis in sorted(axes)] for axes in numbered.values()]
    return markers if len(markers) > 1 and {*map(len, markers)} in ({2}, {3}) else []


def _table(path: Path, known: _Columns) -> Iterator[Setting]:
    """The settings of a table of impacts."""
    lacking = [column for column in REQUIRED if column not in known.names]
    computed = [column for columns in COMPUTED[PLANE].values() if {*columns} <= {*lacking} for column in columns]
    stated = {quantity: next(iter(units)) for quantity, units in known.units.items() if len(units) == 1}
    units = Units(SI | stated)
    yield Setting(name="path", value=str(path), comment="from the folder in which commands run")
    if "mass" in lacking:
        yield Setting(name="mass", value=OPEN, comment="of every body, kg; the table has no column mass")
    about = f"from which {', '.join(computed)} are computed; " if computed else "null: unknown; "
    yield Setting(name="shape", value=OPEN if computed else None, comment=f"of the body, {about}{_SHAPE}")
    if "inertia" in lacking:
        yield Setting(name="inertia", value=None, comment="of every body, kg m²; null: of uniform density")
    for column, name in known.names.items():
        if name != column:
            yield Setting(name=f"columns.{column}", value=name, comment=units.text(column))
    for column in lacking:
        if column not in ("mass", *computed):
            near = suggest(column, known.others).replace(", did you mean", "; is it")
            when = "after contact" if column.endswith("_post") else "before contact"
            about = f"{units.text(column)}, {_MEANINGS[column.removesuffix('_post')]}, {when}{near}"
            yield Setting(name=f"columns.{column}", value=OPEN, comment=about)
    for quantity, choices in UNIT_FACTORS.items():
        columns = known.units.get(quantity, {})
        source = " and ".join(f"{unit} as in {names[0]!r}" for unit, names in columns.items())
        value = OPEN if len(columns) > 1 else stated.get(quantity, SI[quantity])
        mixed = "one for all, and the audit names the correction of the others: " if len(columns) > 1 else ""
        about = mixed + (source or "assumed, for no column states it")
        yield Setting(name=f"units.{quantity}", value=value, comment=f"{' or '.join(choices)}; {about}")
    yield Setting(name="correct", value=[], comment="corrections that the audit names, in this order")


def _body(path: Path, markers: Sequence[Sequence[str]]) -> Iterator[Setting]:
    """The settings that every recording needs."""
    yield Setting(name="path", value=str(path), comment="from the folder in which commands run")
    yield Setting(name="mass", value=OPEN, comment="of the body, kg")
    hull = "null: the convex hull of its markers; " if len(markers) > 2 else ""
    yield Setting(name="shape", value=None if hull else OPEN, comment=f"of the body, {hull}{_SHAPE}")
    yield Setting(name="inertia", value=None, comment="about the centre of mass, kg m²; null: of uniform density")


def _layout(known: _Columns, markers: list[list[str]]) -> Iterator[Setting]:
    """The settings of the columns of a recording; columns with our names need none."""
    names = known.names
    if "time" not in names:
        yield Setting(name="rate", value=OPEN, comment="frames a second, for no column is a time in s")
    axes, turns = ([name for name in group if name in names] for group in (("x", "y", "z"), ("qw", "qx", "qy", "qz")))
    columns: dict[str, tuple[Any, Any, str]] = {
        "time": (names.get("time"), "time", "s"),
        "recording": (names.get("recording", "recording"), "recording", "name of the recording"),
    }
    if markers:
        columns["markers"] = (markers, [], "of each marker, in the unit of length")
    elif len(turns) == 4 and len(axes) == 3:
        columns["position"] = ([names[axis] for axis in axes], axes, "in the unit of length")
        columns["quaternion"] = ([names[turn] for turn in turns], turns, "w first")
    else:
        position = [names[axis] for axis in axes] if len(axes) == 2 else OPEN
        columns["position"] = (position, ["x", "y"], "the two in the plane of motion, in the unit of length")
        columns["angle"] = (names.get("theta", OPEN), "theta", "in the plane of motion")
    for name, (value, usual, about) in columns.items():
        if value != usual:
            yield Setting(name=f"columns.{name}", value=value, comment=about)
    for name, choices, evidence in (("unit", UNITS, "gravity"), ("angle", ANGLES, "the impacts")):
        units = known.units.get(name, {})
        value = None if not units else OPEN if len(units) > 1 else next(iter(units))
        yield Setting(name=name, value=value, comment=f"{', '.join(choices)}; null: found from {evidence}")
