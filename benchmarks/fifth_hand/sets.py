"""The sets by their numbers, which tell nothing about their kind, and their files."""

import csv
from pathlib import Path

import numpy as np

from fifth_hand.laboratory import COLUMNS, Scene, table
from fifth_hand.named import ONE, SEVERAL
from fifth_hand.nothing import NOTHING
from fifth_hand.unnamed import SEQUENCE, STATE
from third_hand.nature import Table

_SEED = 20261123
KINDS = {
    "nothing": NOTHING,
    "one": ONE,
    "several": SEVERAL,
    "unknown, of the state": STATE,
    "unknown, along the sequence": SEQUENCE,
}
_IN_ORDER = [100 * (k + 1) + i for k, scenes in enumerate(KINDS.values()) for i in range(len(scenes))]
_NUMBERS = [f"{number + 1:02d}" for number in np.random.default_rng(_SEED + 7).permutation(len(_IN_ORDER))]
_SEEDS = dict(sorted(zip(_NUMBERS, _IN_ORDER, strict=True)))
KIND = {name: list(KINDS)[seed // 100 - 1] for name, seed in _SEEDS.items()}
"""Of the set of each number."""
SETS: dict[str, Scene] = {name: KINDS[KIND[name]][seed % 100] for name, seed in _SEEDS.items()}


def draw(name: str) -> Table:
    """Make the set of this number."""
    seed = _SEEDS[name]
    return table(SETS[name], np.random.default_rng([_SEED, seed]), np.random.default_rng([_SEED, seed, 9]))


def write(table: Table, path: Path) -> None:
    """Write the table as the laboratory hands it over: places to 1 µm, velocities to 10 µm/s and 10 µrad/s."""
    digits = dict.fromkeys(table.columns, "{:.5f}") | dict.fromkeys(COLUMNS, "{:.6f}")
    digits |= {"mass": "{:g}", "inertia": "{:g}"}
    values = ([digits[column].format(one) for one in some] for column, some in table.columns.items())
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["object", "order", *table.columns])
        for i, row in enumerate(zip(table.objects, *values, strict=True)):
            writer.writerow([row[0], i + 1, *row[1:]])
