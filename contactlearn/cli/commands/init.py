"""The command init: the settings of a user's measurements in a YAML file, for `data=NAME` on every command."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from contactlearn.cli.config_files import DATA_NAME, choices, own_data
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import atomic_write
from contactlearn.data.headers import OPEN, FileContents, Setting, propose

_SECTIONS = {
    "columns": "our name: that in the file; others have our names, or are not used",
    "units": "in which the file is written; all others follow",
}
_KINDS = {"table": "a table of impacts, docs/tables.md", "tracks": "recordings of tracked poses, docs/tracks.md"}


def write_settings(path: Path, name: str | None, stated: Mapping[str, Any] = MappingProxyType({})) -> str:
    """Write NAME.yaml in the working directory; return a summary of it, line by line.

    Args:
        path: a table of impacts, a recording, or a folder with recordings.
        name: NAME; None for that of the file.
        stated: settings by name, without `data.`, that are known already; `columns` say how a table is read.

    Raises:
        ContactLearnError: a name that `data=` cannot choose, or of another file; or the file cannot be written.
        DataError: see `contactlearn.data.headers.propose`.
    """
    word = name or re.sub(r"\W+", "_", path.resolve().stem, flags=re.ASCII).strip("_")
    word = f"data_{word}" if word[:1].isdigit() and name is None else word
    file = Path(f"{word}.yaml")
    if not DATA_NAME.fullmatch(word):
        raise ContactLearnError(f"--name is a word of the letters a to z, digits and _ for data=NAME, got {word!r}")
    if word in choices("data") and word not in own_data():
        raise ContactLearnError(f"data={word} is a source of this package; choose another name, --name my{word}")
    if file.exists():
        raise ContactLearnError(f"{file} exists already and is not replaced; edit it, or choose another --name")
    flat = {
        f"{key}.{inner}" if key in _SECTIONS else key: value
        for key, whole in stated.items()
        for inner, value in (whole.items() if key in _SECTIONS else [(key, whole)])
    }
    columns = stated.get("columns", {})
    of_frames = any(isinstance(value, list) for value in columns.values())  # position: [x, y]
    contents = propose(path, None if of_frames else columns)
    contents = replace(contents, settings=tuple(_with_stated(contents.settings, flat)))
    try:
        with atomic_write(file) as part:
            part.write_text(_text(path, word, contents), encoding="utf-8")
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error  # without the name of a temporary file
        raise ContactLearnError(f"{file}: cannot be written: {why}") from error
    missing = [setting.name for setting in contents.settings if setting.value == OPEN]
    verb = "is" if contents.source == "table" else "holds"
    lines = [f"{file} written: {path} {verb} {_KINDS[contents.source]}"]
    lines += [f"read as: {', '.join(contents.read_as)}"] if contents.read_as else []
    lines += (
        [f"fill in: {', '.join(missing)}: {'its line has' if len(missing) == 1 else 'each has'} a comment"]
        if missing
        else []
    )
    lines += [f"not used: {', '.join(map(repr, contents.unused))}"] if contents.unused else []
    first = f"contactlearn impacts data={word} -o impacts.parquet, " if contents.source == "tracks" else ""
    lines.append(f"next: {first}contactlearn audit data={word}, and data={word} on every command in this folder")
    lines += ["or: name its columns in one command", contents.column_listing] if contents.column_listing else []
    return "\n".join(lines)


def _with_stated(settings: Sequence[Setting], stated: Mapping[str, Any]) -> list[Setting]:
    """Settings with the values that are stated, and those that are stated only, each section in one piece."""
    found = {one.name: one for one in settings}
    for name, value in stated.items():
        comment = found[name].comment if name in found else "as stated"
        found[name] = Setting(name=name, value=value, comment=comment)
    sections = [*dict.fromkeys(name.rpartition(".")[0] for name in found)]
    places = {name: k for k, name in enumerate(found)}
    first = {section: min(places[name] for name in found if name.rpartition(".")[0] == section) for section in sections}
    return sorted(
        found.values(), key=lambda one: first[group] if (group := one.name.rpartition(".")[0]) else places[one.name]
    )


def _text(path: Path, name: str, contents: FileContents) -> str:
    """The file's text."""
    lines = [
        f"# {str(path)!r}, {_KINDS[contents.source]}: data={name} on every command in this folder.",
        "# A value of ??? must be filled in.",
        f"_target_: contactlearn.data.{contents.source}.load",
    ]
    section = ""
    for setting in contents.settings:
        group, _, key = setting.name.rpartition(".")
        lines += [f"{group}: # {_SECTIONS[group]}"] if group not in ("", section) else []
        section = group
        lines.append(f"{'  ' if group else ''}{key}: {_value(setting.value)} # {setting.comment}")
    return "\n".join([*lines, ""])


def _value(value: Any) -> str:
    """A value in a line of YAML, in which no text is a reference."""
    if value == OPEN:
        return OPEN
    literal = value.replace("${", "\\${") if isinstance(value, str) else value
    style = '"' if isinstance(value, str) and not value.isidentifier() else None
    written = yaml.safe_dump(literal, default_style=style, default_flow_style=True, allow_unicode=True, width=10**9)
    return written.removesuffix("\n").removesuffix("...").strip()
