"""Modules of a room that are loaded when they are first named: editors complete them, and nothing loads early."""

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import iter_modules


def submodules(room: str, path: Iterable[str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package, by its `__name__` and `__path__`."""
    names = sorted(module.name for module in iter_modules(path))

    def get(name: str) -> object:
        if name in names:
            return import_module(f"{room}.{name}")
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    return get, lambda: names
