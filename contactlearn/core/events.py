"""Events: progress of what takes long, as typed values that a terminal, a page or another process consumes.

A function that takes long calls `on_event` with one event for each result and for each step of a long task.  Each room
adds events of its own: `inference.learning.events`, `diagnosis.events`.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

import msgspec

_INTERVAL = 0.1  # s between two events of a task
_Item = TypeVar("_Item")


class EventBase(msgspec.Struct, frozen=True, tag_field="event"):
    """Common base: immutable, written to JSON with the name of its class."""


class TaskProgress(EventBase, frozen=True, kw_only=True):
    """Progress of a long task: `done` steps of `total`; `total` is None while it is unknown."""

    task: str
    done: int
    total: int | None


def ignore(event: EventBase) -> None:
    """Consume an event without effect."""


def track(
    items: Iterable[_Item], task: str, on_event: Callable[[TaskProgress], None], total: int | None = None
) -> Iterator[_Item]:
    """Yield the items of a long task, and report how many are done.

    Args:
        items: steps of the task.
        task: its name for the user.
        on_event: receives a `TaskProgress` at the beginning, at the end, and at most every 0.1 s in between.
        total: number of items if they have no length.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    done, latest = 0, time.monotonic()
    on_event(TaskProgress(task=task, done=0, total=total))
    for done, item in enumerate(items, 1):
        yield item
        if time.monotonic() - latest > _INTERVAL:
            latest = time.monotonic()
            on_event(TaskProgress(task=task, done=done, total=total))
    on_event(TaskProgress(task=task, done=done, total=done))
