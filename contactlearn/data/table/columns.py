"""Columns of a table: their names, their units, and the estimates of the apparatus.

    columns={vx: speed_x}       the file's column speed_x is our vx
    columns={inertia: null}     the file has no inertia, whatever its columns are called

`vx_pre, vy_pre, omega_pre` are read as `vx, vy, omega` where the file lacks these.  An unknown column whose name is
near a missing one is refused as a slip; other unknown columns are not used.  Where the body's shape is known, `rx, ry`
may be left out, and `inertia` as well.

Four units are stated, and the sense in which θ and ω are positive; all others follow: velocities are lengths a time, an
inertia is a mass times a squared length, a covariance is the product of its two velocities.  Rotations that are
positive clockwise are angles with a negative factor.

Estimates of the apparatus are the same numbers in every row, always in SI: a column survives a dropped row, another
program that saves the table, and CSV.
"""

import math
import re
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from itertools import product
from types import MappingProxyType

from contactlearn.core.errors import DataError, UnknownNameError, suggest
from contactlearn.data.table.sheet import Sheet
from contactlearn.mechanics.apparatus import APPLIED, PAIRS, PROPERTIES, Apparatus, Estimate
from contactlearn.mechanics.impacts import OPTIONAL
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space

SI = MappingProxyType({"length": "m", "mass": "kg", "angle": "rad", "time": "s", "rotation": "counterclockwise"})
"""The stated units of a table as `save` writes it."""

UNIT_FACTORS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254},
    "mass": {"kg": 1.0, "g": 1e-3},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "time": {"s": 1.0, "ms": 1e-3},
    "rotation": {"counterclockwise": 1.0, "clockwise": -1.0},
}
"""Factors to SI by quantity and unit."""

_LENGTH, _VELOCITY, _SPIN = {"length": 1}, {"length": 1, "time": -1}, {"angle": 1, "time": -1}
_INERTIA = {"mass": 1, "length": 2}
POWERS: dict[str, dict[str, int]] = {
    "mass": {"mass": 1},
    **dict.fromkeys(("rx", "ry", "rz", "x", "y", "z"), _LENGTH),
    "theta": {"angle": 1},
    **dict.fromkeys(("vx", "vy", "vz"), _VELOCITY),
    **dict.fromkeys(("omega", "wx", "wy", "wz"), _SPIN),
    "time": {"time": 1},
    **dict.fromkeys(("inertia", *SPACE.inertia), _INERTIA),
}
"""Powers of the quantities in the unit of a column, of which those after contact and covariances follow."""


class Units:
    """The stated units of a table; those that are not stated are SI.

    Raises:
        DataError: not a mapping of quantities to units.
        UnknownNameError: a quantity or unit that does not exist.
    """

    def __init__(self, stated: Mapping[str, str]):
        if not isinstance(stated, Mapping):
            raise DataError(f"data.units is given as {{length: mm, angle: deg}}, got {stated!r}")
        for quantity, unit in stated.items():
            if quantity not in UNIT_FACTORS:
                raise UnknownNameError("quantity in data.units:", str(quantity), UNIT_FACTORS)
            if unit not in UNIT_FACTORS[quantity]:
                raise UnknownNameError(f"unit in data.units.{quantity}:", str(unit), UNIT_FACTORS[quantity])
        self._stated = {**SI, **stated}

    def factor(self, column: str) -> float:
        """Return the factor that takes the numbers of a column to SI."""
        powers = _powers(column)
        powers |= {"rotation": powers.get("angle", 0)}
        return math.prod(UNIT_FACTORS[quantity][self._stated[quantity]] ** power for quantity, power in powers.items())

    def text(self, column: str) -> str:
        """Return the unit of a column as it is written in the table."""
        if column == "order":
            return "trials"
        over, under = (
            " ".join(
                self._stated[quantity] + {1: "", 2: "²"}[abs(power)]
                for quantity in ("mass", "length", "angle", "time")
                if (power := _powers(column).get(quantity, 0)) * sign > 0
            )
            for sign in (1, -1)
        )
        return f"{over}/{under}" if under else over


def _powers(column: str) -> dict[str, int]:
    """Powers of the quantities in the unit of a column; none where it is always the same."""
    name = column.removesuffix("_post")
    if not name.startswith("cov_"):
        return {**POWERS.get(name, {})}
    first, second = (POWERS[part] for part in name.split("_")[1:])
    return {quantity: first.get(quantity, 0) + second.get(quantity, 0) for quantity in (*first, *second)}


NEEDED = tuple(column for name in ("gravity", "delay") for column in PAIRS[name])
"""Columns that every table with estimates of the apparatus has."""


def apparatus_of(cells: Sheet) -> Apparatus | None:
    """Return the apparatus of a table, if it has one.

    Raises:
        DataError: a cell is no number, rows differ, or an error is negative.
    """
    known = {
        field: Estimate(
            value=_one(cells, names[0], PROPERTIES[field]["unit"]),
            error=_one(cells, names[1], PROPERTIES[field]["unit"], 0.0),
            applied=_one(cells, had, PROPERTIES[field]["unit"]) if (had := APPLIED.get(field)) in cells.header else 0.0,
        )
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


NAMES = ("trial", "object")


def columns_of(space: Space) -> tuple[str, ...]:
    """Return all columns that a table may have."""
    groups = (*space.components.values(), *space.covariances.values(), *PAIRS.values(), [*APPLIED.values()])
    return NAMES + tuple(column for columns in groups for column in columns)


def required_in(space: Space) -> tuple[str, ...]:
    """Return the columns that a table must have."""
    fields = space.components.items()
    return tuple(column for field, columns in fields if field not in OPTIONAL for column in columns)


COLUMNS, REQUIRED = columns_of(PLANE), required_in(PLANE)
COMPUTED = {space: {"inertia": space.inertia, "r": space.position} for space in BOTH}
"""Columns by the space and by the field that they fill, that a known shape may replace."""

_NEAR, _SLIP = 0.5, 0.85  # similarity to a needed, and to any other column's name, from which on a name is a slip of it
_VALUES = ("null", "true", "false", "nan", "inf")  # words of Hydra's that are no text
_FEW = 4  # missing columns up to which all that are known are listed
_APART = 0.75  # to a needed name that begins with another letter: m_g is not omega, pos_x is not vy_post


@dataclass(frozen=True, kw_only=True)
class NamedColumns:
    """A table under our names, the file's columns that are not used, and the fields that the shape must give."""

    space: Space
    cells: Sheet
    unused: tuple[str, ...]
    computed: tuple[str, ...]


def name_columns(
    cells: Sheet, mapped: Mapping[str, str | None] | None, *, shaped: bool, stated: Sequence[str] = ()
) -> NamedColumns:
    """Rename the columns of a table to ours.

    Args:
        cells: the table under its own names.
        mapped: the file's column by ours, None where the file has none; columns that are not mentioned have our names.
        shaped: whether the body's shape is known.
        stated: our columns for which a setting states one number.

    Raises:
        DataError: columns that are missing or stated as well, incomplete groups, a name twice, or one that looks like a
            slip.
        UnknownNameError: a mapping of a column that does not exist.
    """
    space = SPACE if {*SPACE.pose[3:]} & {*cells.header, *(mapped or ())} else PLANE
    every = columns_of(space)
    names = _checked(cells, mapped, every)
    taken = {name for name in names.values() if name is not None}
    ours = {name: name for name in cells.header if name in every and name not in names and name not in taken}
    before = {f"{column}_pre": column for column in space.velocity}
    before = {column: name for name, column in before.items() if name in cells.header and name not in taken}
    ours |= {column: name for column, name in before.items() if column not in ours and column not in names}
    ours |= {column: name for column, name in names.items() if name is not None}
    _refuse_repeated(cells, [*ours.values()])
    for column in stated:
        if column in ours:
            raise DataError(
                f"{cells.path}: data.{column} states what the column {ours[column]!r} has; leave it out, or ignore the "
                f"column by 'data.columns={{{column}: null}}'"
            )
    unused = tuple(name for name in cells.header if name not in ours.values())
    lacking = [column for column in required_in(space) if column not in ours and column not in stated]
    if space is SPACE and ("inertia" in stated or "inertia" in cells.header):  # one for all axes
        ours |= {"inertia": "inertia"} if "inertia" in cells.header else {}
        lacking = [column for column in lacking if column not in SPACE.inertia]
    computed = tuple(field for field, columns in COMPUTED[space].items() if {*columns} <= {*lacking})
    spared = {column for field in computed if shaped for column in COMPUTED[space][field]}
    needed = [column for column in lacking if column not in spared]
    free = [column for column in every if column not in ours and column not in names and column not in stated]
    slips = _slips(unused, needed, free)
    if slips or needed:
        raise DataError(f"{cells.path}: {_long(cells, needed) or _missing(space, slips, needed, unused, computed)}")
    _refuse_incomplete(space, cells, [*ours])
    place = cells.header.index
    columns = [cells.columns[place(name)] for name in ours.values()]
    return NamedColumns(
        space=space,
        cells=replace(cells, header=[*ours], columns=columns, written=ours),
        unused=unused,
        computed=computed,
    )


def _checked(cells: Sheet, mapped: Mapping[str, str | None] | None, known: Sequence[str]) -> dict[str, str | None]:
    """The mapping of names, with the file's as text."""
    if mapped is None:
        return {}
    if not isinstance(mapped, Mapping):
        raise DataError(f"data.columns is given as {{vx: speed_x, vy: speed_y}}, our name first, got {mapped!r}")
    names = {str(column): None if name is None else str(name) for column, name in mapped.items()}
    for column, name in names.items():
        if column not in known:
            turned = f" (our name comes first: {{{name}: {column}}})" if name in known else ""
            raise UnknownNameError(f"column in data.columns{turned}:", column, known)
        if name is not None and name not in cells.header:
            near, there = suggest(name, cells.header), ", ".join(map(repr, cells.header))
            raise DataError(f"{cells.path}: data.columns.{column}={name}: no such column{near or ';'} it has {there}")
    return names


def _refuse_repeated(cells: Sheet, names: Sequence[str]) -> None:
    """Refuse a name that stands twice in the header, or fills two of our columns."""
    twice = [name for name, count in Counter(cells.header).items() if count > 1 and name in names]
    if twice:
        raise DataError(f"{cells.path}: column names must be unique; repeated: {', '.join(map(repr, twice))}")
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(f"{cells.path}: data.columns uses {name!r} {count} times; a column fills one of ours")


def _slips(unused: Sequence[str], needed: Sequence[str], free: Sequence[str]) -> dict[str, str]:
    """The missing column that each name is a slip of, the nearest pairs first and each column once."""
    near: list[tuple[float, str, str]] = []
    for name, column in product(unused, free):
        apart = _APART if column.endswith("_post") or name[:1].lower() != column[0] else _NEAR  # v_x_pre is not vx_post
        least = apart if column in needed else _SLIP
        pair = SequenceMatcher(None, column, name.lower())
        if pair.real_quick_ratio() >= least and pair.quick_ratio() >= least and pair.ratio() >= least:
            near.append((pair.ratio(), name, column))
    found: dict[str, str] = {}
    for _, name, column in sorted(near, key=lambda one: (one[2] not in needed, -one[0])):
        if name not in found and column not in found.values():
            found[name] = column
    return {name: found[name] for name in unused if name in found}


def _missing(
    space: Space, slips: Mapping[str, str], needed: Sequence[str], unused: Sequence[str], computed: Sequence[str]
) -> str:
    """Describe which columns are missing, which look like them, and how to map their names."""
    lacking = [column for column in needed if column not in slips.values()]
    parts = [f"unknown column {name!r}, did you mean {near!r}?" for name, near in slips.items()]
    few = len(lacking) <= _FEW or not unused
    other = f"{len(lacking)} columns are missing, or have other names than ours"
    parts += [f"missing column {', '.join(lacking)}" if few else other] if lacking else []
    others = [repr(name) for name in unused if name not in slips]
    parts += [f"not used: {', '.join(others)}"] if lacking and others else []
    if unused:
        mapped = [f"{near}: {_quoted(name)}" for name, near in slips.items()] + [f"{column}: …" for column in lacking]
        word = shlex.quote(f"data.columns={{{', '.join(mapped)}}}")
        parts.append(f"{word} says which columns of the file these are")
    if slips and not {*slips.values()} & {*needed}:
        parts.append(f"or {{{next(iter(slips.values()))}: null}} that it has none")
    if given := [column for field in computed for column in COMPUTED[space][field] if column in lacking]:
        parts.append(f"or state the body's shape, data.shape={{kind: …}}, from which {', '.join(given)} are computed")
    if "mass" in lacking:
        parts.append("or state the mass of every body in kg, data.mass=…")
    plain = [column for column in columns_of(space) if not column.startswith(("cov_", "apparatus_"))]
    every = f"needed: {', '.join(required_in(space))}; known: {', '.join(plain)}, cov_…, apparatus_… (docs/tables.md)"
    parts.append(every if few else "optional columns: docs/tables.md")
    return "; ".join(parts)


def _long(cells: Sheet, needed: Sequence[str]) -> str | None:
    """Describe the mistake of a long table, which has our names in cells; None for any other table."""
    for name, column in zip(cells.header, cells.columns, strict=True):
        if len({*needed}.intersection(map(str, column[: len(COLUMNS)]))) > 1:
            return (
                f"is a long table, with names of quantities in its column {name!r}; a row a trial is needed, as pandas "
                f"makes it: table.pivot(index='trial', columns={name!r}, values='value')"
            )
    return None


def _quoted(name: str) -> str:
    """A name as a setting takes it: brackets, as of units, and other signs want quotes."""
    plain = re.fullmatch(r"[A-Za-z_][\w.-]*( [\w.-]+)*", name, re.ASCII) and name.lower() not in _VALUES
    return name if plain else '"' + re.sub(r'(\\*)("|$)', lambda m: 2 * m[1] + (m[2] and '\\"'), name) + '"'


def _refuse_incomplete(space: Space, cells: Sheet, ours: Sequence[str]) -> None:
    """Refuse a table that has a part of columns that come together."""
    several = {3: "all three", 6: "all six", 7: "all seven", 21: "all 21"}
    groups = [(columns, several[len(columns)]) for columns in (space.components["q_post"], *space.covariances.values())]
    groups += [(pair, "both") for pair in PAIRS.values()]
    groups += [((*PAIRS[name], had), "all three") for name, had in APPLIED.items() if had in ours]
    if any(column in ours for pair in PAIRS.values() for column in pair):
        groups.append((NEEDED, "all four"))
    for group, count in groups:
        lacking = [column for column in group if column not in ours]
        if lacking and (len(lacking) < len(group) or group is NEEDED):
            raise DataError(f"{cells.path}: {', '.join(group)} come {count} or none; missing: {', '.join(lacking)}")
