"""Settings of `data=table` or `data=tracks` for a file, from the names of its columns.

The names are understood as the reader of tables understands them (`table.names`).  Nothing is guessed from numbers.  A
required setting that the names do not state is left open.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from contactlearn.core.errors import ContactLearnError, DataError, UnknownLayoutError, suggest
from contactlearn.data import table
from contactlearn.data.cameras import refusal_of_cameras
from contactlearn.data.packed import files_in, is_archive, is_single, several
from contactlearn.data.recordings.conventions import ANGLES, UNITS
from contactlearn.data.recordings.readers import (
    SUFFIXES as RECORDING_SUFFIXES,
    TUM_COLUMNS,
    is_motive,
    leading_numbers,
    recording_files,
)
from contactlearn.data.recordings.readers.columns import (
    FRAME_NUMBERS,
    SENSED,
    bodies_in_names,
    bodies_in_rows,
    column_names,
    comments,
    first_rows,
    nanoseconds_beside,
    nested_table,
    of_sensor,
    orientation_columns,
    recording_column,
    sensed,
)
from contactlearn.data.recordings.readers.exports import Export, export_of
from contactlearn.data.recordings.readers.motive import bodies_of
from contactlearn.data.table.columns import (
    COMPUTED,
    columns_of,
    computed_fields,
    recognised_columns,
    refusal_of_unmeasured,
    refuse_repeated,
    required_in,
    setting_text,
    trial_column,
)
from contactlearn.data.table.descriptions import direction_in
from contactlearn.data.table.dialect import is_missing
from contactlearn.data.table.files import sheet_of
from contactlearn.data.table.names import (
    Recognised,
    Stated,
    Vocabulary,
    impact_vocabulary,
    name_words,
    recognise,
    spins_per_second,
    times_in,
    unit_in,
)
from contactlearn.data.table.probable import probable_columns
from contactlearn.data.table.several import refusal_of_several, refusal_side_by_side
from contactlearn.data.table.sheet import Sheet
from contactlearn.data.table.units import COMPOUND, SI, UNIT_FACTORS, Units, powers_of
from contactlearn.mechanics.space import PLANE, SPACE, Space

OPEN = "???"
"""The value of a setting that must be stated: OmegaConf's."""

_SHAPE = (
    "lengths in m: {kind: ellipse, semi_axes: [a, b]}, {kind: disc, radius: R}, {kind: rectangle, sides: [a, b]} or "
    "{kind: polygon, vertices: [[x, y], …]} about the centre of mass, in space cuboid, cylinder, ellipsoid, sphere or "
    "polyhedron (docs/tables.md); of several bodies by name: {oak: {kind: …}, beech: {kind: …}}"
)
_MARKER = re.compile(r"(?:m|marker)?(\d*)([xyz])(\d*)")
_MEANINGS_IN_SPACE = {"x": "of the centre of mass", "y": "of the centre of mass", "z": "of the centre of mass, up"}
_MEANINGS = {
    "x": "of the centre of mass, to the right", "y": "of the centre of mass, up, along the floor's normal",
    "theta": "of the body, counter-clockwise", "vx": "to the right", "vy": "up", "omega": "counter-clockwise",
    "rx": "contact point minus centre of mass, to the right", "ry": "contact point minus centre of mass, up",
}  # fmt: skip
_PREVIEWED = 1000  # rows
_FIRST = 3  # files of a folder whose headers are looked at, until one can be read
_HEADINGS = ("heading", "yaw", "bearing", "azimuth", "rotation", "rot", "theta", "angle", "phi", "orientation")
_TURNS = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radians": "rad"}
_SENSES = ("cw", "ccw", "clockwise", "counterclockwise", "counter", "anticlockwise")
_NUMBERED = re.compile(r"(?:q|quat|quaternion|orientation|rotation|rot)[\W_]*[0-4]", re.I)
_PIXEL = "px"
_RATE = re.compile(
    r"(\d+(?:\.\d+)?)\s*(?:fps|frames?\s*(?:/|per|a)\s*s)|(?:fps|frame ?rate)\s*(?:[:=]|is|of)?\s*(\d+(?:\.\d+)?)"
    r"|(?<!analog )(?:sampl(?:ing|e)|camera)[ _](?:rate|frequency)"
    r"[^\na-z\d]*(?:hz[^\na-z\d]*)?(\d+(?:\.\d+)?)(?!\.?\d|\s*[km]hz)",
    re.I,
)
_FREQUENCY = re.compile(
    r"^\W*frequency\W+(\d+(?:\.\d+)?)\s*hz\W*$"
    r"|^\W*number of frames\W+\d+\W*\n\W*frequency\W+(\d+(?:\.\d+)?)\W*$",  # as NDI writes it
    re.I | re.M,
)
_FILTER = re.compile(r"cut\W?off|filter|low\W?pass|butterworth", re.I)
_SIZE, _PIXELS, _PER = r"(?P<size>\d+(?:\.\d+)?)", r"(?:px|pix(?:el)?s?)", r"\s*(?:/|_?per_?|a)\s*"
_SCALES = (
    (rf"{_SIZE}\s*(?P<unit>mm|cm|um|µm|m|in){_PER}{_PIXELS}", 1),
    (rf"{_PIXELS}(?:\s*size)?\s*(?:=|:|is)\s*{_SIZE}\s*(?P<unit>mm|cm|um|µm|m|in)\b", 1),
    (rf"\b(?P<unit>mm|cm|um|µm|m|in){_PER}{_PIXELS}[\s\])=:]*{_SIZE}", 1),
    (rf"{_SIZE}\s*{_PIXELS}{_PER}(?P<unit>mm|cm|m|in)\b", -1),
    (rf"{_PIXELS}{_PER}(?P<unit>mm|cm|m|in)[\s\])=:]*{_SIZE}", -1),
)
"""How a size of a pixel is written, and the power of the number before it."""
_POSE = ("x", "y", "z", "theta", "qw", "qx", "qy", "qz")
_FRAME = ("time", *_POSE, "recording")


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


_UNNAMED = (
    Setting(name="rate", value=None, comment="frames a second, for files without times"),
    Setting(name="body", value=None, comment="rigid body, topic or group, where a file holds several"),
)
"""Settings of files whose columns have no names to look at."""


@dataclass(frozen=True, kw_only=True)
class FileContents:
    """The name of the source, `table` or `tracks`, its settings in order, the unused columns, and how it was read.

    `column_listing` is what the columns probably are, line by line, where it is open which is which.
    """

    source: str
    settings: tuple[Setting, ...]
    unused: tuple[str, ...] = ()
    read_as: tuple[str, ...] = ()
    column_listing: str = ""


def propose(path: Path, columns: Mapping[str, Any] | None = None) -> FileContents:
    """Return the settings with which a file or a folder is read.

    Args:
        path: a table of impacts, a recording, or a folder with recordings.
        columns: names in a table by ours, as settings state them; they are not among those returned.

    Raises:
        DataError: it cannot be read, or is neither.
    """
    packed = files_in(path, {*table.SUFFIXES, *RECORDING_SUFFIXES}) if is_archive(path) else []
    if len(packed) == 1:
        first = packed[0]
    else:
        first = path if path.suffix.lower() in table.SUFFIXES and is_single(path) else recording_files(path)[0]
    of_text = first.suffix.lower() in table.DELIMITED
    cells = None if of_text else _impacts_of(first, columns)
    nested = nested_table(first) if cells is None else None
    if of_text and nested is not None and (cells := _impacts_of(first, columns)) is not None:
        nested = None
    if cells is None and nested is None and (first.suffix.lower() not in table.SUFFIXES or _is_recording(first)):
        bodies = bodies_of(first) if first.suffix.lower() == ".csv" else []
        body = _body(path, bodies=bodies) if len(bodies) > 1 else _body(path)
        unnamed = [one for one in _UNNAMED if one.name != "body" or len(bodies) < 2]
        return FileContents(source="tracks", settings=(*body, *unnamed))
    if nested is None and first.suffix.lower() in (".csv", ".tsv", ".txt") and (export := export_of(first)):
        return FileContents(source="tracks", settings=(*_of_export(path, export),))
    cells = cells or (
        table.preview(first, columns) if nested is None else replace(sheet_of(nested.head(_PREVIEWED)), path=first)
    )
    header = cells.header
    if why := refusal_side_by_side(cells.repeated or header):
        raise DataError(f"{first}: {why}")
    space, impacts = recognised_columns(header)
    refuse_repeated(cells, [*impacts.names.values()])
    absent = [ours for ours, name in (columns or {}).items() if name is None]
    impacts = impacts.without(absent)
    frames, markers = recognise(header, _frame_units()), _markers(header)
    _refuse_sensors(first, header, frames)
    bodies = {} if markers or "x" in frames.names else bodies_in_names(header, _POSE)
    frames = _stamped(header, frames)
    if bodies:
        ours = {name: column for names in bodies.values() for name, column in names.items()}
        frames = recognise([*dict.fromkeys(ours.get(name, name) for name in header)], _frame_units())
    if any(column in impacts.names for column in ("speed_post", *space.components["v_post"])):
        if path.is_dir() or len(packed) > 1:
            every = packed or [file for file in sorted(path.rglob("*")) if file.suffix.lower() in table.SUFFIXES]
            raise DataError(f"{path}: {several(path, every, 'table')}")
        if "trial" not in impacts.names and (trial := trial_column(cells, impacts.others)):
            others = tuple(name for name in impacts.others if name != trial)
            impacts = replace(impacts, names={**impacts.names, "trial": trial}, others=others)
        for column, name in impacts.names.items():
            if column in columns_of(space) and column not in table.NAMES:
                replace(cells, gaps=True).numbers(name, Units(SI, impacts.units).text(column))
        unused = tuple(name for name in impacts.others if not name.startswith(("cov_", "apparatus_")))  # of our tables
        impacts = _with_stated(replace(impacts, others=unused), columns or {})
        return _contents("table", _table(path, space, impacts, cells), cells, unused=unused)
    if why := refusal_of_cameras(header):
        raise DataError(f"{first}: {why}")
    times = [times_in(name, opposite=False) for name in header]
    paired = times.count("pre") == times.count("post") > 0  # as families of numbers before and after contact
    recording = frames.names.get("recording")
    named = {*cells.names(recording)} if recording in header else set[str]()
    clock = "time" in frames.names or {*FRAME_NUMBERS} & {*header} or 0 < 2 * len(named) <= len(cells)
    alone = bool(named) and len(named) == len(cells)  # a row a trial, and no frames
    framed = not paired and (clock or not (alone or "pre" in times))
    posed = framed and (markers or ("x" in frames.names and {"y", "z"} & {*frames.names}))
    if posed:
        if "recording" not in frames.names and (recording := recording_column(first_rows(first))) in frames.others:
            others = tuple(name for name in frames.others if name != recording)
            frames = replace(frames, names={**frames.names, "recording": recording}, others=others)
        frames = frames if "theta" in frames.names or "z" in frames.names else _with_heading(frames)
        column, named = ("", []) if bodies else _bodies_in_rows(first, frames)
        where = f"in column {column!r}" if named else "in names of columns"
        body = _body(path, markers, bodies or named, where)
        return _contents("tracks", (*body, *_layout(first, frames, markers)), cells)
    names = column_names(first) if first.suffix.lower() == ".parquet" else header
    if clock and framed and frames.others:
        return _contents("tracks", (*_body(path), *_open_layout(first, frames, names)), cells)
    if why := refusal_of_several(header):
        raise DataError(f"{first}: {why}")
    if why := refusal_of_unmeasured(header):
        raise UnknownLayoutError(f"{first}: {why}; its columns are\n{_column_listing(cells, 'table')}")
    raise UnknownLayoutError(
        f"{first}: is neither a table of impacts, which has velocities after contact such as vx_post (docs/tables.md), "
        f"nor a recording, which has x, y and theta (docs/tracks.md); its columns are\n{_column_listing(cells)}"
    )


def _contents(source: str, settings: Iterable[Setting], cells: Sheet, *, unused: tuple[str, ...] = ()) -> FileContents:
    """The settings of a file, with a listing of its columns where one of them is open."""
    settings = (*settings,)
    asked = any(one.value == OPEN and one.name.startswith("columns.") for one in settings)
    listing = _column_listing(cells, source) if asked else ""
    return FileContents(source=source, settings=settings, unused=unused, read_as=cells.read_as, column_listing=listing)


def _column_listing(cells: Sheet, source: str | None = None) -> str:
    """What the columns of a file probably are, and a command with what the comments above its header say."""
    remarks = "\n".join(comments(Path(cells.path)))
    pixels = any({"px", "pixel", "pixels"} & {*name_words(name)} for name in cells.header)
    settings = (_rate_of(remarks), *([_pixel_of(remarks)] if pixels else []))
    stated = {one.name: one.value for one in settings if one.value != OPEN}
    return probable_columns(Path(cells.path), cells, _frame_units(), stated, source=source)


def _impacts_of(first: Path, columns: Mapping[str, Any] | None) -> Sheet | None:
    """The cells of a file that is a table of impacts; None of a recording, and of what is no table."""
    if first.suffix.lower() not in table.READ:
        return None
    try:
        cells = table.preview(first, columns)
    except UnknownLayoutError:
        raise
    except DataError:
        return None
    space, impacts = recognised_columns(cells.header)
    return cells if any(column in impacts.names for column in space.components["v_post"]) else None


def _stamped(header: Sequence[str], known: Recognised) -> Recognised:
    """Columns of which whole seconds beside nanoseconds are the times: others are those of arrival, or dates."""
    if (stamp := next((name for name in header if nanoseconds_beside(name, header)), None)) is None:
        return known
    others = tuple(name for name in (*known.others, known.names.get("time")) if name and name != stamp)
    return replace(known, names={**known.names, "time": stamp}, others=others)


def _refuse_sensors(first: Path, header: Sequence[str], known: Recognised) -> None:
    """Refuse a file in which all that is measured are accelerations and rates.

    Raises:
        DataError: naming its columns.
    """
    measured = [name for name in header if name not in (known.names.get("time"), known.names.get("recording"))]
    measured = [name for name in measured if name not in FRAME_NUMBERS]
    app = of_sensor(first) and not {"theta", "qw"} & {*known.names}
    if measured and (app or all(map(sensed, measured))):
        raise DataError(f"{first}: has {', '.join(map(repr, measured))}: {SENSED}")


def stated_by_header(path: Path) -> dict[str, Any]:
    """Return columns, units and the rate that the header of a recording, or of the first of a folder, states.

    Nothing of a file with our names, or of a format that has its own reader.

    Raises:
        DataError: the header leaves a column open, or is none of a recording.
    """
    reasons = list[ContactLearnError]()
    for file in recording_files(path)[:_FIRST]:
        try:
            contents = propose(file)
            break
        except ContactLearnError as error:
            reasons.append(error)
    else:
        if any(map(_has_our_names, recording_files(path)[:_FIRST])):
            return {}  # the reader says what is wrong
        raise reasons[0]
    if contents.source != "tracks":
        return {}
    values = {one.name: one.value for one in contents.settings if one.value != OPEN}
    left = [one for one in contents.settings if one.value == OPEN and one.name.startswith("columns.")]
    if left:
        asked = "; ".join(f"{one.name.removeprefix('columns.')}: {one.comment}" for one in left)
        raise DataError(f"{file}: which column is which? state data.columns={{…}}, {asked}\n{contents.column_listing}")
    columns = {name.removeprefix("columns."): value for name, value in values.items() if name.startswith("columns.")}
    stated = {name: values[name] for name in ("unit", "angle", "rate") if values.get(name) is not None}
    return stated | ({"columns": columns} if columns else {})


def _has_our_names(file: Path) -> bool:
    try:
        return {"x", "y"} <= {*first_rows(file).columns} and not of_sensor(file)
    except Exception:  # a damaged file can break a library anywhere
        return False


def _open_layout(first: Path, known: Recognised, names: Sequence[str]) -> Iterator[Setting]:
    """The settings of a recording whose times or names of recordings are known, and not its columns of poses."""
    if "time" not in known.names:
        yield _rate_of("\n".join(comments(first)))
    for name in ("time", "recording"):
        if known.names.get(name, name) != name:
            yield Setting(
                name=f"columns.{name}", value=known.names[name], comment="s" if name == "time" else "its name"
            )
    others = ", ".join(name for name in names if name not in known.names.values() and not sensed(name))
    yield Setting(name="columns.position", value=OPEN, comment=f"[x, y] or [x, y, z] among {others}")
    yield Setting(name="columns.quaternion", value=None, comment="four columns, for positions in space")
    yield Setting(name="columns.angle", value=None, comment="in the plane of motion; null of a ball without it")


def _is_recording(path: Path) -> bool:
    """Whether a file of text is one of Motive, or of TUM: eight numbers a line, and no header."""
    if path.suffix.lower() == ".csv":
        return is_motive(path)
    return path.suffix.lower() == ".txt" and leading_numbers(path) == TUM_COLUMNS


def _of_export(path: Path, export: Export) -> Iterator[Setting]:
    """The settings of an export of a tracker that its header leaves open."""
    bodies = [*export.bodies] or export.subjects or export.tracks
    of_one = [name for name in export.points if not export.subjects or name.startswith(f"{export.subjects[0]}:")]
    where = "in column 'track'" if export.tracks else "in names of columns"
    yield from _body(path, [export.points[name] for name in of_one], bodies if len(bodies) > 1 else (), where)
    if len(bodies) < 2 and any(f"{name} t" in export.names for name in export.points):  # of tracks with their own times
        yield Setting(
            name="body", value=None, comment=f"{' or '.join(export.points)}, if each is one; null: points of one"
        )
    if export.rate is None and export.clock not in export.names:
        yield Setting(name="rate", value=OPEN, comment="frames a second, for no column is a time in s")
    if export.unit is None:
        yield Setting(name="unit", value=None, comment=f"{', '.join(UNITS)}, or the size of a pixel in m; null: found")


def _frame_units() -> Vocabulary:
    """The columns of a recording and their units; the reader takes the unit of times off the column's name."""
    units: dict[str, dict[str, Stated]] = {column: {"": {}} for column in _FRAME}
    units["time"] |= {name: {} for name in (*UNIT_FACTORS["time"], "ns")}
    units["theta"] |= {name: {"angle": name} for name in ANGLES}
    for column in "xyz":
        units[column] |= {name: {"unit": name} for name in UNITS}
        units[column] |= {name: {"unit": _PIXEL} for name in (_PIXEL, "pixel", "pixels")}
    return units


def _markers(header: Sequence[str]) -> list[list[str]]:
    """The columns of numbered markers, such as x1, y1, x2, y2; none if there are fewer than two of one dimension."""
    numbered: dict[str, dict[str, str]] = {}
    for name in header:
        match = _MARKER.fullmatch("".join(name_words(name)))
        if match and (match[1] or match[3]):
            numbered.setdefault(match[1] or match[3], {})[match[2]] = name
    markers = [[axes[axis] for axis in sorted(axes)] for axes in numbered.values()]
    return markers if len(markers) > 1 and {*map(len, markers)} in ({2}, {3}) else []


def _with_stated(known: Recognised, columns: Mapping[str, Any]) -> Recognised:
    """The same with the units in names of columns that settings name; other entries of settings say theirs."""
    vocabulary = {**impact_vocabulary(PLANE), **impact_vocabulary(SPACE)}
    named = {ours: name for ours, name in columns.items() if isinstance(name, str) and ours in known.names}
    units = {ours: unit for ours, name in named.items() if (unit := unit_in(name, ours, vocabulary))}
    return replace(known, units={**known.units, **units})


def _table(path: Path, space: Space, known: Recognised, cells: Sheet | None) -> Iterator[Setting]:
    """The settings of a table of impacts."""
    angles = {end: direction_in(known, end) for end in ("", "_post") if f"speed{end}" in known.names}
    known = known.without([ours for ours, name in known.names.items() if name in angles.values()])
    names = {column: name for column, name in known.names.items() if column in columns_of(space)}
    lacking = [column for column in required_in(space) if column not in names]
    lacking = [column for column in lacking if not angles or column.removesuffix("_post") not in ("vx", "vy")]
    if "inertia" in known.others:  # one for all axes
        lacking = [column for column in lacking if column not in SPACE.inertia]
    fields = computed_fields(space, lacking, known.others)
    shaped = {"inertia", "r"} & {*fields}
    fields = [field for field in fields if field != "orientation" or "r" in fields]  # a disc may be stated
    computed = [column for field in fields for column in COMPUTED[space][field]]
    units = Units(SI, known.units)
    yield Setting(name="path", value=str(path), comment="from the folder in which commands run")
    if "mass" in lacking:
        yield Setting(name="mass", value=OPEN, comment="of every body, kg; the table has no column mass")
    about = f"from which {', '.join(computed)} are computed; " if shaped else "null: unknown; "
    yield Setting(name="shape", value=OPEN if shaped else None, comment=f"of the body, {about}{_SHAPE}")
    if {*space.inertia} <= {*lacking}:
        yield Setting(name="inertia", value=None, comment="of every body, kg m²; null: of uniform density")
    for column, name in names.items():
        if name != column:
            open_ = [f"units.{one}" for one in powers_of(column) if _unit(one, names, known)[0] == OPEN]
            unit, silent = units.text(column), not known.units.get(column)
            about = f"by {' and '.join(open_)}" if silent and open_ else f"{unit}, assumed" if silent and unit else unit
            yield Setting(name=f"columns.{column}", value=name, comment=about or "a name")
    for end, name in angles.items():
        if (speed := known.names[f"speed{end}"]) != f"speed{end}":
            yield Setting(name=f"columns.speed{end}", value=speed, comment=units.text(f"speed{end}"))
        angle = repr(name) if name else "the angle of this velocity"
        about = f"{angle} if it is from the floor; if it is from the normal, write direction_normal{end} for this key"
        yield Setting(name=f"columns.direction_floor{end}", value=OPEN, comment=about)
    spins = spins_per_second(known.others)
    for column in lacking:
        if column not in ("mass", *computed):
            near = suggest(column, known.others).replace(", did you mean", "; is it")
            when = "after contact" if column.endswith("_post") else "before contact"
            meaning = (_MEANINGS if space is PLANE else _MEANINGS_IN_SPACE).get(
                column.removesuffix("_post"), "of the body"
            )
            about = ", ".join(part for part in (units.text(column), meaning, f"{when}{near}") if part)
            if column in spins:
                about = f"{{column: {setting_text(spins[column])}, unit: rad/s}}, or rev/s: its 1/s may be either"
            yield Setting(name=f"columns.{column}", value=OPEN, comment=about)
    for quantity, choices in UNIT_FACTORS.items():
        if quantity != "rotation" or space is PLANE:
            value, source = _unit(quantity, names, known)
            yield Setting(name=f"units.{quantity}", value=value, comment=f"{' or '.join(choices)}; {source}")
    own = f", such as those of {', '.join(map(repr, known.others))}" if known.others else ""
    groups = [] if cells is None else [name for name in known.others if _is_covariate(cells, name)]
    yield Setting(name="covariates", value=groups, comment=f"columns that outcomes may depend on{own}")
    measured = [name for column, name in names.items() if column not in table.NAMES]
    bad = [] if cells is None else cells.missing(measured)
    rows = f"; a number is missing in row {', '.join(map(str, bad[:_SHOWN_ROWS]))}{' …' * (len(bad) > _SHOWN_ROWS)}"
    about = f"corrections that the audit names, in this order{rows if bad else ''}"
    rig = [*known.names.values(), *names.values()] if cells is None else cells.header
    corrections = [*["drop_incomplete"] * bool(bad), *["rig"] * ("apparatus_gravity" in rig)]
    yield Setting(name="correct", value=corrections, comment=about)


_MOST_GROUPS, _SHOWN_ROWS = 12, 10
_OF_SURROUNDINGS = re.compile(r"temp[eé]r|humid|feucht|humedad|umidit", re.I)


def _is_covariate(cells: Sheet, name: str) -> bool:
    """Whether a column has a few names, each in several rows, or numbers of the air or the material that vary."""
    counts = Counter(cells.names(name))
    if cells.is_numeric(name):
        return bool(_OF_SURROUNDINGS.search(name)) and len(counts) > 1
    few = 1 < len(counts) <= _MOST_GROUPS and min(counts.values()) > 1
    return few and not any(map(is_missing, counts))


def _unit(quantity: str, names: Mapping[str, str], known: Recognised) -> tuple[str | None, str]:
    """The unit of a quantity, and its reason; `OPEN` where some columns state another than SI, and others none."""
    stated = known.stated(quantity)
    silent = [
        name
        for column, name in names.items()
        if quantity in powers_of(column) and quantity not in known.units.get(column, {})
    ]
    source = " and ".join(f"{unit} as in {named[0]!r}" for unit, named in stated.items())
    telling = [unit for unit in stated if unit not in (SI[quantity], *COMPOUND)]
    if telling and silent:
        spins = quantity == "angle" and any("time" in powers_of(column) for column in names)
        of = f"of {', '.join(map(repr, silent))}, which state none{' (rad means rad/s of a spin)' if spins else ''}"
        return OPEN, f"{of}; {source}, which keeps it"
    if not telling and stated and not silent and SI[quantity] not in stated:
        return None, f"null: as each column states it; {source}"
    if quantity == "angle" and not stated and not silent:
        return None, f"null: as columns state it, or {SI[quantity]}; no column is of it"
    if not stated and not silent and (of_others := _units_of_others(quantity, known.others)):
        return None, f"null: as each column states it; {of_others}"
    if not telling:
        return SI[quantity], source or "assumed, for no column states it"
    return (next(iter(stated)), source) if len(stated) == 1 else (None, f"null: as each column states it; {source}")


def _units_of_others(quantity: str, names: Sequence[str]) -> str:
    """The units but those of SI that columns state whose meaning is open, which may be lengths, velocities or spins."""
    vocabulary = impact_vocabulary(PLANE)
    units = {
        name: unit
        for name in names
        for column in ("vx", "x", "omega", "theta", "time")
        if (unit := unit_in(name, column, vocabulary).get(quantity)) and unit != SI[quantity]
    }
    return " and ".join(f"{unit} as in {name!r}" for name, unit in units.items())


def _bodies_in_rows(first: Path, known: Recognised) -> tuple[str, list[str]]:
    """The column that names several bodies, and their names, in the first recording of a file."""
    rows, recording = first_rows(first), known.names.get("recording")
    if recording in rows.columns:
        rows = rows[rows[recording] == rows[recording].iloc[0]]
    if not {*known.names.values()} <= {*map(str, rows.columns)}:  # rows that the reader of tables has changed
        return "", []
    return bodies_in_rows(str(first), rows, known.names.get("time"), known.names.values())


def _body(
    path: Path,
    markers: Sequence[Sequence[str]] = (),
    bodies: Iterable[str] = (),
    where: str = "in names of columns",
) -> Iterator[Setting]:
    """The settings that every recording needs, of one of several bodies where names of columns or rows have them."""
    yield Setting(name="path", value=str(path), comment="from the folder in which commands run")
    if bodies:
        yield Setting(name="body", value=OPEN, comment=f"{' or '.join(bodies)}, {where}")
    yield Setting(name="mass", value=OPEN, comment="of the body, kg")
    hull = "null: the convex hull of its markers; " if len(markers) > 2 else ""
    yield Setting(name="shape", value=None if hull else OPEN, comment=f"of the body, {hull}{_SHAPE}")
    yield Setting(name="inertia", value=None, comment="about the centre of mass, kg m²; null: of uniform density")


def _layout(first: Path, known: Recognised, markers: list[list[str]]) -> Iterator[Setting]:
    """The settings of the columns of a recording; columns with our names need none."""
    remarks = "\n".join(comments(first))
    names, counted = known.names, any(name in FRAME_NUMBERS for name in known.others)
    others = [name for name in known.others if name not in FRAME_NUMBERS and not sensed(name)]
    if "time" not in names:
        yield _rate_of(remarks)
    axes, turns = ([name for name in group if name in names] for group in (("x", "y", "z"), ("qw", "qx", "qy", "qz")))
    columns: dict[str, tuple[Any, Any, str]] = {
        "time": (names.get("time", "time" if counted else None), "time", "s"),
        "recording": (names.get("recording", "recording"), "recording", "name of the recording"),
    }
    if markers:
        columns["markers"] = (markers, [], "of each marker, in the unit of length")
    elif len(turns) == 4 and len(axes) == 3:
        columns["position"] = ([names[axis] for axis in axes], axes, "in the unit of length")
        columns["quaternion"] = ([names[turn] for turn in turns], turns, "w first")
    elif len(axes) == 3 and len(numbered := [name for name in others if _NUMBERED.fullmatch(name)]) == 4:
        columns["position"] = ([names[axis] for axis in axes], axes, "in the unit of length")
        columns["quaternion"] = (sorted(numbered), [], "whether w is first or last: order=wxyz or xyzw, or found")
    elif len(axes) == 3 and (turned := orientation_columns([*known.others, *(names[turn] for turn in turns)])):
        columns["position"] = ([names[axis] for axis in axes], axes, "in the unit of length")
        about = "turns about x, y and z, or a vector of rotation" if len(turned) == 3 else "row by row"
        columns["euler" if len(turned) == 3 else "matrix"] = ([*turned], [], about)
    else:
        among = ", ".join(others)
        about = f"in the plane of motion, if it is among {among}; null: nobody measured it, as of a ball"
        if len(axes) == 2 or "theta" in names:
            position = [names[axis] for axis in axes] if len(axes) == 2 else OPEN
            columns["position"] = (position, ["x", "y"], "the two in the plane of motion, in the unit of length")
        else:
            columns["position"] = ([names[axis] for axis in axes], axes, "in the unit of length")
            about = f"null: no orientation was measured, as of a ball; else quaternion: four columns among {among}"
        angle = names.get("theta", OPEN if others else None)
        columns["angle"] = (angle, "theta", about if angle == OPEN else "in the plane of motion; null: not measured")
    for name, (value, usual, about) in columns.items():
        if value != usual:
            yield Setting(name=f"columns.{name}", value=value, comment=about)
    for name, choices, evidence in (("unit", UNITS, "gravity"), ("angle", ANGLES, "the impacts")):
        units = known.stated(name)
        value = None if not units else OPEN if len(units) > 1 else next(iter(units))
        about = f"{', '.join(choices)}; null: found from {evidence}"
        if value == _PIXEL:
            yield _pixel_of(remarks)
            continue
        yield Setting(name=name, value=value, comment=about)


def _rate_of(remarks: str) -> Setting:
    """The setting of the frame rate."""
    stated = _RATE if _RATE.search(remarks) or _FILTER.search(remarks) else _FREQUENCY
    rate = _only_number(stated, remarks)
    source = "for no column is a time in s" if rate is None else "as the comment above the header says"
    return Setting(name="rate", value=rate or OPEN, comment=f"frames a second, {source}")


def _pixel_of(remarks: str) -> Setting:
    """The setting of the size of a pixel."""
    sizes = {
        f"{float(match['size']) ** power * UNIT_FACTORS['length'][match['unit'].replace('µ', 'u').lower()]:.6g}"
        for pattern, power in _SCALES
        for match in re.finditer(pattern, remarks, re.I)
        if float(match["size"])
    }
    value = float(sizes.pop()) if len(sizes) == 1 else OPEN
    about = "size of a pixel in m" + (", as the comment above the header says" if value != OPEN else "")
    return Setting(name="unit", value=value, comment=about)


def _with_heading(known: Recognised) -> Recognised:
    """Columns of which one is an angle by another name, such as Heading_deg_cw; impacts show its sense."""
    words = {name: [word for word in name_words(name) if word not in _SENSES] for name in known.others}
    names = [name for name, one in words.items() if one[:1] and one[0] in _HEADINGS and {*one[1:]} <= {*_TURNS}]
    if len(names) != 1:
        return known
    units = {_TURNS[word] for word in words[names[0]][1:]}
    return replace(
        known,
        names={**known.names, "theta": names[0]},
        units={**known.units, **({"theta": {"angle": units.pop()}} if len(units) == 1 else {})},
        others=tuple(name for name in known.others if name != names[0]),
    )


def _only_number(pattern: re.Pattern[str], text: str) -> float | None:
    """The number that all matches of a pattern state; None if there is none, or two."""
    numbers = {float(number) for groups in pattern.findall(text) for number in groups if number}
    return numbers.pop() if len(numbers) == 1 else None
