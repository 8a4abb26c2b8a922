"""Impacts from and to a table file: CSV (UTF-8, comma, decimal point) or Parquet, a row a trial.

    mass, inertia                    kg, kg m²       about the centre of mass
    rx, ry                           m               contact point minus centre of mass
    x, y, theta                      m, m, rad       pose before contact
    vx, vy, omega                    m/s, m/s, rad/s before contact
    vx_post, vy_post, omega_post     likewise        after contact
    trial, object                    optional        names; by default 1, 2, 3 … and "body"
    x_post, y_post, theta_post       optional        pose after contact: all three or none
    time                             optional, s     time of contact
    cov_vx_vx, cov_vx_vy …           optional        covariance of the errors of vx, vy, omega, its upper half: six or
    cov_vx_vx_post …                                 none; and of vx_post, vy_post, omega_post
    apparatus_gravity, …_error       optional        what is known of the apparatus (`contactlearn.apparatus`) and its
    apparatus_slope, … _error …                      standard error: m/s², 1/s, rad, rad, s; in every row the same
    order                            optional        place in the sequence of measurements; by default 1, 2, 3 …

World axes: x right, y up (the floor's normal), theta counter-clockwise.  Columns come in any order.
A cell is a number or a name, never code.  The body's shape is not a column: it is named beside
the path.  What `save` writes, `load` gives back: every bit of every number, every name as written.
"""

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from contactlearn.data.table import known, sheet
from contactlearn.errors import DataError, suggest
from contactlearn.impacts import COMPONENTS, COVARIANCES, OPTIONAL, UPPER, Impacts
from contactlearn.numerics import written_whole
from contactlearn.shapes import Shape, make_shape

NAMES = ("trial", "object")
COLUMNS = NAMES + tuple(column for columns in (COMPONENTS | COVARIANCES | known.PAIRS).values() for column in columns)
REQUIRED = tuple(column for field, columns in COMPONENTS.items() if field not in OPTIONAL for column in columns)

_UNITS = {
    "mass": "kg",
    "inertia": "kg m²",
    "theta": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "omega": "rad/s",
    "time": "s",
    "order": "trials",
}
_READERS = {".csv": sheet.read_csv, ".parquet": sheet.read_parquet}
_WRITERS = {".csv": sheet.write_csv, ".parquet": sheet.write_parquet}


def load(
    path: str | os.PathLike[str],
    shape: dict[str, Any] | Shape | None = None,
    *,
    suspect: bool = False,
    drop_incomplete: bool = False,
) -> Impacts:
    """Impacts from the table file `path`.

    Args:
        path: a .csv or .parquet file with the columns of the module's table.
        shape: the body's shape for `shapes.make_shape`, or None where it is not known.
        suspect: read also what does not approach the floor, for the audit and for corrections.
        drop_incomplete: leave out rows with an empty cell, or one that is not a finite number, and name them in
            `Impacts.incomplete`; trials without names or order keep the number of their row.

    Raises:
        DataError: the file cannot be read, or breaks a rule; it names the row (counted from 1
            without the header), the line of a CSV file, the column, the value and a fix.
        UnknownNameError: a shape that does not exist.
    """
    path, body = Path(path), make_shape(shape)
    if path.is_dir():
        raise DataError(f"{path}: is a directory; give the path of a .csv or .parquet file")
    read = _READERS[_suffix(path)]
    if not path.exists():
        raise DataError(f"{path}: no such file; check the path (relative to {Path.cwd()})")
    try:
        cells = read(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    _check_header(path, cells.header)
    if not cells.columns[0]:
        raise DataError(f"{path}: has a header but no impacts; at least one row is needed")
    values: dict[str, Any] = {}
    if drop_incomplete:
        cells, values = _complete(path, cells)
    values |= {name: cells.names(name) for name in NAMES if name in cells.header}
    for field, columns in COMPONENTS.items():
        if columns[0] in cells.header:
            numbers = [cells.numbers(column, _UNITS.get(column.removesuffix("_post"), "m")) for column in columns]
            stacked = torch.tensor(numbers, dtype=torch.float64)
            values[field] = stacked[0] if len(columns) == 1 else stacked.T
    values |= {
        field: _covariance(cells, columns) for field, columns in COVARIANCES.items() if columns[0] in cells.header
    }
    try:
        return Impacts(**values, shape=body, source=str(path), suspect=suspect, apparatus=known.apparatus_of(cells))
    except DataError as error:
        if error.row is None or cells.lines is None:
            raise
        raise DataError(f"{error}; line {cells.lines[error.row - 1]} of the file", row=error.row) from None


def _covariance(cells: sheet.Sheet, columns: Sequence[str]) -> Tensor:
    """The covariances [N, 3, 3] of their upper halves."""
    halves = [cells.numbers(column, "products of m/s and rad/s") for column in columns]
    whole = torch.zeros(len(halves[0]), 3, 3, dtype=torch.float64)
    for i, j, values in zip(*UPPER, halves, strict=True):
        whole[:, i, j] = whole[:, j, i] = torch.tensor(values, dtype=torch.float64)
    return whole


def _complete(path: Path, cells: sheet.Sheet) -> tuple[sheet.Sheet, dict[str, Any]]:
    """The rows in which no number is missing, with their numbers for names and order, and the names of the others."""
    rows = range(1, len(cells.columns[0]) + 1)
    names = cells.names("trial") if "trial" in cells.header else tuple(map(str, rows))
    bad = cells.missing([column for column in cells.header if column not in NAMES])
    left = [row for row in rows if row not in {*bad}]
    if not left:
        raise DataError(f"{path}: each of {len(rows)} rows has an empty cell, or one that is not a number")
    values = {"trial": tuple(names[row - 1] for row in left), "order": torch.tensor(left, dtype=torch.float64)}
    return cells.without(bad), values | {"incomplete": tuple(names[row - 1] for row in bad)}


def save(impacts: Impacts, path: str | os.PathLike[str]) -> Path:
    """Write impacts to a .csv or .parquet file that `load` reads back exactly; the shape is not saved.

    The file appears whole or not at all.

    Raises:
        DataError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    write = _WRITERS[_suffix(path)]
    columns: dict[str, list[Any]] = {name: list(getattr(impacts, name)) for name in NAMES}
    for field, names in COMPONENTS.items():
        value = getattr(impacts, field)
        if value is not None:
            columns |= zip(names, value.reshape(len(impacts), -1).T.tolist(), strict=True)
    for field, names in COVARIANCES.items():
        value = getattr(impacts, field)
        if value is not None:
            columns |= zip(names, value[:, *UPPER].T.tolist(), strict=True)
    if impacts.apparatus is not None:
        columns |= known.columns_of(impacts.apparatus, len(impacts))
    try:
        with written_whole(path) as part:
            write(columns, part)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error}") from error
    return path


def check_suffix(path: Path) -> None:
    """Refuse a file that is no table, before any work is done for it.

    Raises:
        DataError: another suffix than .csv or .parquet.
    """
    _suffix(path)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise DataError(f"{path}: a table is a .csv or .parquet file, got suffix {suffix!r}; export it as CSV")
    return suffix


def _check_header(path: Path, header: list[str]) -> None:
    twice = [name for name, count in Counter(header).items() if count > 1]
    if twice:
        raise DataError(f"{path}: column names must be unique; repeated: {', '.join(map(repr, twice))}")
    free = [column for column in COLUMNS if column not in header]
    unknown = [name for name in header if name not in COLUMNS]
    if unknown:
        near = "; ".join(repr(name) + suggest(name, free) for name in unknown)
        index = " (an unnamed index? write the table without it)" if {"", "__index_level_0__"} & set(unknown) else ""
        raise DataError(f"{path}: unknown column {near}{index}; known: {', '.join(COLUMNS)}")
    missing = [column for column in REQUIRED if column not in header]
    if missing:
        raise DataError(f"{path}: missing column {', '.join(missing)}; needed: {', '.join(REQUIRED)}")
    groups = [(COMPONENTS["q_post"], "all three"), *((columns, "all six") for columns in COVARIANCES.values())]
    groups += [(pair, "both") for pair in known.PAIRS.values()]
    if any(column in header for pair in known.PAIRS.values() for column in pair):
        groups.append((known.NEEDED, "all four"))
    for group, count in groups:
        lacking = [column for column in group if column not in header]
        if lacking and (len(lacking) < len(group) or group is known.NEEDED):
            raise DataError(f"{path}: {', '.join(group)} come {count} or none; missing: {', '.join(lacking)}")
