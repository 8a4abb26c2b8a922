"""Impacts from a table, a row a trial, and to a CSV or Parquet file.

    mass, inertia                    kg, kg m²       about the centre of mass; or one number for all, an argument each;
                                                     inertia is optional for a known shape
    rx, ry                           m               contact point minus centre of mass; optional for a known shape
    x, y, theta                      m, m, rad       pose before contact
    vx, vy, omega                    m/s, m/s, rad/s before contact
    vx_post, vy_post, omega_post     m/s, m/s, rad/s after contact
    trial, object                    optional        names; by default 1, 2, 3 … and "body"
    x_post, y_post, theta_post       optional        pose after contact: all three or none
    time                             optional, s     time of contact
    cov_vx_vx, cov_vx_vy …           optional        covariance of the errors of vx, vy, omega, its upper half: six or
    cov_vx_vx_post …                                 none; and of vx_post, vy_post, omega_post
    apparatus_gravity, …_error       optional        estimates of the apparatus (`mechanics.apparatus`), each with its
    apparatus_slope, … _error …                      standard error: m/s², 1/s, rad, rad, s; in every row the same
    order                            optional        place in the sequence of measurements; by default 1, 2, 3 …
    covariate_temperature …          optional        further quantities of each trial, numbers or names of groups;
                                                     `covariates` says which columns with other names are that

World axes: x right, y up (the floor's normal), theta counter-clockwise.  Columns come in any order.  Names that say the
same in other words, with units, are understood ("vx' [mm/s]", see `names`); others are mapped (`columns`), other units
and clockwise rotations are stated (`units`), and other columns are not used.  Text may have any separator and decimal
mark (`dialect`), spreadsheets are read as they are, and so is a DataFrame; `Table.read_as` says what was understood.
A cell is a number or a name, never code.  The body's shape is not a column but an argument, with lengths in m, or a
shape for each name in the column object.  `load` reads what `save` writes without any loss.  A small table is read into
memory; a large one of text or Parquet is read in blocks of rows, once for every pass.
"""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownLayoutError
from contactlearn.core.numerics import atomic_write, finite_number
from contactlearn.data.array_files import HDF5
from contactlearn.data.blocks import BLOCK, LARGE, Blocks
from contactlearn.data.packed import UNREAD, exists, for_library, only_file, opened_bytes
from contactlearn.data.table import files
from contactlearn.data.table.columns import (
    COLUMNS,
    COMPUTED,
    REQUIRED,
    NamedColumns,
    apparatus_of,
    chains_in,
    checked_names,
    columns_of,
    covariate_columns,
    name_columns,
)
from contactlearn.data.table.descriptions import by_settings, phase_column, restated
from contactlearn.data.table.mapped import with_made_columns
from contactlearn.data.table.names import NAMES, name_words
from contactlearn.data.table.options import TableOptions
from contactlearn.data.table.probable import probable_columns
from contactlearn.data.table.reshaped import is_long, repeats_in
from contactlearn.data.table.rows import filled_down, is_merged
from contactlearn.data.table.several import runs_below, runs_in
from contactlearn.data.table.sheet import Sheet
from contactlearn.data.table.units import STATED, Units
from contactlearn.mechanics.bodies import (
    AnyShape,
    Shapes,
    body_codes,
    check_body_names,
    contact_points,
    make_shapes,
    per_body,
    principal_moments,
    shapes_among,
)
from contactlearn.mechanics.impacts import COVARIATE, Impacts
from contactlearn.mechanics.shapes import Shape, require_dimension
from contactlearn.mechanics.space import PLANE, SPACE, Space

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "COLUMNS", "NAMES", "REQUIRED", "SUFFIXES", "Impacts", "Table", "blocks_of", "check_suffix", "is_large", "load",
    "preview", "read", "read_blocks", "save", "table_blocks", "write_frames",
]  # fmt: skip

_PREVIEWED = 1000  # rows, of which two rows an impact and the scalar of a quaternion are seen
_MAX_GROUPS = 12  # of names in a covariate, that may be more than half of the rows
_SAME = 1e-6  # relative difference of a number in a setting and in a column, up to which they say the same
_TURNED = 8 * math.pi  # |θ| in rad, in the median, above which it is taken to be in degrees: four turns
_JSON, _ARRAYS = (".json", ".jsonl", ".ndjson"), (".mat", ".npz", *HDF5)
DELIMITED = (".csv", ".tsv", ".txt", ".dat", ".asc", ".prn", ".tab", ".lvm")
_READERS = {
    **dict.fromkeys((*DELIMITED, ".tex", ".md", ".html", ".htm"), files.read_text),
    **dict.fromkeys((".sqlite", ".sqlite3", ".db"), files.read_database),
    **dict.fromkeys((".xlsx", ".ods"), files.read_spreadsheet),
    ".parquet": files.read_parquet,
    **dict.fromkeys(_JSON, files.read_json),
    **dict.fromkeys(_ARRAYS, files.read_arrays),
}
_WRITERS = {".csv": files.write_csv, ".parquet": files.write_parquet}
READ = tuple(_READERS)
"""Suffixes of all files that can be read."""
SUFFIXES = tuple(suffix for suffix in _READERS if suffix not in _ARRAYS)
"""Of the files that are tables first, of those that can be read."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """The content of a table file.

    Args:
        impacts: the measurements.
        unused: the file's columns that are not used.
        computed: what the file lacks and the body's shape gives: `inertia`, `r` and `height`, and `place`, which is 0.
        read_as: how the file was understood, in words; nothing for one as `save` writes it.
    """

    impacts: Impacts
    unused: tuple[str, ...]
    computed: tuple[str, ...]
    read_as: tuple[str, ...] = ()


def load(
    path: "str | os.PathLike[str] | DataFrame",
    shape: Mapping[str, Any] | Shape | None = None,
    columns: Mapping[str, str | Mapping[str, Any] | None] | None = None,
    units: Mapping[str, str | None] = STATED,
    mass: float | None = None,
    inertia: float | Sequence[float] | None = None,
    covariates: Sequence[str] = (),
    *,
    validate: bool = True,
    drop_incomplete: bool = False,
) -> Impacts:
    """Impacts from a table: a file, or a DataFrame with the same columns.

    Args:
        path: a file of one of `SUFFIXES`, or a DataFrame, with the columns of the module's table.
        shape: of all bodies, such as `shapes.Ellipse((0.035, 0.025))`, or of each by its name; lengths in m.
        columns: names in the table by ours, such as {"vx": "speed_x"}; None where it has no such column.  In place of a
            name {"column": "U", "unit": "km/h", "factor": -1}, or {"value": 0.5} for all rows.
        units: of length, mass, angle and time, and the sense of rotation; those left out are as in the names of
            columns, such as "vx [mm/s]", or SI.
        mass: of all bodies in kg, for a table without that column.
        inertia: of all bodies in kg m², for a table without that column; in space one or three along the body's axes.
        covariates: columns of quantities that outcomes may depend on, such as temperature or operator.
        validate: False reads also trials that do not approach the floor, for `audit` and `correct`.
        drop_incomplete: leave out rows in which a number is missing.

    Raises:
        DataError: naming the rule, the row, the column, the value as written and a fix.
        UnknownNameError: a shape, column, quantity or unit that does not exist.
    """
    table = read(
        path, shape=shape, columns=columns, units=units, mass=mass, inertia=inertia, covariates=covariates,
        validate=validate, drop_incomplete=drop_incomplete,
    )  # fmt: skip
    return table.impacts


Impacts.from_frame = staticmethod(load)


def read(
    path: "str | os.PathLike[str] | DataFrame",
    *,
    shape: Mapping[str, Any] | Shape | None = None,
    columns: Mapping[str, str | Mapping[str, Any] | None] | None = None,
    units: Mapping[str, str | None] = STATED,
    mass: float | None = None,
    inertia: float | Sequence[float] | None = None,
    covariates: Sequence[str] = (),
    validate: bool = True,
    drop_incomplete: bool = False,
) -> Table:
    """Impacts from the table `path`, with the use of its columns.

    Args:
        path: a file of one of `SUFFIXES`, or a DataFrame, with the columns of the module's table.
        shape: of all bodies or of each by its name in the column object, for `bodies.make_shapes`, or None where it is
            not known; lengths in m.  Names of bodies that the table has none of are refused, but not of `Shapes`, which
            may be those of a larger table.
        columns: names in the file by those of the module's table, such as {"vx": "speed_x"}; None where the file has
            no such column.
        units: of length, mass, angle and time, and the sense of rotation, see `units.UNIT_FACTORS`; those left out are
            as in names of columns, or SI.  A unit in the name of a column goes first.
        mass: of all bodies in kg, for a table without that column.
        inertia: of all bodies in kg m², for a table without that column; in space one or three along the body's axes.
        covariates: columns of quantities that outcomes may depend on, numbers or names of groups; a unit at the end of
            a column's name may be left out.
        validate: False reads also trials that do not approach the floor, for the audit and for corrections.
        drop_incomplete: leave out rows that are cut short, with an empty cell or one that is no finite number; named in
            `Impacts.incomplete`; trials without names or order keep the number of their row.

    Raises:
        DataError: the file cannot be read, or breaks a rule; it names the row (counted from 1
            without the header), the line of a CSV file, the file's column, the value as written and a fix.
        UnknownNameError: a shape, column, quantity or unit that does not exist.
    """
    (table,) = read_blocks(
        path, None, shape=shape, columns=columns, units=units, mass=mass, inertia=inertia, covariates=covariates,
        validate=validate, drop_incomplete=drop_incomplete,
    )  # fmt: skip
    return table


def read_blocks(
    path: "str | os.PathLike[str] | DataFrame",
    rows: int | None,
    *,
    drop_incomplete: bool = False,
    validate: bool = True,
    mass: float | None = None,
    inertia: float | Sequence[float] | None = None,
    covariates: Sequence[str] = (),
    units: Mapping[str, str | None] = STATED,
    columns: Mapping[str, str | Mapping[str, Any] | None] | None = None,
    shape: Mapping[str, Any] | Shape | None = None,
) -> Iterator[Table]:
    """Impacts from the table file `path`, `rows` at a time, so that the file need not fit in memory.

    Names are unique in each block alone.  The other arguments and the errors are those of `read`; with rows=None there
    is one block.
    """
    known_shape, known_units, body = make_shapes(shape), Units(units), _stated(mass, inertia)
    read, left, bodies, numeric = 0, False, dict[str, None](), dict[str, bool]()
    for cells in _sheets(path, rows, gaps=drop_incomplete):
        own = covariate_columns(cells, covariates)
        cells, mapped = with_made_columns(cells, columns, gaps=drop_incomplete)
        cells, mapped = by_settings(cells, {**mapped, **own})
        options = TableOptions(units=known_units, columns=mapped, shape=known_shape, body=body, gaps=drop_incomplete)
        cells = restated(cells.measured(own.values()), options)
        try:
            named = name_columns(cells, options)
        except UnknownLayoutError as error:
            page = probable_columns(Path(cells.path), cells, source="table")
            raise UnknownLayoutError(f"{error}; its columns are\n{page}") from None
        if isinstance(known_shape, Mapping):
            bodies |= dict.fromkeys(_body_names(named.cells, known_shape))
        kept, values = _complete(named.cells) if drop_incomplete else (named.cells, _numbered(named.cells))
        read += len(cells)
        if len(kept):
            left = True
            if named.space is PLANE and "inertia" in body and body["inertia"].ndim:
                raise DataError(f"{_source(path)}: data.inertia is one number in a plane; three are of a body in space")
            _refuse_other(kept, body, named)
            values |= {name: x.expand(len(kept), *x.shape) for name, x in body.items()}
            values["covariates"] = _covariates(kept, numeric)
            impacts = _impacts(kept, values, named, known_shape, validate=validate)
            yield Table(impacts=impacts, unused=named.unused, computed=named.computed, read_as=_read_as(named))
    source = _source(path)
    if not left:
        raise DataError(f"{source}: each of {read} rows has an empty cell, or one that is not a number")
    if isinstance(known_shape, Mapping) and not isinstance(shape, Shapes):
        check_body_names(known_shape, bodies, source)


def _stated(mass: float | None, inertia: float | Sequence[float] | None) -> dict[str, Tensor]:
    """What the settings state of every body."""
    found = dict[str, Tensor]()
    if mass is not None:
        found["mass"] = torch.tensor(finite_number("data.mass", mass, 0, above=True), dtype=torch.float64)
    if isinstance(inertia, Sequence) and not isinstance(inertia, str):
        found["inertia"] = principal_moments(inertia)
    elif inertia is not None:
        found["inertia"] = torch.tensor(finite_number("data.inertia", inertia, 0, above=True), dtype=torch.float64)
    return found


def _refuse_other(cells: Sheet, stated: Mapping[str, Tensor], named: NamedColumns) -> None:
    """Refuse a setting that states another number than the columns have, which may state it too."""
    for name, value in stated.items():
        parts = named.space.components[name]
        columns = [column for column in dict.fromkeys((name, *parts)) if column in cells.columns]
        numbers = dict(zip(parts, value.reshape(-1).expand(len(parts)).tolist(), strict=True))
        for column, number in product(columns, dict.fromkeys(numbers.values())):
            if numbers.get(column, number) != number:
                continue
            there = _numbers(cells, column, named.units)
            other = ((there / number - 1).abs() > _SAME).nonzero()
            if len(other):
                row, written = int(other[0, 0]), cells.written.get(column, column)
                raise DataError(
                    f"{cells.path}: data.{name}={number:.6g}, but the column {written!r} has {there[row]:.6g} in row "
                    f"{cells.first + row + 1}; leave that setting out, or ignore what the table has by "
                    f"'data.columns={{{': null, '.join(columns)}: null}}'"
                )


def _source(path: "str | os.PathLike[str] | DataFrame") -> str:
    """The table's name in errors."""
    return str(path) if isinstance(path, str | os.PathLike) else type(path).__name__


def _read_as(named: NamedColumns) -> tuple[str, ...]:
    """How a table was understood, with the columns that have other names than ours and their units."""
    renamed = {column: name for column, name in named.cells.written.items() if name != column}
    ours = {column: column.replace(COVARIATE, "covariate ") for column in renamed}
    words = (f"{ours[column]} is {name!r} in {named.units.text(column)}" for column, name in renamed.items())
    sense = "clockwise" if named.units.factor("theta") < 0 else "counter-clockwise"
    senses = (
        f", positive {sense}" if {"topspin", "backspin"} & {*name_words(name)} else "" for name in renamed.values()
    )
    said = (word.removesuffix(" in ") + sense for word, sense in zip(words, senses, strict=True))
    return (*named.cells.read_as, *said)


def raw_cells(path: Path) -> Sheet:
    """Return all rows of a table file as raw cells, under its own names.

    Raises:
        DataError: see `read`.
    """
    return next(_sheets(path, None))


def preview(path: Path, columns: Mapping[str, Any] | None = None) -> Sheet:
    """Return the first rows of a table file as raw cells, a row an impact, under its own names.

    What only the body's shape can tell, or a setting, is left open.

    Args:
        path: the table.
        columns: names in the table by ours, as in `read`; these columns are under our names.

    Raises:
        DataError: see `read`.
        UnknownNameError: a column that does not exist.
    """
    cells, mapped = by_settings(*with_made_columns(next(_sheets(path, _PREVIEWED, gaps=True)), columns, gaps=True))
    cells = restated(cells, TableOptions(units=Units(STATED), columns=mapped, asked=False, gaps=True))
    names = checked_names(cells, mapped, [*columns_of(PLANE), *columns_of(SPACE)])
    return cells.renamed({name: column for column, name in names.items() if name is not None})


def _body_names(cells: Sheet, shapes: Mapping[str, Shape]) -> Sequence[str]:
    """The names of the bodies of a table that has shapes by name."""
    if "object" not in cells.columns:
        raise DataError(
            f"{cells.path}: data.shape has shapes of {', '.join(shapes)}, but the table has no column object with "
            "such names; 'data.columns={object: …}' says which column it is"
        )
    return cells.names("object")


def _sheets(path: "str | os.PathLike[str] | DataFrame", rows: int | None, *, gaps: bool = False) -> Iterator[Sheet]:
    """The cells of a table, under its own names, `rows` at a time; two rows an impact are never parted.

    With `gaps` rows of text may be cut short, see `read_text`.
    """
    if not isinstance(path, str | os.PathLike):
        yield _filled(files.sheet_of(path))
        return
    path = only_file(Path(path), _READERS, "table")
    if path.is_dir():
        raise DataError(f"{path}: is a directory; give the path of a table, such as a .csv file")
    reader = _READERS[_suffix(path, _READERS)]
    if reader is files.read_text:
        reader = partial(files.read_text, gaps=gaps)
    if not exists(path):
        raise DataError(f"{path}: no such file; check the path (relative to {Path.cwd()})")
    try:
        for cells in reader(path, rows):
            if rows is not None and not cells.first and _is_of_several_rows(cells):
                yield from map(_filled, reader(path, None))
                return
            if len(cells) or not cells.first:
                yield _filled(cells)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def _is_of_several_rows(cells: Sheet) -> bool:
    """Whether what an impact is stands in several rows of a table, which is then read as a whole."""
    several = (
        phase_column(cells)
        or is_long(cells)
        or any(chains_in(cells.header).values())
        or repeats_in(cells.header)
        or runs_in(cells.header)
    )
    return bool(several) or any(is_merged(name, column) for name, column in cells.columns.items())


def _filled(cells: Sheet) -> Sheet:
    if not len(cells):
        raise DataError(f"{cells.path}: has a header but no impacts; at least one row is needed")
    return filled_down(runs_below(cells))


def _impacts(
    cells: Sheet, values: dict[str, Any], named: NamedColumns, shape: AnyShape | None, *, validate: bool
) -> Impacts:
    """Build impacts from the rows of a named table that are complete, and the values that are known already."""
    space, units = named.space, named.units
    values |= {name: cells.names(name) for name in NAMES if name in cells.columns}
    if space is SPACE and units.factor("theta") < 0:
        raise DataError(
            f"{cells.path}: data.units.rotation is of a plane; in space turn the axes into right-handed ones"
        )
    absent = [name for field in named.computed if field not in ("inertia", "r") for name in COMPUTED[space][field]]
    for field, names in space.components.items():
        names = ("inertia",) if field == "inertia" and "inertia" in cells.columns else names
        if names[-1] in (*cells.header, *absent):
            zeros = torch.zeros(len(cells), dtype=torch.float64)
            stacked = torch.stack([zeros if name in absent else _numbers(cells, name, units) for name in names], -1)
            values[field] = stacked[:, 0] if len(names) == 1 else stacked
    values |= {
        field: _covariance(cells, space, names, units)
        for field, names in space.covariances.items()
        if names[0] in cells.columns
    }
    if shape is not None:
        values |= _computed(cells.path, named.computed, shape, values)
    if "height" in named.computed:
        values["q"][:, space.d - 1] = -values["r"][:, space.d - 1]
    if "spin" in named.computed:
        P = values["mass"][:, None] * (values["v_post"] - values["v_pre"])[:, :2]
        values["v_post"][:, 2] = (values["r"][:, 0] * P[:, 1] - values["r"][:, 1] * P[:, 0]) / values["inertia"]
    source, apparatus = str(cells.path), apparatus_of(cells)
    try:
        return Impacts(**values, shape=shape, source=source, validate=validate, apparatus=apparatus)
    except DataError as error:
        if error.row is None:
            raise
        place = cells.place(error.row, error.column)
        below = error.shifted_by(cells.first)
        raise DataError(f"{below}{place}", row=below.row) from None


def _covariates(cells: Sheet, numeric: dict[str, bool]) -> dict[str, Tensor | tuple[str, ...]]:
    """The covariates of a named table; `numeric` remembers over blocks which of them are numbers."""
    found: dict[str, Tensor | tuple[str, ...]] = {}
    for column in (column for column in cells.columns if column.startswith(COVARIATE)):
        if numeric.setdefault(column, cells.is_numeric(column)):
            found[column.removeprefix(COVARIATE)] = torch.from_numpy(cells.numbers(column, "its unit"))
        else:
            names = found[column.removeprefix(COVARIATE)] = cells.names(column)
            if len({*names}) > max(_MAX_GROUPS, len(names) / 2):
                name = cells.written.get(column, column)
                raise DataError(
                    f"{cells.path}: data.covariates: the column {name!r} has {len({*names})} names in {len(names)} "
                    f"rows, such as {names[0]!r}, and groups need several rows each; of numbers, write nothing else "
                    "into the cells, and their unit into the column's name"
                )
    return found


def _numbered(cells: Sheet) -> dict[str, Any]:
    """Names and order of the rows by their numbers, for a table without such columns."""
    rows = range(cells.first + 1, cells.first + len(cells) + 1)
    values = {} if "trial" in cells.columns else {"trial": tuple(map(str, rows))}
    return values if "order" in cells.columns else values | {"order": torch.tensor(rows, dtype=torch.float64)}


def _numbers(cells: Sheet, column: str, units: Units) -> Tensor:
    """The numbers [N] of a column in SI."""
    return torch.from_numpy(cells.numbers(column, units.text(column), units.factor(column)))


def _covariance(cells: Sheet, space: Space, columns: Sequence[str], units: Units) -> Tensor:
    """The covariances [N, D, D] of their upper halves."""
    halves = [_numbers(cells, column, units) for column in columns]
    whole = torch.zeros(len(halves[0]), space.D, space.D, dtype=torch.float64)
    for i, j, values in zip(*space.upper, halves, strict=True):
        whole[:, i, j] = whole[:, j, i] = values
    return whole


def _computed(
    path: Path | str, computed: Sequence[str], shape: AnyShape, values: Mapping[str, Any]
) -> dict[str, Tensor]:
    """The fields that the shape of each body gives: where it touches the floor, and its inertia at uniform density."""
    found: dict[str, Tensor] = {}
    body = body_codes(values["object"]) if isinstance(shape, Mapping) else None
    planar = values["q"].shape[1] == 3
    for one in shapes_among(shape).values():
        require_dimension(str(path), one, PLANE if planar else SPACE)
    if "r" in computed:
        theta = values["q"][:, 2] if planar else values["q"][:, 3:]
        if planar and (turned := theta.abs().median().item()) > _TURNED:
            raise DataError(
                f"{path}: rx, ry are computed from theta, which is {turned:.3g} rad in the median: "
                "is it in degrees? say data.units.angle=deg, otherwise take whole turns off"
            )
        found["r"] = contact_points(shape, body, theta)
    if "inertia" in computed:
        mass = values["mass"][:, None]
        found["inertia"] = per_body(shape, body, lambda one: mass * one.gyration_squared()).squeeze(-1)
    return found


def _complete(cells: Sheet) -> tuple[Sheet, dict[str, Any]]:
    """The rows in which no number is missing, with their numbers for names and order, and the names of the others."""
    values = _numbered(cells)
    names = values.get("trial") or cells.names("trial")
    bad = cells.missing([column for column in cells.columns if column not in NAMES])
    left = sorted({*range(1, len(cells) + 1)} - {*bad})
    values = {name: value[[row - 1 for row in left]] for name, value in values.items() if name == "order"}
    values |= {"trial": tuple(names[row - 1] for row in left), "incomplete": tuple(names[row - 1] for row in bad)}
    return cells.without(bad), values


def save(impacts: Impacts | Iterable[Impacts], path: str | os.PathLike[str]) -> Path:
    """Write impacts to a .csv or .parquet file that `load` reads back exactly; the shape is not saved.

    The file appears whole or not at all.  Impacts in blocks of the same fields are written block by block.

    Raises:
        DataError: another suffix, or the file cannot be written.
    """
    blocks = [impacts] if isinstance(impacts, Impacts) else impacts
    return write_frames((block.to_frame() for block in blocks), path)


def write_frames(frames: Iterable["DataFrame"], path: str | os.PathLike[str]) -> Path:
    """Write frames of the same columns, one below the other, to a .csv or .parquet file, whole or not at all.

    Raises:
        DataError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    write = _WRITERS[_suffix(path, _WRITERS)]
    try:
        with atomic_write(path) as part:
            write(frames, part)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error}") from error
    return path


def check_suffix(path: Path, suffixes: Iterable[str] = tuple(_WRITERS)) -> None:
    """Refuse a file to write that is no table, or one to read with suffixes=SUFFIXES, before any work is done for it.

    Raises:
        DataError: another suffix.
    """
    _suffix(path, suffixes)


def _suffix(path: Path, suffixes: Iterable[str]) -> str:
    suffix = path.suffix.lower()
    if suffix in UNREAD:
        raise DataError(f"{path}: is compressed; unpack it first, and give the file that comes out")
    if suffix not in suffixes:
        raise DataError(f"{path}: a table is a {' or '.join(suffixes)} file, got suffix {suffix!r}; export it as CSV")
    return suffix


def table_blocks(path: Path, shape: AnyShape | None) -> Blocks:
    """Return the impacts of a table file as `save` writes it.

    Raises:
        DataError: see `read`.
    """
    if not is_large(path):
        return Blocks.of(load(path, shape))
    return Blocks.survey(lambda: blocks_of(read_blocks(path, BLOCK, shape=shape), lambda one: one.impacts))


def blocks_of(tables: Iterator[Table], impacts_of: Callable[[Table], Impacts]) -> Iterator[Impacts]:
    """Yield the impacts of a table that is read in blocks; errors name the row of the whole table.

    Args:
        tables: the blocks, for which rows are right already.
        impacts_of: corrects the impacts of a block.

    Raises:
        DataError: impacts that break a rule once corrected.
    """
    trials = 0
    for table in tables:
        try:
            impacts = impacts_of(table)
        except DataError as error:
            raise error.shifted_by(trials) from None
        trials += len(impacts)
        yield impacts


def is_large(path: Path) -> bool:
    """Whether a table file has more than `LARGE` rows; an unreadable file is not large."""
    try:
        path = only_file(path, _READERS, "table")
        if path.suffix.lower() == ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(for_library(path)) as file:
                return file.metadata.num_rows > LARGE
        with opened_bytes(path) as file:
            return sum(1 for _ in islice(file, LARGE + 2)) > LARGE + 1
    except (OSError, ValueError):  # errors of pyarrow and of archives are these
        return False
