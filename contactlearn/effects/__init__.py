"""Physical effects: named corrections of a rigid contact, one a file, with few parameters each.

`Effect` in base.py is the seam; `catalogue()` has every effect by name: the files of this folder,
those that other packages announce under the entry point `contactlearn.effects`, and any class of
yours that has been imported.  docs/effects.md lists them with their formulas.
"""

import importlib
import pkgutil
from dataclasses import MISSING, Field, fields
from importlib.metadata import entry_points

from contactlearn.effects.base import PLACES, Effect, Parameter, parameter
from contactlearn.effects.identity import EffectId
from contactlearn.effects.state import State, columns
from contactlearn.errors import ContactLearnError, UnknownNameError

ENTRY_POINT = "contactlearn.effects"

__all__ = [
    "ENTRY_POINT",
    "PLACES",
    "Effect",
    "EffectId",
    "Parameter",
    "State",
    "catalogue",
    "columns",
    "find",
    "parameter",
]


def catalogue() -> dict[str, type[Effect]]:
    """Every effect that needs no arguments, by name, in the order of the places and then of the alphabet.

    Raises:
        ContactLearnError: two effects of one name.
    """
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    for entry in entry_points(group=ENTRY_POINT):
        entry.load()
    found = {}
    for effect in sorted(Effect.__subclasses__(), key=lambda e: (PLACES.index(e.place), e.name)):
        if not all(_optional(f) for f in fields(effect)):
            continue
        if effect.name in found:
            homonyms = f"{found[effect.name].__module__} and {effect.__module__}"
            raise ContactLearnError(f"two effects are called {effect.name}, in {homonyms}; rename the class of one")
        found[effect.name] = effect
    return found


def find(name: str) -> type[Effect]:
    """The effect of that name, with or without arguments.

    Raises:
        UnknownNameError: no such effect; one of another package is known once that has been imported.
    """
    known = catalogue() | {effect.name: effect for effect in Effect.__subclasses__()}
    if name not in known:
        raise UnknownNameError("effect", name, known)
    return known[name]


def _optional(field: Field) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING
