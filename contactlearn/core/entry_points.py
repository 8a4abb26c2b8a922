"""Entry points under which other packages announce laws and effects."""

import os
import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points


def announced(group: str) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group, read again once a folder of the path, where packages are, has changed."""
    return _announced(group, tuple((folder, _changed(folder)) for folder in sys.path))


def _changed(folder: str) -> int:
    """Time in ns at which a folder last changed; 0 of one that is not there."""
    try:
        return os.stat(folder or ".").st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=16)
def _announced(group: str, folders: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    del folders  # of the metadata, which importlib reads from all packages
    return tuple(entry_points(group=group))
