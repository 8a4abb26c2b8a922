"""A table file as raw cells: what `table` reads, writes and names in its errors.

CSV goes through the standard library's reader, in strict mode: it knows the line of every row,
and neither pads, drops nor guesses.  Parquet goes through pyarrow.  A cell stays text (CSV) or a
plain value (Parquet) until `numbers` or `names` asks for it, so that every error can name it.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from contactlearn.errors import DataError

_LEAVE_OUT = "leave the trial out, as data.correct=[drop_incomplete] does"


@dataclass(frozen=True)
class Sheet:
    """Header and columns of raw cells.

    `lines` are the rows' lines in a CSV file, `written` the file's names of columns by those of the header.
    """

    path: Path
    header: list[str]
    columns: list[list[Any]]
    lines: list[int] | None = None
    written: Mapping[str, str] = field(default_factory=dict[str, str])

    def numbers(self, column: str, unit: str, factor: float = 1.0) -> list[float]:
        """The column as finite numbers times a factor; DataError names the first cell that is not one, as written."""
        values = []
        for row, cell in enumerate(self.columns[self.header.index(column)], 1):
            try:
                values.append(factor * _number(cell))
            except ValueError as error:
                place = f"row {row}" + (f" (line {self.lines[row - 1]})" if self.lines else "")
                rule = f"must be a finite number in {unit}; {error}"
                name = self.written.get(column, column)
                raise DataError(f"{self.path}: {place}, column {name}: {rule}", row=row) from None
        return values

    def place(self, row: int, column: str | None) -> str:
        """Where a row (from 1) is in a CSV file, and what is written in one of our columns there."""
        place = "" if self.lines is None else f"; line {self.lines[row - 1]} of the file"
        if column not in self.header:
            return place
        cell = self.columns[self.header.index(column)][row - 1]
        return f"{place}; column {self.written.get(column, column)} has {cell!r} there"

    def missing(self, columns: Sequence[str]) -> list[int]:
        """Rows, counted from 1, in which a number of these columns is missing: an empty cell, or no finite number."""
        cells = [self.columns[self.header.index(column)] for column in columns]
        return [row for row, values in enumerate(zip(*cells, strict=True), 1) if any(map(_is_missing, values))]

    def without(self, rows: Sequence[int]) -> "Sheet":
        """Return the sheet without some rows, counted from 1."""
        left = [k for k in range(len(self.columns[0])) if k + 1 not in {*rows}]
        lines = None if self.lines is None else [self.lines[k] for k in left]
        return replace(self, columns=[[cells[k] for k in left] for cells in self.columns], lines=lines)

    def names(self, column: str) -> tuple[str, ...]:
        """The column as text, exactly as written."""
        return tuple("" if cell is None else str(cell) for cell in self.columns[self.header.index(column)])


def _is_empty(cell: Any) -> bool:
    return cell is None or (isinstance(cell, str) and not cell.strip())


def _is_missing(cell: Any) -> bool:
    """Whether a cell is empty or reads as not-a-number or infinity; other text is a mistake, and no missing number."""
    try:
        return _is_empty(cell) or (isinstance(cell, str | float) and not math.isfinite(float(cell)))
    except ValueError:
        return False


def _number(cell: Any) -> float:
    """The number in a cell; the message of its ValueError ends a sentence."""
    if _is_empty(cell):
        raise ValueError(f"the cell is empty: fill it in or {_LEAVE_OUT}")
    try:
        # float() alone would also take True, "1_000" and other things that are not measurements.
        if isinstance(cell, bool) or not isinstance(cell, str | int | float | Decimal) or "_" in str(cell):
            raise ValueError
        value = float(cell)
    except ValueError:
        hint = ""
        if isinstance(cell, str) and cell.count(",") == 1 and "." not in cell:
            hint = f": a decimal comma? write {cell.strip().replace(',', '.')}"
        raise ValueError(f"got {cell!r}{hint}") from None
    if not math.isfinite(value):
        raise ValueError(f"got {cell}: {_LEAVE_OUT}")
    return value


def read_csv(path: Path) -> Sheet:
    """Cells of a comma-separated UTF-8 file; rows that are blank throughout are passed over."""
    with path.open(newline="", encoding="utf-8-sig") as file:  # -sig: spreadsheets write a byte-order mark
        reader = csv.reader(file, strict=True)
        try:
            rows = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
        except UnicodeDecodeError:
            raise DataError(f"{path}: must be UTF-8 text; save it as 'CSV UTF-8'") from None
        except csv.Error as error:
            raise DataError(f"{path}: line {reader.line_num} is not CSV: {error}; check its quotes") from None
    if not rows:
        raise DataError(f"{path}: the file is empty; its first line must name the columns")
    header = [name.strip() for name in rows[0][1]]
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        rule = "columns must be separated by commas, not by semicolons or tabs"
        raise DataError(f"{path}: {rule}; save it as comma-separated CSV with decimal points")
    for row, (line, cells) in enumerate(rows[1:], 1):
        if len(cells) != len(header):
            hint = "a decimal comma?" if len(cells) > len(header) else "a missing comma, or a truncated file?"
            seen = f"{len(cells)} cells where the header has {len(header)}; {hint}"
            raise DataError(f"{path}: row {row} (line {line}) has {seen}", row=row)
    columns = [[cells[i] for _, cells in rows[1:]] for i in range(len(header))]
    return Sheet(path, header, columns, [line for line, _ in rows[1:]])


def read_parquet(path: Path) -> Sheet:
    """Cells of a Parquet file; its page checksums are verified where it has them."""
    from pyarrow import parquet

    try:
        # Not read_table: that one also makes columns out of folder names such as mass=1.
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            table = file.read()
        return Sheet(path, table.column_names, [column.to_pylist() for column in table.columns])
    except Exception as error:  # a damaged file can break the library anywhere
        raise DataError(f"{path}: is not a readable Parquet file ({error}); write or copy it again") from error


def write_csv(columns: dict[str, list[Any]], path: Path) -> None:
    """Write a new CSV file; a float is written as its repr, which reads back exactly."""
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def write_parquet(columns: dict[str, list[Any]], path: Path) -> None:
    """Write a Parquet file with page checksums."""
    import pyarrow
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(columns), path, write_page_checksum=True)
