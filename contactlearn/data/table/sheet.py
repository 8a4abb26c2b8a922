"""A table file as raw cells, which `table` reads, writes and names in its errors.

CSV goes through the standard library's reader, in strict mode: it knows the line of every row,
and neither pads, drops nor guesses.  Parquet goes through pyarrow.  A cell stays text (CSV) or a
plain value (Parquet) until `numbers` or `names` converts it, so that every error can quote it.
Both come in blocks of rows, so that a file need not fit in memory.
"""

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError

if TYPE_CHECKING:
    from pandas import DataFrame

_COMMENT = ("#", "%", "//")
_LEAVE_OUT = "leave the trial out, as data.correct=[drop_incomplete] does"
Cells = list[Any] | np.ndarray
"""One column: raw cells, or the plain numbers of a Parquet column without an empty cell."""


@dataclass(frozen=True)
class Sheet:
    """Header and columns of raw cells: the rows of a file after the `first` ones.

    `lines` are the rows' lines in a CSV file, `written` the file's names of columns by those of the header.
    """

    path: Path
    header: list[str]
    columns: list[Cells]
    lines: list[int] | None = None
    written: Mapping[str, str] = field(default_factory=dict[str, str])
    first: int = 0

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def numbers(self, column: str, unit: str, factor: float = 1.0) -> Float[np.ndarray, " n"]:
        """The column as finite numbers times a factor; DataError names the first cell that is not one, as written."""
        cells = self.columns[self.header.index(column)]
        if (plain := _plain_numbers(cells)) is not None:
            return factor * plain
        values = []
        for row, cell in enumerate(cells):
            try:
                values.append(factor * _number(cell.item() if isinstance(cell, np.generic) else cell))
            except ValueError as error:
                place = f"row {self.first + row + 1}" + (f" (line {self.lines[row]})" if self.lines else "")
                below = "; a row of units below the header? remove it" if self._is_text(row) else ""
                missing = sum(map(_is_missing, cells)) if _is_missing(cell) else 1
                others = f" ({missing} rows of the column are like this one)" if missing > 1 else ""
                rule = f"must be a finite number in {unit}; {error}{below}{others}"
                name = self.written.get(column, column)
                raise DataError(f"{self.path}: {place}, column {name}: {rule}", row=self.first + row + 1) from None
        return np.array(values, float)

    def _is_text(self, row: int) -> bool:
        """Whether a row is the first of the file and has no number, as one of units has none."""
        return self.first + row == 0 and not any(_is_number(cells[row]) for cells in self.columns)

    def place(self, row: int, column: str | None) -> str:
        """Where a row (of the sheet, from 1) is in a CSV file, and the content of one of our columns there."""
        place = "" if self.lines is None else f"; line {self.lines[row - 1]} of the file"
        if column not in self.header:
            return place
        cell = self.columns[self.header.index(column)][row - 1]
        cell = cell.item() if isinstance(cell, np.generic) else cell
        return f"{place}; column {self.written.get(column, column)} has {cell!r} there"

    def missing(self, columns: Sequence[str]) -> list[int]:
        """Rows of the sheet, from 1, in which a number of these columns is missing: empty, or no finite number."""
        bad = np.zeros(len(self), bool)
        for cells in (self.columns[self.header.index(column)] for column in columns):
            if _plain_numbers(cells) is None:
                bad |= np.fromiter(map(_is_missing, cells), bool, len(self))
        return (bad.nonzero()[0] + 1).tolist()

    def without(self, rows: Sequence[int]) -> "Sheet":
        """Return the sheet without some rows of it, counted from 1."""
        dropped = {*rows}
        left = [k for k in range(len(self)) if k + 1 not in dropped]
        lines = None if self.lines is None else [self.lines[k] for k in left]
        columns = [cells[left] if isinstance(cells, np.ndarray) else [cells[k] for k in left] for cells in self.columns]
        return replace(self, columns=columns, lines=lines)

    def names(self, column: str) -> tuple[str, ...]:
        """The column as text, exactly as written."""
        return tuple("" if cell is None else str(cell) for cell in self.columns[self.header.index(column)])


def _plain_numbers(cells: Cells) -> Float[np.ndarray, " n"] | None:
    """The numbers of a column with nothing else in it, as `_number` reads them; None for any other."""
    if isinstance(cells, np.ndarray):
        values = cells.astype(float)
    else:
        try:
            if "_" in "".join(cells):
                return None
            values = np.fromiter(map(float, cells), float, len(cells))
        except (TypeError, ValueError):  # not text, or no number: `_number` knows
            return None
    return values if np.isfinite(values).all() else None


def _is_empty(cell: Any) -> bool:
    return cell is None or (isinstance(cell, str) and not cell.strip())


def _is_missing(cell: Any) -> bool:
    """Whether a cell is empty or reads as not-a-number or infinity; other text is a mistake, and no missing number."""
    try:
        return _is_empty(cell) or (isinstance(cell, str | float | np.floating) and not math.isfinite(float(cell)))
    except ValueError:
        return False


def _is_number(cell: Any) -> bool:
    """Whether a cell is a finite number, be it with a decimal comma."""
    try:
        plain = cell.replace(",", ".") if isinstance(cell, str) else cell
        return isinstance(cell, np.generic) or math.isfinite(_number(plain))
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


def read_csv(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of a comma-separated UTF-8 file; rows that are blank throughout are passed over.

    Args:
        path: the file.
        rows: in each sheet; None for one sheet of all of them.

    Raises:
        DataError: the file is not CSV, has no header, or rows of another length than that.
    """
    written = _csv_rows(path)
    header = [name.strip() for _, cells in islice(written, 1) for name in cells]
    if not header:
        raise DataError(f"{path}: the file is empty; its first line must name the columns")
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        rule = "columns must be separated by commas, not by semicolons or tabs"
        raise DataError(f"{path}: {rule}; save it as comma-separated CSV with decimal points")
    first = 0
    while (block := [*islice(written, rows)]) or not first:
        for row, (line, cells) in enumerate(block, first + 1):
            if len(cells) != len(header):
                hint = "a decimal comma?" if len(cells) > len(header) else "a missing comma, or a truncated file?"
                for text, name in ((cells[0], "it"), (header[0], "the first line")):
                    hint = f"is {name} a comment? remove it" if text.startswith(_COMMENT) else hint
                seen = f"{len(cells)} cells where the header has {len(header)}; {hint}"
                raise DataError(f"{path}: row {row} (line {line}) has {seen}", row=row)
        columns: list[Cells] = [[cells[i] for _, cells in block] for i in range(len(header))]
        yield Sheet(path, header, columns, [line for line, _ in block], first=first)
        first += len(block)
        if not block:
            return


def _csv_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every row that is not blank."""
    with path.open(newline="", encoding="utf-8-sig") as file:  # -sig: spreadsheets write a byte-order mark
        reader = csv.reader(file, strict=True)
        try:
            yield from ((reader.line_num, cells) for cells in reader if any(map(str.strip, cells)))
        except UnicodeDecodeError:
            raise DataError(f"{path}: must be UTF-8 text; save it as 'CSV UTF-8'") from None
        except csv.Error as error:
            raise DataError(f"{path}: line {reader.line_num} is not CSV: {error}; check its quotes") from None


def read_parquet(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of a Parquet file, in sheets of `rows` or in one; its page checksums are verified where it has them.

    Raises:
        DataError: the file is not Parquet, or damaged.
    """
    from pyarrow import parquet

    first = 0
    try:
        # Not read_table: that one also makes columns out of folder names such as mass=1.  A buffer would keep the file.
        with parquet.ParquetFile(path, page_checksum_verification=True, pre_buffer=False) as file:
            whole = rows is None or file.metadata.num_rows <= rows
            for block in [file.read()] if whole else file.iter_batches(rows):
                yield Sheet(path, block.schema.names, [_cells(column) for column in block.columns], first=first)
                first += len(block)
    except DataError:
        raise
    except Exception as error:  # a damaged file can break the library anywhere
        raise DataError(f"{path}: is not a readable Parquet file ({error}); write or copy it again") from error


def _cells(column: Any) -> Cells:
    """The cells of an Arrow column."""
    from pyarrow import types

    if (types.is_floating(column.type) or types.is_integer(column.type)) and not column.null_count:
        return column.to_numpy()
    return column.to_pylist()


def of_frame(frame: "DataFrame", path: Path) -> Sheet:
    """The cells of a DataFrame; a named index is a column, too.

    Raises:
        DataError: something else than a DataFrame, or one without rows.
    """
    from pandas import DataFrame  # takes long to load

    if not isinstance(frame, DataFrame):
        raise DataError(f"a table is the path of a .csv or .parquet file, or a DataFrame; got {type(frame).__name__}")
    if not len(frame):
        raise DataError("DataFrame: has no rows; at least one is needed")
    named = frame.reset_index() if all(frame.index.names) else frame
    columns: list[Cells] = []
    for _, values in named.items():
        plain = values.dtype.kind in "fiu" and not values.hasnans
        columns.append(values.to_numpy() if plain else values.astype(object).where(values.notna(), None).tolist())
    return Sheet(path, [str(name) for name in named.columns], columns)


Columns = Mapping[str, Sequence[Any] | np.ndarray]


def write_csv(blocks: Iterable[Columns], path: Path) -> None:
    """Write a new CSV file of blocks of rows; a float is written as its repr, which reads back exactly."""
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for place, columns in enumerate(blocks):
            if not place:
                writer.writerow(columns)
            plain = [cells.tolist() if isinstance(cells, np.ndarray) else cells for cells in columns.values()]
            writer.writerows(zip(*plain, strict=True))


def write_parquet(blocks: Iterable[Columns], path: Path) -> None:
    """Write a Parquet file of blocks of rows, with page checksums; there is at least one block."""
    import pyarrow
    from pyarrow import parquet

    tables = (pyarrow.table(dict(columns)) for columns in blocks)
    first = next(tables)
    with parquet.ParquetWriter(path, first.schema, write_page_checksum=True) as file:
        for block in chain((first,), tables):
            file.write_table(block)
