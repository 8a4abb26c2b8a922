"""Every error that contactlearn raises on purpose.

Each message says the rule, the value seen and the likely fix.  `suggest` adds the nearest
known names when a name is not one of them.
"""

import re
import unicodedata
from collections.abc import Iterable


class ContactLearnError(ValueError):
    """Base of all errors that a user can fix; its text is meant to be read alone."""


class DataError(ContactLearnError):
    """Measurements that break a rule of `Impacts` or of a data file.

    `row` (from 1) and `column` (by our name) are None where it is no single one.
    """

    def __init__(self, message: str, *, row: int | None = None, column: str | None = None):
        super().__init__(message)
        self.row, self.column = row, column

    def shifted_by(self, rows: int) -> "DataError":
        """Return the error with the row counted from the start of the table, `rows` rows above the block."""
        text = re.sub(r"(?<=[:;f] row )\d+", lambda number: str(int(number[0]) + rows), str(self))
        return DataError(text, row=self.row and self.row + rows, column=self.column)


class UnknownLayoutError(DataError):
    """A file whose columns are not known: its text goes on with a line for each, and the command that names them."""


class UnknownNameError(ContactLearnError):
    """A law, variant, column, norm … that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str], hint: str = ""):
        known = list(known)
        self._arguments = (kind, name, known, hint)
        listed = f"; known: {', '.join(known)}" if known else ""
        super().__init__(f"unknown {kind} {name!r}{hint or suggest(name, known)}{listed}")

    def __reduce__(self):  # so that it can come back from a worker process
        return type(self), self._arguments


def suggest(name: str, known: Iterable[str], least: float = 0.5) -> str:
    """Return ", did you mean 'x'?" for the nearest known name of at least this similarity, or an empty string."""
    from difflib import get_close_matches

    near = get_close_matches(str(name), list(known), n=1, cutoff=least)
    return f", did you mean {near[0]!r}?" if near else ""


def no_attribute(module: str, name: str, known: Iterable[str]) -> AttributeError:
    """Return the error of a name that a module lacks, with the nearest one and all that it has."""
    known = list(known)
    return AttributeError(
        f"module {module!r} has no attribute {name!r}{suggest(name, known)}; known: {', '.join(known)}"
    )


def install_hint(extra: str) -> str:
    """Return how an optional part is installed, in words."""
    return f"pip install 'contactlearn[{extra}]', or '.[{extra}]' in a checkout"


def terminal_safe(text: str) -> str:
    """Return text as a terminal may be given it: characters that steer one, and invisible ones, become "?".

    Names of columns, files, trials and settings come from others, and may hold escape sequences.  Line ends stay.
    """
    return "".join("?" if unicodedata.category(c) in _STEERING and c not in "\n\t" else c for c in text)


_STEERING = ("Cc", "Cf", "Cs")  # control, format such as turned directions of writing, halves of pairs
