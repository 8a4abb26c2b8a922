"""Tables with a number in a row, or several in a cell, as a table with a column for each number.

trial, phase, variable, value, unit      a row a number, as tidyr's pivot_longer and pandas' melt make
run, Time interval 1 (s), 2 …            a row a run, with times of flight between bounces, or those of bounces
run, bounce, instant                     the same with a row a bounce
run, Height 1 (m), Height 2 (m), 3 …     or heights of flights
drop height, trial 1 (cm), trial 2 (cm)  repeats of a rebound, or of other columns, beside those that they share
v_minus_1 … 3, v_plus_1 … 3              vectors whose components are numbered, as MATLAB writes matrices
"[ 2.88 -1.13]", "(1.2, 3.4)", [1, 2]    a vector in a cell, as pandas writes arrays, and JSON has them
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from statistics import mode
from typing import Any

import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.table.columns import chains_in, recognised_columns, setting_text, trial_column
from contactlearn.data.table.dialect import is_missing, is_numeral, text_of
from contactlearn.data.table.names import components_of, is_unit, name_words, time_of, times_in
from contactlearn.data.table.sheet import Cells, Sheet
from contactlearn.data.table.units import Units
from contactlearn.mechanics.rigid_body import GRAVITY

_MOST_VARIABLES = 60  # names of quantities of a long table
_MIN_VARIABLES = 3  # of them that the reader knows
_MAX_BESIDE = 4  # columns of numbers beside the names, of which one may be that of the values; more may be trials
VALUES = {"value", "values", "wert", "werte", "valeur", "valor", "valore", "measurement", "reading", "number"}
"""Words for the column of the numbers of a table that has a row each."""
_UNITS = {"unit", "units", "einheit", "unité", "unite", "unidad", "unità"}
_MIN_FLIGHTS = 3  # times of a run that show by falling that they are not those of the bounces themselves
_SCALAR = re.compile(r"np\.\w+\(([^()]*)\)")
_VECTOR = re.compile(
    r"(?:[A-Za-z_][\w.]*(?:\{[^{}]*\})?\s*)?[\[({<]+(?P<inside>[^\[\](){}<>]*)[\])}>]+|(?P<bare>[^\[\](){}<>]+)"
)
_BEFORE = {"pose", "state", "impact", "contact", "geometry", "all", "both"}
"""Words of a phase whose numbers are those at contact."""


@dataclass(frozen=True, kw_only=True)
class _Long:
    """Names of the columns of a long table."""

    variable: str
    value: str
    unit: str | None
    phase: str | None
    trials: tuple[str, ...]


def by_bounce(cells: Sheet) -> Sheet:
    """Return a table with a row a bounce, its number in the run and its instant, with a row a run; others as it is."""
    known = recognised_columns(cells.header)[1]
    run, time = known.names.get("trial"), known.names.get("time")
    number = next((name for name in cells.header if _BOUNCES.intersection(name_words(name))), None)
    if None in (run, time, number) or not {*known.names} <= {"trial", "time", "object"} or run == number:
        return cells
    run, time, number = str(run), str(time), str(number)
    try:
        numbers = cells.numbers(number, "").astype(int)
        instants = cells.numbers(time, "s", Units({}, {"time": known.units.get("time", {})}).factor("time"))
    except (DataError, ValueError):
        return cells
    runs, first = cells.names(run), dict[str, int]()
    for row, name in enumerate(runs):
        first.setdefault(name, row)
    if len({*zip(runs, numbers.tolist(), strict=True)}) < len(cells) or numbers.min() != 1 or len(first) == len(cells):
        return cells
    places = {name: place for place, name in enumerate(first)}
    made = {f"bounce {k} (s)": np.full(len(first), np.nan) for k in range(1, numbers.max() + 1)}
    for name, k, instant in zip(runs, numbers.tolist(), instants, strict=True):
        made[f"bounce {k} (s)"][places[name]] = instant
    starts = [first[name] for name in runs]
    others = {name: cells.columns[name] for name in cells.header if name not in (time, number)}
    shared = [name for name, x in others.items() if all(x[k] == x[start] for k, start in enumerate(starts))]
    cells = cells.gathered([*first.values()])
    said = f"a run for each {run!r}, with its bounces by {number!r} and {time!r}"
    return cells.with_columns([*((name, cells.columns[name]) for name in shared), *made.items()], said)


_BOUNCES = {"bounce", "hit", "impact", "aufprall", "rebond", "choc", "rebote", "rimbalzo", "studs"}
"""Words of a column that numbers the bounces of a run."""


def by_flight(cells: Sheet) -> Sheet:
    """Return a table with a row a run, and its flights or bounces in columns, with a row a bounce; others as it is.

    A body that bounces is shorter in flight each time.
    """
    chains = chains_in(cells.header)
    kept = [name for name in cells.header if not any(name in names for names in chains.values())]
    alone = recognised_columns(kept)[1].names
    if [*alone.keys() & {"speed", "vy", "height"}] == ["height"] and min(chains["height"].values(), default=0) == 1:
        if math.factorial(len(chains["height"])) ** len(cells) < _ORDERS:  # repeats may fall by chance
            return cells
        chains = {"height": {alone["height"]: 0, **chains["height"]}}
        kept.remove(alone["height"])
    elif {"speed", "vy", "height"} & {*alone}:
        return cells
    found = next((one for kind, names in chains.items() if (one := _bounces(cells, kind, names))), None)
    if found is None:
        return cells
    (runs, bounces), before, after, numbers, said = found
    others = [one for names in chains.values() if (one := " … ".join(map(repr, [*names][:: max(len(names) - 1, 1)])))]
    others = [one for one in others if one not in said]
    said += f"; not used: {', '.join(others)}" if others else ""
    made: dict[str, Cells] = {"speed before [m/s]": before[runs, bounces], "speed after [m/s]": after[runs, bounces]}
    return _parted(cells, runs.tolist(), [numbers[bounce] for bounce in bounces], kept, made, said)


def _parted(
    cells: Sheet, rows: Sequence[int], numbers: Sequence[int], kept: Sequence[str], made: Mapping[str, Cells], said: str
) -> Sheet:
    """The table with several impacts for each row, called by the row's trial and their numbers, and made columns."""
    trial = recognised_columns(kept)[1].names.get("trial") or trial_column(cells, kept)
    named = cells.names(trial) if trial else [str(row + 1) for row in range(len(cells))]
    trials = [f"{named[row]}/{number}" for row, number in zip(rows, numbers, strict=True)]
    cells = cells.gathered(rows)
    beside = ((name, cells.columns[name]) for name in kept if name != trial)
    return cells.with_columns([("trial", trials), *beside, *made.items()], said)


def _bounces(
    cells: Sheet, kind: str, names: Mapping[str, int]
) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray, list[int], str] | None:
    """The bounces between the flights of a chain, if these become shorter.

    Returns:
        Rows and columns of the bounces, speeds before and after them by row and column, their numbers, and words.
    """
    table, numbers = replace(cells, gaps=True), [*names.values()]
    if len(names) < _MIN_FLIGHTS + (kind == "bounce") or numbers != [*range(numbers[0], numbers[-1] + 1)]:
        return None
    if kind == "height":
        units = recognised_columns([re.sub(r"[\W_]*\d+", "", name, count=1) for name in names])[1].units
        unit = Units({}, {"height": next(iter(units.values()), {})})
        heights = [table.numbers(name, unit.text("height"), unit.factor("height")) for name in names]
        speeds = np.sqrt(2 * GRAVITY * np.stack(heights, 1).clip(min=0))
    else:
        times = np.stack([table.numbers(name, "s", 1e-3 if "ms" in name_words(name) else 1.0) for name in names], 1)
        speeds = GRAVITY / 2 * (np.diff(times) if kind == "bounce" else times)
    both = np.isfinite(speeds[:, 1:]) & np.isfinite(speeds[:, :-1])
    if not both.any() or (speeds[:, 1:] >= speeds[:, :-1])[both].any() or (speeds <= 0).any():
        return None
    first, *_, last = names
    said = {
        "flight": f"a bounce between two of {first!r} … {last!r}, which fall as times of flight t do: v = g t/2 in "
        "vacuum",
        "bounce": f"a bounce at each of {first!r} … {last!r} but the first and the last, for which the times t between "
        "them fall: v = g t/2 in vacuum",
        "height": f"a bounce between two of {first!r} … {last!r}, which fall as heights h of flights do: v² = 2 g h in "
        "vacuum",
    }[kind]
    later = numbers[0 if kind == "height" else 1 :]  # a flight k ends at bounce k + 1, or height k at bounce k
    return both.nonzero(), speeds[:, :-1], speeds[:, 1:], later, said


def by_repeat(cells: Sheet) -> Sheet:
    """Return a table with an impact for each of the numbered repeats that stand in a row; any other as it is.

    Raises:
        DataError: numbered heights of few rows may be those of one bounce after the other as well.
    """
    if not (repeats := repeats_in(cells.header)):
        return cells
    stems = [*next(iter(repeats.values()))]
    taken = {name for names in repeats.values() for name in names.values()}
    shared = [name for name in cells.header if name not in taken]
    every = [names[stems[0]] for names in repeats.values()]
    first = np.stack([replace(cells, gaps=True).numbers(name, "") for name in every])
    if len(stems) == 1 and not (np.diff(first, axis=0) >= 0).any():
        drop = setting_text(recognised_columns(shared)[1].names.get("height", "…"))
        raise DataError(
            f"{cells.path}: {', '.join(map(repr, every))} fall in each row: are they repeats, or one bounce after the "
            f"other? For one of them, 'data.columns={{height: {drop}, height_post: {setting_text(every[0])}}}'; for "
            "all, write a row a bounce, with what is before and after it"
        )
    places = [
        (row, number) for row in range(len(cells)) for number, names in repeats.items()
        if not all(is_missing(cells.columns[name][row]) for name in names.values())
    ]  # fmt: skip
    made: dict[str, Cells] = {
        stem: [cells.columns[repeats[number][stem]][row] for row, number in places] for stem in stems
    }
    said = f"an impact for each of {every[0]!r} … {every[-1]!r} that is not empty"
    return _parted(cells, [row for row, _ in places], [number for _, number in places], shared, made, said)


def repeats_in(header: Sequence[str]) -> dict[int, dict[str, str]]:
    """Return columns by the number of the repeat and by their names without it; none of another table.

    They are heights or velocities after contact, beside what is before it.
    """
    families = dict[str, dict[int, str]]()
    for group in (2, 1):  # without the number, or without the word before it as well
        for name, match in [(each, one) for each in header for one in _NUMBER.finditer(each) if int(one[2])]:
            stem = " ".join(f"{name[: match.start(group)]} {name[match.end() :]}".split())
            families.setdefault(stem, {}).setdefault(int(match[2]), name)
    families = {stem: names for stem, names in families.items() if len(names) > 1}
    taken = {name for names in families.values() for name in names.values()}
    opposite = ["out"] if any("out" in name_words(name) for name in header) else []
    alone = recognised_columns([*(name for name in header if name not in taken), *opposite])[1].names
    if {*_OUTCOMES} & {*alone}:
        return {}
    found, used = dict[str, dict[int, str]](), set[str]()
    for stem, names in families.items():
        unit = "".join(_UNIT_AT_END.findall(stem))
        bare = stem if stem != unit or "height" not in alone else f"height {unit}".strip()  # trial 1 (cm), trial 2 (cm)
        known = {*recognised_columns([bare, *opposite])[1].names} - {"trial", "time"}
        if known and not used & {*names.values()}:
            used |= {*names.values()}
            found[f"{bare} after" if known & {"height", "speed"} & {*alone} else bare] = names
    numbers = max((one.keys() for one in found.values()), key=len, default=set[int]())
    found = {stem: names for stem, names in found.items() if names.keys() == numbers}
    known = recognised_columns([*alone.values(), *found, *opposite])[1].names
    before = {*alone, "height"} & {*known}  # others that are numbered too are vectors
    if not any(one in known and one.removesuffix("_post") in before for one in _OUTCOMES):
        return {}
    return {number: {stem: names[number] for stem, names in found.items()} for number in sorted(numbers)}


_OUTCOMES = ("vx_post", "vy_post", "vz_post", "speed_post", "height_post")
_ORDERS = 1000  # of repeats, of which one would fall in all rows, from which on they are one bounce after the other
_UNIT_AT_END = re.compile(r"\s*[\[(][^\])]*[\])]$")
_NUMBER = re.compile(r"([^\W\d_]*[ _.#]*)(?<![\d.,])(\d+)(?!\d|[.,]\d)")
"""A number in a name, with the word before it."""


def is_long(cells: Sheet) -> bool:
    """Return whether a table has a row a number, with names of quantities in a column."""
    return bool(_variable(cells))


def by_trial(cells: Sheet) -> Sheet:
    """Return a long table with a row a trial; any other table as it is.

    Raises:
        DataError: a quantity stands twice for one trial, or in two units; or it is not clear which column is which.
    """
    if not (variable := _variable(cells)):
        return cells
    long, columns = _long(cells, variable), cells.columns
    taken = {long.variable, long.value, long.unit, long.phase}
    kept = [name for name in cells.header if name not in taken]
    names = dict[tuple[str, str], str]()
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    first: dict[tuple[str, ...], int] = {}
    units: dict[tuple[str, str], str] = {}
    for row in range(len(cells)):
        phase = text_of(columns[long.phase][row]) if long.phase else ""
        quantity = text_of(columns[variable][row])
        time = "post" if time_of(phase) == "post" else ""
        unit = text_of(columns[long.unit][row]).strip("[]()") if long.unit else ""
        unit = "" if unit in ("-", "1") else unit
        if units.setdefault((quantity, time), unit) != unit:
            raise DataError(
                f"{cells.path}: row {row + 1}: {quantity!r} is in {unit or 'no unit'}, and in "
                f"{units[quantity, time] or 'no unit'} above; a quantity has one unit",
                row=row + 1,
            )
        if quantity in kept:  # as a name of the trial itself
            continue
        name = names.setdefault((quantity, time), f"{quantity}{' after' * bool(time)}{f' [{unit}]' * bool(unit)}")
        trial = tuple(text_of(columns[one][row]) for one in long.trials)
        first.setdefault(trial, row)
        numbers = rows.setdefault(trial, {})
        if name in numbers:
            said = ", ".join(f"{one}={cell}" for one, cell in zip(long.trials, trial, strict=True))
            raise DataError(
                f"{cells.path}: row {row + 1}: a second {name!r} of {said or 'the only trial'}; a long table has each "
                "quantity once a trial, and a column that says which trial it is",
                row=row + 1,
            )
        numbers[name] = columns[long.value][row]
    cells = cells.gathered([*first.values()])
    plain: dict[str, Cells] = {name: cells.columns[name] for name in kept}
    if len(long.trials) > 1:
        plain[long.trials[-1]] = ["/".join(trial) for trial in rows]
    made = ((name, [numbers.get(name) for numbers in rows.values()]) for name in names.values())
    said = f"a long table: {long.value!r} of each {long.variable!r}" + (f" and {long.phase!r}" if long.phase else "")
    return cells.with_columns([*plain.items(), *made], said)


def _variable(cells: Sheet) -> str | None:
    """The column with names of quantities, among them velocities."""
    for name, column in cells.columns.items():
        if not isinstance(column, list) or len(column) < _MIN_VARIABLES or not isinstance(column[0], str):
            continue
        if is_numeral(column[0]) or len({*map(text_of, column[: 2 * _MOST_VARIABLES])}) > _MOST_VARIABLES:
            continue
        quantities = {*map(text_of, column)}
        if len(quantities) <= _MOST_VARIABLES:
            known = {*recognised_columns([*quantities])[1].names}
            if len(known) >= _MIN_VARIABLES and len({"vx", "vy", "vx_post", "vy_post"} & known) > 1:
                return name
    return None


def _long(cells: Sheet, variable: str) -> _Long:
    """Which column of a long table is which."""
    columns, others = cells.columns, [name for name in cells.header if name != variable]
    unit = next((name for name in others if _UNITS.intersection(name_words(name)) or _are_units(columns[name])), None)
    phase = next((name for name in others if name != unit and _is_phase(columns[name])), None)
    others = [name for name in others if name not in (unit, phase)]
    values = [name for name in others if VALUES.intersection(name_words(name))]
    trial = recognised_columns(others)[1].names.get("trial")
    values = values or [
        name for name in others if name != trial and any(map(is_numeral, columns[name]))
        and 2 * len({*map(text_of, columns[name])}) >= len(cells)  # those of trials have blocks of rows
    ]  # fmt: skip
    beside = sum(any(map(is_numeral, column)) for column in columns.values())
    beside += len(cells.repeated) - len({*cells.repeated})
    if len(values) != 1 and beside > _MAX_BESIDE:
        raise DataError(
            f"{cells.path}: names of quantities stand below each other in its column {variable!r}, and {beside} "
            "columns of numbers beside them: is each column a trial? Then transpose the table: a row is an impact, "
            "each quantity has a column (in a spreadsheet: copy, paste special, transpose); else name the column "
            "of the values 'value'"
        )
    if len(values) != 1:
        seen = " or ".join(map(repr, values)) or "none"
        raise DataError(
            f"{cells.path}: is a long table, with names of quantities in its column {variable!r}, and the column of "
            f"their values may be {seen}: name it 'value'"
        )
    names = [name for name in others if name != values[0]]
    whole = [*map(text_of, columns[variable])]
    phases = [*map(text_of, columns[phase])] if phase else whole
    candidates = [(one,) for one in ([trial] if trial else names)]
    candidates += [(one, trial) for one in names if trial and one != trial]  # numbers begin again in each session
    for trials in candidates:
        keys = {*zip(whole, phases, *(map(text_of, columns[one]) for one in trials), strict=True)}
        if len(keys) == len(whole):
            return _Long(variable=variable, value=values[0], unit=unit, phase=phase, trials=trials)
    return _Long(variable=variable, value=values[0], unit=unit, phase=phase, trials=(trial,) if trial else ())


def _is_phase(column: Cells) -> bool:
    """Whether a column says what is after contact, and of other rows that they are before it, or at it."""
    texts = {*map(text_of, column)}
    plain = [text for text in texts if not time_of(text) and text and not _BEFORE.intersection(name_words(text))]
    return "post" in map(time_of, texts) and not plain


def _are_units(column: Cells) -> bool:
    texts = {*map(text_of, column)} - {""}
    return bool(texts) and len(texts) <= _MOST_VARIABLES and all(map(is_unit, texts))


def by_component(cells: Sheet, chosen: Collection[str]) -> Sheet:
    """Return a table of impacts with a column for each number of a vector; any other table as it is.

    Args:
        cells: the table.
        chosen: columns that settings name, which are left as they are.

    Raises:
        DataError: a column after contact holds vectors, and its name does not say of what.
    """
    cells = _by_number(cells, chosen)
    vectors = {
        name: parts for name, column in cells.columns.items()
        if name not in chosen and (parts := _parts(column, cells.numerals.decimal))
    }  # fmt: skip
    if not vectors:
        return cells
    sizes = {name: mode(map(len, filter(None, parts))) for name, parts in vectors.items()}
    opposite = any(times_in(name, opposite=True) == "post" for name in cells.header)
    plain = components_of({name: sizes.get(name, 1) for name in cells.header}, opposite=opposite)
    names = {name: plain[name] for name in vectors if plain.get(name)}
    turns = [name for name in vectors if name not in names and _is_unit(vectors[name])]
    known = recognised_columns([*cells.header, *chain.from_iterable(names.values())])[1].names
    if len(turns) == 1 and "wx" in known and not {"q0", "qw"} & {*known, *chain.from_iterable(names.values())}:
        names[turns[0]] = ("q0", "q1", "q2", "q3")
    names |= _twists({name: vectors[name] for name in vectors if name not in names}, opposite=opposite)
    changes = dict[str, dict[str, Cells]]()
    for name in (name for name in vectors if name in names):
        parts, size = vectors[name], len(names[name])
        odd = [None if part is None else text_of(cell) for cell, part in zip(cells.columns[name], parts, strict=True)]
        whole = [part if part and len(part) == size else [cell] * size for part, cell in zip(parts, odd, strict=True)]
        changes[name] = {one: [part[k] for part in whole] for k, one in enumerate(names[name])}
    made = cells.edited(changes, *(f"{name!r} holds {', '.join(names[name])}" for name in changes))
    if any(column in recognised_columns(made.header)[1].names for column in ("vx_post", "vy_post", "vz_post")):
        return made
    for name in vectors:
        if name not in names and times_in(name, opposite=opposite) == "post" and sizes[name] > 1:
            cell = next(cell for cell in cells.columns[name] if not is_missing(cell))
            raise DataError(
                f"{cells.path}: column {name!r} holds vectors of {sizes[name]} numbers, such as {text_of(cell)!r}, and "
                "it is not clear of what: write their numbers into columns of their own, such as vx_post, vy_post, "
                "omega_post (docs/tables.md), or call it velocity_after, spin_after or twist_after"
            )
    return cells


def are_vectors(cells: Sheet, name: str) -> bool:
    """Return whether a column has vectors in its cells."""
    return _parts(cells.columns[name], cells.numerals.decimal) is not None


def _by_number(cells: Sheet, chosen: Collection[str]) -> Sheet:
    """The table with names for the numbered components of vectors that stand in it before and after contact."""
    families = dict[str, list[str]]()
    for name in cells.header:
        if name not in chosen and (match := _COMPONENT.fullmatch(name)):
            families.setdefault(f"{match['vector']}{match['unit'] or ''}", []).append(name)
    families = {vector: names for vector, names in families.items() if 1 < len(names) < len("wxyz")}
    sizes = {vector: len(names) for vector, names in families.items()}
    opposite = any(times_in(name, opposite=True) == "post" for name in sizes)
    plain = components_of(sizes | dict.fromkeys(cells.header, 1), opposite=opposite)
    plain = {vector: plain[vector] for vector in families if plain.get(vector)}
    if not {"pre", "post"} <= {times_in(vector, opposite=opposite) for vector in plain}:
        return cells
    ours = {name: one for vector in plain for name, one in zip(families[vector], plain[vector], strict=True)}
    said = (f"{', '.join(map(repr, families[vector]))} are {', '.join(plain[vector])}" for vector in plain)
    return cells.renamed(ours, *said)


_COMPONENT = re.compile(r"(?P<vector>.*[^\W\d])[_ .]?[(\[]?[0-3][)\]]?(?P<unit>\s*[\[(][^\])\d]+[\])])?")


def _is_unit(parts: list[list[Any] | None]) -> bool:
    """Whether vectors have four components and length 1, as quaternions."""
    whole = [part for part in parts if part and len(part) == len("wxyz") and not any(map(is_missing, part))]
    try:
        lengths = np.linalg.norm(np.array(whole, float), axis=-1)
    except ValueError:  # decimal commas
        return False
    return len(whole) > len(parts) / 2 and bool(np.allclose(lengths, 1, atol=_OF_LENGTH_1))


def _twists(vectors: Mapping[str, list[list[Any] | None]], *, opposite: bool) -> dict[str, tuple[str, ...]]:
    """Components of the only two vectors of six numbers before and after contact, if one half goes to one side."""
    whole = {name: parts for name, parts in vectors.items() if all(part and len(part) == 6 for part in parts)}
    times = {times_in(name, opposite=opposite): name for name in whole}
    if len(whole) != 2 or times.keys() != {"pre", "post"}:
        return {}
    one_sided = np.abs(np.sign(np.array(whole[times["pre"]], float)).mean(0))
    linear_first, linear_last = (one_sided[half].max() > _ONE_SIDED for half in (slice(0, 3), slice(3, 6)))
    if linear_first == linear_last:
        return {}
    order = ("vx", "vy", "vz", "wx", "wy", "wz") if linear_first else ("wx", "wy", "wz", "vx", "vy", "vz")
    return {times["pre"]: order, times["post"]: tuple(f"{one}_post" for one in order)}


_ONE_SIDED = 0.9  # share of impacts by which one sign of the normal velocity is more frequent, as of no spin
_OF_LENGTH_1 = 1e-3  # of a quaternion with four decimals


def _parts(column: Cells, decimal: str) -> list[list[Any] | None] | None:
    """The numbers of each cell of a column of vectors, None of an empty cell; None of any other column."""
    if not isinstance(column, list):
        return None
    first = next((cell for cell in column if not is_missing(cell)), None)
    if first is None or not numbers_in(first, decimal):
        return None
    parts = [None if is_missing(cell) else numbers_in(cell, decimal) or [] for cell in column]
    return parts if 2 * sum(map(bool, parts)) > len(parts) - parts.count(None) else None


def numbers_in(cell: Any, decimal: str) -> list[Any] | None:
    """Return the numbers of a vector, as text if it is text; None if the cell is none."""
    if isinstance(cell, str):
        if is_numeral(cell) or not (match := _VECTOR.fullmatch(_SCALAR.sub(r"\1", cell.strip()))):
            return None
        inside = match["inside"] if match["inside"] is not None else match["bare"]
        marks = r"[;|]" if re.search("[;|]", inside) else r"\s" if decimal == "," else r"[\s,]"
        parts = [part for part in re.split(rf"\s*{marks}\s*", inside.strip()) if part]
        parts = parts[:-1] if parts[-1:] in (["true"], ["false"]) else parts  # whether the norm of a quaternion is 1
        if match["bare"] is not None and len(parts) < 2:
            return None
    elif isinstance(cell, list | tuple) or (isinstance(cell, np.ndarray) and cell.ndim):
        parts = [*(cell.tolist() if isinstance(cell, np.ndarray) else cell)]
    else:
        return None
    return parts if parts and all(is_numeral(part) or is_missing(part) for part in parts) else None
