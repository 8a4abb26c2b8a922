"""Frozen dataclasses as JSON text and back, for the files that results are kept in.

`to_json` writes a dataclass, `from_json` reads the same dataclass and checks everything: every entry has the declared
type, every number is finite, and a file that is too large or nested too deeply is refused.  Where a float may be
missing (`float | None`), a number that is not finite is written as null; elsewhere it is refused.  Fields that the
type does not declare are ignored, so that a file of a newer version with more in it can be read.

This is not a checkpoint: tensors are kept by `contactlearn.models.checkpoint`.
"""

import re
from typing import Any, TypeVar

import msgspec

from contactlearn.core.errors import ContactLearnError

LARGEST_FILE = 64 * 2**20
"""Size in bytes above which a text is refused."""
DEEPEST_NESTING = 40
"""Levels of objects and lists in each other above which a text is refused."""

Kind = TypeVar("Kind")
_MISSING = "Object missing required field"


def to_json(value: object) -> str:
    """Encode a dataclass as indented JSON in UTF-8, with a line end.

    Raises:
        ContactLearnError: an entry that the declared type of its field does not allow, such as nan for a `float`, or a
            text that UTF-8 cannot hold.
    """
    try:
        text = msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n"
    except UnicodeEncodeError as error:
        raise ContactLearnError(f"a text is not Unicode: {error.object!r}; is it the name of a file?") from None
    from_json(type(value), text)
    return text


def from_json(kind: type[Kind], text: str | bytes) -> Kind:
    """Decode JSON as an instance of a dataclass.

    Raises:
        ContactLearnError: in one line, which entry breaks which rule.
    """
    content = parsed(text)
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise ContactLearnError(_explained(error, content, kind)) from None


def parsed(text: str | bytes) -> Any:
    """Decode JSON as plain objects, lists, texts and finite numbers.

    Raises:
        ContactLearnError: the text is no JSON, is too large, or is nested too deeply.
    """
    if len(text) > LARGEST_FILE:
        raise ContactLearnError(f"is larger than {LARGEST_FILE >> 20} MiB")
    try:
        content = msgspec.json.decode(text)
    except RecursionError:
        raise ContactLearnError(f"is nested too deeply: the limit is {DEEPEST_NESTING} levels") from None
    except (msgspec.DecodeError, UnicodeError) as error:
        raise ContactLearnError(f"is not JSON, or was cut off: {_line(error)}") from None
    if _deep(content, DEEPEST_NESTING):
        raise ContactLearnError(f"is nested too deeply: the limit is {DEEPEST_NESTING} levels")
    return content


def _explained(error: msgspec.ValidationError, content: Any, kind: type) -> str:
    """Write the path of the entry that breaks a rule, and the rule: `errors.mirtich.low: expected float, got str`."""
    rule, _, where = _line(error).partition(" - at `$")
    path, here = [], content
    for step in re.findall(r"\[[^]]*\]|[^.[]+", where.removesuffix("`")):
        if step == "[...]":  # msgspec does not say which key
            step = _first_wrong(content, here, kind, str(error))
        elif step[0] == "[":
            step = int(step[1:-1])
        path.append(str(step))
        here = here[step]
    missing = rule.startswith(_MISSING)
    if missing:
        path.append(rule.split("`")[1])
    name = "".join(c if c.isprintable() else " " for c in ".".join(path)) or "the file"
    if missing:
        return f"{name} is not there: not from this program, or from another version of it"
    return f"{name}: {rule[:1].lower()}{rule[1:].replace('`', '')}"


def _first_wrong(content: Any, entries: dict[str, Any], kind: type, message: str) -> str:
    """Name the first wrong one of the entries, an object within `content`, which then holds that entry alone.

    Halves of the entries are tried: a half with the wrong entry in it gives the same message again.
    """
    items = list(entries.items())
    while len(items) > 1:
        first, second = items[: len(items) // 2], items[len(items) // 2 :]
        _replace(entries, first)
        items = first if _message(content, kind) == message else second
    _replace(entries, items)
    return items[0][0]


def _replace(entries: dict[str, Any], items: list[tuple[str, Any]]) -> None:
    entries.clear()
    entries.update(items)


def _message(content: Any, kind: type) -> str:
    """The message of the rule that the content breaks; empty if none."""
    try:
        msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        return str(error)
    return ""


def _deep(content: Any, levels: int) -> bool:
    inner = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    return levels == 0 or any(_deep(one, levels - 1) for one in inner)


def _line(error: Exception) -> str:
    return str(error).splitlines()[0]
