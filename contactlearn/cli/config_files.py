"""The settings and choices that exist, from shipped files and catalogues, and the nearest one to a misspelt name.

A setting that no file declares is refused, also after a `+`, by which Hydra would accept and the program ignore it.
A part that holds entries by name (`effect`, `model` …) is open: each entry is checked where it is read.

The groups `effect` and `law` have no files: their choices are those of the catalogues.  Names are read from the classes
in the source files, and so are a law's options: a command's `--help` shows both, and torch takes seconds to load.  An
effect that is chosen, and all that other packages announce, is imported.

`data=mydata` also takes mydata.yaml from the working directory, which sets some settings of a shipped source of data:

    _target_: contactlearn.data.table.load
    path: drops.csv
"""

import ast
import json
import os
import re
import shlex
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from contactlearn.cli.config_security import read_checked
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest

_PACKAGE = Path(__file__).parents[1]
CONFIGS = next(str(path) for path in (_PACKAGE / "configs", _PACKAGE.parent / "configs") if path.is_dir())
"""Beside the package in a checkout, inside it where it is installed."""
_OPEN = ("data", "law", "model", "effect", "candidate", "limits", "reference", "transfer.bodies")
_CATALOGUES = {"effect": ("effects", "Effect"), "law": ("laws", "Law")}
BEST = "best"
"""The law of a diagnosis with the least held-out error of the paper's laws."""
NAME = re.compile(r"\w[\w -]{0,59}")
"""A name of a user's that becomes the name of a file and of a chart."""
DATA_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""NAME of `data=NAME` and NAME.yaml."""
_DIAGNOSIS = "diagnosis.json"
_MODEL_WORD = re.compile(r"[+~]*(data|experiment|law|variant|effect|fit)(?=[.=])")
"""Settings that a diagnosis passes on."""
_COMMANDS = ("train", "evaluate", "diagnose")
_UNUSED = {"train": {"reference"}, "evaluate": set[str](), "diagnose": {"train", "bounds", "reference"}}
"""Parts of an experiment that a command has no use for."""
_REFUSED = re.compile(r"Could not (?:override|append to config|delete from config)[^']*'([^']+)'")


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
    parts = {*_content(Path(CONFIGS, f"{command}.yaml")), "data", "defaults", *_UNUSED[command]}
    return sorted(_content(experiment).keys() - parts)


def choices(group: str) -> list[str]:
    """Return the names of the choices of a group; of effects and laws also those that other packages announce.

    Raises:
        ContactLearnError: two effects or laws have one name.
    """
    if group not in _CATALOGUES:
        shipped = (path.stem for path in Path(CONFIGS, group).glob("*.yaml"))
        return sorted([*shipped, *(own_data() if group == "data" else ())])
    return sorted({*_sources(group), *_announced(group), *([BEST] if group == "law" else [])})


def own_data() -> dict[str, Path]:
    """Return the YAML files of the working directory that `data=NAME` may choose, by name; shipped sources go first."""
    files = (path for path in sorted(Path.cwd().glob("*.yaml")) if DATA_NAME.fullmatch(path.stem))
    return {path.stem: path for path in files if not Path(CONFIGS, "data", path.name).exists()}


def with_pluses(words: Sequence[str]) -> list[str]:
    """Return the words of a command with ++ before those that give a model's GPyTorch modules their arguments.

    No file declares these arguments, and Hydra takes a setting that no file declares only after a plus.
    """
    return [re.sub(r"^(?=model\.[^.=]+\.(kernel|mean|likelihood|optimiser)\.)", "++", word) for word in words]


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
    if command == "diagnose" or value in choices("model") or not is_folder:
        return list(words)
    own = [word for word in words if word != f"model={given}"]
    typed = {word.partition("=")[0].lstrip("+~") for word in own}
    try:
        content = json.loads(Path(value, _DIAGNOSIS).read_text(encoding="utf-8"))
        said, law = shlex.split(content["use"]), content["diagnosis"]["law"]
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise ContactLearnError(
            f"model={value}: there is no diagnosis (no readable {_DIAGNOSIS}); give the folder of a run of diagnose.py"
        ) from None
    if law is None:
        raise ContactLearnError(f"model={value}: its data were refused, so it has no model; see its report.html")
    found = [(key[1], word) for word in said if (key := _MODEL_WORD.match(word)) and key[1] not in typed]
    if foreign := next((word for _, word in found if "_target_" in word and word not in own), None):
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
        group, _, choice = word.lstrip("+").partition("=")
        if group not in groups(command) or "(" in choice:  # a setting, or a function of Hydra's
            continue
        for name in re.findall(r"\w+", choice):
            known = group in _CATALOGUES and has_choice(group, name)
            if not known and name != "null" and name not in choices(group):
                raise UnknownNameError(group, name, choices(group))
            if group == "experiment" and name not in ("null", *experiments(command)):
                for part in _lacking(command, Path(CONFIGS, "experiment", f"{name}.yaml")):
                    if not any(part in _declared(other) for other in _COMMANDS):
                        raise _unknown(part, _declared(command), f"experiment={name}: ")
                taken = ", ".join(experiments(command))
                raise ContactLearnError(f"experiment={name} has settings that {command}.py lacks; it takes {taken}")


def restrict_settings(cfg: DictConfig, command: str, words: Sequence[str]) -> None:
    """Take out the parts of an experiment that a command has no use for, and refuse settings that it does not have.

    Args:
        cfg: a composed configuration.
        command: its name; that of a file of the user's own, by --config-name, is not checked.
        words: of the command line.

    Raises:
        ContactLearnError: with the nearest setting.
    """
    if not Path(CONFIGS, f"{command}.yaml").exists():
        return
    typed = {name.partition(".")[0]: value for name, _, value in (word.lstrip("+~").partition("=") for word in words)}
    with open_dict(cfg):
        for part in _UNUSED[command] - typed.keys() if "experiment" in typed else ():
            cfg.pop(part, None)
    known = _declared(command)
    for key in _keys(OmegaConf.to_container(cfg)):
        if key not in known and key != "hydra":
            ours = key.partition(".")[0] in typed or "experiment" not in typed
            raise _unknown(key, known, "" if ours else f"experiment={typed['experiment']}: ")


def explain_error(error: Exception, command: str, words: Sequence[str]) -> str:
    """Return Hydra's error on the words of a command in one line, with the nearest setting for an unknown one."""
    refused = _REFUSED.search(str(error))
    own = refused and re.fullmatch(r"(effect|candidate|model)\.(\w+)(?:\.(.+))?", refused[1])
    if own and f"Key {own[2]!r} is not in struct" in str(error.__cause__):
        key, part, name = own.group(0, 1, 2)
        known = choices(part) if part in groups(command) else []
        kept = [word for word in words if word.startswith("checkpoint=")]
        if name in known and kept and command == "train":
            return f"{kept[0]} keeps the features and target that it was trained with; take out {key}=…"
        if name in known:
            return f"{key} is a setting of {part} {name}, which is not chosen; add {part}=[{name}]"
        near = suggest(name, known)
        if part == "model" and own[3] is None:
            return f"{key}: the settings of a model stand under its name, model.NAME.{name}=…, for there may be several"
        return f"{key}: no {part} is called {name!r}{near}; one of your own is added with a plus, +{key}=…"
    if own and own[1] == "model" and own[2] in choices("model"):
        near = suggest(own[3].partition(".")[0], _content(Path(CONFIGS, "model", f"{own[2]}.yaml"))[own[2]])
        return f"unknown setting {own[0]!r}{near}; --help lists all settings"
    if refused and refused[0].startswith("Could not delete") and refused[1] in _declared(command):
        return f"{refused[1]} cannot be taken out; {refused[1]}=null where it may have no value"
    if refused:
        group, _, name = refused[1].partition(".")
        named = choices(group) if group in ("data", "law") else []
        shipped = [choice for choice in named if group == "law" or not has_choice("data", choice)]
        holders = [f"{group}={choice}" for choice in shipped if name in _settings(group, choice)]
        if holders or refused[1] in _declared(command):
            source = next((word.removeprefix("data=") for word in reversed(words) if word.startswith("data=")), "")
            near = suggest(name, _settings("data", source)) if group == "data" and source in named else ""
            others = f"other choices ({', '.join(holders)})" if holders else "other choices"
            return f"{refused[1]} is a setting of {others}, not of these{near}; --help lists all settings"
        in_files = {f"data.{key}" for path in Path(CONFIGS, "data").glob("*.yaml") for key in _content(path)}
        return str(_unknown(refused[1], _declared(command) | in_files))
    message = " ".join(str(error).partition("Config search path")[0].split())
    if plugin := re.search(r"Could not find 'hydra/(sweeper|launcher)/(\w+)'", message):
        kind, name = plugin.groups()
        installed = message.rsplit(": ", 1)[-1].split()
        return (
            f"no hydra/{kind} {name!r} is installed{suggest(name, installed)}; there are {', '.join(installed)}; "
            f"others are plugins of Hydra's, such as pip install hydra-{name}-{kind}"
        )
    unread = any(sign in message for sign in ("Unknown function", "no viable alternative", "mismatched input"))
    return message + ('; text with brackets, = or the like stands in double quotes: {x: "x (mm)"}' if unread else "")


def _unknown(key: str, known: set[str], place: str = "") -> ContactLearnError:
    others = [f"{command}.py" for command in _COMMANDS if key in _declared(command)]
    if others:
        return ContactLearnError(
            f"{place}{key} is a setting of {' and '.join(others)} only; --help lists the settings of this command"
        )
    last = {name.rpartition(".")[2]: name for name in known}
    near = suggest(key, known) or suggest(last.get(key.rpartition(".")[2], ""), known)
    return ContactLearnError(f"{place}unknown setting {key!r}{near}; --help lists all settings")


@lru_cache
def _declared(command: str) -> set[str]:
    """Dotted keys of all settings of a command, those of the experiments with them."""
    files = [Path(CONFIGS, f"{command}.yaml")]
    own = _content(files[0])
    known = {*_keys(own), "data", "law"}
    for path in Path(CONFIGS, "experiment").glob("*.yaml"):  # they may fill what is null
        known |= set(_keys({name: part for name, part in _content(path).items() if own.get(name, "") is None}))
    return known - {"defaults", "hydra"}


@lru_cache
def required_settings(command: str) -> list[str]:
    """Return the dotted keys of all settings that a command's own file declares, each part before its settings."""
    own = _content(Path(CONFIGS, f"{command}.yaml"))
    return ["data", "law", *(key for key in _keys(own) if key.partition(".")[0] not in ("defaults", "hydra"))]


def _settings(group: str, choice: str) -> dict[str, Any]:
    """Settings of one choice of a group."""
    made = group in _CATALOGUES or has_choice(group, choice)
    return choice_settings(group, choice) if made else _content(Path(CONFIGS, group, f"{choice}.yaml"))


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


# --- Catalogues of effects and laws ---------------------------------------------------------------


def has_choice(group: str, name: str) -> bool:
    """Whether a name is a choice of `effect` or `law`, or a file of the user's for `data`.

    Other packages are loaded only if it is none of this one's.
    """
    if group == "data":
        return name in own_data()
    return name in _sources(group) or (group, name) == ("law", BEST) or name in _announced(group)


def choice_settings(group: str, name: str) -> dict[str, Any]:
    """Return the settings of a choice: `_target_`, `form` where there are several, and options with their defaults.

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
    if name in _sources(group):
        return {"_target_": f"contactlearn.laws.{name}.{_camel(name)}"} | _options(name)
    from contactlearn.laws import catalogue

    (law, *_) = catalogue()[name].values()
    return {"_target_": f"{law.__module__}.{law.__qualname__}"} | law().options


def _own_settings(file: Path) -> dict[str, Any]:
    """The settings in a file of the user's for `data`, and the shipped values of those that it leaves out."""
    content = OmegaConf.to_container(read_checked(file, "data"))
    shipped = {one["_target_"]: one for one in map(_content, sorted(Path(CONFIGS, "data").glob("*.yaml")))}
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
def _sources(group: str) -> dict[str, str]:
    """Source files of this package's effects or laws by the name of the module, which is that of its class."""
    room, base = _CATALOGUES[group]
    texts = {path.stem: path.read_text("utf-8") for path in Path(_PACKAGE, room).glob("*.py")}
    return {
        name: text
        for name, text in texts.items()
        if re.search(rf"^class {_camel(name)}\(.*\b{base}\):", text, re.MULTILINE)
    }


def _options(law: str) -> dict[str, Any]:
    """Fields of a law with their defaults, from its source."""
    found = {}
    for node in ast.walk(ast.parse(_sources("law")[law])):
        if isinstance(node, ast.ClassDef) and node.name == _camel(law):
            for field in node.body:
                if isinstance(field, ast.AnnAssign) and "ClassVar" not in ast.unparse(field.annotation) and field.value:
                    found[ast.unparse(field.target)] = ast.literal_eval(field.value)
    return found


def _announced(group: str) -> list[str]:
    """Names of what other packages announce, with all of the catalogue."""
    room, _ = _CATALOGUES[group]
    if not entry_points(group=f"contactlearn.{room}"):
        return []
    from contactlearn import effects, laws

    return list(effects.catalogue() if group == "effect" else laws.catalogue())


def _camel(name: str) -> str:
    return "".join(part.title() for part in name.split("_"))
