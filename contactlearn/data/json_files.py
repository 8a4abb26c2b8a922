"""Files of JSON: one document, or a record a line."""

import json
import re
from pathlib import Path
from typing import Any

from contactlearn.core.errors import DataError
from contactlearn.data.packed import opened_text, size_of

_END = re.compile(r"[\w.+-]*\s*")  # of a text that breaks off, from its mistake on: the beginning of a word or number


def json_content(path: Path, *, most: int) -> Any:
    """Return the content of a file; that of records a line is a list of them.

    Args:
        path: the file.
        most: bytes that it may have.

    Raises:
        DataError: it is larger, no JSON, or breaks off before its end.
    """
    if size_of(path) > most:
        raise DataError(f"{path}: is larger than {most >> 20} MiB; split it, or export it as Parquet or CSV")
    try:
        with opened_text(path, encoding="utf-8-sig") as file:
            text = file.read()
    except UnicodeDecodeError:
        raise DataError(f"{path}: is no JSON: it must be UTF-8 text throughout") from None
    try:
        return _parsed(path, text)
    except _SeveralError:
        lines = enumerate(text.splitlines())
        return [_parsed(path, line, above) for above, line in lines if line.strip()]


class _SeveralError(DataError):
    """A text goes on after its first value."""


def _parsed(path: Path, text: str, above: int = 0) -> Any:
    """Return the value of a text with so many lines above it."""
    try:
        return json.loads(text)
    except RecursionError:
        raise DataError(f"{path}: is no JSON that can be read: it is nested too deeply") from None
    except json.JSONDecodeError as error:
        place = f"line {above + error.lineno}, column {error.colno}"
        if error.msg == "Extra data":
            raise _SeveralError(f"{path}: is no JSON: a value ends before {place}") from None
        if "Unterminated" in error.msg or _END.fullmatch(error.doc, error.pos):
            why = "as a download that was interrupted; copy or export the file again"
            raise DataError(f"{path}: is no whole JSON: it breaks off at {place}, {why}") from None
        raise DataError(f"{path}: is no JSON: {error.msg} at {place}") from None
