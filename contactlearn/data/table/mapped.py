"""Columns that settings make: of another column in a stated unit or sense, or of one number for all rows.

    columns={vx: {column: U_norm, unit: km/h}, vy: {column: V, factor: -1}, theta: {value: 90, unit: deg}}

In a table of impacts each becomes a column with its unit in its name, and the settings map ours to that name; in
recordings (`recordings.readers.columns`) one in SI.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from contactlearn.core.errors import DataError, UnknownNameError, suggest
from contactlearn.core.numerics import finite_number
from contactlearn.data.table.columns import without_unit
from contactlearn.data.table.names import unit_as_written
from contactlearn.data.table.sheet import Cells, Sheet
from contactlearn.data.table.units import UNIT_FACTORS, Units, powers_of

_ENTRIES = ("column", "unit", "factor", "value")
_FORMS = "{column: …, unit: …, factor: …} for a column of the file, or {value: …, unit: …} for one number of all rows"


@dataclass(frozen=True, kw_only=True)
class StatedColumn:
    """A column of the file, or None and one value of all rows, its unit where it is stated, and a factor before it."""

    column: str | None
    value: float
    unit: str
    factor: float


def with_made_columns(cells: Sheet, mapped: Any, *, gaps: bool) -> tuple[Sheet, dict[str, str | None]]:
    """Return the table with the columns that settings make, and settings that map ours to their names.

    Args:
        cells: the table under its own names.
        mapped: by ours, names of columns, or {column: …, unit: …, factor: …}, or {value: …, unit: …}.
        gaps: whether numbers may be missing.

    Raises:
        DataError: no mapping; an entry has neither column nor value or both, no such column, or another unit.
        UnknownNameError: an entry that does not exist.
    """
    if mapped is not None and not isinstance(mapped, Mapping):
        raise DataError(f"data.columns is given as {{vx: speed_x, vy: speed_y}}, our name first, got {mapped!r}")
    mapped = {str(ours): one for ours, one in (mapped or {}).items()}
    entries = {ours: one for ours, one in mapped.items() if isinstance(one, Mapping)}
    made, names, sources, said = dict[str, Cells](), dict[str, str](), set[str](), list[str]()
    for ours, entry in entries.items():
        one = stated_column(f"{cells.path}: data.columns.{ours}", entry, ours, cells.header)
        if (source := one.column) is None:
            name, column = ours, np.full(len(cells), one.factor * one.value)
            said.append(f"{ours} is {one.factor * one.value:g}{f' {one.unit}' * bool(one.unit)} in every row")
        else:
            sources.add(source)
            bare = without_unit(source)
            own = source[len(bare) :].strip(" []()")
            if one.factor != 1 and own and powers_of(ours) and not unit_as_written(own, ours):
                one = replace(one, unit=Units({}).text(ours))  # by the factor to SI of a unit that is not known
            name, column = bare if one.unit else source, cells.columns[source]
            if one.factor != 1:
                plain = replace(cells.unmarked((), [source]), gaps=gaps)
                column = one.factor * plain.numbers(source, one.unit or "the unit of its column")
                said.append(f"{source!r} times {one.factor:g}")
        name = f"{name} [{one.unit}]" if one.unit else name
        names[ours] = name if name not in made else f"{ours} {name}"
        made[names[ours]] = column
    kept = ((name, column) for name, column in cells.columns.items() if name not in sources and name not in made)
    texts = {ours: None if one is None else str(one) for ours, one in mapped.items()}
    return cells.with_columns([*kept, *made.items()], *said), {**texts, **names}


def stated_column(setting: str, entry: Mapping[str, Any], like: str, header: Sequence[str]) -> StatedColumn:
    """Return what an entry of `data.columns` states of a column.

    Args:
        setting: with the file, for errors.
        entry: {column: …, unit: …, factor: …}, or {value: …, unit: …}.
        like: our column whose units it may have.
        header: names of the file.

    Raises:
        DataError: an entry has neither column nor value or both, no such column, or another unit.
        UnknownNameError: an entry that does not exist.
    """
    for key in entry:
        if key not in _ENTRIES:
            raise UnknownNameError(f"entry of {setting.rpartition(' ')[2]}:", str(key), _ENTRIES)
    if ("column" in entry) == ("value" in entry):
        seen = "both column and value" if "value" in entry else "neither column nor value"
        raise DataError(f"{setting} has {seen}: {_FORMS}")
    unit = entry.get("unit")
    if unit is not None and powers_of(like) and not unit_as_written(str(unit), like):
        choices = "; ".join(f"{quantity} in {', '.join(UNIT_FACTORS[quantity])}" for quantity in powers_of(like))
        raise DataError(f"{setting}.unit={unit} is no unit of {like}; it has {choices}, such as mm/s or rev/min")
    number = {name: finite_number(f"{setting}.{name}", entry.get(name, 1.0), -np.inf) for name in ("factor", "value")}
    name = str(entry["column"]) if "column" in entry else None
    found = [one for one in header if one == name] or [one for one in header if without_unit(one) == name]
    if name is not None and len(found) != 1:
        near, there = suggest(name, header), ", ".join(map(repr, header))
        raise DataError(f"{setting}.column={name}: no such column{near or ';'} it has {there}")
    return StatedColumn(column=found[0] if found else None, unit="" if unit is None else str(unit), **number)
