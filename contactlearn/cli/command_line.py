"""The words of a command line as Hydra takes them: its flags, and settings with paths as a shell gives them.

Hydra reads values by a grammar of its own, in which `Kügel.csv`, `a&b.csv` and `a,b.csv` are errors or several values.
Paths are quoted for it here, and `~` is the home folder.  A comma between paths stays a sweep, unless a file has that
name.
"""

import argparse
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, Quote, QuotedString
from hydra.errors import HydraException

from contactlearn.core.errors import ContactLearnError, suggest

_PATHS = re.compile(r"[+~]*((\w[\w -]*\.)*(path|dir)|checkpoint)")
"""Settings whose values are paths."""
_QUOTED = re.compile(r"(['\"]).*\1", re.DOTALL)
_LETTERS = re.compile(r"""("(?:\\.|[^"])*"|'(?:\\.|[^'])*')|([^\s,:{}\[\]="'$]*[^\x00-\x7f][^,:{}\[\]="'$]*)""")
_CALL = re.compile(r"(choice|glob|sort|shuffle|range|interval|tag|str|extend_list)\(.*\)", re.DOTALL)
_FLAGS = (
    ("--help", "-h"), ("--hydra-help",), ("--version",), ("--settings",), ("--run", "-r"), ("--multirun", "-m"),
    ("--resolve",),
)  # fmt: skip
_TAKING = ("--cfg", "-c"), ("--package", "-p"), ("--config-name", "-cn"), ("--info", "-i")
_MISTYPED_FLAG = 0.7  # similarity to a flag, from which on a word is taken for it: --data is no --package
_INFO = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ContactLearnError(f"{message}; --help explains the command line")


@dataclass(frozen=True, kw_only=True)
class CommandLine:
    """A command line.

    Args:
        flags: for Hydra, before the words.
        words: settings.
        folders: with configuration files of the user's: those in place of the shipped ones, and those beside them.
        several: whether it is a sweep.
        config_name: of the user's own configuration, in place of the command's.
    """

    flags: tuple[str, ...]
    words: tuple[str, ...]
    folders: tuple[str | None, str | None]
    several: bool
    config_name: str | None


def parse_command_line(given: Sequence[str]) -> CommandLine:
    """Sort the words of a command line into flags and settings, in whatever order they come.

    Raises:
        ContactLearnError: a flag that does not exist, or that would unpickle a file.
    """
    parser = _Parser(add_help=False, allow_abbrev=False)
    for names in _FLAGS:
        parser.add_argument(*names, action="store_true")
    parser.add_argument("--shell-completion", "-sc", action="store_true")
    for names in (("--config-path", "-cp"), ("--config-dir", "-cd"), ("--experimental-rerun",), *_TAKING[:-1]):
        parser.add_argument(*names)
    parser.add_argument(*_TAKING[-1], nargs="?", const="all", choices=_INFO)
    parser.add_argument("--verbose", action="store_true")
    following = [*given[1:], ""]
    options, words = parser.parse_known_args(
        # a setting behind --info is no value of it
        [
            "--info=all" if word in ("--info", "-i") and after not in _INFO else word
            for word, after in zip(given, following, strict=False)
        ]
    )
    words = [word for word in words if word != "--"]  # what follows is no flag: settings are none anyway
    unknown = next((word for word in words if word.startswith("-")), None)
    if unknown is not None:
        known = [name for action in parser._actions for name in action.option_strings if name.startswith("--")]
        key, _, value = unknown.lstrip("-").partition("=")
        near = suggest(unknown, known, _MISTYPED_FLAG) or f"; settings are written {key}={value or 'VALUE'}"
        raise ContactLearnError(f"unknown flag {unknown!r}{near}")
    if options.experimental_rerun is not None:
        raise ContactLearnError(
            "--experimental-rerun would unpickle a file, which can run anything; overrides.yaml in the folder .hydra "
            "of a run has its settings, to be typed again"
        )
    showing = "hydra_help", "settings", "version", "shell_completion", "cfg", "info"
    shown = [name for name in showing if getattr(options, name)]
    if len(shown) + options.multirun > 1:
        raise ContactLearnError(
            f"--{shown[0].replace('_', '-')} shows something and runs nothing; take out the other flag"
        )
    if options.hydra_help:
        words = []
    for word in words:
        if re.match(r"[+~]*hydra\.searchpath\b|[^=]*@[^=]*\bhydra\b", word):
            raise ContactLearnError(f"{word} would take configuration files unread; use --config-dir FOLDER")
    several = options.multirun or any(re.fullmatch(r"[+]*hydra\.mode=MULTIRUN", word) for word in words)
    options.multirun = several
    flags = [names[0] for names in _FLAGS if getattr(options, names[0].strip("-").replace("-", "_"))]
    flags += ["--shell-completion"] if options.shell_completion else []
    for name, *_ in _TAKING:
        value = getattr(options, name.strip("-").replace("-", "_"))
        flags += [f"{name}={value}"] if value is not None else []
    folders = [
        None if one is None else os.path.abspath(_home(one)) for one in (options.config_path, options.config_dir)
    ]
    for folder in folders:
        if folder is not None and not os.path.isdir(folder):
            raise ContactLearnError(f"{folder}: no such folder of configuration files")
    words += ["verbose=true"] if options.verbose else []
    return CommandLine(
        flags=tuple(flags),
        words=tuple(words),
        folders=(folders[0], folders[1]),
        several=several,
        config_name=options.config_name,
    )


def quoted(words: Sequence[str], *, several: bool = False) -> list[str]:
    """Return settings with paths, and texts of letters beyond ASCII, quoted as Hydra's grammar wants them.

    Args:
        words: as a shell gives them.
        several: whether a comma sweeps.

    Raises:
        ContactLearnError: a word that Hydra cannot read, or that has several values without a sweep.
    """
    found = [_with_quoted_letters(_quoted_path(word)) for word in words]
    for word in found:
        override = parse_override(word)
        if override.is_sweep_override() and not several:
            raise ContactLearnError(
                f"{word} has several values: add -m to run each; a list stands in brackets, {_key(word)}=[…,…], and a "
                f"text with a comma in double quotes, '{_key(word)}=\"…\"'"
            )
    return found


def one_of_each(words: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Return what a sweep is over, and the settings of jobs, each of which differs from the first in one value.

    A range without steps, which some sweepers sample from, is left out.
    """
    overrides = [parse_override(word) for word in words]
    swept = [override for override in overrides if override.is_sweep_override()]
    values = {
        override.input_line: [f"{override.get_key_element()}={value}" for value in override.sweep_string_iterator()]
        for override in swept
        if override.is_discrete_sweep()
    }
    left = {override.input_line for override in swept} - values.keys()
    first = [values.get(word, [word])[0] for word in words if word not in left]
    others = [
        [value if word == line else values.get(word, [word])[0] for word in words if word not in left]
        for line, several in values.items()
        for value in several[1:]
    ]
    return [override.get_key_element().lstrip("+") for override in swept], [first, *others]


def parse_override(word: str) -> Override:
    """Read a setting by Hydra's grammar.

    Raises:
        ContactLearnError: it is no setting, or one that cannot be read.
    """
    try:
        return OverridesParser.create().parse_override(word)
    except HydraException as error:
        key, equals, value = word.partition("=")
        if not equals and not word.startswith("~"):
            of_file = re.search(r"[/\\]|\.\w+$", word)
            how = data_from(word) if of_file else "settings are written key=value, and --settings lists them"
            raise ContactLearnError(f"{word!r} is no setting; {how}") from error
        if value.rstrip().endswith(","):
            raise ContactLearnError(f"{word} ends in a comma: write a list as '{key}=[…,…]', in quotes") from error
        for opening, closing in ("[]", "{}"):
            if value.count(opening) != value.count(closing) and not re.search(r"['\"]", value):
                more, less = (opening, closing) if value.count(opening) > value.count(closing) else (closing, opening)
                raise ContactLearnError(f"{word} has more {more} than {less}") from error
        seen = " ".join(str(error).partition("See https")[0].split())
        raise ContactLearnError(
            f'{word} cannot be read: {seen}; text with brackets, = or the like stands in double quotes: {{x: "x (mm)"}}'
        ) from error


def data_from(path: str | Path) -> str:
    """How a file becomes the data of a command."""
    return f"say data=table data.path={path}, or write its settings with `contactlearn init {path} --name NAME`"


def _with_quoted_letters(word: str) -> str:
    key, equals, value = word.partition("=")
    return key + equals + _LETTERS.sub(lambda found: found[1] or f'"{found[2].rstrip()}"', value)


def _quoted_path(word: str) -> str:
    key, equals, value = word.partition("=")
    if not equals or not _PATHS.fullmatch(key) or value in ("", "null", "???"):
        return word
    if _QUOTED.fullmatch(value) and not os.path.exists(_home(value)):
        return f"{key}={value[0]}{_home(value[1:-1])}{value[-1]}"
    if os.path.exists(_home(value)):
        return f"{key}={quoted_path(value)}"
    if "${" in value or _CALL.fullmatch(value):
        return word
    if key.endswith("checkpoint") and value.startswith("[") and value.endswith("]"):
        return f"{key}=[{','.join(quoted_path(part.strip()) for part in value[1:-1].split(','))}]"
    if value.startswith("[") and key.endswith("data.path"):
        raise ContactLearnError(f"{word}: a path is that of one file or folder; join several tables into one")
    if key.lstrip("+").startswith("hydra."):  # Hydra sweeps over none of its own
        return f"{key}={quoted_path(value)}"
    return f"{key}={','.join(part if _QUOTED.fullmatch(part) else quoted_path(part) for part in value.split(','))}"


def quoted_path(path: str) -> str:
    """Return a path as a quoted text of Hydra's grammar, with the home folder for `~`."""
    text = _home(path).replace("${", "\\${")
    return (
        text
        if re.fullmatch(r"[A-Za-z./][\w./-]*[./][\w./-]*", text, re.ASCII)
        else QuotedString(text, Quote.single).with_quotes()
    )


def _home(path: str) -> str:
    """A path with the home folder for its `~`, unless a file is called so."""
    return os.path.expanduser(path) if path.startswith("~") and not os.path.exists(path) else path


def _key(word: str) -> str:
    return word.partition("=")[0]
