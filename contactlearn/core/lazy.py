"""Modules of a room that are loaded when they are first named: editors complete them, and nothing loads early."""

import sys
from importlib import import_module
from pkgutil import iter_modules

from contactlearn.core.errors import no_attribute


def load_when_named(room: str) -> None:
    """Let a package, by its `__name__`, load each of its modules when it is first named, and list them all.

    A type checker sees nothing of it, and so refuses the names of modules that do not exist.
    """
    package = sys.modules[room]
    names = sorted(module.name for module in iter_modules(package.__path__))

    def get(name: str) -> object:
        if name in names:
            return import_module(f"{room}.{name}")
        raise no_attribute(room, name, names)

    vars(package).update(__getattr__=get, __dir__=lambda: names)
