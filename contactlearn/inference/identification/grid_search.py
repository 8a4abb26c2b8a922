"""Global search of a box for the least cost: a grid over the box, finer grids about its best nodes, a pattern search.

The costs of B repetitions with S subset sizes each are minimised at once; they need not be smooth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError

Cost = Callable[[Tensor], Tensor]
"""Costs [..., B, S] at parameters (μ, ε) [..., B, S, 2]."""


@dataclass(frozen=True)
class Box:
    """Bounds of μ and ε, and the number of grid nodes along each."""

    mu: tuple[float, float] = (0.0, 1.0)
    eps: tuple[float, float] = (0.0, 1.0)
    nodes: int = 64

    def __post_init__(self) -> None:
        for name, (low, high) in (("mu", self.mu), ("eps", self.eps)):
            if not 0 <= low < high:
                raise DataError(f"bounds of {name} must be 0 ≤ low < high, got {[low, high]}")
        if self.eps[1] > 1:
            raise DataError(f"bounds of eps must end at 1 or below, got {list(self.eps)}")
        if self.nodes < 3:
            raise DataError(f"the grid needs at least 3 nodes a parameter, got {self.nodes}")

    @property
    def low(self) -> Float[Tensor, "2"]:
        """Lower bounds of (μ, ε)."""
        return torch.tensor((self.mu[0], self.eps[0]), dtype=torch.float64)

    @property
    def high(self) -> Float[Tensor, "2"]:
        """Upper bounds of (μ, ε)."""
        return torch.tensor((self.mu[1], self.eps[1]), dtype=torch.float64)

    def axes(self) -> tuple[Tensor, Tensor]:
        """Grid nodes of μ and of ε, [nodes] each."""
        mu, eps = (torch.linspace(*ends, self.nodes, dtype=torch.float64) for ends in (self.mu, self.eps))
        return mu, eps


def nested_sums(grid: Tensor, order: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """Sum the rows of `grid` over the first k trials of `order`, for every size k: [S, nodes²]."""
    pieces = torch.stack([grid[order[a:b]].sum(0) for a, b in pairwise((0, *sizes))])
    return pieces.cumsum(0)


def lowest_nodes(surfaces: Tensor, minima: int, nodes: int) -> Tensor:
    """Find the lowest local minima and the lowest nodes of surfaces [B, S, G, G]: indices [minima + nodes, B, S, 2]."""
    width = surfaces.shape[-1]
    lowest = -torch.nn.functional.max_pool2d(-surfaces, 3, stride=1, padding=1)
    basins = torch.where(surfaces <= lowest, surfaces, torch.inf).flatten(-2)
    value, index = basins.topk(minima, dim=-1, largest=False)
    index = torch.where(value.isfinite(), index, index[..., :1])  # the best is repeated where there are fewer minima
    index = torch.cat((index, surfaces.flatten(-2).topk(nodes, dim=-1, largest=False).indices), -1)
    return torch.stack((index // width, index % width), -1).movedim(-2, 0)


def finer(cost: Cost, x: Tensor, box: Box, keep: int) -> Tensor:
    """Find the best points [keep, B, S, 2] of 7 × 7 grids that reach from each x [K, B, S, 2] to its neighbours."""
    low, high = box.low.to(x), box.high.to(x)
    offsets = torch.linspace(-1, 1, 7, dtype=x.dtype, device=x.device) / (box.nodes - 1)
    offsets = torch.cartesian_prod(offsets, offsets)[:, None, None] * (high - low)
    found = []
    for centre in x:
        around = torch.minimum(torch.maximum(centre + offsets, low), high)
        value, which = cost(around).min(0)
        found.append((value, _pick(around, which)))
    values, points = (torch.stack(parts) for parts in zip(*found, strict=True))
    best = values.topk(keep, dim=0, largest=False).indices
    return points.gather(0, best[..., None].expand(*best.shape, 2))


def pattern_search(cost: Cost, x: Tensor, box: Box, tolerance: float = 1e-6) -> tuple[Tensor, Tensor]:
    """Minimise the cost from the starts x [starts, B, S, 2]: the best x [B, S, 2] and its cost [B, S].

    Each round tries twelve points around x, at first one grid spacing away, and nearer after a round without
    improvement.  The pattern turns from round to round, so that it can follow a valley or a jump at any angle.
    """
    low, high = box.low.to(x), box.high.to(x)
    clock = 2 * torch.pi / 12 * torch.arange(12, dtype=x.dtype, device=x.device).view(12, *(1,) * (x.ndim - 1))
    spacing = 1 / (box.nodes - 1)
    step = torch.full_like(x[..., 0], spacing)
    best = cost(x)
    turn = 0.0
    while bool((step > tolerance).any()):
        around = torch.stack(((clock + turn).cos(), (clock + turn).sin()), -1) * step[..., None] * (high - low)
        around = torch.minimum(torch.maximum(x + around, low), high)
        value, which = cost(around).min(0)
        better = value < best * (1 - 1e-9)
        x = torch.where(better[..., None], _pick(around, which), x)
        best = torch.where(better, value, best)
        # A flat valley may be long, so the step grows again along it.
        step = torch.where(better, (2 * step).clamp_max(spacing), 0.7 * step)
        turn += 2.4  # the golden angle, rad
    best, which = best.min(0)
    return _pick(x, which), best


def _pick(x: Tensor, which: Tensor) -> Tensor:
    """x[which[...], ..., :] along the first axis."""
    return x.gather(0, which[None, ..., None].expand(1, *which.shape, x.shape[-1]))[0]


def ranges_within(cost: Cost, surfaces: Tensor, best: Tensor, x: Tensor, mu: Tensor, eps: Tensor) -> list[Tensor]:
    """Find the ranges [B, S, 2] of μ and of ε over which the least cost stays within 0.1 % of its minimum.

    The other parameter is at its best node or at its optimum, whichever gives the lower cost.
    """
    limit = 1.001 * best[..., None]
    ranges = []
    for own, nodes, profile in ((0, mu, surfaces.amin(-1)), (1, eps, surfaces.amin(-2))):
        line = x.expand(len(nodes), *x.shape).clone()
        line[..., own] = nodes.view(-1, *(1,) * (x.ndim - 1))
        near = (profile <= limit) | (cost(line).movedim(0, -1) <= limit)
        low, high = torch.where(near, nodes, torch.inf).amin(-1), torch.where(near, nodes, -torch.inf).amax(-1)
        ranges.append(torch.stack((torch.minimum(low, x[..., own]), torch.maximum(high, x[..., own])), -1))
    return ranges
