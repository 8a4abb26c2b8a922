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


def catalogued(group: str) -> list[str]:
    """Return the names of the effects, or of the laws and `best`: those of this package and those that others announce.

    Raises:
        ContactLearnError: two effects or laws have one name.
    """
    return sorted({*_classes(group), *_announced(group), *([_BEST] if group == "law" else [])})


def has_choice(group: str, name: str) -> bool:
    """Whether a name is one of `catalogued`; other packages are loaded only if it is none of this one's."""
    return name in _classes(group) or (group, name) == ("law", _BEST) or name in _announced(group)


def entry(group: str, name: str) -> dict[str, Any]:
    """Return the settings of a choice: `_target_`, `form` where there are several, and options with their defaults.

    Those of an effect stand under its name, since a model has several.
    """
    if group == "effect":
        return {name: _effect(name)}
    if name == _BEST:
        return {"_target_": None}
    if name in _classes(group):
        return {"_target_": f"contactlearn.laws.{name}.{_camel(name)}"} | _options(_classes(group)[name])
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
def _classes(group: str) -> dict[str, ast.ClassDef]:
    """Classes of this package by the name of their module, which is theirs in small letters."""
    room, base = _KINDS[group]
    found = {}
    for path in Path(_PACKAGE, room).glob("*.py"):
        text, kind = path.read_text("utf-8"), _camel(path.stem)
        if re.search(rf"^class {kind}\(.*\b{base}\):", text, re.MULTILINE):
            nodes = ast.parse(text).body if group == "law" else [ast.ClassDef(kind)]
            found[path.stem] = next(node for node in nodes if isinstance(node, ast.ClassDef) and node.name == kind)
    return found


def _options(law: ast.ClassDef) -> dict[str, Any]:
    """Fields of a law by name, with their defaults."""
    fields = [node for node in law.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)]
    own = [field for field in fields if field.value is not None and "ClassVar" not in ast.unparse(field.annotation)]
    return {field.target.id: ast.literal_eval(field.value) for field in own}


def _announced(group: str) -> list[str]:
    """Names of what other packages announce, with all of the catalogue."""
    room, _ = _KINDS[group]
    if not entry_points(group=f"contactlearn.{room}"):
        return []
    from contactlearn import effects, laws

    return list(effects.catalogue() if group == "effect" else laws.catalogue())


def _camel(name: str) -> str:
    return "".join(part.title() for part in name.split("_"))
