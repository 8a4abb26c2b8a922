"""Classes that a configuration names by `_target_`: found, checked to be of one kind, and never anything else."""

from typing import TypeVar

from hydra.utils import get_class

from contactlearn.errors import ContactLearnError

Base = TypeVar("Base")


def subclass(target: object, base: type[Base]) -> type[Base]:
    """Return the class that a dotted path names; nothing but a subclass of `base`.

    Raises:
        ContactLearnError: the path cannot be imported, or names another thing.
    """
    try:
        kind = get_class(str(target))
    except Exception as error:
        seen = str(error).splitlines()[0]
        raise ContactLearnError(
            f"_target_={target} cannot be imported ({seen}); is its package installed, or its folder on PYTHONPATH?"
        ) from None
    if not issubclass(kind, base) or kind is base:
        package = base.__module__.rpartition(".")[0]
        raise ContactLearnError(f"_target_ must be a subclass of {package}.{base.__name__}, got {target}")
    return kind
