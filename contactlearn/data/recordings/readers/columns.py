"""CSV and Parquet: a row a frame, columns named in the layout.

    time; x, y, theta                     in a plane
    time; x, y, z; qw, qx, qy, qz         in space; or roll, pitch, yaw, or nine columns of a matrix
    recording                             in a file with several recordings, each of them in one piece

An empty cell is a coordinate that the tracker lost.  Exports with other lines above their frames are in `exports`.
"""

import csv
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice, takewhile
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pandas as pd
from pyarrow import parquet

from contactlearn.core.errors import DataError, suggest
from contactlearn.data.packed import for_library, opened_text
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.poses import Array, turn
from contactlearn.data.recordings.readers import JSON, RECORDED, TABLES, VECTOR, Layout, in_seconds
from contactlearn.data.recordings.readers.exports import Export, export_of, padded
from contactlearn.data.recordings.readers.nested import frame_of, is_folded, json_table, titled, unfolded
from contactlearn.data.recordings.track import Recording
from contactlearn.data.table import DELIMITED, raw_cells
from contactlearn.data.table.dialect import MISSING, WIDE, Dialect, Header, Numerals, csv_rows, sniffed
from contactlearn.data.table.mapped import stated_column
from contactlearn.data.table.names import unit_as_written
from contactlearn.data.table.several import runs_in
from contactlearn.data.table.units import Units

_OF_TRANSFORMS = "child_frame_id"
FRAME_NUMBERS = ("frame", "Frame", "frame_number", "frame_index", "frame_idx", "frames", "seq")
"""Columns that count frames; a frame that they leave out was dropped."""
_ROWS = 200_000  # that are read at once
_WIDE = r"\s{2,}|\t"  # what parts columns whose names have blanks
_PLAIN = 12  # lines by which a text is as plain as most
_NUMBER = re.compile(r"(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|NaN)?")
_SNIFFED = 60  # lines by which a text is understood
_LONGER = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
_LOST = 1e20  # from which on a number is a mark of a lost coordinate, such as -3.697314E28 of NDI
MOST_FRAMES = 2_000_000
"""Of a recording: more than half an hour at 1000 frames a second, and a gigabyte or two of memory."""


def read(path: Path, layout: Layout) -> Iterator[Recording | DataError]:
    """Yield the recordings of a CSV or Parquet file, or the error of one."""
    nested = nested_table(path)
    export = None if nested is not None or path.suffix.lower() == ".parquet" else export_of(path)
    layout = layout if export is None else export.layout(path, layout)
    names, seen = layout.recording, set[str]()
    pending, rows = list[pd.DataFrame](), 0
    for part in _parts(path, export) if nested is None else [nested]:
        if names == "recording" not in part.columns and (column := recording_column(part)):
            layout, names = replace(layout, recording=column), column
        part = _as_stated(path, _of_body(path, part, layout), layout)
        _check_columns(path, part, layout)
        for piece in _pieces(part, names):
            if pending and _name(pending[-1], names) != _name(piece, names):
                yield _whole(path, pending, rows, layout, seen)
                pending, rows = [], 0
            rows += len(piece)
            if rows <= MOST_FRAMES or not pending:
                pending.append(piece)
            elif names not in part.columns:
                raise DataError(
                    f"{path}: has more than {MOST_FRAMES} frames and no column {names!r} of recordings: split it"
                )
    if not pending:
        raise DataError(f"{path}: holds no frames")
    yield _whole(path, pending, rows, layout, seen)


_COUNTED = {"id", "name", "no", "nr", "number", "index", "idx", "file", ""}


def recording_column(table: pd.DataFrame) -> str | None:
    """Return the column that a word for a recording names, such as clip, and whose values are in one piece each."""
    for name in map(str, table.columns):
        words = {*re.split(r"[\W\d_]+", name.lower())} - _COUNTED
        if len(words) == 1 and words <= RECORDED:
            keys = table[name].astype(str)
            if 1 < keys.nunique() == 1 + int((keys != keys.shift()).iloc[1:].sum()):
                return name
    return None


def _name(piece: pd.DataFrame, names: str | None) -> str | None:
    return str(piece[names].iloc[0]) if names in piece.columns else None


def _pieces(part: pd.DataFrame, names: str | None) -> Iterator[pd.DataFrame]:
    """Rows of one recording, the last of which may go on in the next part."""
    if names not in part.columns:
        yield part
    elif len(part):
        keys = part[names].astype(str)
        order = {key: place for place, key in enumerate(pd.unique(keys))}
        order[keys.iloc[-1]] = len(order)
        for _, piece in part.groupby(keys.map(order)):
            yield piece


def _parts(path: Path, export: Export | None, rows: int | None = None) -> Iterator[pd.DataFrame]:
    """Frames of a text or Parquet file, so many at a time."""
    rows = rows or _ROWS
    if path.suffix.lower() == ".parquet":
        with parquet.ParquetFile(for_library(path), pre_buffer=False) as file:
            for batch in file.iter_batches(rows):
                yield _flat(batch.to_pandas())
        return
    text, format = _of_export(path, export) if export else _of_text(path)
    engine = {"engine": "python"} if format["sep"] == _WIDE else {"low_memory": False}
    options = {"chunksize": rows, "na_values": MISSING, "skipinitialspace": True, "index_col": False, "header": None}
    with text, pd.read_csv(text, **options, **engine, **format) as reader:
        try:
            yield from reader if export is None else map(export.cleaned, reader)
        except pd.errors.ParserError as error:
            if not (counts := _LONGER.search(str(error))):
                raise
            raise DataError(
                f"{path}: cannot be read: line {counts[2]} has {counts[3]} cells, and those above it have {counts[1]}; "
                "a row has a cell for each column: leave out lines above the names of the columns"
            ) from None


def comments(path: Path) -> list[str]:
    """Return the comments and other lines above the header of a text file."""
    if path.suffix.lower() not in DELIMITED:
        return []
    try:
        dialect, above, _ = _placed(path)
    except DataError:  # whose frames have no header above them
        return []
    with dialect.opened(path) as file:
        return [line.strip() for line in islice(file, above - len(dialect.header.raw))]


def _plain(path: Path) -> Dialect | None:
    """The dialect of a text with names in its first line, and in each other line as many numbers with points.

    Most recordings are such, and there may be thousands.
    """
    try:
        with opened_text(path, encoding="utf-8-sig") as file:
            header, *frames = [line.rstrip("\r\n") for line in islice(file, _PLAIN)] or [""]
    except UnicodeDecodeError:
        return None
    separator = next((mark for mark in "\t;," if mark in header), ",")
    names = header.split(separator)
    known = all(re.match(r"\w", name) and '"' not in name and not _NUMBER.fullmatch(name) for name in names)
    rows = [line.split(separator) for line in frames]
    if not known or not rows or len({*names}) < len(names) or {*map(len, rows)} != {len(names)}:
        return None
    if not all(_NUMBER.fullmatch(cell) for row in rows for cell in row):
        return None
    return Dialect(
        encoding="utf-8-sig", separator=separator, above=0, comments=0, numerals=Numerals(),
        header=Header(names=names, rows=1, read_as=(), raw=(tuple(names),)),
    )  # fmt: skip


def _placed(path: Path) -> tuple[Dialect, int, list[str]]:
    """The dialect of a text, the number of lines above its frames, and the first of these."""
    dialect = _plain(path) or sniffed(path, most=_SNIFFED)
    rows, above = dialect.header.rows, dialect.above
    try:
        with dialect.opened(path) as file:
            head = [*islice(csv_rows(islice(file, above, None), dialect.separator), rows + 1)]
    except csv.Error as error:
        raise DataError(f"{path}: line {above + error.args[0]} is not CSV: {error.args[1]}") from None
    return dialect, above + (head[rows - 1][0] if rows else 0), head[rows][1] if len(head) > rows else []


def _of_text(path: Path) -> tuple[TextIO, dict[str, Any]]:
    """An opened text, and what pandas is to be told of it.

    Raises:
        DataError: it holds no frames.
    """
    dialect, above, first = _placed(path)
    if not first:
        raise DataError(f"{path}: holds no frames")
    names, other = list[str](), "." if dialect.numerals.decimal == "," else ","
    for name in padded(dialect.header.names, first):
        count = sum(one == name or one.startswith(f"{name}.") for one in names) if name in names else 0
        names.append(f"{name}.{count}" if count else name)
    return dialect.opened(path), {
        "sep": {" ": r"\s+", WIDE: _WIDE}.get(dialect.separator, dialect.separator),
        "decimal": dialect.numerals.decimal,
        "thousands": other if dialect.numerals.grouped else None,
        "skiprows": above,
        "names": names,
    }


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a Parquet file, lists as a column each."""
    with parquet.ParquetFile(for_library(path), pre_buffer=False) as file:
        return [*map(str, _flat(next(file.iter_batches(1)).to_pandas()).columns)]


def _flat(frames: pd.DataFrame) -> pd.DataFrame:
    """Frames in which a column of lists, as LeRobot writes states, has a column each, such as `observation.state.0`."""
    for name in [name for name in frames.columns if isinstance(frames[name].iloc[0], list | np.ndarray)]:
        values = np.stack(frames.pop(name).to_list())
        if values.ndim == 2:
            frames = frames.join(
                pd.DataFrame(values, frames.index, [f"{name}.{k}" for k in range(values.shape[1])])  # pyright: ignore[reportArgumentType]
            )
    return frames


def _of_export(path: Path, export: Export) -> tuple[TextIO, dict[str, Any]]:
    """The same of an export, whose frames end with its first blank line."""
    with opened_text(path, encoding="utf-8-sig", errors="replace") as file:
        frames = [*islice(takewhile(str.strip, islice(file, export.above, None)), _SNIFFED)]
        more = sum(1 for _ in takewhile(str.strip, file)) if len(frames) == _SNIFFED else 0
    commas = export.separator != "," and any(re.search(r"\d,\d", line) for line in frames)
    return opened_text(path, encoding="utf-8-sig"), {
        "sep": export.separator,
        "decimal": "," if commas else ".",
        "skiprows": export.above,
        "nrows": len(frames) + more,
        "names": export.names,
    }


def _whole(path: Path, pieces: list[pd.DataFrame], rows: int, layout: Layout, seen: set[str]) -> Recording | DataError:
    """One recording of its pieces, or its error.

    Raises:
        DataError: it is alone; or its frames are not in one piece, and those of others will not be either.
    """
    name = _name(pieces[0], layout.recording) or path.stem
    if name in seen:
        raise DataError(f"{path}: the frames of recording {name!r} are not in one piece; sort the file by recording")
    seen.add(name)
    if rows > MOST_FRAMES:
        return DataError(f"{path}: {name}: has {rows} frames, more than {MOST_FRAMES}: split it")
    try:
        return _recording(path, name, pieces[0] if len(pieces) == 1 else pd.concat(pieces), layout)
    except DataError as error:
        if layout.recording not in pieces[0].columns:
            raise
        return error


def _recording(path: Path, name: str, table: pd.DataFrame, layout: Layout) -> Recording:
    if len(table) == 0:
        raise DataError(f"{path}: holds no frames")
    place = f"{path}: {name}" if layout.recording in table.columns else str(path)
    table = _once(table, layout)
    table, layout = _with_poses(_rows_of_body(place, table, layout), layout), _with_orientation(table, layout)
    time = _times(path, place, table, layout)
    if layout.markers:
        markers = np.stack([_columns(place, table, names) for names in layout.markers], 1)
        return pose_of_markers(markers, time, layout.places, name=name, source=str(path), unit=layout.unit)
    spatial = layout.position[2:] and layout.position[2] in table.columns
    position = _columns(place, table, layout.position if spatial else layout.position[:2])
    if spatial:
        measured = not {*layout.quaternion}.isdisjoint(map(str, table.columns))
        quaternion = _orientations(place, table, layout.quaternion) if measured else np.tile(_UNTURNED, (len(table), 1))
        return Recording(
            name=name, source=str(path), time=time, position=position, quaternion=quaternion, unit=layout.unit,
            order=layout.order,
        )  # fmt: skip
    if layout.angle is None or layout.angle not in table.columns:
        angle = np.zeros(len(table))  # not measured: see `_no_angle`
    else:
        angle = _column(place, table, layout.angle)
    return Recording(name=name, source=str(path), time=time, position=position, angle=angle, unit=layout.unit)


def _once(table: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """The frames without those that repeat the one before in all columns, as a message that was written twice."""
    if layout.time not in table.columns or not table[layout.time].duplicated().any():
        return table
    try:
        repeated = table.eq(table.shift()) | (table.isna() & table.shift().isna())
    except (TypeError, ValueError):  # lists in cells cannot be compared
        return table
    return table[~repeated.all(axis=1)]


def _with_poses(table: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """The frames of a log that has rows of a faster instrument between them, whose cells of the position are empty."""
    places = [name for name in layout.position if name in table.columns]
    seen = np.flatnonzero(table[places].notna().any(axis=1))
    between = layout.time in table.columns and len(seen) > 9 and (np.diff(seen) == 1).mean() < _ADJACENT
    return table.iloc[seen] if between else table


def _of_body(path: Path, table: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """A table with the columns of one of several bodies, such as x_red, y_red, x_blue, y_blue, under their own names.

    Raises:
        DataError: it is not stated which body.
    """
    known = [*layout.position, *layout.quaternion, *([] if layout.angle is None else [layout.angle])]
    bodies = {} if layout.markers else bodies_in_names([*map(str, table.columns)], known)
    if not bodies:
        return table
    return table.rename(columns=bodies[_chosen(str(path), [*bodies], layout, "in names of columns")])


def _as_stated(path: Path, table: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """A table with the columns that settings make, those with a stated unit in SI.

    Raises:
        DataError: see `stated_column`; or a unit of a quaternion.
    """
    columns = dict[str, Array]()
    for name, (field, like, entry) in layout.stated_columns.items():
        setting = f"{path}: data.columns.{field}"
        if "towards" in entry:
            centre, point = (_columns(str(path), table, names) for names in (layout.position[:2], entry["towards"]))
            columns[name] = np.arctan2(*(point - centre).T[::-1])
            continue
        one = stated_column(setting, entry, like, [*map(str, table.columns)])
        if field == "quaternion" and one.unit and len(layout.quaternion) != 3:
            raise DataError(f"{setting}: a quaternion and a matrix have no unit, got {one.unit}; leave it out")
        column = np.full(len(table), one.value) if one.column is None else _column(str(path), table, one.column)
        column = one.factor * column
        if one.unit:
            column = column * Units({}, {like: unit_as_written(one.unit, like)}).factor(like)
            column = turn(column) if field == "quaternion" else column
        columns[name] = column
    return table.assign(**columns) if columns else table


_SECONDS = {"ns": 1e-9, "ms": 1e-3, "min": 60.0, "h": 3600.0, **dict.fromkeys(("us", "µs", "μs"), 1e-6)}


def bodies_in_names(header: Sequence[str], known: Sequence[str]) -> dict[str, dict[str, str]]:
    """For each of several bodies, our names of columns by those of the file, such as x_red, y_red, x_blue and y_blue.

    Args:
        header: names in the file.
        known: our names of a body's columns, the two of its position first.
    """
    if {*known[:2]} <= {*header}:
        return {}
    named: dict[str, dict[str, str]] = {}
    for column in header:
        for name in sorted(known, key=len, reverse=True):  # tool_qx is qx of tool, and not x of tool_q
            start = re.fullmatch(rf"{re.escape(name)}[_ .:-]?(.+)", column)
            end = re.fullmatch(rf"(.+?)[_ .:-]?{re.escape(name)}", column)
            matches = [match for match in (start, end) if match]
            for match in matches:
                named.setdefault(match[1], {})[column] = name
            if matches:
                break
    bodies = {body: names for body, names in named.items() if {*known[:2]} <= {*names.values()}}
    return bodies if len(bodies) > 1 else {}


def _rows_of_body(place: str, table: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """The rows of one of several bodies, which a column names; times grow for each of them, and not for all together.

    Raises:
        DataError: it is not stated which body.
    """
    used = {layout.time, layout.recording, layout.angle, *layout.position, *layout.quaternion}
    column, bodies = bodies_in_rows(place, table, layout.time, used)
    return (
        table[table[column].astype(str) == _chosen(place, bodies, layout, f"in column {column!r}")] if bodies else table
    )


def bodies_in_rows(
    place: str, table: pd.DataFrame, time: str | None, used: Collection[str | None]
) -> tuple[str, list[str]]:
    """Return the column that names the bodies of which rows alternate, and their names; none of a single body.

    The frames of transforms of ROS are bodies; other columns are where times grow for each body, and not for all.

    Args:
        place: of the table, for errors.
        table: frames of a recording.
        time: name of the column of times; None if frames are counted.
        used: other columns that are known.
    """
    for column in (name for name in table.columns if str(name).endswith(_OF_TRANSFORMS) and name not in used):
        if len(bodies := [*pd.unique(table[column].astype(str))]) > 1:
            return column, bodies
    clock = next((name for name in (time, *FRAME_NUMBERS) if name in table.columns), None)
    if clock is None:
        return "", []
    when = pd.Series(_stamps(place, table, clock), index=table.index)
    if len(when) < 2 or (when.diff().iloc[1:] > 0).all():
        return "", []
    for column in (name for name in table.columns if name not in {*used, clock, time}):
        steps = when.groupby(table[column].astype(str)).diff().dropna()
        bodies = [*pd.unique(table[column].astype(str))]
        if 1 < len(bodies) <= len(table) // 2 and (steps > 0).all():
            return column, bodies
    return "", []


def nested_table(path: Path) -> pd.DataFrame | None:
    """Return the frames of JSON, of a table that is no text, and of a text with titles or odd cells; None of others."""
    suffix = path.suffix.lower()
    if suffix in JSON:
        return json_table(path)
    if suffix not in DELIMITED:
        return unfolded(frame_of(raw_cells(path))) if suffix in TABLES else None
    if (frames := titled(path)) is not None or export_of(path) is not None:
        return frames
    with suppress(DataError):  # `_parts` says what is wrong
        if runs_in(_placed(path)[0].header.names):
            return frame_of(raw_cells(path))
    if _plain(path):
        return None
    with suppress(DataError):  # `_parts` says what is wrong
        return unfolded(pd.concat(_parts(path, None))) if is_folded(next(_parts(path, None, _SNIFFED))) else None
    return None


def first_rows(path: Path) -> pd.DataFrame:
    """Return the first rows of a file that has no lines above its header but comments."""
    nested = nested_table(path)
    return next(_parts(path, None)) if nested is None else nested


def _chosen(place: str, bodies: Sequence[str], layout: Layout, where: str) -> str:
    """The stated one of several bodies.

    Raises:
        DataError: none is stated, or another one.
    """
    if layout.body in bodies:
        return str(layout.body)
    choices = " or ".join(f"data.body={body}" for body in bodies)
    raise DataError(f"{place}: has {len(bodies)} bodies {where}; state {choices}")


def _times(path: Path, place: str, table: pd.DataFrame, layout: Layout) -> Array:
    """Times in s: a column of them, of dates with times, or of frame numbers and the frame rate."""
    number = next((name for name in FRAME_NUMBERS if name in table.columns), None)
    if layout.time is not None and layout.time in table.columns:
        stamps = _stamps(place, table, layout.time)
        if number is not None and layout.time not in FRAME_NUMBERS:
            stamps = _with_dropped(stamps, _column(place, table, number))
        return layout.checked(stamps, place)
    if number is None or layout.time is None:
        return layout.times(len(table), str(path))
    return layout.checked(_column(place, table, number), place)


def nanoseconds_beside(name: str, header: Collection[str]) -> str | None:
    """Return the column of nanoseconds that belongs to one of whole seconds, such as header.stamp.sec."""
    parts = (re.sub(r"secs?$", part, name) for part in _NANOSECONDS)
    return next((one for one in parts if one in header), None) if name.endswith(("sec", "secs")) else None


def _stamps(place: str, table: pd.DataFrame, name: str) -> Array:
    """A column of times, in the unit that its name states; times of day and dates are counted in s from the first.

    Beside whole seconds, such as header.stamp.sec, a column of nanoseconds counts too.
    """
    if part := nanoseconds_beside(name, table.columns):
        return _column(place, table, name) + 1e-9 * _column(place, table, part)
    stated = re.search(r"[\W_](ms|[uµμ]s|ns|min|h)\W*$", name)
    if pd.api.types.is_numeric_dtype(table[name]):
        times = _column(place, table, name)
        if stated:
            return (times - times[0]) * _SECONDS[stated[1]]
        seconds = in_seconds(times)
        if _IN_SECONDS.search(name) and (seconds[1:] - seconds[:-1] < times[1:] - times[:-1]).any():
            step = float(np.median(np.diff(times)))
            raise DataError(
                f"{place}: frames are {step:.4g} s apart by the column {name!r}, and no flight is seen at such a rate; "
                f"are they in ms? Then call it 'time [ms]' in the file"
            )
        return seconds
    if (clock := _of_clock(place, table[name])) is not None:
        return clock
    stamps = pd.to_datetime(table[name], errors="coerce", format="ISO8601")
    if pd.to_numeric(table[name], errors="coerce").notna().any() or stamps.isna().all():
        return _column(place, table, name)  # numbers, with some text
    if stamps.isna().any():
        row = int(np.argmax(stamps.isna().to_numpy()))
        raise DataError(
            f"{place}: row {row + 1}, column {name}: must be a date with a time, got {table[name].iloc[row]!r}"
        )
    return ((stamps - stamps.iloc[0]) / pd.Timedelta(seconds=1)).to_numpy(dtype=np.float64)


_CLOCK = re.compile(
    r"\s*(?:(?P<h>\d{1,2}):(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,]\d+|:\d{3})?)|(\d{1,3}):(\d{1,2}[.,]\d+))\s*"
)
_DAY, _HOUR = 86400.0, 3600.0  # s


def _of_clock(place: str, cells: pd.Series) -> Array | None:
    """Times of day in s, across midnight or the full hour; None if the first is none.

    They are hh:mm:ss, with .sss or :sss behind it or not, or mm:ss.sss.

    Raises:
        DataError: another one is none.
    """
    parts = [_CLOCK.fullmatch(str(cell)) for cell in cells]
    if not parts or (first := parts[0]) is None:
        return None
    row = next((k for k, part in enumerate(parts) if part is None or bool(part["h"]) != bool(first["h"])), None)
    if row is not None:
        raise DataError(
            f"{place}: row {row + 1}, column {cells.name}: must be a time of day as {cells.iloc[0]!r} is, "
            f"got {cells.iloc[row]!r}"
        )
    numbers = [[float(re.sub("[,:]", ".", one)) for one in part.groups() if one] for part in parts if part]
    seconds = np.array([sum(one * 60**k for k, one in enumerate(reversed(row))) for row in numbers])
    period = _DAY if len(numbers[0]) == 3 else _HOUR
    return seconds - seconds[0] + period * np.cumsum(np.diff(seconds, prepend=seconds[0]) < -period / 2)


_IN_SECONDS = re.compile(r"[\[(]\s*s(?:ec|econds)?\s*[\])]\s*$")
_NANOSECONDS = ("nanosec", "nanosecs", "nsec", "nsecs")


def _with_dropped(stamps: Array, number: Array) -> Array:
    """Time stamps that count rows are those of the frame numbers, where these leave out frames that were dropped."""
    ahead, steps = np.diff(number), np.diff(stamps)
    regular = len(steps) > 1 and (np.abs(steps / np.median(steps) - 1) < 0.5).all()
    if not regular or not (ahead >= 1).all() or (ahead == ahead[0]).all():
        return stamps
    return stamps[0] + (number - number[0]) * float(np.median(steps)) / float(np.median(ahead))


def _check_columns(path: Path, table: pd.DataFrame, layout: Layout) -> None:
    """Refuse a file that lacks columns, before any of its recordings is refused for it."""
    for name, names, few in (("position", layout.position, "two or three"), ("quaternion", layout.quaternion, "four")):
        if len(names) == 1:
            raise DataError(f"{path}: data.columns.{name} must name {few} columns of a table, got {names[0]!r}")
    spatial = layout.position[2:] and layout.position[2] in table.columns
    layout = _with_orientation(table, layout)
    angle = () if layout.angle is None or _no_angle(table, layout) else (layout.angle,)
    measured = not {*layout.quaternion}.isdisjoint(map(str, table.columns)) or not _no_angle(table, layout)
    turned = layout.quaternion if measured else ()
    poses = (*layout.position, *turned) if spatial else (*layout.position[:2], *angle)
    for name in chain.from_iterable(layout.markers) if layout.markers else poses:
        if sensed(name) and not layout.markers:  # of which one may be called ax
            raise DataError(f"{path}: column {name!r} is no position and no angle: {SENSED}")
        if name not in table.columns:
            known = [str(column) for column in table.columns]
            raise DataError(
                f"{path}: has no column {name!r}{suggest(name, known)}; it has {', '.join(known)} "
                "('data.columns={time: t, position: [px, py], angle: phi}' says which are which; angle: null of a ball)"
            )
    if layout.time not in table.columns and (layout.time is None or not {*FRAME_NUMBERS} & {*table.columns}):
        if layout.time is not None and (bare := layout.time.lstrip("#%/! ")) in table.columns:
            raise DataError(
                f"{path}: {layout.time[: -len(bare)]!r} begins a comment, and is no part of a name: write "
                f"data.columns.time={bare}"
            )
        layout.times(0, str(path))


_SENSOR = re.compile(  # words, and units of accelerations, g among them, and of rates
    r"(?:(?:raw|linear|lin|total|absolute|user|uncalibrated|angular)[\W_]*)*"
    r"(?:acc(?![a-z])|accel|gyro|beschleunigung|accélération|aceleraci[oó]n|accelerazione|[agw][xyz](?![a-z]))"
    r"|.*(?:m\s*/\s*s\s*(?:\^|\*\*)?\s*[2²]|m\s*/\s*s\s*/\s*s|m\s*s\^?[-⁻−][2²]|_m_?p?_?s2|[\[(]\s*g\s*[\])]|_g$"
    r"|(?:°|deg|rad|degrees|radians)(?:\s*/\s*|_per_|_)s(?![a-z])|dps\b)",
    re.IGNORECASE,
)
SENSED = (
    "these are accelerations and rates of a sensor on the body; positions and orientation, or velocities before and "
    "after contact, are needed"
)


def sensed(name: str) -> bool:
    """Whether a name is that of a sensor's acceleration or rate, by its words or unit: no position and no angle."""
    return _SENSOR.match(name) is not None


def of_sensor(path: Path) -> bool:
    """Whether the name of a file is that which an app gives the readings of a sensor."""
    return re.fullmatch(r"(?:[a-z]*[\W_]*)(?:accelerometer|acceleration|gyroscope)\w*", path.stem, re.I) is not None


def _with_orientation(table: pd.DataFrame, layout: Layout) -> Layout:
    """The layout with turns or a matrix in place of a quaternion that the table has not."""
    missing = {*layout.quaternion}.isdisjoint(map(str, table.columns))
    other = orientation_columns([*map(str, table.columns)]) if missing else ()
    return replace(layout, quaternion=other) if other else layout


_TURNS = (
    ("roll", "pitch", "yaw"),
    *(tuple(f"{name}{axis}" for axis in "xyz") for name in ("r", "rot", "euler", "angle")),
)
_ADJACENT = 0.1  # share of frames with a pose that follow each other, up to which others' rows are between them
_ENTRY = re.compile(r"(?:r|m|rot|mat|rotation|matrix)(\d)(\d?)")
_UNTURNED = (1.0, 0.0, 0.0, 0.0)  # of a ball, nobody measured its turns: see `_no_angle`
_DEGREES = 2 * np.pi + 0.1  # of a turn, above which it is in degrees


def orientation_columns(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of turns about x, y and z, or of a matrix row by row, by their names; none without them."""
    bare = {re.sub(r"[\W_]+", "", re.sub(r"[\[(](?!\d)[^\])]*[\])]\s*$", "", name)).lower(): name for name in header}
    bare = {re.sub(r"(?:deg|degrees|rad)$", "", word): name for word, name in bare.items()}
    for names in _TURNS:
        if {*names} <= {*bare}:
            return tuple(bare[name] for name in names)
    vector = {match[1]: name for word, name in bare.items() if (match := re.fullmatch(f"{VECTOR}([xyz012])", word))}
    if len(vector) == 3:
        return tuple(vector[key] for key in sorted(vector))
    entries = sorted((match.groups(), name) for word, name in bare.items() if (match := _ENTRY.fullmatch(word)))
    return tuple(name for _, name in entries) if len(entries) == 9 else ()


def _orientations(place: str, table: pd.DataFrame, names: Sequence[str]) -> Array:
    """Quaternions, matrices, or turns in rad; in degrees where a name says so, or one is above a whole turn."""
    values = _columns(place, table, names)
    if len(names) != 3:
        return values
    degrees = any(re.search(r"deg|°", name) for name in names) or np.nanmax(np.abs(values), initial=0.0) > _DEGREES
    return np.radians(values) if degrees else values


def _no_angle(table: pd.DataFrame, layout: Layout) -> bool:
    """Whether no column is the angle, or is left that may be it."""
    known = {layout.time, layout.recording, *layout.position, *FRAME_NUMBERS}
    return layout.angle is None or {*table.columns} <= known


def _columns(place: str, table: pd.DataFrame, names: Sequence[str]) -> Array:
    return np.stack([_column(place, table, name) for name in names], 1)


def _column(place: str, table: pd.DataFrame, name: str) -> Array:
    """A column as numbers, not a number where it is empty."""
    try:
        numbers = table[name].to_numpy(dtype=np.float64, na_value=np.nan)
        return np.where((np.abs(numbers) < _LOST) | np.isinf(numbers), numbers, np.nan)
    except (TypeError, ValueError):
        cells = pd.to_numeric(table[name], errors="coerce")
        row = int(np.argmax((cells.isna() & table[name].notna()).to_numpy()))
        raise DataError(
            f"{place}: row {row + 1}, column {name}: must be a number, got {table[name].iloc[row]!r}"
        ) from None
