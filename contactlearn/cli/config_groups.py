"""The configuration groups `effect` and `law`, from the catalogues of effects and laws instead of files.

Names are read from the classes in the source files, and so are a law's options: a command's `--help` shows both, and
torch takes seconds to load.  An effect that is chosen, and all that other packages announce, is imported.
"""

import ast
import re
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).parents[1]
_KINDS = {"effect": ("effects", "Effect"), "law": ("laws", "Law")}
_BEST = "best"  # of the paper's laws the one with the least held-out error, for a diagnosis


def is_catalogued(group: str) -> bool:
    """Whether a group has no files because a catalogue has its choices."""
    return group in _KINDS


def catalogue_names(group: str) -> list[str]:
    """Return the names of the effects, or of the laws and `best`: those of this package and those that others announce.

    Raises:
        ContactLearnError: two effects or laws have one name.
    """
    return sorted({*_sources(group), *_announced(group), *([_BEST] if group == "law" else [])})


def has_choice(group: str, name: str) -> bool:
    """Whether a name is one of `catalogue_names`; other packages are loaded only if it is none of this one's."""
    return name in _sources(group) or (group, name) == ("law", _BEST) or name in _announced(group)


def choice_settings(group: str, name: str) -> dict[str, Any]:
    """Return the settings of a choice: `_target_`, `form` where there are several, and options with their defaults.

    Those of an effect stand under its name, since a model has several.
    """
    if group == "effect":
        return {name: _effect(name)}
    if name == _BEST:
        return {"_target_": None}
    if name in _sources(group):
        return {"_target_": f"contactlearn.laws.{name}.{_camel(name)}"} | _options(name)
    from contactlearn.laws import catalogue

    (law, *_) = catalogue()[name].values()
    return {"_target_": f"{law.__module__}.{law.__qualname__}"} | law().options


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
    room, base = _KINDS[group]
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
    room, _ = _KINDS[group]
    if not entry_points(group=f"contactlearn.{room}"):
        return []
    from contactlearn import effects, laws

    return list(effects.catalogue() if group == "effect" else laws.catalogue())


def _camel(name: str) -> str:
    return "".join(part.title() for part in name.split("_"))
