"""Columns of a table: their names, and the estimates of the apparatus.

    columns={vx: speed_x}       the file's column speed_x is our vx
    columns={inertia: null}     the file has no inertia, whatever its columns are called

Names that say the same in other words are read likewise (`names`), `vx_pre, vy_pre, omega_pre` among them, where no
column has our name.  An unknown column whose name is near a missing one is refused as a slip; other unknown columns are
not used.  Where the body's shape is known, `rx, ry` may be left out, and `inertia` and `x, y` as well.

Estimates of the apparatus are the same numbers in every row, always in SI: a column survives a dropped row, another
program that saves the table, and CSV.
"""

import re
import shlex
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from itertools import product

import numpy as np

from contactlearn.core.errors import DataError, UnknownLayoutError, UnknownNameError, suggest
from contactlearn.data.cameras import refusal_of_cameras
from contactlearn.data.table.names import (
    MOVING,
    NAMES,
    OTHERS,
    VECTORS,
    Recognised,
    impact_vocabulary,
    is_coefficient,
    is_duration,
    is_unit,
    name_words,
    recognise,
    spins_per_second,
    times_in,
    unit_in,
)
from contactlearn.data.table.options import TableOptions
from contactlearn.data.table.several import refusal_of_several
from contactlearn.data.table.sheet import Sheet
from contactlearn.data.table.units import COMPOUND, SI, UNIT_FACTORS, Units, powers_of
from contactlearn.mechanics.apparatus import APPLIED, PAIRS, PROPERTIES, Apparatus, Estimate
from contactlearn.mechanics.impacts import COVARIATE, OPTIONAL
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space

NEEDED = tuple(column for name in ("gravity", "delay") for column in PAIRS[name])
"""Columns that every table with estimates of the apparatus has."""


def apparatus_of(cells: Sheet) -> Apparatus | None:
    """Return the apparatus of a table, if it has one.

    Raises:
        DataError: a cell is no number, rows differ, or an error is negative.
    """
    known = dict[str, Estimate]()
    for field, (value, error) in PAIRS.items():
        unit, had = PROPERTIES[field]["unit"], APPLIED.get(field)
        if value in cells.columns:
            applied = _constant(cells, had, unit) if had and had in cells.columns else 0.0
            known[field] = Estimate(
                value=_constant(cells, value, unit), error=_constant(cells, error, unit, 0.0), applied=applied
            )
    return Apparatus(**{field: known.get(field) for field in PAIRS}) if known else None  # pyright: ignore[reportArgumentType]  (`NEEDED`)


def _constant(cells: Sheet, column: str, unit: str, least: float = float("-inf")) -> float:
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
for _space in BOTH:
    COMPUTED[_space] |= {"place": _space.pose[: _space.d - 1], "height": _space.pose[_space.d - 1 : _space.d]}
COMPUTED[PLANE] |= {"orientation": ("theta",), "spin": ("omega", "omega_post"), "slip": ("vx", "vx_post")}
"""Columns by the space and by what they fill, that a table may lack.

A known shape replaces inertia and r.  The height follows of r, the place is 0, no orientation is that of a disc, a spin
that was not measured of the moments, and bounces along the normal alone have no slip.
"""


def trial_column(cells: Sheet, names: Collection[str]) -> str | None:
    """Return the first of some columns that names trials, such as shot or run: nearly all of its cells differ."""
    for name in cells.columns:
        words = {*name_words(name)} if name.strip() not in ("#", "№") else {"nr"}
        if name in names and words and words <= _TRIALS:
            there = cells.names(name)
            if all(there) and len({*there}) >= _DISTINCT * len(there):
                return name
    return None


_TRIALS = {"drop", "shot", "run", "stroke", "throw", "test", "hit", "toss", "trial", "bounce", "experiment", "row"}
_TRIALS |= {"nr", "no", "num", "number", "id", "index"}
_DISTINCT = 0.9  # share of cells of names of trials: rows may be pasted twice


def covariate_columns(cells: Sheet, covariates: Sequence[str]) -> dict[str, str]:
    """Return the columns that fill covariates, by our names, such as {"covariate_temperature": "temperature [°C]"}.

    Args:
        cells: the table under its own names.
        covariates: names of columns, with or without the unit at their end.

    Raises:
        DataError: the table has no such column, or it is not clear which it is.
    """
    if isinstance(covariates, str) or not all(isinstance(covariate, str) for covariate in covariates):
        raise DataError(f"data.covariates is a list of columns, such as [temperature, operator], got {covariates!r}")
    found: dict[str, str] = {}
    for name in covariates:
        plain = [one for one in cells.header if name in (one, without_unit(one))]
        named = [name] if name in plain else plain or [one for one in cells.header if _word(one) == _word(name)]
        if len(named) != 1:
            seen = f"may be {' or '.join(map(repr, named))}" if named else f"is no column{suggest(name, cells.header)}"
            raise DataError(
                f"{cells.path}: data.covariates: {name!r} {seen}; it has {', '.join(map(repr, cells.header))}"
            )
        found[f"{COVARIATE}{_word(named[0])}"] = named[0]
    return found


def without_unit(name: str) -> str:
    """Return a name without the unit in brackets at its end."""
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name)


def _word(name: str) -> str:
    """A name as a word of letters, digits and _, without its unit."""
    return re.sub(r"\W+", "_", without_unit(name)).strip("_").lower()


_SPINS = {"omega", "ω", "spin", "rotation", "angular", "rpm", "w", "rot", "dtheta"}
_SPEEDS = {"v", "vx", "velocity", "speed", "vel", "tangential", "slip", "u", "dx", "horizontal"}
_ANGLES = {"theta", "θ", "phi", "φ", "angle", "orientation", "attitude", "rotation"}
# similarity to a needed, and to any other column's name, from which on a name is a slip of it
_NEEDED_SIMILARITY, _OTHER_SIMILARITY = 0.5, 0.85
_VALUES = ("null", "true", "false", "nan", "inf")  # words of Hydra's that are no text
_MAX_LISTED = 4  # missing columns up to which all that are known are listed
_UNLIKE_SIMILARITY = 0.75  # to a needed name that begins with another letter: m_g is not omega, pos_x is not vy_post


@dataclass(frozen=True, kw_only=True)
class NamedColumns:
    """A table under our names, its units, the file's columns that are not used, and the fields that the shape gives."""

    space: Space
    cells: Sheet
    units: Units
    unused: tuple[str, ...]
    computed: tuple[str, ...]


def recognised_columns(header: Sequence[str], mapped: Collection[str] = ()) -> tuple[Space, Recognised]:
    """Return the space of a table, and which of its columns are which.

    Quaternions make it one of bodies in space, and so do three components of velocities or spins, or three moments of
    inertia, if there is no angle and no spin as in a plane.

    Args:
        header: names of columns.
        mapped: our columns for which a setting says which they are.
    """
    known, planar = recognise(header, impact_vocabulary(SPACE)), recognise(header, impact_vocabulary(PLANE))
    named, spatial = {*known.names, *mapped}, SPACE.components
    triples = (SPACE.velocity[:3], SPACE.velocity[3:], spatial["v_post"][:3], spatial["v_post"][3:], SPACE.inertia)
    flat = {"theta", "omega", "theta_post", "omega_post"} & {*planar.names, *mapped}
    if {*SPACE.pose[3:]} & named or (not flat and any({*triple} <= named for triple in triples)):
        return SPACE, known
    return PLANE, _with_spins_about_z(planar, known)


def _with_spins_about_z(planar: Recognised, spatial: Recognised) -> Recognised:
    """Columns of a plane, with spins that are called those about the axis across it, and no other is there."""
    spins = {ours: f"wz{ours.removeprefix('omega')}" for ours in ("omega", "omega_post")}
    if {"wx", "wy", "wx_post", "wy_post"} & {*spatial.names}:
        return planar
    spins = {ours: wz for ours, wz in spins.items() if ours not in planar.names and wz in spatial.names}
    names = {ours: spatial.names[wz] for ours, wz in spins.items()}
    units = {ours: spatial.units[wz] for ours, wz in spins.items() if wz in spatial.units}
    return replace(
        planar,
        names={**planar.names, **names},
        units={**planar.units, **units},
        others=tuple(name for name in planar.others if name not in names.values()),
    )


def computed_fields(space: Space, lacking: Collection[str], unused: Iterable[str]) -> tuple[str, ...]:
    """Return the fields of `COMPUTED` all of whose columns a table lacks; none that an unused column may be.

    Nobody measured a spin if the normal velocities are there, and no slip if there is no spin either.
    """
    fields = [field for field, columns in COMPUTED[space].items() if {*columns} <= {*lacking}]
    words = {word for name in unused for word in name_words(name)}
    turning = any(unit_in(name, "omega", impact_vocabulary(PLANE)) for name in unused)
    if {"vy", "vy_post"} & {*lacking} or turning or any(word in _SPINS or "spin" in word for word in words):
        fields = [field for field in fields if field not in ("spin", "slip")]
    if "spin" not in fields or words & {"x", *_SPEEDS}:
        fields = [field for field in fields if field != "slip"]
    heights = words & {"y", "z", "height", "h"} if "r" not in fields else set[str]()  # else it follows of the shape
    doubtful = {"height": heights, "place": words & {"x", "y", "z"}, "orientation": words & _ANGLES}
    return tuple(field for field in fields if not doubtful.get(field))


def name_columns(cells: Sheet, options: TableOptions) -> NamedColumns:
    """Rename the columns of a table, which has its own names, to ours.

    Raises:
        DataError: columns that are missing or stated as well, incomplete groups, a name twice, one that looks like a
            slip, or units that no column has.
        UnknownNameError: a mapping of a column that does not exist.
    """
    space, known = recognised_columns(cells.header, options.columns)
    stated, shaped = options.body, options.shape is not None
    every = (*columns_of(space), *(one for one in (*cells.header, *options.columns) if one.startswith(COVARIATE)))
    names = checked_names(cells, options.columns, every)
    taken = {name for name in names.values() if name is not None}
    if names:
        known = recognise([name for name in cells.header if name not in taken], impact_vocabulary(space))
    ours = {name: name for name in cells.header if name in every and name not in names and name not in taken}
    ours |= {column: name for column, name in known.names.items() if column in every and column not in names}
    ours |= {column: name for column, name in names.items() if name is not None}
    if "trial" not in {**ours, **names} and (trial := trial_column(cells, {*cells.header} - {*ours.values()})):
        ours["trial"] = trial
    refuse_repeated(cells, [*ours.values()])
    for column in _parts_of_pose(space, [*ours]):
        del ours[column]
    of_all_axes: tuple[str, ...] = ()
    if space is SPACE and ("inertia" in stated or "inertia" in cells.columns):  # one for all axes
        ours |= {"inertia": "inertia"} if "inertia" in cells.columns else {}
        of_all_axes = SPACE.inertia
    unused = tuple(name for name in cells.header if name not in ours.values())
    spins = spins_per_second(cells.header)
    spins = {column: name for column, name in spins.items() if column in every and ours.get(column, name) == name}
    if spins:
        forms = (f"{column}: {{column: {setting_text(name)}, unit: rad/s}}" for column, name in spins.items())
        raise DataError(
            f"{cells.path}: {' and '.join(map(repr, spins.values()))} may be in rad/s or in rev/s: say which, "
            f"'data.columns={{{', '.join(forms)}}}' or unit: rev/s"
        )
    known_elsewhere = {*ours, *stated, *of_all_axes}
    lacking = [column for column in required_in(space) if column not in known_elsewhere]
    bounces = {column for column in ("vy", "vy_post") if names.get(column)}  # settings say that there is no more
    computed = computed_fields(space, lacking, () if len(bounces) == 2 else unused)
    given = [field for field in computed if shaped or (field not in ("inertia", "r") and "r" not in computed)]
    given = [field for field in given if field != "orientation" or not options.turning]
    spared = {column for field in given for column in COMPUTED[space][field]}
    needed = [column for column in lacking if column not in spared]
    free = [column for column in every if column not in known_elsewhere and column not in names]
    slips = _slips(unused, needed, free)
    if slips or needed:
        why = refusal_of_cameras(cells.header) or refusal_of_several(cells.header) or _doubtful(known, needed)
        unmeasured = not any(column.endswith("_post") for column in ours)
        why = (
            why
            or (unmeasured and refusal_of_unmeasured(cells.header))
            or _missing(space, slips, needed, unused, computed, _of_length_1(cells, unused))
        )
        unknown = len(needed) > max(_MAX_LISTED, len(cells.header) - len(unused))
        raise (UnknownLayoutError if unknown else DataError)(f"{cells.path}: {why}")
    _refuse_incomplete(space, cells, [*ours])
    columns = {column: cells.columns[name] for column, name in ours.items()}
    return NamedColumns(
        space=space,
        cells=replace(cells, columns=columns, written=ours),
        units=_with_columns(cells, options.units, space, ours),
        unused=unused,
        computed=computed,
    )


def _with_columns(cells: Sheet, units: Units, space: Space, ours: Mapping[str, str]) -> Units:
    """The units of settings, and those that names of columns state."""
    vocabulary = impact_vocabulary(space)
    named = {column: unit for column, name in ours.items() if (unit := unit_in(name, column, vocabulary))}
    for column, name in ours.items():
        written = re.search(r"[\[(]([^\])]+)[\])]\s*$", name)
        other = column not in named and not column.startswith(COVARIATE)
        if written and other and written[1] != "-" and is_unit(written[1]):
            raise DataError(
                f"{cells.path}: column {name!r} cannot be {column}, whose unit is {units.text(column) or 'none'}"
            )
        if written and other and powers_of(column) and re.search(r"[/^⁻·]|\bHz\b", written[1]):
            raise DataError(
                f"{cells.path}: column {name!r}: the unit {written[1]} of {column} is not known; convert the column to "
                f"{units.text(column)}, or write a known one, such as mm, mm/s, km/h, deg/s or rev/min"
            )
    for quantity in UNIT_FACTORS:
        having = [column for column in ours if quantity in powers_of(column)]
        silent = [column for column in having if quantity not in named.get(column, {})]
        units_named = {column: named[column][quantity] for column in having if column not in silent}
        stated = units.stated.get(quantity)
        if stated and having and not silent and stated not in units_named.values():
            column, unit = next(iter(units_named.items()))
            raise DataError(
                f"{cells.path}: data.units.{quantity}={stated}, but the column {ours[column]!r} says {unit}, and "
                "no other column is without a unit; leave that setting out, or rename the columns"
            )
        telling = [column for column, unit in units_named.items() if unit not in (SI[quantity], *COMPOUND)]
        if telling and silent and not stated:
            unit, usual, setting = units_named[telling[0]], SI[quantity], f"data.units.{quantity}"
            names = ", ".join(ours[column] for column in silent)
            raise DataError(
                f"{cells.path}: the column {ours[telling[0]]!r} is in {unit}, and {names} do not say: {setting}={unit} "
                f"if these are too, {setting}={usual} if they are in {usual}"
            )
    return Units(units.stated, named)


_FLIGHTS = {"interval", "intervals", "flight", "zeitintervall", "intervall", "flugzeit", "vol", "intervalle", "vuelo"}
_FLIGHTS |= {"intervalo", "intervallo", "volo"}
_TIMES = {"time", "times", "t", "dt", "δt", "zeit", "temps", "tiempo", "tempo", "s", "ms"}
_BESIDE_FLIGHTS = {"of", "between", "de", "di", "bounce", "bounces", "hop", "bouncing", "impact", "hit", "aufprall"}
_BEFORE = {"vx", "vy", "vz", "speed", "height", "px", "py", "momentum"}


def chains_in(header: Sequence[str]) -> dict[str, dict[str, int]]:
    """Return the names with a running number that say of each flight or bounce of a run what it is, and the numbers.

    By `flight` are times such as "Time interval 1 (s)", by `bounce` such as "Bounce 1 (s)", and by `height` such as
    "Height 1 (m)", each in the order of its numbers.
    """
    chains: dict[str, dict[str, int]] = {"flight": {}, "bounce": {}, "height": {}}
    for name in header:
        words = name_words(name)
        digits = [word for word in words if word.isdigit()]
        if len(digits) != 1:
            continue
        if {*words} <= {*_FLIGHTS, *_TIMES, *_BESIDE_FLIGHTS, *digits} and {*words} & (_FLIGHTS | _TIMES):
            chains["flight" if {*words} & _FLIGHTS else "bounce"][name] = int(digits[0])
        elif {"height", "height_post"} & {*recognise([re.sub(r"[\W_]*\d+", "", name)], impact_vocabulary(PLANE)).names}:
            chains["height"][name] = int(digits[0])
    return {kind: dict(sorted(names.items(), key=lambda one: one[1])) for kind, names in chains.items()}


def refusal_of_unmeasured(header: Sequence[str]) -> str:
    """Return how to compute velocities from columns that have others in their place, or that none is after contact.

    Empty where some are, and where nothing is known of an impact.
    """
    split = {name: name_words(name) for name in header}
    chains = chains_in(header)
    flights = [*chains["flight"], *chains["bounce"]]
    if len(flights) > 1:
        return (
            f"has no velocities before and after contact; are {', '.join(map(repr, flights))} times between bounces? A "
            "body is in flight for t = 2 v/g: write a row a bounce, with v_in = g t/2 of the flight before it and "
            "v_out = g t/2 of that after it, in m/s (docs/tables.md)"
        )
    gates = {times_in(name, opposite=True): name for name in header if is_duration(name)}
    if {"pre", "post"} <= gates.keys():
        return (
            f"has no velocities before and after contact; are {gates['pre']!r} and {gates['post']!r} times in which a "
            "light gate is dark? v = width/t: write columns v_in and v_out in m/s, with the width of what passes the "
            "gate (docs/tables.md)"
        )
    coefficients = [name for name, words in split.items() if is_coefficient(name) or "".join(words) == "et"]
    if coefficients:
        return (
            f"has no velocities before and after contact; the coefficients {', '.join(map(repr, coefficients))} give "
            "those after it: add vy_post = −e_n vy along the normal and vx_post = e_t vx along the floor, beside vx "
            "and vy, or speed and 'angle from normal' (docs/tables.md)"
        )
    known = recognised_columns(header)[1]
    if _BEFORE.intersection(known.names) and not any(one.endswith("_post") for one in (*known.names, *known.doubtful)):
        others = f"; none of {', '.join(map(repr, known.others))} is known to be it" if known.others else ""
        return (
            "has no velocity after contact: vx_post, vy_post and omega_post, or a height of rebound, or a coefficient "
            f"of restitution must be measured{others} (docs/tables.md); a column with another name is stated by "
            "'data.columns={vy_post: …}'"
        )
    return ""


def _doubtful(known: Recognised, needed: Sequence[str]) -> str | None:
    """Describe names of which two have the meaning of a needed column."""
    for column in needed:
        if column in known.doubtful:
            names = " or ".join(map(repr, known.doubtful[column]))
            mapped = shlex.quote(f"data.columns={{{column}: {setting_text(known.doubtful[column][0])}}}")
            return f"column {column} may be {names}: say which, such as {mapped}"
    return None


def checked_names(cells: Sheet, mapped: Mapping[str, str | None], known: Sequence[str]) -> dict[str, str | None]:
    """Return the mapping of names, those of the file with their units.

    Raises:
        DataError: no such column in the file.
        UnknownNameError: no column of ours.
    """
    plain = {name: [one for one in cells.header if without_unit(one) == name] for name in mapped.values() if name}
    names = {column: plain[name][0] if name and len(plain[name]) == 1 else name for column, name in mapped.items()}
    for column, name in names.items():
        if column not in known:
            turned = f" (our name comes first: {{{name}: {column}}})" if name in known else ""
            own = [one for one in known if not one.startswith(("cov_", "apparatus_"))]  # which only our tables have
            own += [f"{one}{end}" for one in OTHERS for end in ("", "_post") if one not in ("direction", column)]
            own += ("restitution", *VECTORS, *MOVING)
            raise UnknownNameError(f"column in data.columns{turned}:", column, [*dict.fromkeys(own)])
        if name is not None and name not in cells.columns:
            free = [one for one in cells.header if one not in names.values()]  # a column that is mapped already is none
            near, there = suggest(name, free), ", ".join(map(repr, cells.header))
            raise DataError(f"{cells.path}: data.columns.{column}={name}: no such column{near or ';'} it has {there}")
        if column.startswith(("v", "omega")) and is_duration(str(name)):
            raise DataError(
                f"{cells.path}: data.columns.{column}={name}: a time by its name, and no velocity; of a light gate "
                "write a column with v = width/t in m/s"
            )
        if column.startswith("v") and column.endswith("_post") and is_coefficient(str(name)):
            raise DataError(
                f"{cells.path}: data.columns.{column}={name}: a coefficient of restitution by its name, and no "
                f"velocity: 'data.columns={{restitution: {setting_text(str(name))}}}', beside a speed or a height"
            )
    return names


def refuse_repeated(cells: Sheet, names: Sequence[str]) -> None:
    """Refuse a name that stands twice in the header, or fills two of our columns."""
    if twice := [name for name, count in Counter(cells.repeated).items() if count > 1 and name in names]:
        raise DataError(
            f"{cells.path}: column names must be unique; repeated: {', '.join(map(repr, twice))}; call those after "
            f"contact {', '.join(f'{name}_post' for name in twice)} in the file, if they are"
        )
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(f"{cells.path}: data.columns uses {name!r} {count} times; a column fills one of ours")


def _slips(unused: Sequence[str], needed: Sequence[str], free: Sequence[str]) -> dict[str, str]:
    """The missing column that each name is a slip of, the nearest pairs first and each column once."""
    near: list[tuple[float, str, str]] = []
    for name, column in product(unused, free):
        apart = (
            _UNLIKE_SIMILARITY if column.endswith("_post") or name[:1].lower() != column[0] else _NEEDED_SIMILARITY
        )  # v_x_pre is not vx_post
        least = apart if column in needed else _OTHER_SIMILARITY
        pair = SequenceMatcher(None, column, name.lower())
        if pair.real_quick_ratio() >= least and pair.quick_ratio() >= least and pair.ratio() >= least:
            near.append((pair.ratio(), name, column))
    found: dict[str, str] = {}
    for _, name, column in sorted(near, key=lambda one: (one[2] not in needed, -one[0])):
        if name not in found and column not in found.values():
            found[name] = column
    return {name: found[name] for name in unused if name in found}


def _missing(
    space: Space,
    slips: Mapping[str, str],
    needed: Sequence[str],
    unused: Sequence[str],
    computed: Sequence[str],
    four: str,
) -> str:
    """Describe which columns are missing, which look like them, and how to map their names.

    Args:
        four: settings of columns that may be a quaternion; empty if there are none.
    """
    lacking = [column for column in needed if column not in slips.values()]
    parts = [f"unknown column {name!r}, did you mean {near!r}?" for name, near in slips.items()]
    few = len(lacking) <= _MAX_LISTED or not unused
    other = f"{len(lacking)} columns are missing, or have other names than ours"
    if turned := {*(turns := SPACE.pose[3:])} <= {*lacking}:
        lacking = [column for column in lacking if column not in turns]
        parts.append(
            "missing quaternion, body to world, for v_z, three spins or three moments of inertia are of bodies in "
            "space: 'data.columns={quaternion_xyzw: …}' says its column of vectors, quaternion_wxyz with the scalar "
            f"first; four columns are {four or '{qw: …, qx: …, qy: …, qz: …}'}{', whose length is 1' * bool(four)}"
        )
    parts += [f"missing column {', '.join(lacking)}" if few else other] if lacking else []
    others = [repr(name) for name in unused if name not in slips]
    parts += [f"not used: {', '.join(others)}"] if others and (lacking or turned) else []
    if unused and (slips or lacking):
        mapped = [f"{near}: {setting_text(name)}" for name, near in slips.items()] + [
            f"{column}: …" for column in lacking
        ]
        word = shlex.quote(f"data.columns={{{', '.join(mapped)}}}")
        parts.append(f"{word} says which columns of the file these are")
    if slips and not {*slips.values()} & {*needed}:
        parts.append(f"or {{{next(iter(slips.values()))}: null}} that it has none")
    if given := [column for field in computed for column in COMPUTED[space][field] if column in lacking]:
        disc = " of a disc" if given == ["theta"] else ""
        parts.append(
            f"or state the body's shape{disc}, data.shape={{kind: …}}, from which {', '.join(given)} are computed"
        )
    if "mass" in lacking:
        parts.append("or state the mass of every body in kg, data.mass=…")
    plain = [column for column in columns_of(space) if not column.startswith(("cov_", "apparatus_"))]
    every = f"needed: {', '.join(required_in(space))}; known: {', '.join(plain)}, cov_…, apparatus_… (docs/tables.md)"
    parts.append(every if few and not turned else "optional columns: docs/tables.md")
    return "; ".join(parts)


def _of_length_1(cells: Sheet, unused: Sequence[str]) -> str:
    """Settings of four columns beside each other that may be a quaternion, for their length is 1, the scalar last."""
    numeric = [name for name in unused if cells.is_numeric(name)]
    for names in zip(*(numeric[k:] for k in range(4)), strict=False):
        try:
            lengths = np.stack([replace(cells, gaps=True).numbers(name, "1") ** 2 for name in names]).sum(0)
        except DataError:
            continue
        if abs(lengths[lengths == lengths] - 1).max(initial=0) < _LENGTH_SHARE:
            return f"{{{', '.join(f'{q}: {setting_text(name)}' for q, name in zip(_SCALAR_LAST, names, strict=True))}}}"
    return ""


_SCALAR_LAST, _LENGTH_SHARE = ("qx", "qy", "qz", "qw"), 0.01


def setting_text(name: str) -> str:
    """A name as a setting takes it: brackets, as of units, and other signs want quotes."""
    plain = re.fullmatch(r"[A-Za-z_][\w.-]*( [\w.-]+)*", name, re.ASCII) and name.lower() not in _VALUES
    return name if plain else '"' + re.sub(r'(\\*)("|$)', lambda m: 2 * m[1] + (m[2] and '\\"'), name) + '"'


def _parts_of_pose(space: Space, ours: Sequence[str]) -> list[str]:
    """The columns of a pose after contact that lacks what the one before it lacks: θ alone, or the place of a ball."""
    after = space.components["q_post"]
    lacking = [column for column in after if column not in ours]
    alike = all(column.removesuffix("_post") not in ours for column in lacking)
    return [column for column in after if column in ours] if lacking and alike else []


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
