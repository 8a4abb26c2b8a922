"""Analytical models of planar impact, one law a file: (W, v_c, μ, ε) → P.

`Law` in base.py is the interface; `catalogue()` has every law by name and variant: the files of this folder, those
that other packages announce under the entry point `contactlearn.laws`, and any class of yours that has been
imported.  docs/laws.md tells how to add one, docs/notation.md what the variants are.
"""

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from typing import Any

from contactlearn.core.entry_points import announced
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest
from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact

ENTRY_POINT = "contactlearn.laws"

__all__ = ["ENTRY_POINT", "PAPER_LAWS", "Contact", "Law", "catalogue", "find", "named", "names"]


def catalogue() -> dict[str, dict[str, type[Law]]]:
    """Return every law by name and variant: the paper's in its order, then others of this package, then yours.

    Raises:
        ContactLearnError: two laws of one name and variant.
    """
    _load_own()
    _load_announced()
    found: dict[str, dict[str, type[Law]]] = {}
    for law in sorted(_concrete(Law), key=_rank):
        family = found.setdefault(law.name, {})
        other = family.get(law.variant, law)
        if (other.__module__, other.__qualname__) != (law.__module__, law.__qualname__):  # else it was defined again
            homonyms = f"{other.__module__} and {law.__module__}"
            raise ContactLearnError(
                f"two laws are called {law.name} ({law.variant}), in {homonyms}; rename the class of one"
            )
        family[law.variant] = law
    return found


def names() -> tuple[str, ...]:
    """Return the names of all laws in the order of the catalogue."""
    return tuple(catalogue())


def find(name: str, variant: str = "textbook", **options: Any) -> Law:
    """Return a law by name, with μ = ε = 0; `law.at(mu, eps)` has others.

    A law that the paper's authors computed as in the textbooks has no variant `fazeli2017` of its own: the textbook
    law is returned.

    Args:
        name: one of `names()`.
        variant: `textbook` or `fazeli2017`, or another that some law has.
        options: fields of the law other than μ and ε.

    Raises:
        UnknownNameError: no such law, variant or option; a law of another package is known once that has been imported.
    """
    known = catalogue()
    if name not in known:
        raise UnknownNameError("law", name, known)
    variants = dict.fromkeys(variant for family in known.values() for variant in family)
    if variant not in variants:
        raise UnknownNameError("variant", variant, variants)
    family = known[name]
    law = family.get(variant) or family.get("textbook") or next(iter(family.values()))
    settings = law().options
    if unknown := [key for key in options if key not in settings]:
        others = [other for other in known if unknown[0] in find(other).options]
        has = f"law={others[0]} has it" if others else f"it has {', '.join(settings) or 'none'}"
        raise ContactLearnError(f"law {name} has no option {unknown[0]!r}{suggest(unknown[0], settings)}; {has}")
    return law(**options)


def named(law: Law | str) -> Law:
    """Return a law as it is, or the one of a name.

    Raises:
        ContactLearnError: neither a law nor a name.
        UnknownNameError: no such law.
    """
    if isinstance(law, str):
        return find(law)
    if isinstance(law, Law):
        return law
    raise ContactLearnError(f"law must be a Law or its name, such as 'mirtich' or laws.find('mirtich'), got {law!r}")


def _concrete(kind: type[Law]) -> Iterator[type[Law]]:
    """Yield all concrete subclasses."""
    for law in kind.__subclasses__():
        if not inspect.isabstract(law):
            yield law
        yield from _concrete(law)


def _rank(law: type[Law]) -> tuple[Any, ...]:
    """Order in the catalogue: a family stays together, `textbook` first."""
    own = law.__module__.startswith(f"{__name__}.")
    return law.variant != "textbook", law.paper is None, law.paper or 0, not own, law.name


@functools.cache
def _load_own() -> None:
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")


@functools.cache
def _load_announced() -> None:
    for entry in announced(ENTRY_POINT):
        entry.load()


_load_own()
PAPER_LAWS = tuple(law.name for law in sorted(_concrete(Law), key=_rank) if law.paper is not None)
"""Names of the six laws that the paper compares, in its order."""
