"""The error of a function that is given a DataFrame, a path or an array where it asks for impacts."""

from contactlearn.errors import ContactLearnError
from contactlearn.impacts import Impacts


def check_impacts(given: object) -> None:
    """Refuse what are no impacts.

    Raises:
        ContactLearnError: with the way from a table to impacts.
    """
    if isinstance(given, Impacts):
        return
    kind = type(given).__name__
    written = "frame.to_csv('drops.csv', index=False) writes one, and " if kind == "DataFrame" else ""
    raise ContactLearnError(
        f"impacts are asked for, got {kind}; {written}contactlearn.data.table.load('drops.csv', shape=…) reads a table"
    )
