"""The sets by their numbers, which tell nothing about their kind, and their files."""

import csv
from pathlib import Path

import numpy as np

from sixth_hand.laboratory import Scene, table
from sixth_hand.named import ONE, SEVERAL
from sixth_hand.nothing import NOTHING
from sixth_hand.unnamed import SEQUENCE, STATE
from third_hand.nature import Table

_SEED = 20417
KINDS = {
    "nothing": NOTHING,
    "one": ONE,
    "several": SEVERAL,
    "unknown, of the state": STATE,
    "unknown, along the sequence": SEQUENCE,
}
_IN_ORDER = [(kind, scene) for kind, scenes in KINDS.items() for scene in scenes]
_PLACES = {f"{k + 1:02d}": int(i) for k, i in enumerate(np.random.default_rng(_SEED).permutation(len(_IN_ORDER)))}
KIND = {name: _IN_ORDER[i][0] for name, i in _PLACES.items()}
"""Of the set of each number."""
SETS: dict[str, Scene] = {name: _IN_ORDER[i][1] for name, i in _PLACES.items()}
TOLD = {name for name, i in _PLACES.items() if not SETS[name].seen or i % 3}
"""Sets whose outlines the laboratory tells."""


def draw(name: str) -> Table:
    """Make the set of this number."""
    seed = [_SEED, _PLACES[name]]
    return table(SETS[name], np.random.default_rng(seed), np.random.default_rng([*seed, 1]))


def write(table: Table, path: Path) -> None:
    """Write the table as the laboratory hands it over: poses to 10 µm and 10 µrad, velocities to six digits."""
    digits = dict.fromkeys(table.columns, "{:.6g}") | dict.fromkeys(("x", "y", "theta"), "{:.5f}")
    digits |= dict.fromkeys(("rx", "ry"), "{:.6f}")
    values = ([digits[column].format(one) for one in some] for column, some in table.columns.items())
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["object", "trial", *table.columns])
        writer.writerows([who, i, *row] for i, (who, *row) in enumerate(zip(table.objects, *values, strict=True), 1))
