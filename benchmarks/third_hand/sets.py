"""The sets by their numbers, which tell nothing about their kind, and their files."""

import csv
from pathlib import Path

import numpy as np

from third_hand.known import KNOWN
from third_hand.nature import COLUMNS, Scene, Table, happen
from third_hand.others import OTHERS

_SCENES = [*KNOWN, *OTHERS]
_SEEDS = {f"{number + 1:02d}": i for i, number in enumerate(np.random.default_rng(48).permutation(len(_SCENES)))}
SETS: dict[str, Scene] = {name: _SCENES[i] for name, i in sorted(_SEEDS.items())}


def draw(name: str, n: int | None = None) -> Table:
    """Make the set of this number, or one like it with `n` trials."""
    return happen(SETS[name], 7000 + _SEEDS[name], n)


def write(table: Table, path: Path) -> None:
    """Write the table as the laboratory hands it over: six digits, and nothing that tells what is hidden."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["object", *COLUMNS])
        for j, name in enumerate(table.objects):
            writer.writerow([name, *(f"{table.columns[column][j]:.6g}" for column in COLUMNS)])
