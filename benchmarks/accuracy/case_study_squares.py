"""The raw figure of the case study of the squares: heights of contacts against θ, with sharp and with round corners.

python benchmarks/accuracy/case_study_squares.py FOLDER/recordings.parquet docs/case_study_squares.png
"""

import math
import sys

import matplotlib.pyplot as plt
import numpy as np
import torch

from contactlearn.data import tracks
from contactlearn.data.audit.rig import reshaped
from contactlearn.mechanics.shapes import Polygon, contact_point

HALF = 0.03  # m
SQUARE = Polygon(((-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)))


def draw(path: str, out: str) -> None:
    """Find the impacts of the squares and draw the height of the outline's middle at contact against θ."""
    found = tracks.find(
        path=path,
        mass=0.0485,
        shape=SQUARE,
        rate=250,
        columns={"position": ["x", "z"], "angle": "th", "recording": "recording"},
    )
    q, rig = found.impacts.q.numpy(), found.rig
    outline = {name: one.value for name, one in found.floor.outline.items()}
    zero, corner = found.floor.orientation.value, outline["corner"]
    middle = outline["middle_a"] * np.sin(q[:, 2] + zero) + outline["middle_b"] * np.cos(q[:, 2] + zero)
    theta = np.degrees((q[:, 2] + math.pi / 4) % (math.pi / 2) - math.pi / 4)
    lower = found.floor.sinking.value * found.impacts.v_pre[:, 1].median().item()  # at the median speed
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    axes.plot(theta, 1e3 * (q[:, 1] + middle - math.tan(rig.slope.value) * q[:, 0]), ".", color="0.6", markersize=3)
    angle = torch.linspace(-math.pi / 4, math.pi / 4, 181, dtype=torch.float64)
    for shape, offset, label, style in (
        (SQUARE, 0.0, "sharp corners, zero as stated", "--"),
        (reshaped(SQUARE, {"corner": corner}), zero, "round corners, zero as measured", "-"),
    ):
        height = lower + found.floor.height.value - contact_point(shape, angle + offset)[:, 1].numpy()
        axes.plot(np.degrees(angle.numpy()), (1e3 * height).tolist(), "k", linestyle=style, linewidth=1, label=label)
    axes.set(xlabel="θ modulo 90° (°)", ylabel="height of the outline's middle (mm)")
    axes.legend(frameon=False)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    draw(*sys.argv[1:3])
