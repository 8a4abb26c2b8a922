"""The sets by their numbers, which tell nothing about their kind, and their files."""

from pathlib import Path

import numpy as np

from fourth_hand.laboratory import Laboratory, Scene
from fourth_hand.scenes import SCENES
from third_hand.nature import Table

COLUMNS = ("mass", "inertia", "rx", "ry", "x", "y", "theta")
BEFORE = ("vx_pre", "vy_pre", "omega_pre")
AFTER = ("vx_post", "vy_post", "omega_post")

_PLACES = {f"{number + 1:02d}": i for i, number in enumerate(np.random.default_rng(90417).permutation(len(SCENES)))}
SETS: dict[str, Scene] = {name: SCENES[i] for name, i in sorted(_PLACES.items())}


def draw(name: str) -> Table:
    """Make the set of this number."""
    scene, rng = SETS[name], np.random.default_rng([2718, _PLACES[name]])
    lab, n = Laboratory(scene, rng), scene.n
    before, after = scene.noise.errors(rng, n)
    measured = lab.v + before
    noise = lab.size(lab.post + after - lab.impact([], measured)[1])
    post = lab.impact(lab.changes(noise))[1] + after
    place = np.stack([lab.x, -lab.r[:, 1]], -1) + 2e-4 * rng.standard_normal((n, 2))
    values = np.column_stack([lab.mass, lab.inertia, lab.r, place, lab.theta, measured, post])
    columns = dict(zip((*COLUMNS, *BEFORE, *AFTER), values.T, strict=True))
    return Table(columns, [f"body{i + 1}" for i in lab.index])


def write(table: Table, path: Path) -> None:
    """Write the table as the laboratory hands it over: six digits, and nothing that tells what is hidden."""
    lines = [",".join(["object", "order", *table.columns])]
    for k, (name, *values) in enumerate(zip(table.objects, *table.columns.values(), strict=True)):
        lines.append(",".join([name, str(k + 1), *(f"{value:.6g}" for value in values)]))
    path.write_text("\n".join(lines) + "\n", "utf-8", newline="\n")
