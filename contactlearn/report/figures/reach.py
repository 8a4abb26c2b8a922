"""The region of impulse space that a law can give one impact: its image of a box of (μ, ε), as a union of cells.

A grid over the box is mapped cell by cell; its nodes lie closer at small μ, where the impulse changes fastest.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.inference.identification.shared import Box
from contactlearn.laws import Law
from contactlearn.mechanics import rigid_body
from contactlearn.report.figures.style import array

_JUMP = 0.03  # of the ellipse's size, between the corners of a cell
_RESOLUTION = 4000  # steps across the ellipse: finer than a printer's dot

Cells = Float[np.ndarray, "_ 4 2"]


def grid(box: Box, nodes: tuple[int, int], finer: int = 1) -> tuple[Float[Tensor, " a"], Float[Tensor, " b"]]:
    """Nodes of μ, quadratically spaced, and of ε in a box; `finer` steps lie between each two of `nodes`."""
    u, w = (torch.linspace(0, 1, finer * (count - 1) + 1, dtype=torch.float64) for count in nodes)
    return box.mu[0] + u**2 * (box.mu[1] - box.mu[0]), box.eps[0] + w * (box.eps[1] - box.eps[0])


def reach(
    law: Law,
    W: Float[Tensor, "2 2"],
    v_c: Float[Tensor, "2"],
    box: Box,
    nodes: tuple[int, int] = (65, 33),
    finer: int = 4,
) -> Cells:
    """The cells of a (μ, ε) grid as a law maps them, each as its four corners in N s, counter-clockwise.

    Sticking makes μ void, and maps many cells onto one; one of them is kept.  Where P̂ jumps (Whittaker's does) a cell
    would hold impulses that the law cannot give: it is split, and parts that jump still are left out.
    """
    mu, eps = grid(box, nodes, finer)
    P = array(law.at(mu[:, None], eps).impulse(W, v_c))
    size = np.linalg.norm(np.ptp(array(rigid_body.energy_ellipse(W, v_c)), axis=0))
    parts, coarse = _cells(P), _cells(P[::finer, ::finer])
    jumps = np.linalg.norm(np.ptp(parts, axis=2), axis=-1) > _JUMP * size
    split = jumps.reshape(nodes[0] - 1, finer, nodes[1] - 1, finer).any((1, 3))
    parts = parts[~jumps & split.repeat(finer, 0).repeat(finer, 1)]
    unit = size / _RESOLUTION
    cells = np.round(np.concatenate((coarse[~split], parts)) / unit)
    cells = np.where((areas(cells) < 0)[:, None, None], cells[:, ::-1], cells)
    return np.unique(cells, axis=0) * unit


def areas(cells: Cells) -> Float[np.ndarray, " cells"]:
    """Signed areas of cells."""
    across, up = cells[:, 2] - cells[:, 0], cells[:, 3] - cells[:, 1]
    return 0.5 * (across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0])


def clipped(polygon: Float[np.ndarray, "n 2"], normal: Float[np.ndarray, "2"], bound: float) -> np.ndarray:
    """The part of a convex polygon where normal·P ≥ bound."""
    kept = []
    height = polygon @ normal - bound
    for p, q, h, k in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
        kept += [p] if h >= 0 else []
        kept += [p + h / (h - k) * (q - p)] if h * k < 0 else []
    return np.array(kept)


def _cells(P: Float[np.ndarray, "a b 2"]) -> Float[np.ndarray, "c d 4 2"]:
    """Corners of the cells between nodes, c = a − 1 by d = b − 1."""
    return np.stack((P[:-1, :-1], P[1:, :-1], P[1:, 1:], P[:-1, 1:]), 2)
