"""What is known of the apparatus as columns of a table: the same numbers in every row.

A column survives whatever is done to a table: a row is dropped, another program saves it, it becomes CSV.
"""

from dataclasses import fields

from contactlearn.core.errors import DataError
from contactlearn.data.table.sheet import Sheet
from contactlearn.mechanics.apparatus import Apparatus, Measured

PAIRS = {field.name: (f"apparatus_{field.name}", f"apparatus_{field.name}_error") for field in fields(Apparatus)}
"""The columns of a value and its standard error, by the field of `Apparatus` that they fill."""
NEEDED = tuple(column for name in ("gravity", "delay") for column in PAIRS[name])
"""Those without which there are none."""
_UNITS = {"gravity": "m/s²", "drag": "1/s", "slope": "rad", "orientation": "rad", "delay": "s"}


def columns_of(known: Apparatus, rows: int) -> dict[str, list[float]]:
    """Return the columns of what is known."""
    pairs = {PAIRS[field.name]: getattr(known, field.name) for field in fields(Apparatus)}
    return {
        name: [value] * rows
        for names, one in pairs.items()
        if one is not None
        for name, value in zip(names, (one.value, one.error), strict=True)
    }


def apparatus_of(cells: Sheet) -> Apparatus | None:
    """Return what a table says of the apparatus, or None.

    Raises:
        DataError: a cell is no number, rows differ, or an error is negative.
    """
    known = {
        field: Measured(value=_one(cells, names[0], _UNITS[field]), error=_one(cells, names[1], _UNITS[field], 0.0))
        for field, names in PAIRS.items()
        if names[0] in cells.header
    }
    return Apparatus(**{field: known.get(field) for field in PAIRS}) if known else None  # pyright: ignore[reportArgumentType]  (`NEEDED`)


def _one(cells: Sheet, column: str, unit: str, least: float = float("-inf")) -> float:
    """The number of a column, the same in every row."""
    values = cells.numbers(column, unit)
    bad = ((values != values[0]) | (values < least)).nonzero()[0]
    if len(bad):
        row, value = cells.first + int(bad[0]) + 1, values[bad[0]]
        rule = f"must be at least {least:g}" if value < least else "must be the same in every row"
        raise DataError(
            f"{cells.path}: row {row}, column {column}: {rule}, got {value:g} after {values[0]:g}; tables of two "
            "apparatus are two tables, or one without these columns",
            row=row,
        )
    return float(values[0])
