"""The impulses that a law can give one impact, as a share of the admissible ones (Fig. 2.3 of Fazeli et al. 2017)."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.inference.identification.shared import Box
from contactlearn.laws import Law
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import require_space

_NODES = 33, 17  # of μ and ε; eight times as many change no share of the published drops by 0.01
_JUMP = 0.2  # of the energy ellipse's radius: a wider cell spans a jump of the law


def grid(box: Box, nodes: tuple[int, int], finer: int = 1) -> tuple[Float[Tensor, " a"], Float[Tensor, " b"]]:
    """Nodes of μ, quadratically spaced, and of ε in a box; `finer` steps lie between each two of `nodes`."""
    u, w = (torch.linspace(0, 1, finer * (count - 1) + 1, dtype=torch.float64) for count in nodes)
    return box.mu[0] + u**2 * (box.mu[1] - box.mu[0]), box.eps[0] + w * (box.eps[1] - box.eps[0])


def reached_share(law: Law, impacts: Impacts, box: Box | None = None) -> Float[Tensor, "n"]:
    """Compute the share [N] of the admissible impulses, by area, that a law gives with some (μ, ε) in the box.

    It is the area of those cells of a (μ, ε) grid, as the law maps them, whose centres are admissible.  The laws map
    sliding contacts one to one; where a contact sticks, cells become lines, which have no area.  A cell across a jump
    (Whittaker's law has one) is left out.  The admissible impulses are half of the energy ellipse, since the line
    v_n⁺ = 0 runs through its centre; the few of them that pull count as well.
    """
    require_space("the area of the admissible impulses", impacts.space)
    mu, eps = (nodes.to(impacts.mass) for nodes in grid(box or Box(), _NODES))
    W, v_c = impacts.W, impacts.v_c
    P = law.at(mu[:, None, None], eps[:, None]).impulse(W, v_c)
    across, along = P[1:, 1:] - P[:-1, :-1], P[:-1, 1:] - P[1:, :-1]  # diagonals of the cells
    radius = (v_c * (rigid_body.effective_inertia(W) @ v_c[..., None])[..., 0]).sum(-1).sqrt()
    width = torch.maximum(*((d * (W @ d[..., None])[..., 0]).sum(-1) for d in (across, along))).sqrt()
    counted = rigid_body.admissible(W, v_c, (P[1:, 1:] + P[:-1, :-1]) / 2) & (width < _JUMP * radius)
    area = 0.5 * (across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0]).abs()
    return (area * counted).sum((0, 1)) / (math.pi / 2 * radius**2 / torch.linalg.det(W).sqrt())
