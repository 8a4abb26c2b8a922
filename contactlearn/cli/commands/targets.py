"""Classes that a configuration names by `_target_`: found, checked to be of one kind, and never anything else."""

from importlib import import_module
from typing import TypeVar

from contactlearn.core.errors import ContactLearnError, suggest

Base = TypeVar("Base")


def subclass(target: object, base: type[Base]) -> type[Base]:
    """Return the class that a dotted path names; nothing but a subclass of `base`.

    Raises:
        ContactLearnError: the path cannot be imported, or names another thing.
    """
    place, _, name = str(target).rpartition(".")
    if not place:
        raise ContactLearnError(
            f"_target_ must be a class in its module, such as {target}.{base.__name__}, got {target}"
        )
    try:
        module = import_module(place)
    except Exception as error:
        missing = isinstance(error, ModuleNotFoundError) and f"{place}.".startswith(f"{error.name}.")
        why = "is its package installed, or its folder on PYTHONPATH?" if missing else f"mend {place} first"
        seen = f"{type(error).__name__}: {error}".splitlines()[0]
        raise ContactLearnError(f"_target_={target} cannot be imported ({seen}); {why}") from None
    kind = getattr(module, name, None)
    if kind is None:
        raise ContactLearnError(f"_target_={target}: {place} has no {name!r}{suggest(name, vars(module))}")
    if not isinstance(kind, type) or not issubclass(kind, base) or kind is base:
        package = base.__module__.rpartition(".")[0]
        raise ContactLearnError(f"_target_ must be a subclass of {package}.{base.__name__}, got {target}")
    return kind
