"""The shipped configuration files: the settings and choices that exist, and the nearest one to a misspelt name.

A setting that no file declares is refused, also after a `+`, by which Hydra would accept and the program ignore it.
A part that holds entries by name (`effect`, `model` …) is open: each entry is checked where it is read.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.config_groups import catalogue_names, choice_settings, has_choice, is_catalogued
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest

_PACKAGE = Path(__file__).parents[1]
CONFIGS = next(str(path) for path in (_PACKAGE / "configs", _PACKAGE.parent / "configs") if path.is_dir())
"""Beside the package in a checkout, inside it where it is installed."""
_OPEN = ("data", "law", "model", "effect", "candidate", "limits", "reference", "transfer.bodies")
_COMMANDS = ("train", "evaluate", "diagnose")
_REFUSED = re.compile(r"Could not (?:override|append to config|delete from config)[^']*'([^']+)'")


def groups() -> list[str]:
    """Return the names of all groups of choices."""
    folders = (path.name for path in Path(CONFIGS).iterdir() if path.is_dir())
    return sorted({*folders, "effect", "law"} - {"hydra"})


def choices(group: str) -> list[str]:
    """Return the names of the choices of a group."""
    if is_catalogued(group):
        return catalogue_names(group)
    return sorted(path.stem for path in Path(CONFIGS, group).glob("*.yaml"))


def check_choices(words: list[str]) -> None:
    """Raise for a choice that its group lacks, such as law=mirtisch; Hydra suggests nothing.

    Raises:
        UnknownNameError: with the nearest name.
    """
    for word in words:
        group, _, choice = word.lstrip("+").partition("=")
        if group not in groups() or "(" in choice:  # a setting, or a function of Hydra's
            continue
        for name in re.findall(r"\w+", choice):
            known = is_catalogued(group) and has_choice(group, name)
            if not known and name != "null" and name not in choices(group):
                raise UnknownNameError(group, name, choices(group))


def check_settings(cfg: DictConfig, command: str) -> None:
    """Raise for a setting that the command does not have.

    Raises:
        ContactLearnError: with the nearest setting.
    """
    if not Path(CONFIGS, f"{command}.yaml").exists():  # a configuration of the user's own, by --config-name
        return
    known = _declared(command)
    for key in _keys(OmegaConf.to_container(cfg)):
        if key not in known and key != "hydra":
            raise _unknown(key, known)


def explain_error(error: Exception, command: str, words: Sequence[str]) -> str:
    """Return Hydra's error on the words of a command in one line, with the nearest setting for an unknown one."""
    refused = _REFUSED.search(str(error))
    own = refused and re.fullmatch(r"(effect|candidate)\.(\w+)(\..+)?", refused[1])
    if own and f"Key {own[2]!r} is not in struct" in str(error.__cause__):
        return _not_there(*own.group(0, 1, 2))
    if refused:
        holders, near = _holders(refused[1]), _near_in_source(refused[1], words)
        if holders or refused[1] in _declared(command):
            others = f"other choices ({', '.join(holders)})" if holders else "other choices"
            return f"{refused[1]} is a setting of {others}, not of these{near}; --help lists all settings"
        return str(_unknown(refused[1], _declared(command) | _data_keys()))
    message = " ".join(str(error).partition("Config search path")[0].split())
    unread = any(sign in message for sign in ("Unknown function", "no viable alternative", "mismatched input"))
    return message + ('; text with brackets, = or the like stands in double quotes: {x: "x (mm)"}' if unread else "")


def _holders(key: str) -> list[str]:
    """The choices of data and laws that have a setting."""
    group, _, name = key.partition(".")
    named = choices(group) if group in ("data", "law") else []
    return [f"{group}={choice}" for choice in named if name in _settings(group, choice)]


def _near_in_source(key: str, words: Sequence[str]) -> str:
    """The nearest setting of the data source that the words choose."""
    chosen = [word.removeprefix("data=") for word in words if word.startswith("data=")]
    there = chosen and chosen[-1] in choices("data")
    known = _settings("data", chosen[-1]) if there else {}
    return suggest(key.removeprefix("data."), known) if key.startswith("data.") else ""


def _not_there(key: str, group: str, name: str) -> str:
    """Say how an effect comes into a model whose settings were given, but not the effect."""
    known = choices("effect")
    if group == "effect" and name in known:
        return f"{key} is a setting of an effect that is not in the model; add effect=[{name}]"
    near = suggest(name, known) if group == "effect" else ""
    return f"{key}: no {group} is called {name!r}{near}; one of your own is added with a plus, +{key}=…"


def _unknown(key: str, known: set[str]) -> ContactLearnError:
    others = [f"{command}.py" for command in _COMMANDS if key in _declared(command)]
    if others:
        return ContactLearnError(
            f"{key} is a setting of {' and '.join(others)} alone; --help lists all of this command"
        )
    last = {name.rpartition(".")[2]: name for name in known}
    near = suggest(key, known) or suggest(last.get(key.rpartition(".")[2], ""), known)
    return ContactLearnError(f"unknown setting {key!r}{near}; --help lists all settings")


@lru_cache
def _declared(command: str) -> set[str]:
    """Dotted keys of all settings of a command, those of the experiments with them."""
    files = [Path(CONFIGS, f"{command}.yaml")]
    own = _content(files[0])
    known = set(_keys(own)) | {one for one in _OPEN[:3] if "." not in one}
    for path in sorted(Path(CONFIGS, "experiment").glob("*.yaml")) if "transfer" in own else []:
        known |= {key for key in _keys(_content(path)) if key.partition(".")[0] in own}
    return known - {"defaults", "hydra"}


@lru_cache
def required_settings(command: str) -> list[str]:
    """Return the dotted keys of all settings that a command's own file declares, each part before its settings."""
    own = _content(Path(CONFIGS, f"{command}.yaml"))
    return ["data", "law", *(key for key in _keys(own) if key.partition(".")[0] not in ("defaults", "hydra"))]


@lru_cache
def _data_keys() -> set[str]:
    return {f"data.{key}" for path in Path(CONFIGS, "data").glob("*.yaml") for key in _content(path)}


def _settings(group: str, choice: str) -> dict[str, Any]:
    """Settings of one choice of a group."""
    return choice_settings(group, choice) if is_catalogued(group) else _content(Path(CONFIGS, group, f"{choice}.yaml"))


def _content(path: Path) -> dict[str, Any]:
    found = OmegaConf.to_container(OmegaConf.load(path))
    assert isinstance(found, dict)
    return {str(key): value for key, value in found.items()}


def _keys(content: Any, path: str = "") -> Iterator[str]:
    """Dotted keys of settings and of what holds them; an open part counts as one."""
    for name, value in content.items():
        key = f"{path}.{name}" if path else str(name)
        yield key
        if isinstance(value, Mapping) and key not in _OPEN and key not in ("defaults", "hydra"):
            yield from _keys(value, key)
