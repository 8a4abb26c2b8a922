"""A table as raw cells, which `table` names in its errors.

A cell stays text, or a plain value of Parquet, a spreadsheet or a DataFrame, until `numbers` or `names` converts it, so
that every error can quote it.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from contactlearn.core.errors import DataError
from contactlearn.data.table.dialect import Numerals, is_missing, is_numeral, is_numeric, with_one_unit, written_in
from contactlearn.data.table.names import name_words
from contactlearn.data.table.units import Units

LEAVE_OUT = "leave the trial out, as data.correct=[drop_incomplete] does, in Python drop_incomplete=True"
"""A way out that ends a message about a missing number or row."""
_MORE_THAN_NUMBERS = re.compile(r"[^\d.,eE+\-\n ]")
Cells = list[Any] | np.ndarray
"""One column: raw cells, or the plain numbers of a Parquet column without an empty cell."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Columns of raw cells by their names: the rows of a file after the `first` ones.

    `lines` are the rows' lines in a text file, `written` the file's names of columns by ours, `repeated` the names of
    all columns where two have the same, of which the sheet has the first, and `read_as` says in words how the file was
    understood.  With `gaps` a missing number is not a number, and no error.
    """

    path: Path | str
    columns: Mapping[str, Cells] = field(default_factory=dict[str, Cells])
    lines: list[int] | None = None
    written: Mapping[str, str] = field(default_factory=dict[str, str])
    first: int = 0
    numerals: Numerals = field(default_factory=Numerals)
    read_as: tuple[str, ...] = ()
    gaps: bool = False
    repeated: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def header(self) -> list[str]:
        """Return the names of the columns, in order."""
        return [*self.columns]

    def with_columns(self, columns: Iterable[tuple[str, Cells]], *said: str) -> "Sheet":
        """Return the sheet with other columns, and words for how it is read; of two of one name with the first."""
        kept, names = dict[str, Cells](), list[str]()
        for name, cells in columns:
            names.append(name)
            kept.setdefault(name, cells)
        repeated = (*self.repeated, *(names if len(kept) < len(names) else ()))
        return replace(self, columns=kept, read_as=(*self.read_as, *said), repeated=repeated)

    def edited(self, changes: Mapping[str, Mapping[str, Cells]], *said: str) -> "Sheet":
        """Return the sheet with some columns in place of others, by the names of these."""
        every = (changes.get(name, {name: cells}) for name, cells in self.columns.items())
        return self.with_columns(chain.from_iterable(one.items() for one in every), *said)

    def renamed(self, names: Mapping[str, str], *said: str) -> "Sheet":
        """Return the sheet with other names of some columns."""
        return self.with_columns(((names.get(name, name), cells) for name, cells in self.columns.items()), *said)

    def gathered(self, rows: Sequence[int]) -> "Sheet":
        """Return some rows of the sheet, counted from 0, in their order."""
        lines = None if self.lines is None else [self.lines[row] for row in rows]
        return replace(self, columns={name: taken(cells, rows) for name, cells in self.columns.items()}, lines=lines)

    def quantity(self, name: str, column: str, units: Units) -> Float[np.ndarray, " n"]:
        """Return the numbers in SI of a column that is our `column`."""
        return self.numbers(name, units.text(column), units.factor(column))

    def numbers(self, column: str, unit: str, factor: float = 1.0) -> Float[np.ndarray, " n"]:
        """The column as finite numbers times a factor; DataError names the first cell that is not one, as written."""
        cells = self.columns[column]
        if (plain := _plain_numbers(cells, self.numerals)) is not None:
            return factor * plain
        values, gaps = list[float](), self._gaps(column) if self.gaps else []
        for row, cell in enumerate(cells):
            if self.gaps and gaps[row]:
                values.append(math.nan)
                continue
            try:
                values.append(factor * _number(cell.item() if isinstance(cell, np.generic) else cell, self.numerals))
            except ValueError as error:
                place = f"row {self.first + row + 1}" + (f" (line {self.lines[row]})" if self.lines else "")
                alike = _is_missing if _is_missing(cell) else self._is_no_number
                missing = sum(map(alike, cells))
                others = f" ({missing} rows of the column are like this one)" if missing > 1 else ""
                rule = f"must be a finite number in {unit}; {error}{others}"
                name = self.written.get(column, column)
                raise DataError(f"{self.path}: {place}, column {name}: {rule}", row=self.first + row + 1) from None
        return np.array(values, float)

    def _is_no_number(self, cell: Any) -> bool:
        try:
            _number(cell.item() if isinstance(cell, np.generic) else cell, self.numerals)
        except ValueError:
            return not _is_missing(cell)
        return False

    def place(self, row: int, column: str | None) -> str:
        """Where a row (of the sheet, from 1) is in a text file, and the content of one of our columns there."""
        place = "" if self.lines is None else f"; line {self.lines[row - 1]} of the file"
        if column is None or column not in self.columns:
            return place
        cell = self.columns[column][row - 1]
        cell = cell.item() if isinstance(cell, np.generic) else cell
        return f"{place}; column {self.written.get(column, column)} has {cell!r} there"

    def missing(self, columns: Sequence[str]) -> list[int]:
        """Rows of the sheet, from 1, in which a number of these columns is missing: empty, or no finite number."""
        bad = np.zeros(len(self), bool)
        for column in columns:
            if _plain_numbers(self.columns[column], self.numerals) is None:
                bad |= self._gaps(column)
        return (bad.nonzero()[0] + 1).tolist()

    def _gaps(self, column: str) -> Bool[np.ndarray, " n"]:
        """Whether each cell of a column lacks a number; text that is none does where most of the others are numbers."""
        cells, numeric = self.columns[column], self.is_numeric(column)
        lacking = (
            _is_missing(cell) or (numeric and not is_numeral(cell) and self._is_no_number(cell)) for cell in cells
        )
        return np.fromiter(lacking, bool, len(self))

    def without(self, rows: Sequence[int]) -> "Sheet":
        """Return the sheet without some rows of it, counted from 1."""
        dropped = {*rows}
        return self.gathered([k for k in range(len(self)) if k + 1 not in dropped])

    def is_numeric(self, column: str) -> bool:
        """Whether at least half of the cells of a column that are not missing are numbers."""
        cells = self.columns[column]
        return _plain_numbers(cells, self.numerals) is not None or is_numeric([*cells])

    def unmarked(self, names: Collection[str], mapped: Collection[str] = ()) -> "Sheet":
        """Return the sheet with plain numbers in columns whose cells have units, errors or marks beside them.

        Args:
            names: of columns of numbers, which are called by the unit in their cells.
            mapped: those that settings name, in whose cells a unit is refused.

        Raises:
            DataError: a column has cells with different units, or with and without, or another than its name says.
        """
        changes, said, bare = dict[str, dict[str, Cells]](), list[str](), dict[str, list[str]]()
        for name, cells in self.columns.items():
            if name not in (*names, *mapped) or not isinstance(cells, list) or not _has_marks(cells):
                continue
            written = [None if is_missing(cell) else written_in(str(cell)) for cell in cells]
            units = dict[str, int]()
            for row, one in enumerate(written):
                if one is not None:
                    units.setdefault(one.unit, row)
            unit = next(filter(None, units), "")
            if len(units) > 1 or (unit and name in mapped):
                rows = " and ".join(f"{one or 'no unit'} in row {self.first + row + 1}" for one, row in units.items())
                raise DataError(
                    f"{self.path}: column {name}: its cells have {rows}: write numbers of one unit, and the unit in "
                    f"the column's name, such as '{name} [{unit}]'"
                )
            beside = dict.fromkeys(one for cell in written if cell is not None for one in cell.beside)
            words = name_words(f"[{unit}]")
            named = name if not unit or name_words(name)[-len(words) :] == words else f"{name} [{unit}]"
            plain = [cell if one is None else one.number for cell, one in zip(cells, written, strict=True)]
            changes[name] = {named: plain}
            if beside:
                bare.setdefault(" and ".join(beside), []).append(name)
            said += [f"{name!r} in {unit}, as its cells say"] if unit else []
        for left_out, (first, *others) in bare.items():
            means = ": rows may be means of trials, which scatter less than single ones" if "±" in left_out else ""
            said.append(f"{first!r}{f' and {len(others)} more columns' if others else ''} without {left_out}{means}")
        return self.edited(changes, *said)

    def measured(self, names: Collection[str]) -> "Sheet":
        """Return the sheet with plain numbers in some columns, if all their cells have one unit, of whatever kind."""
        found = {name: one for name in names if (one := with_one_unit(self.columns[name]))}
        said = (f"{name!r} in {unit}, as its cells say" for name, (_, unit) in found.items())
        return self.edited({name: {name: numbers} for name, (numbers, _) in found.items()}, *said)

    def names(self, column: str) -> tuple[str, ...]:
        """The column as text, exactly as written."""
        return tuple("" if cell is None else str(cell) for cell in self.columns[column])


def taken(cells: Cells, rows: Sequence[int | None]) -> Cells:
    """Return the cells of some rows of a column, which are empty where there is no row."""
    if isinstance(cells, np.ndarray) and None not in rows:
        return cells[np.array(rows, int)]
    return [None if row is None else cells[row] for row in rows]


def _has_marks(cells: Sequence[Any]) -> bool:
    """Whether some cells of a column have more than a number; most columns have none, and are long."""
    try:
        return bool(_MORE_THAN_NUMBERS.search("\n".join(cells))) and any(map(_is_marked, cells))
    except TypeError:  # cells that are no text
        return any(map(_is_marked, cells))


def _is_marked(cell: Any) -> bool:
    """Whether a cell has a number, and more than that."""
    return isinstance(cell, str) and not is_numeral(cell) and not is_missing(cell) and written_in(cell) is not None


def _plain_numbers(cells: Cells, numerals: Numerals) -> Float[np.ndarray, " n"] | None:
    """The numbers of a column with nothing else in it, as `_number` reads them; None for any other."""
    if isinstance(cells, np.ndarray):
        values = cells.astype(float)
    else:
        try:
            text = "\n".join(cells)
            if "_" in text or (numerals.decimal == "," and "." in text):
                return None
            plain = text.replace(",", ".").split("\n") if numerals.decimal == "," else cells
            values = np.fromiter(map(float, plain), float, len(cells))
        except (TypeError, ValueError):  # not text, or no number: `_number` knows
            return None
    return values if len(values) == len(cells) and np.isfinite(values).all() else None


def _is_missing(cell: Any) -> bool:
    """Whether a cell is empty, says so, or reads as not-a-number or infinity; other text is a mistake."""
    try:
        return is_missing(cell) or (isinstance(cell, str | float | np.floating) and not math.isfinite(float(cell)))
    except ValueError:
        return False


def _number(cell: Any, numerals: Numerals) -> float:
    """The number in a cell; the message of its ValueError ends a sentence."""
    if is_missing(cell):
        seen = f"got {cell.strip()}" if isinstance(cell, str) and cell.strip() else "the cell is empty"
        raise ValueError(f"{seen}: fill it in or {LEAVE_OUT}")
    # float() alone would also take True, "1_000" and other things that are not measurements.
    if isinstance(cell, bool) or not isinstance(cell, str | int | float | Decimal) or "_" in str(cell):
        raise ValueError(f"got {cell!r}")
    plain = numerals.plain(cell) if isinstance(cell, str) else cell
    try:
        value = float(plain)
    except ValueError:
        hint = ""
        if isinstance(cell, str) and cell.count(",") == 1 and "." not in cell:
            hint = f": a decimal comma? write {cell.strip().replace(',', '.')}"
        raise ValueError(f"got {cell!r}{hint}") from None
    if not math.isfinite(value):
        raise ValueError(f"got {cell}: {LEAVE_OUT}")
    return value
