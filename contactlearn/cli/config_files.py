"""The choices that exist, from shipped files and catalogues, and the words that Hydra is given.

The groups `effect` and `law` have no files: their choices are those of the catalogues, which are named as the modules
that define them, since torch takes seconds to load.  An effect that is chosen, and all that other packages announce, is
imported.

`data=mydata` also takes mydata.yaml from the working directory, which sets some settings of a shipped source of data:

    _target_: contactlearn.data.table.load
    path: drops.csv
"""

import json
import os
import re
import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from hydra.core.override_parser.types import Glob
from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.command_line import data_from, parse_override
from contactlearn.cli.config_security import leaf_values, read_checked
from contactlearn.core.entry_points import announced
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest

_PACKAGE = Path(__file__).parents[1]
CONFIGS = next(str(path) for path in (_PACKAGE / "configs", _PACKAGE.parent / "configs") if path.is_dir())
"""Beside the package in a checkout, inside it where it is installed."""
_CATALOGUES = {
    "effect": (
        "effects",
        {
            "base",
            "checks",
            "covariate_dependent_friction",
            "covariate_dependent_restitution",
            "floor_functions",
            "formula",
            "functions",
            "identity",
            "impulse_path",
            "side_functions",
            "state",
        },
    ),
    "law": ("laws", {"base", "contact", "hodograph"}),
}
"""The package of each catalogue, and those of its modules that define none of its classes."""
BEST = "best"
"""The law of a diagnosis with the least held-out error of the paper's laws."""
NAME = re.compile(r"\w[\w -]{0,59}")
"""A name of a user's that becomes the name of a file and of a chart."""
DATA_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""NAME of `data=NAME` and NAME.yaml."""
_MISTYPED = 0.8  # similarity to a source, from which on a name is a slip of it: cube is none of cube_tosses
_DIAGNOSIS = "diagnosis.json"
_MODEL_WORD = re.compile(r"[+~]*(data|experiment|law|variant|effect|fit)(?=[.=])")
"""Settings that a diagnosis passes on."""
UNUSED = {
    "train": {"reference", "figures"},
    "evaluate": set[str](),
    "diagnose": {"train", "bounds", "reference", "figures"},
    "plan": set[str](),
}
"""Parts of an experiment that a command has no use for."""


_user_folders: tuple[str | None, str | None] = (None, None)


@contextmanager
def user_folders(first: str | None, last: str | None) -> Generator[None]:
    """Let Hydra compose from two more folders of configuration files: before the shipped ones, and behind them."""
    global _user_folders
    before, _user_folders = _user_folders, (first, last)
    try:
        yield
    finally:
        _user_folders = before


def added_folders() -> tuple[str | None, str | None]:
    """Return the folders that `user_folders` adds."""
    return _user_folders


@lru_cache
def groups(command: str) -> list[str]:
    """Return the names of the groups of choices of a command: those of its defaults list."""
    entries = _content(Path(CONFIGS, f"{command}.yaml"))["defaults"]
    names = (str(name).removeprefix("optional ") for entry in entries if entry != "_self_" for name in entry)
    return sorted(name for name in names if not name.startswith("override "))


def experiments(command: str) -> list[str]:
    """Return the names of the experiments all of whose parts a command has, or has no use for."""
    return [path.stem for path in sorted(Path(CONFIGS, "experiment").glob("*.yaml")) if not _lacking(command, path)]


def _lacking(command: str, experiment: Path) -> list[str]:
    """Parts of an experiment that a command neither has nor ignores."""
    parts = {*_content(Path(CONFIGS, f"{command}.yaml")), "data", "defaults", *UNUSED[command]}
    return sorted(_content(experiment).keys() - parts)


def choices(group: str) -> list[str]:
    """Return the names of the choices of a group; of effects and laws also those that other packages announce.

    Raises:
        ContactLearnError: two effects or laws have one name.
    """
    if group not in _CATALOGUES:
        shipped = (path.stem for path in Path(CONFIGS, group).glob("*.yaml"))
        return sorted([*shipped, *(own_data() if group == "data" else ())])
    return sorted({*_modules(group), *_announced(group), *([BEST] if group == "law" else [])})


def summaries(group: str) -> dict[str, str]:
    """Return what each effect or law of this package is, by name: the first line of its module, which is not run."""
    if group not in _CATALOGUES:
        return {}
    room, _ = _CATALOGUES[group]
    texts = {name: Path(_PACKAGE, room, f"{name}.py").read_text(encoding="utf-8") for name in _modules(group)}
    told = {name: text.partition("\n")[0].strip('"').rstrip(".") for name, text in texts.items()}
    return told | ({BEST: "the law with the lowest held-out error"} if group == "law" else {})


def own_data() -> dict[str, Path]:
    """Return the YAML files of the working directory that `data=NAME` may choose, by name; shipped sources go first."""
    files = (path for path in sorted(Path.cwd().glob("*.yaml")) if DATA_NAME.fullmatch(path.stem))
    return {path.stem: path for path in files if not Path(CONFIGS, "data", path.name).exists()}


def with_pluses(words: Sequence[str], command: str) -> list[str]:
    """Return the words of a command with ++ before each setting that its file has not, so that Hydra refuses none.

    A group that the file chooses, such as law, needs no plus and gets none.  What the whole configuration has is
    checked once it is composed, where the nearest name is known.
    """
    plain = [word.lstrip("+") if word.lstrip("+").partition("=")[0] in groups(command) else word for word in words]
    return [f"++{word.lstrip('+')}" if _is_setting(word, command) else word for word in plain]


def _is_setting(word: str, command: str) -> bool:
    """Whether a word sets what the file of the command lacks, and is no choice of a group and nothing of Hydra's."""
    key, equals, _ = word.lstrip("+").partition("=")
    folders = (Path(folder, key) for folder in _user_folders if folder is not None)
    chooses = key in groups(command) or "/" in key or "@" in key or any(folder.is_dir() for folder in folders)
    theirs = key[:1] == "~" or key.partition(".")[0] == "hydra" or (word[:1] != "+" and key in _declared(command))
    return bool(equals) and not theirs and not chooses


@lru_cache
def _declared(command: str) -> set[str]:
    """Dotted keys of the values in the file of a command."""
    return {".".join(path) for path, _ in leaf_values(_content(Path(CONFIGS, f"{command}.yaml")))}


def with_globs(words: Sequence[str], command: str) -> list[str]:
    """Return words with the choices that match in place of `law=glob(w*)`.

    Raises:
        ContactLearnError: no choice matches, or the setting has no choices.
    """
    return [_without_glob(word, command) if "=glob(" in word else word for word in words]


def _without_glob(word: str, command: str) -> str:
    key, _, _ = word.partition("=")
    pattern = parse_override(word).value()
    group = key.lstrip("+")
    if not isinstance(pattern, Glob):
        return word
    if group not in groups(command):
        raise ContactLearnError(f"{word}: glob(…) takes choices, of {', '.join(groups(command))}; {group} has none")
    matching = pattern.filter([choice for choice in choices(group) if choice != BEST])
    if not matching:
        raise ContactLearnError(f"{word} matches no {group}; known: {', '.join(choices(group))}")
    return f"{key}={','.join(matching)}"


def with_forms(words: Sequence[str]) -> list[str]:
    """Return words with `effect=[NAME] effect.NAME.form=FORM` in place of `effect=[NAME:FORM]`, as results print it."""
    found = list[str]()
    for word in words:
        key, _, choice = word.partition("=")
        forms = re.findall(r"(\w+):(\w+)", choice) if key.lstrip("+") == "effect" else []
        found.append(re.sub(r":\w+", "", word) if forms else word)
        found += [f"effect.{name}.form={form}" for name, form in forms]
    return found


def with_diagnosed_model(words: Sequence[str], command: str) -> list[str]:
    """Return the words of a command with those of a diagnosis, its data, law and effects, in place of model=RUN.

    Words of the command go first: data=… takes the place of the diagnosed data.  The file is data like any other, so it
    may set nothing else, and no class.

    Raises:
        ContactLearnError: the folder RUN has no diagnosis, that of refused data, one with a class of another package
            that the command does not name, or one with data, law or effects that are no choices here.
    """
    given = next((word.removeprefix("model=") for word in words if word.startswith("model=")), "")
    value = os.path.expanduser(given.strip("'\""))
    is_folder = bool(value) and ("/" in value or Path(value).is_dir())
    if command in ("diagnose", "plan") or value in choices("model") or not is_folder:
        return list(words)
    own = [word for word in words if word != f"model={given}"]
    typed = {word.partition("=")[0].lstrip("+~") for word in own}
    try:
        content = json.loads(Path(value, _DIAGNOSIS).read_text(encoding="utf-8"))
        said, law = shlex.split(content["use"]), content["diagnosis"]["law"]
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise ContactLearnError(
            f"model={value}: there is no diagnosis (no readable {_DIAGNOSIS}); give the folder of a run of diagnose"
        ) from None
    if law is None:
        raise ContactLearnError(f"model={value}: its data were refused, so it has no model; see its report.html")
    found = [(key[1], word) for word in said if (key := _MODEL_WORD.match(word)) and key[1] not in typed]
    classes = (word for _, word in found if "_target_" in word and "._target_=contactlearn.effects." not in word)
    if foreign := next((word for word in classes if word not in own), None):
        raise ContactLearnError(
            f"model={value}: a class of another package is only taken from the command line: add {foreign} to it, if "
            "you trust that class"
        )
    for group, word in found:
        try:
            check_choices([word], command)
        except UnknownNameError as error:
            raise ContactLearnError(
                f"model={value} was diagnosed with {word}, which is missing here: {error}; add {group}=… to the "
                "command, or run it in the folder in which the diagnosis was run"
            ) from None
    model = [] if "model" in typed else [f"model={'analytical' if command == 'train' else '[]'}"]
    return [*(word for _, word in found if word not in own), *model, *own]


def check_choices(words: list[str], command: str) -> None:
    """Raise for a choice that its group lacks, such as law=mirtisch; Hydra suggests nothing.

    Raises:
        ContactLearnError: an experiment of another command.
        UnknownNameError: with the nearest name.
    """
    for word in words if not any(_user_folders) else ():  # which may hold more choices
        group, equals, choice = word.lstrip("+").partition("=")
        if group in groups(command) and equals and not choice:
            raise ContactLearnError(f"{word} has no value; {group}=… takes one of {', '.join(choices(group))}")
        if group not in groups(command) or "(" in choice:  # a setting, or a function of Hydra's
            continue
        if group == "data" and re.search(r"[/\\]|\.\w+$", choice):
            raise ContactLearnError(f"{word}: data=NAME takes a name and no path; {_named_data(Path(choice))}")
        for name in re.findall(r"[\w-]+", choice):
            if name != "null" and name not in choices(group):
                absent = group == "data" and not suggest(name, choices(group), _MISTYPED)
                wanted = f"`contactlearn init FILE --name {name}` writes it"
                wanted = wanted if DATA_NAME.fullmatch(name) else "NAME.yaml has the letters a to z, digits and _"
                hint = f": no file {name}.yaml is in this folder; {wanted}"
                raise UnknownNameError(group, name, choices(group), hint if absent else "")
            if group == "experiment" and name not in ("null", *experiments(command)):
                taken = ", ".join(experiments(command))
                raise ContactLearnError(f"experiment={name} has settings that {command}.py lacks; it takes {taken}")


def _named_data(path: Path) -> str:
    """How a file that was given as data is used."""
    if path.suffix in (".yaml", ".yml"):
        there = "" if path.parent == Path() else f"in the folder {path.parent} "
        return f"it reads NAME.yaml of the folder in which the command runs: {there}say data={path.stem}"
    return data_from(path)


def without_hydra(cfg: DictConfig, *others: str) -> DictConfig:
    """Return the configuration of a command without Hydra's part, and without others."""
    return OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key not in ("hydra", *others)])


@lru_cache
def shipped_settings(group: str) -> dict[str, dict[str, Any]]:
    """Return the settings of every shipped choice of a group, by name."""
    return {path.stem: _content(path) for path in sorted(Path(CONFIGS, group).glob("*.yaml"))}


def _content(path: Path) -> dict[str, Any]:
    found = OmegaConf.to_container(OmegaConf.load(path))
    assert isinstance(found, dict)
    return {str(key): value for key, value in found.items()}


# --- Catalogues of effects and laws ---------------------------------------------------------------


def choice_settings(group: str, name: str) -> dict[str, Any]:
    """Return the settings of a choice: `_target_`, for an effect also its `form` and options with their defaults.

    Those of an effect stand under its name, since a model has several.  A user's file of data has those of its source.

    Raises:
        ContactLearnError: the file is not YAML, names no shipped source, or has a setting that this source lacks.
    """
    if group == "data":
        return _own_settings(own_data()[name])
    if group == "effect":
        return {name: _effect(name)}
    if name == BEST:
        return {"_target_": None}
    if name in _modules(group):
        return {"_target_": f"contactlearn.laws.{name}.{name.title().replace('_', '')}"}
    from contactlearn.laws import catalogue

    (law, *_) = catalogue()[name].values()
    return {"_target_": f"{law.__module__}.{law.__qualname__}"}


def _own_settings(file: Path) -> dict[str, Any]:
    """The settings in a file of the user's for `data`, and the shipped values of those that it leaves out."""
    content = OmegaConf.to_container(read_checked(file, "data"))
    shipped = {one["_target_"]: dict(one) for one in shipped_settings("data").values()}
    if not isinstance(content, dict) or content.get("_target_") not in shipped:
        raise ContactLearnError(
            f"{file.name}: is no source of data; it begins with _target_: contactlearn.data.table.load, or that of "
            "another source of configs/data; contactlearn init FILE writes such a file"
        )
    settings = shipped[content["_target_"]]
    for key, value in content.items():
        if key not in settings:
            raise UnknownNameError(f"setting in {file.name}:", str(key), settings)
        both = isinstance(settings[key], dict) and isinstance(value, dict)
        settings[key] = settings[key] | value if both else value
    return settings


def _effect(name: str) -> dict[str, Any]:
    from contactlearn.effects import Effect, catalogue

    default = catalogue()[name][0]
    family = [base for base in default.__mro__ if issubclass(base, Effect) and base is not Effect][-1]
    options = {key: list(x) if isinstance(x, tuple) else x for key, x in default().options.items()}
    form = {} if default.form is None else {"form": default.form}
    return {"_target_": f"{family.__module__}.{family.__qualname__}"} | form | options


@lru_cache
def _modules(group: str) -> set[str]:
    """Names of this package's effects or laws: those of the modules that define them."""
    room, others = _CATALOGUES[group]
    return {module.name for module in iter_modules([str(_PACKAGE / room)])} - others


def _announced(group: str) -> list[str]:
    """Names of what other packages announce, with all of the catalogue."""
    room, _ = _CATALOGUES[group]
    entries = announced(f"contactlearn.{room}")
    return [*import_module(f"contactlearn.{room}").catalogue()] if entries else []
