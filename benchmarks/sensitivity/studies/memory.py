"""Memory of pure functions of the package: a case is decided about many times, and its fits are the same each time."""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from types import ModuleType
from typing import Any

_FUNCTIONS: list[tuple[ModuleType | type, str]] = []


def remember(name: str, *owners: ModuleType | type) -> None:
    """Let `memory` know a function of some modules, or a class method, that is expensive and pure."""
    _FUNCTIONS.extend((owner, name) for owner in owners)


@contextmanager
def memory() -> Iterator[None]:
    """Compute these functions once for the same arguments, as long as this lasts."""
    originals = [(owner, name, vars(owner)[name]) for owner, name in _FUNCTIONS]
    try:
        for owner, name in _FUNCTIONS:
            setattr(owner, name, _remembered(getattr(owner, name)))
        yield
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)


def _remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    known: dict[bytes, Any] = {}

    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        key = pickle.dumps((arguments, sorted(named.items())))
        if key not in known:
            known[key] = function(*arguments, **named)
        return known[key]

    return call
