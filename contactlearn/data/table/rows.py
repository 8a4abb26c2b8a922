"""Rows of a file that are no impacts, and cells that stand for those below them.

    Mittelwert;1,23;…      a row of statistics: its first word, or that in a column of numbers, says so
    Trials 12 and 40 were repeated.      a note: the only cell of its row
    x;y;theta;…            the header again, as below a page break

Such rows are left out and named.  Nothing is decided by the numbers of a row.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from contactlearn.core.errors import DataError
from contactlearn.data.table.dialect import COMMENT, Header, is_blank, is_missing, is_numeral, text_of
from contactlearn.data.table.names import name_words
from contactlearn.data.table.sheet import Cells, Sheet

_STATISTIC = (
    r"mean|average|avg|mittelwert|mittel|durchschnitt|moyenne|moy|media|promedio|(?:the )?standard[ -]?(?:dev|err|"
    r"abw|fehl|avv|afw|uncert)\w*\.?|s\.? ?d\.?|s\.? ?e\.? ?m\.?|st\.?d?\.?[ .-]*(?:dev|abw)\w*\.?|[ée]cart[- ]?type|"
    r"medelvärde|medel|gemiddelde?|gem\.|średnia|keskiarvo|průměr|média|среднее|"
    r"odchylenie|odchylka|desvio|ст\.? ?откл\w*|desviaci[óo]n|deviazione|median|m[ée]diane|mediana|"
    r"varian(?:ce|z)|varianza|rms"
)
_BEGIN = 2  # letters with which the words begin: few rows begin with these
_BEGINNINGS = {"me", "mé", "av", "mi", "du", "mo", "pr", "th", "st", "s.", "sd", "s ", "se", "éc", "ec", "de", "va",
               "rm", "n=", "n ", "n:", "ge", "śr", "ke", "od", "ср", "ст"}  # fmt: skip
_STATISTICAL = re.compile(rf"(?:{_STATISTIC})(?:\W.*)?|n ?[=:].*", re.IGNORECASE | re.DOTALL)
_COUNTED = re.compile(
    r"(?:totale?|sum|summe|somme|suma|somma|min\w*|max\w*|anzahl|count|range|n|σ|s)[.:]?", re.IGNORECASE
)
"""Words that may be names of groups, too: of statistics only where the other cells of the column are numbers."""
_OF_BODY = re.compile(r"\b(?:mass|masse|masa|massa|diameter|durchmesser|diamètre|radius|m)\s*[=:]\s*\d", re.IGNORECASE)
"""In the title of a further table it says that its body is another one."""
_RULE = re.compile(r"[-=_*~ .]{3,}")
_REMARKS = {"remark", "remarks", "comment", "comments", "note", "notes", "bemerkung", "bemerkungen", "kommentar",
            "remarque", "remarques", "commentaire", "observaciones", "notas", "osservazioni"}  # fmt: skip
_LABELLED = 3  # first columns among which a label of statistics stands
_LOOKED_AT = 1000  # rows that tell which columns are of numbers
_SHOWN = 3
_MOST_WORDS = 3  # of a name that stands for the rows below it

Row = tuple[int, list[Any]]
"""Its line, and its cells."""


@dataclass(frozen=True, kw_only=True)
class Impactful:
    """Rows that may be impacts, in words those that are none, and which columns are of numbers, for further rows."""

    rows: list[Row]
    read_as: tuple[str, ...]
    numeric: tuple[bool, ...]


def impactful(
    rows: Sequence[Row], header: Header, source: str, *, aligned: bool = False, numeric: tuple[bool, ...] | None = None
) -> Impactful:
    """Return the rows of a table without statistics, notes and further headers.

    Args:
        rows: below the header.
        header: of the table.
        source: of the rows, in errors.
        aligned: whether spaces separate the cells, so that a note has several.
        numeric: which columns are of numbers, where rows above these have told.

    Raises:
        DataError: titles between the rows are of further bodies.
    """
    width, again = len(header.names), {next(filter(None, row), ""): row for row in header.raw}
    suspects = dict[int, str]()
    for k, (_, cells) in enumerate(rows):
        label = next((cell for cell in cells if not is_blank(cell)), "")
        if isinstance(label, str) and (row := again.get(label.strip())) and (*map(text_of, cells),)[:width] == row:
            suspects[k] = "header"
        elif any(map(_is_statistic, (label, *cells[:_LABELLED]))):
            suspects[k] = "statistic"
        elif isinstance(label, str) and _COUNTED.fullmatch(label.strip()):
            suspects[k] = "count"
        elif (len(cells) != width or is_blank(cells[-1])) and _is_note(cells, width, aligned=aligned):
            suspects[k] = "note"
    suspects |= dict.fromkeys(_last_words(rows), "count") | suspects
    if numeric is None:
        others = [cells for k, (_, cells) in enumerate(rows) if k not in suspects and len(cells) == width]
        if 2 * len(others) < len(rows):  # words of statistics are names of groups
            return Impactful(rows=[*rows], read_as=(), numeric=())
        others = others[:_LOOKED_AT]
        numeric = tuple(2 * sum(is_numeral(cells[i]) for cells in others) > len(others) for i in range(width))
    titles = [text_of(next(filter(None, cells))) for k, (_, cells) in enumerate(rows) if suspects.get(k) == "note"]
    if bodies := [title for title in titles if _OF_BODY.search(title)]:
        raise DataError(
            f"{source}: tables of several bodies stand one below the other, such as that below {bodies[0]!r}: write "
            "one table, a row an impact, with columns object and mass, or a file for each body"
        )
    left = [k for k, kind in sorted(suspects.items()) if numeric and _is_left_out(rows[k][1], kind, numeric)]
    if not left:
        return Impactful(rows=[*rows], read_as=(), numeric=numeric)
    said = [f"{_label(rows[k][1])!r} (line {rows[k][0]})" for k in left]
    more = f" and {len(said) - _SHOWN} more" if len(said) > _SHOWN + 1 else ""
    shown = ", ".join(said[: _SHOWN if more else None])
    words = f"left out {len(left)} {'row that is no impact' if len(left) == 1 else 'rows that are no impacts'}: "
    gone = {*left}
    kept = [row for k, row in enumerate(rows) if k not in gone]
    return Impactful(rows=kept, read_as=(f"{words}{shown}{more}",), numeric=numeric)


def _last_words(rows: Sequence[Row]) -> list[int]:
    """The last few rows that begin with a word, as those of statistics do in any language."""
    last = list[int]()
    for k in range(len(rows) - 1, -1, -1):
        label = next((cell for cell in rows[k][1] if not is_blank(cell)), None)
        if not isinstance(label, str) or is_missing(label) or any(map(str.isdigit, label)):
            break
        last.append(k)
    return last if 2 * len(last) < len(rows) else []


def _is_statistic(cell: Any) -> bool:
    """Whether a cell is the label of a row of statistics."""
    if not isinstance(cell, str) or cell.strip()[:_BEGIN].lower() not in _BEGINNINGS:
        return False
    return bool(_STATISTICAL.fullmatch(cell.strip()))


def _is_left_out(cells: Sequence[Any], kind: str, numeric: Sequence[bool]) -> bool:
    """Whether a row that may be no impact is none, as the columns of its texts tell."""
    place = next((i for i, cell in enumerate(cells) if not is_blank(cell)), 0)
    of_numbers = place < len(numeric) and numeric[place]
    if kind == "count":
        return of_numbers
    if kind == "note" and sum(not is_blank(cell) for cell in cells) == 1:  # or the name of a trial that was lost
        label = text_of(cells[place])
        return (
            of_numbers
            or len(label.split()) > 2
            or label.startswith((*COMMENT, "*", "†", "¹"))
            or bool(_RULE.fullmatch(label))
        )
    return True


def _is_note(cells: Sequence[Any], width: int, *, aligned: bool) -> bool:
    """Whether a row is a text across the table, and not a row that is cut off."""
    place = next((i for i, cell in enumerate(cells) if not is_blank(cell)), 0)
    label, split = cells[place], aligned and len(cells) != width
    if not isinstance(label, str) or (not split and not all(map(is_blank, cells[place + 1 :]))):
        return False
    words = [word for cell in cells for word in str(cell).split() if any(map(str.isalpha, word))]
    if split and is_numeral(label) and len(words) > _MOST_WORDS:  # a page's number, and a running title
        return 2 * sum(map(is_numeral, cells)) <= len(cells)
    if is_numeral(label) or is_missing(label):
        return False
    if split:
        return 2 * sum(map(is_numeral, cells)) <= len(cells) and any(map(str.isalpha, label))
    return len(label.split()) > 1 or len(cells) == width or bool(_RULE.fullmatch(label))


def _label(cells: Sequence[Any]) -> str:
    """A few words of a row."""
    whole = " ".join(text_of(cell) for cell in cells if not is_numeral(cell) and not is_blank(cell))
    return whole if len(whole) <= 40 else f"{whole[:37]}…"


def filled_down(cells: Sheet) -> Sheet:
    """Return a sheet in which a name that stands in the first row of its rows only, as in a merged cell, is in all."""
    filled = {
        name: {name: [*accumulate(column, lambda above, cell: above if is_blank(cell) else cell)]}
        for name, column in cells.columns.items()
        if is_merged(name, column)
    }
    said = f"{', '.join(map(repr, filled))} filled in from the row above, where it is empty"
    return cells.edited(filled, *[said] * bool(filled))


def is_merged(name: str, column: Cells) -> bool:
    """Return whether the names of a column are those of the rows below them, too, which are most of the rows."""
    if not isinstance(column, list) or not column or not isinstance(first := column[0], str):
        return False
    if is_blank(first) or is_numeral(first) or not any(map(is_blank, column)) or name == "trial":  # each has its own
        return False
    present = [cell for cell in column if not is_blank(cell)]
    return (
        2 * len(present) <= len(column)
        and all(isinstance(cell, str) and not is_numeral(cell) and len(cell.split()) <= _MOST_WORDS for cell in present)
        and not _REMARKS.intersection(name_words(name))
    )


def rows_joined(tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> tuple[list[dict[str, Any]], str] | None:
    """Return rows with the cells of several tables that a column of each joins, such as trial, and what was done.

    Columns of one name in several tables are called after these, too: before vx, after vx.

    Args:
        tables: their rows by their names.
    """
    headers = {table: [*dict.fromkeys(name for row in rows for name in row)] for table, rows in tables.items()}
    every = [name for header in headers.values() for name in header]
    if len(tables) < 2 or not all(tables.values()):
        return None
    for key in [name for name in dict.fromkeys(every) if every.count(name) == len(tables)]:
        by_key = {table: {text_of(row.get(key)): row for row in rows} for table, rows in tables.items()}
        first, *others = by_key.values()
        if any(len(by_key[table]) != len(rows) for table, rows in tables.items()) or "" in first:
            continue
        if all(one.keys() == first.keys() for one in others):
            found = [
                {key: row[key]}
                | {
                    f"{table} {name}" if every.count(name) > 1 else name: by_key[table][value].get(name)
                    for table, header in headers.items()
                    for name in header
                    if name != key
                }
                for value, row in first.items()
            ]
            return found, f"tables {' and '.join(tables)} joined by {key!r}"
    return None
