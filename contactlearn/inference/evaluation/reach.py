"""The impulses that a law can give one impact, as a share of the admissible ones (Fig. 2.3 of Fazeli et al. 2017)."""

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.inference.identification.result import Box
from contactlearn.laws import Law
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.hull import signed_areas
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import require_space

_NODES = 33, 17  # of μ and ε; eight times as many change no share of the published drops by 0.01
_JUMP = 0.2  # of the energy ellipse's radius: a wider cell spans a jump of the law

_CELL_NODES, _CELL_FINER = (65, 33), 4  # of μ and ε; steps between two of them, where an impulse jumps
_CELL_JUMP = 0.03  # of the ellipse's size, between the corners of a cell that is drawn
_RESOLUTION = 4000  # steps across the ellipse: finer than a printer's dot
_PAGE_NODES, _PAGE_FINER = (9, 5), 4  # of μ and ε; between two of them, to see where an impulse jumps
_PAGE_JUMP = 0.15  # of the momentum, between neighbours of the finer grid

Cells = Float[np.ndarray, "_ 4 2"]


def grid(box: Box, nodes: tuple[int, int], finer: int = 1) -> tuple[Float[Tensor, " a"], Float[Tensor, " b"]]:
    """Nodes of μ, quadratically spaced, and of ε in a box; `finer` steps lie between each two of `nodes`."""
    u, w = (torch.linspace(0, 1, finer * (count - 1) + 1, dtype=torch.float64) for count in nodes)
    return box.mu[0] + u**2 * (box.mu[1] - box.mu[0]), box.eps[0] + w * (box.eps[1] - box.eps[0])


def reached_share(law: Law, impacts: Impacts) -> Float[Tensor, "n"]:
    """Compute the share [N] of the admissible impulses, by area, that a law gives with some (μ, ε) in the default box.

    It is the area of those cells of a (μ, ε) grid, as the law maps them, whose centres are admissible.  The laws map
    sliding contacts one to one; where a contact sticks, cells become lines, which have no area.  A cell across a jump
    (Whittaker's law has one) is left out.  The admissible impulses are half of the energy ellipse, since the line
    v_n⁺ = 0 runs through its centre; the few of them that pull count as well.
    """
    require_space("the area of the admissible impulses", impacts.space)
    mu, eps = (nodes.to(impacts.mass) for nodes in grid(Box(), _NODES))
    W, v_c = impacts.W, impacts.v_c
    P = law.at(mu[:, None, None], eps[:, None]).impulse(W, v_c)
    across, along = P[1:, 1:] - P[:-1, :-1], P[:-1, 1:] - P[1:, :-1]  # diagonals of the cells
    radius = (v_c * (rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0]).sum(-1).sqrt()
    width = torch.maximum(*((d * (W @ d[..., None])[..., 0]).sum(-1) for d in (across, along))).sqrt()
    counted = rigid_body.admissible(W, v_c, (P[1:, 1:] + P[:-1, :-1]) / 2) & (width < _JUMP * radius)
    area = 0.5 * (across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0]).abs()
    return (area * counted).sum((0, 1)) / (math.pi / 2 * radius**2 / torch.linalg.det(W).sqrt())


def reached_cells(law: Law, W: Float[Tensor, "2 2"], v_c: Float[Tensor, "2"], box: Box) -> Cells:
    """The cells of a (μ, ε) grid as a law maps them, each as its four corners in N s, counter-clockwise.

    Sticking makes μ void, and maps many cells onto one; one of them is kept.  Where P̂ jumps (Whittaker's does) a cell
    would hold impulses that the law cannot give: it is split, and parts that jump still are left out.
    """
    mu, eps = grid(box, _CELL_NODES, _CELL_FINER)
    P = _array(law.at(mu[:, None], eps).impulse(W, v_c))
    size = np.linalg.norm(np.ptp(_array(rigid_body.energy_ellipse(W, v_c)), axis=0))
    parts, coarse = _cells(P), _cells(P[::_CELL_FINER, ::_CELL_FINER])
    jumps = np.linalg.norm(np.ptp(parts, axis=2), axis=-1) > _CELL_JUMP * size
    split = jumps.reshape(_CELL_NODES[0] - 1, _CELL_FINER, _CELL_NODES[1] - 1, _CELL_FINER).any((1, 3))
    parts = parts[~jumps & split.repeat(_CELL_FINER, 0).repeat(_CELL_FINER, 1)]
    unit = size / _RESOLUTION
    cells = np.round(np.concatenate((coarse[~split], parts)) / unit)
    cells = np.where((signed_areas(cells) < 0)[:, None, None], cells[:, ::-1], cells)
    return np.unique(cells, axis=0) * unit


def reached_nodes(
    law: Law, W: Float[Tensor, "n 2 2"], v_c: Float[Tensor, "n 2"]
) -> tuple[Float[Tensor, "n a b 2"], Bool[Tensor, "n c d"]]:
    """Return impulses at nodes of (μ, ε), and whether they jump between neighbours, c = a − 1 by d = b − 1.

    Impulses are in units of the momentum ‖M_c v_c‖.
    """
    mu, eps = grid(Box(), _PAGE_NODES, _PAGE_FINER)
    P = law.at(mu[:, None, None], eps[:, None]).impulse(W, v_c)
    momentum = (rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0].norm(dim=-1)
    P = (P / momentum[:, None]).movedim(2, 0)
    along, across = ((step.norm(dim=-1) > _PAGE_JUMP) for step in (P.diff(dim=1), P.diff(dim=2)))
    jumps = along[:, :, 1:] | across[:, 1:]
    cells = jumps.unflatten(2, (_PAGE_NODES[1] - 1, _PAGE_FINER)).unflatten(1, (_PAGE_NODES[0] - 1, _PAGE_FINER))
    return P[:, ::_PAGE_FINER, ::_PAGE_FINER], cells.any(4).any(2)


def _cells(P: Float[np.ndarray, "a b 2"]) -> Float[np.ndarray, "c d 4 2"]:
    """Corners of the cells between nodes, c = a − 1 by d = b − 1."""
    return np.stack((P[:-1, :-1], P[1:, :-1], P[1:, 1:], P[:-1, 1:]), 2)


def _array(values: Tensor) -> np.ndarray:
    return values.detach().cpu().numpy()
