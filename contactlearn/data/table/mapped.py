"""Columns that settings make: of another column in a stated unit or sense, or of one number for all rows.

    columns={vx: {column: U_norm, unit: km/h}, vy: {column: V, factor: -1}, theta: {value: 90, unit: deg}}

Each becomes a column of the table, with its unit in its name, and the settings map ours to that name.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from contactlearn.core.errors import DataError, UnknownNameError, suggest
from contactlearn.core.numerics import finite_number
from contactlearn.data.table.columns import without_unit
from contactlearn.data.table.names import unit_as_written
from contactlearn.data.table.sheet import Cells, Sheet
from contactlearn.data.table.units import UNIT_FACTORS, powers_of

_ENTRIES = ("column", "unit", "factor", "value")
_FORMS = "{column: …, unit: …, factor: …} for a column of the file, or {value: …, unit: …} for one number of all rows"


def with_made_columns(cells: Sheet, mapped: Any, *, gaps: bool) -> tuple[Sheet, Any]:
    """Return the table with the columns that settings make, and settings that map ours to their names.

    Args:
        cells: the table under its own names.
        mapped: by ours, names of columns, or {column: …, unit: …, factor: …}, or {value: …, unit: …}.
        gaps: whether numbers may be missing.

    Raises:
        DataError: an entry has neither column nor value or both, no such column, or another unit.
        UnknownNameError: an entry that does not exist.
    """
    if not isinstance(mapped, Mapping):
        return cells, mapped
    entries = {str(ours): one for ours, one in mapped.items() if isinstance(one, Mapping)}
    made, names, sources, said = dict[str, Cells](), dict[str, str](), set[str](), list[str]()
    for ours, entry in entries.items():
        setting = f"{cells.path}: data.columns.{ours}"
        for key in entry:
            if key not in _ENTRIES:
                raise UnknownNameError(f"entry of data.columns.{ours}:", str(key), _ENTRIES)
        if ("column" in entry) == ("value" in entry):
            seen = "both column and value" if "value" in entry else "neither column nor value"
            raise DataError(f"{setting} has {seen}: {_FORMS}")
        unit = _checked_unit(setting, ours, entry.get("unit"))
        factor = finite_number(f"data.columns.{ours}.factor", entry.get("factor", 1.0), -np.inf)
        if "value" in entry:
            number = finite_number(f"data.columns.{ours}.value", entry["value"], -np.inf)
            name, column = ours, np.full(len(cells), factor * number)
            said.append(f"{ours} is {factor * number:g}{f' {unit}' * bool(unit)} in every row")
        else:
            source = _source_column(setting, cells, str(entry["column"]))
            sources.add(source)
            name, column = without_unit(source) if unit else source, cells.columns[cells.header.index(source)]
            if factor != 1:
                plain = replace(cells.unmarked((), [source]), gaps=gaps)
                column = factor * plain.numbers(source, unit or "the unit of its column")
                said.append(f"{source!r} times {factor:g}")
        name = f"{name} [{unit}]" if unit else name
        names[ours] = name if name not in made else f"{ours} {name}"
        made[names[ours]] = column
    kept = [k for k, name in enumerate(cells.header) if name not in sources and name not in made]
    header, columns = [cells.header[k] for k in kept], [cells.columns[k] for k in kept]
    cells = replace(cells, header=[*header, *made], columns=[*columns, *made.values()])
    return replace(cells, read_as=(*cells.read_as, *said)), {**mapped, **names}


def _source_column(setting: str, cells: Sheet, name: str) -> str:
    """The column of a name, or of one with a unit behind it."""
    found = [one for one in cells.header if one == name] or [one for one in cells.header if without_unit(one) == name]
    if len(found) != 1:
        near, there = suggest(name, cells.header), ", ".join(map(repr, cells.header))
        raise DataError(f"{setting}.column={name}: no such column{near or ';'} it has {there}")
    return found[0]


def _checked_unit(setting: str, ours: str, unit: Any) -> str:
    """A unit that the reader knows for one of our columns; empty where none is stated."""
    if unit is not None and powers_of(ours) and not unit_as_written(str(unit), ours):
        choices = "; ".join(f"{quantity} in {', '.join(UNIT_FACTORS[quantity])}" for quantity in powers_of(ours))
        raise DataError(f"{setting}.unit={unit} is no unit of {ours}; it has {choices}, such as mm/s or rev/min")
    return "" if unit is None else str(unit)
