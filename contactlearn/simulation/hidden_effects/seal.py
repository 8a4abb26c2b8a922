"""The sealed account of mystery drops: written beside them, opened only by `reveal`.

sealed.bin is one line of text that says what it is, then JSON, compressed by zlib and in base64, so that
nobody reads it by accident.  It holds plain values, never code.
"""

import base64
import binascii
import json
import os
import textwrap
import zlib
from pathlib import Path
from typing import Any

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import written_whole
from contactlearn.data import table
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation.hidden_effects.drops import draw

DROPS, SEALED = "drops.csv", "sealed.bin"
TITLE = "contactlearn mystery, sealed truth 1. To open it: python -m contactlearn reveal DIR\n"
_LARGEST = 1 << 28  # bytes of JSON; what a few thousand drops need is a hundredth of it
_KEYS = {
    **{"seed": int, "size": int, "law": str, "mu": float, "eps": float, "noise": dict, "body": dict},
    **{"effects": list, "v_post": list, "v_post_from_measured": list, "v_post_without": list},
}
_EFFECT_KEYS = {"name": str, "form": str, "parameters": dict, "units": dict, "relative_change": float}


def load(seed: int, size: int = 500, folder: str | None = None) -> Impacts:
    """Drops with one to three hidden effects, all drawn from the seed; see `drops.draw`.

    The folder gets drops.csv, for `data=table`, and sealed.bin, for `reveal`.

    Args:
        seed: an integer in [0, 2⁶³).
        size: number of drops.
        folder: where to write; None is outputs/mystery/seed_SEED.

    Raises:
        DataError: a value out of its range, or a folder that cannot be written.
    """
    impacts, truth = draw(seed, size=size)
    place = Path("outputs") / "mystery" / f"seed_{seed}" if folder is None else Path(folder)
    table.save(impacts, place / DROPS)
    seal(truth, place)
    return impacts


def seal(truth: dict[str, Any], folder: str | os.PathLike[str]) -> Path:
    """Write the account of `drops.draw` into the folder, whole or not at all; the same account gives the same bytes."""
    path = Path(folder) / SEALED
    packed = base64.b64encode(zlib.compress(json.dumps(truth, allow_nan=False).encode(), 9)).decode()
    try:
        with written_whole(path) as part:
            part.write_text(TITLE + textwrap.fill(packed, 100) + "\n", encoding="ascii", newline="\n")
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error}") from error
    return path


def reveal(folder: str | os.PathLike[str]) -> dict[str, Any]:
    """The account of what was hidden in a folder of mystery drops; its keys are those of `drops.draw`.

    Raises:
        DataError: no such folder, no account in it, or one that is damaged.
    """
    folder = Path(folder)
    path = folder / SEALED
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; give one that data=mystery wrote, as outputs/mystery/seed_7")
    if not path.is_file():
        raise DataError(f"{folder}: holds no {SEALED}; only a folder that data=mystery wrote can be revealed")
    try:
        title, _, packed = path.read_bytes().partition(b"\n")
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    if title.decode("utf-8", "replace") + "\n" != TITLE:
        raise _damaged(path, "its first line is not that of a sealed truth")
    try:
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(base64.b64decode(b"".join(packed.split()), validate=True), _LARGEST)
        if not unpacking.eof:
            raise _damaged(path, "it ends too early")
        truth = json.loads(text)
    except (binascii.Error, zlib.error, ValueError, RecursionError) as error:
        if isinstance(error, DataError):
            raise
        raise _damaged(path, str(error)) from None
    _check(path, truth)
    return truth


def _check(path: Path, truth: Any) -> None:
    """Every value that a reader relies on is there and of its kind."""
    entries: list[tuple[Any, dict[str, type]]] = [(truth, _KEYS)]
    if isinstance(truth, dict) and isinstance(truth.get("effects"), list):
        entries += [(effect, _EFFECT_KEYS) for effect in truth["effects"]]
    if isinstance(truth, dict):
        entries.append((truth.get("noise"), {"v": float, "omega": float}))
    for entry, keys in entries:
        if not isinstance(entry, dict):
            raise _damaged(path, f"it holds {type(entry).__name__} where a table of values belongs")
        for key, kind in keys.items():
            value = entry.get(key)
            if not isinstance(value, (float, int) if kind is float else kind):
                raise _damaged(path, f"its {key} must be {kind.__name__}, got {value!r}")
    for effect in truth["effects"]:
        for symbol, value in effect["parameters"].items():
            if not isinstance(value, float | int) or not isinstance(effect["units"].get(symbol), str):
                raise _damaged(path, f"its {effect['name']} must give {symbol} as a number with a unit")


def _damaged(path: Path, why: str) -> DataError:
    return DataError(f"{path}: is damaged: {why}; make it again with data=mystery and the same seed")
