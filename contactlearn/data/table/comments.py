"""Units that comments above the header state, as a row of units below it does.

    # lengths in mm, velocities in mm/s, angles in deg      x, vx, theta are read as x [mm], vx [mm/s], theta [deg]
    # units: mm, mm/s, deg                                  the same

A column keeps the unit of its own name.  Comments with two readings are not read, and said to be so.
"""

import re
from collections.abc import Iterator, Sequence

from contactlearn.data.table.names import impact_vocabulary, name_words, recognise, unit_as_written
from contactlearn.data.table.units import powers_of
from contactlearn.mechanics.space import PLANE

_QUANTITIES = {
    "x": {f"{word}{end}" for word in ("length", "position", "distance", "coordinate") for end in ("", "s")}
    | {"heights"},
    "vx": {"velocity", "velocities", "speed", "speeds"},
    "theta": {"angle", "angles", "orientation", "orientations"},
    "mass": {"mass", "masses"},
    "time": {"time", "times"},
    "inertia": {"inertia", "inertias", "moment", "moments"},
    "omega": {"spin", "spins", "rate", "rates"},
}
"""A column of each unit, and the words for it in comments."""
_ANGULAR = {"angular", "rotational", "rotation", "turning"}
_BESIDE = {"all", "the", "of", "are", "is", "given", "measured", "written", "linear", "translational", "and", "for"}
_CLAUSE = re.compile(r"(?P<what>[^\d(\[:=]+?)\s*(?:\bin\b|[:=(\[])\s*(?P<unit>[^)\]]+?)\s*[)\]]?")
_MENTIONED = re.compile(
    r"(?<![\d\w/])(?<!\d )(?:[mcµμuk]?m|deg|degrees|°|rad|radians|rpm|rev|inch(?:es)?|ft|feet|kg|grams|mph|ms)"
    r"(?:/\w+)?(?![\w])"
)


def with_units(names: Sequence[str], comments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return names of columns with the units that comments state for them, and what was understood, in words.

    Args:
        names: of columns; those of a table without velocities after contact stay as they are.
        comments: lines above them.
    """
    known = recognise(names, impact_vocabulary(PLANE))
    silent = {column: name for column, name in known.names.items() if powers_of(column) and column not in known.units}
    texts = [comment.strip().lstrip("#%/ ") for comment in comments]
    if not silent or not {"vx_post", "vy_post"} & {*known.names}:
        return [*names], ()
    stated: dict[str, set[str]] = {}
    for text in texts:
        for column, unit in _statements(text, names):
            stated.setdefault(column, set()).add(unit)
    if all(len(units) == 1 for units in stated.values()):
        of_quantity = [(powers_of(column), unit) for column, (unit,) in stated.items() if column in _QUANTITIES]
        units = {
            name: next((unit for powers, unit in of_quantity if powers == powers_of(column)), None)
            for column, name in silent.items()
        }
        units |= {known.names.get(column, column): unit for column, (unit,) in stated.items() if column in silent}
        if any(units.values()):
            with_them = [f"{name} [{unit}]" if (unit := units.get(name)) else name for name in names]
            return with_them, ("units as the comments above the header state them",)
    mentioned = next((text for text in texts if _MENTIONED.search(text) and "SI" not in text), None)
    return [*names], (f"comments mention units, and are not read: {mentioned!r}",) if mentioned else ()


def _statements(text: str, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Columns, or one of each quantity, with the units that a line states for them."""
    pending, listing = list[str](), False
    for clause in re.split(r"[,;]\s*|\.(?:\s+|$)|\band\b", text):
        parts = _CLAUSE.fullmatch(clause.strip())
        unit = parts["unit"] if parts else clause.strip()
        listing = listing or (parts is not None and name_words(parts["what"])[-1:] in (("unit",), ("units",)))
        if listing:
            yield from ((column, unit) for column in _QUANTITIES if unit_as_written(unit, column))
            continue
        column = _column(parts["what"] if parts else clause, names)
        pending = [*pending, column] if column else []
        if parts is not None:
            yield from ((one, unit) for one in pending if unit_as_written(unit, one))
            pending = []


def _column(what: str, names: Sequence[str]) -> str:
    """The column that a clause is about, or one of its quantity; empty if it is about neither."""
    words = tuple(word for word in name_words(what) if word not in _BESIDE)
    if words and _ANGULAR.intersection(words):
        return "omega" if len(words) == 1 or not _QUANTITIES["theta"].intersection(words) else ""
    quantity = next((column for column, known in _QUANTITIES.items() if words and known.issuperset(words)), "")
    if quantity:
        return quantity
    known = recognise([name for name in names if name_words(name) == words], impact_vocabulary(PLANE))
    return next(iter(known.names), "")
