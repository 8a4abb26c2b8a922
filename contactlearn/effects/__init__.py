"""Physical effects: named corrections of a rigid contact, one a file, with few parameters each.

base           the seam: `Effect`, its four places and its parameters
state          what an effect sees of the impacts
identity       `EffectId`, name and form of an effect
formula        effects from a line of mathematics
functions      splines, harmonics, reference speeds and other functions that effects share
impulse_path   changes of Routh's path while the contact lasts

Every other module is an effect.  `catalogue()` returns all forms by name, `find_effect(name, form)` one of them;
docs/effects.md lists them with their formulas.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any

from contactlearn.core.entry_points import announced
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest
from contactlearn.effects import formula as formula
from contactlearn.effects.base import (
    PLACES as PLACES,
    ChangesFriction as ChangesFriction,
    ChangesRestitution as ChangesRestitution,
    Effect as Effect,
    Parameter as Parameter,
    parameter as parameter,
)
from contactlearn.effects.identity import EffectId as EffectId
from contactlearn.effects.state import State as State, columns as columns
from contactlearn.mechanics.space import PLANE, Space

ENTRY_POINT = "contactlearn.effects"


def catalogue() -> dict[str, tuple[type[Effect], ...]]:
    """Return the forms of every effect by the effect's name, the default form first; one form for most effects.

    Effects are in the order of the places and then of the alphabet.  They come from this folder, from other packages
    that announce theirs under the entry point `contactlearn.effects`, and from any other module that was imported.
    Classes that need arguments are left out.

    Raises:
        ContactLearnError: two effects of one name, or two forms of one name in a family.
    """
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    for entry in announced(ENTRY_POINT):
        entry.load()
    families: dict[str, tuple[type[Effect], ...]] = {}
    for kind in sorted(_defined(Effect), key=lambda e: (PLACES.index(e.place), e.name)):
        forms = tuple(form for form in forms_of(kind) if all(_optional(f) for f in fields(form)))
        if forms and kind.name in families:
            raise _homonyms(f"effects are called {kind.name}", families[kind.name][0], kind)
        if forms:
            families[kind.name] = forms
    return families


def find_effect(name: str, form: str | None = None, space: Space = PLANE) -> type[Effect]:
    """Return the class of an effect, with or without arguments, in a form or in the first of its family in a space.

    Raises:
        UnknownNameError: no such effect or form; an effect of another package is known once that has been imported.
    """
    listed = catalogue()  # by now all of them are loaded
    known = {kind.name: kind for kind in _defined(Effect)}
    if name not in known:
        raise UnknownNameError("effect", name, dict.fromkeys((*listed, *known)))
    there = (kind.form for kind in forms_of(known[name]) if space in kind.spaces)
    return choose_form(known[name], next(there, None) if form is None else form)


def named_effects(effects: Mapping[str, Effect] | Iterable[str | Effect], space: Space = PLANE) -> dict[str, Effect]:
    """Return effects by name: those of a mapping, or listed ones, of which a name is `name` or `name:form`.

    A name without a form has the first that exists in the space.

    Raises:
        ContactLearnError: neither of the two.
        UnknownNameError: no such effect.
    """
    named: Mapping[Any, Any] | None = effects if isinstance(effects, Mapping) else None
    if named is None and isinstance(effects, Iterable) and not isinstance(effects, str):
        ids = [EffectId.parse(listed) if isinstance(listed, str) else listed for listed in effects]
        made = [find_effect(key.name, key.form, space)() if isinstance(key, EffectId) else key for key in ids]
        named = {getattr(effect, "name", ""): effect for effect in made}
    if named is None or not all(isinstance(effect, Effect) for effect in named.values()):
        raise ContactLearnError(
            "effects are listed by name or as effects, such as ['spin_damping:during', SideDrag()], or are effects by "
            f"name, such as {{'spin': SpinDamping()}}; got {effects!r}"
        )
    return dict(named)


def forms_of(kind: type[Effect]) -> tuple[type[Effect], ...]:
    """Return the forms of a family in the order of their declaration; any other effect is its only form.

    Raises:
        ContactLearnError: two forms of one name.
    """
    forms: dict[str | None, type[Effect]] = {}
    for form in _defined(kind) if inspect.isabstract(kind) else (kind,):
        if form.form in forms:
            raise _homonyms(f"forms of {kind.name} are called {form.form}", forms[form.form], form)
        forms[form.form] = form
    return tuple(forms.values())


def choose_form(kind: type[Effect], form: str | None = None) -> type[Effect]:
    """Return the class of one form of a family, its first one if `form` is None.

    Args:
        kind: a family, or an effect with a single form.
        form: name of a form of it.

    Raises:
        UnknownNameError: the family has no such form.
        ContactLearnError: a form of an effect that has none.
    """
    forms = {each.form: each for each in forms_of(kind)}
    if form is None and forms:
        return next(iter(forms.values()))
    if form not in forms or form is None:
        names = [name for name in forms if name is not None]
        if not names and form is None:
            raise ContactLearnError(
                f"{kind.__name__} does not override its method {kind.place}, and no form of it does"
            )
        if not names:
            raise ContactLearnError(f"effect {kind.name} has no forms to choose from, got {form!r}; leave the form out")
        raise UnknownNameError(f"form of {kind.name}", str(form), names)
    return forms[form]


def from_settings(kind: type[Effect], settings: Mapping[str, Any]) -> Effect:
    """Return an effect with options as a configuration holds them.

    Args:
        kind: a family, one form of it, or an effect with a single form.
        settings: the options of the class by name, lists in place of tuples; `form` chooses among a family's forms.
            An option of another form of the family is passed over where it has its default value.

    Raises:
        UnknownNameError: the family has no such form.
        ContactLearnError: an option that the class does not have, or lacks.
    """
    options: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in settings.items()}
    defaults = [(name, f.default) for form in forms_of(kind) for name, f in _options(form).items()]
    kind = choose_form(kind, options.pop("form", None) if kind.form or inspect.isabstract(kind) else None)
    known = _options(kind)
    options = {key: value for key, value in options.items() if key in known or (key, value) not in defaults}
    names = [*(["form"] if kind.form else []), *known]
    for key in options:
        if key not in known:
            fitted = " (it is fitted)" if key in (f.name for f in fields(kind)) else suggest(key, names)
            has = ", ".join(names) or "none"
            raise ContactLearnError(f"{kind.name} has no setting {key!r}{fitted}; it has: {has}")
    if missing := [name for name, f in known.items() if not _optional(f) and name not in options]:
        raise ContactLearnError(f"{kind.name} needs the setting {', '.join(missing)}; give it a value")
    return kind(**options)


def _defined(parent: type[Effect]) -> list[type[Effect]]:
    """Direct subclasses; a class whose definition was refused has no identity, and lives until it is collected."""
    return [kind for kind in parent.__subclasses__() if "id" in vars(kind)]


def _options(kind: type[Effect]) -> dict[str, Field[Any]]:
    """Fields that are not fitted, by name."""
    return {f.name: f for f in fields(kind) if "parameter" not in f.metadata}


def _homonyms(what: str, first: type[Effect], second: type[Effect]) -> ContactLearnError:
    modules = f"{first.__module__} and {second.__module__}"
    return ContactLearnError(f"two {what}, in {modules}; rename one")


def _optional(field: Field[Any]) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING
