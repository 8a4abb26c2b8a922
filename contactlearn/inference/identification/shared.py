"""Identification of the shared parameters (μ, ε) of a law, Eq. (3.1) of Fazeli et al. (2017).

    minimise over (μ, ε):  C(μ, ε) = 1/k Σ_n ‖P_n − P̂_n(μ, ε)‖₂      over k random trials, m times

C is not smooth (trials change their contact mode) and can have several minima, so no single local optimiser finds the
least.  It is evaluated on a grid over the whole box, once for all trials, and the surface of every subset is a mean of
these values.  Finer grids surround the lowest local minima and the lowest nodes of each surface, and their best points
start a pattern search, whose best result is kept.  The search can miss a basin narrower than a sixth of the grid's
spacing, or one without a low node near it.

Where all trials stick, μ is only bounded below: `mu_range` and `eps_range` are the ranges of each parameter within
which the cost, minimised over the other, rises by no more than 0.1 %.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise

import torch
from jaxtyping import Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.inference.identification.result import Box, SubsetFit
from contactlearn.laws import Law, named
from contactlearn.mechanics.impacts import Impacts, measured_impulse, require_impacts

Cost = Callable[[Tensor], Tensor]
"""Costs [..., B, S] at parameters (μ, ε) [..., B, S, 2]."""


__all__ = ["Box", "SubsetFit", "cost_surface", "distances", "fit_subsets"]


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


def pattern_search(cost: Cost, x: Tensor, box: Box) -> tuple[Tensor, Tensor]:
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
    while bool((step > 1e-6).any()):
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


def distances(law: Law, impacts: Impacts, mu: Tensor, eps: Tensor, *, target: str) -> Tensor:
    """Compute ‖P_n − P̂_n‖₂ [..., N] in N s, broadcast over μ and ε [..., N]."""
    P = law.at(mu, eps).impulse(impacts.W, impacts.v_c)
    return _length(P - measured_impulse(impacts, target))


def _length(x: Tensor) -> Tensor:
    """‖x‖₂ over a last axis of 2 or 3; a reduction over so short an axis takes several times as long."""
    first, *others = x.unbind(-1)
    return sum((part**2 for part in others), first**2).sqrt()


def cost_surface(law: Law, impacts: Impacts, mu: Tensor, eps: Tensor, *, target: str = "momentum") -> Tensor:
    """Compute C(μ, ε) [len(mu), len(eps)] in N s over all given trials (Fig. 3.3)."""
    parts = (
        distances(law, impacts[rows], mu[:, None, None], eps[:, None], target=target).sum(-1)
        for rows in torch.arange(len(impacts)).split(_TRIALS)
    )
    return torch.stack([*parts]).sum(0) / len(impacts)


def fit_subsets(
    impacts: Impacts,
    law: Law | str,
    *,
    sizes: Sequence[int] | None = None,
    repetitions: int = 100,
    orders: Int[Tensor, "m k"] | None = None,
    generator: torch.Generator | None = None,
    target: str = "momentum",
    box: Box | None = None,
    progress: Callable[[Iterable[Tensor]], Iterable[Tensor]] = iter,
) -> SubsetFit:
    """Identify one (μ, ε) from the first k trials of m random orders, for every k of `sizes`.

    Args:
        impacts: trials to draw from, without replacement within a repetition.
        law: an analytical law or its name; its own μ and ε are ignored.
        sizes: subset sizes k, increasing; the subsets of one repetition are nested.  Four fifths of the trials if None.
        repetitions: m.
        orders: m orders of the trials [m, k] as rows, at least as many as the largest size; random if left out.
        generator: source of the random orders; seed 0 if left out.
        target: the measured impulse, see `impacts.measured_impulse`.
        box: bounds and grid.
        progress: wraps the iteration over blocks of repetitions, so that a bar can show it.

    Raises:
        DataError: fewer trials than the largest size, or sizes that do not increase.
        UnknownNameError: no such law or target.
    """
    require_impacts(impacts)
    law = named(law)
    sizes, box = (max(1, 4 * len(impacts) // 5),) if sizes is None else tuple(sizes), box or Box()
    orders = _orders(impacts, sizes, repetitions, orders, generator or torch.Generator().manual_seed(0))
    mu, eps = (axis.to(impacts.mass) for axis in box.axes())
    # One evaluation serves every subset: [trials that are drawn, nodes²].
    drawn, rows = orders.unique(return_inverse=True)
    impacts = impacts if len(drawn) == len(impacts) else impacts[drawn]
    grid, rows, count = _grid(law, impacts, mu, eps, target), rows.to(mu.device), torch.tensor(sizes).to(mu)
    P = measured_impulse(impacts, target)
    found = []
    # Repetitions go in blocks, so that a block's surfaces and searches fit in memory.
    for block in progress(rows.split(max(1, _BLOCK // (len(sizes) * (sizes[-1] + box.nodes**2 // 8))))):
        surfaces = torch.stack([nested_sums(grid, order, sizes) for order in block])
        surfaces = (surfaces / count[:, None]).unflatten(-1, (box.nodes, box.nodes))
        found.append(_search(_mean_distance(law, impacts, P, block, sizes), surfaces, box, mu, eps))
    x, best, mu_range, eps_range = (torch.cat(parts) for parts in zip(*found, strict=True))
    mu_flat = mu_range[..., 1] - mu_range[..., 0] > 0.1 * (box.mu[1] - box.mu[0])
    return SubsetFit(law, sizes, x[..., 0], x[..., 1], best, mu_range, eps_range, mu_flat)


def _grid(law: Law, impacts: Impacts, mu: Tensor, eps: Tensor, target: str) -> Tensor:
    """Distances [N, nodes²] at the nodes of μ and ε, a few trials at a time."""
    grid = mu.new_empty(len(impacts), len(mu) * len(eps))
    for rows in torch.arange(len(impacts)).split(_TRIALS):
        at = distances(law, impacts[rows], mu[:, None, None], eps[:, None], target=target)
        grid[rows] = at.flatten(0, 1).T
    return grid


def _orders(
    impacts: Impacts, sizes: tuple[int, ...], repetitions: int, orders: Tensor | None, generator: torch.Generator
) -> Tensor:
    """Rows [m, largest size] of the subsets, given or random; `fit_subsets` lists the errors."""
    if not sizes or sizes[0] < 1 or any(b <= a for a, b in pairwise(sizes)):
        raise DataError(f"sizes must be positive and increasing, got {list(sizes)}")
    if sizes[-1] > len(impacts):
        raise DataError(
            f"{impacts.source}: {sizes[-1]} trials were requested, but only {len(impacts)} are there to draw from"
        )
    if repetitions < 1:
        raise DataError(f"repetitions must be at least 1, got {repetitions}")
    if orders is None:
        drawn = (torch.randperm(len(impacts), generator=generator) for _ in range(repetitions))
        orders = torch.stack([order[: sizes[-1]] for order in drawn])
    if orders.shape[1] < sizes[-1]:
        raise DataError(f"orders must hold the largest size, {sizes[-1]} trials each, got {orders.shape[1]}")
    return orders[:, : sizes[-1]]


def _mean_distance(law: Law, impacts: Impacts, P: Tensor, block: Tensor, sizes: tuple[int, ...]) -> Cost:
    """Mean distance [..., B, S] of a block's subsets as a function of the parameters [..., B, S, 2]."""
    member = torch.arange(sizes[-1], device=P.device) < torch.tensor(sizes, device=P.device)[:, None]
    W, v_c, measured = impacts.W[block][:, None], impacts.v_c[block][:, None], P[block][:, None]

    def cost(x: Tensor) -> Tensor:
        P_hat = law.at(x[..., 0, None], x[..., 1, None]).impulse(W, v_c)
        return (_length(P_hat - measured) * member).sum(-1) / member.sum(-1)

    return cost


def _tilted(cost: Cost, x: Tensor) -> Tensor:
    return cost(x) * (1 + _TILT * x[..., 0])


def _search(cost: Cost, surfaces: Tensor, box: Box, mu: Tensor, eps: Tensor) -> tuple[Tensor, ...]:
    """Best x [B, S, 2], its cost [B, S] and the ranges of μ and of ε [B, S, 2], from surfaces [B, S, nodes, nodes]."""
    # Where all trials stick, every large μ costs the same: the least of them is taken, not what rounding decides, and
    # from it the search sees the end of that plain.
    surfaces = surfaces * (1 + _TILT * mu[:, None])
    cost = partial(_tilted, cost)
    single = surfaces.shape[1] == 1
    low = lowest_nodes(surfaces, *((4, 24) if single else (2, 2)))
    starts = torch.stack((mu[low[..., 0]], eps[low[..., 1]]), -1)
    x, best = pattern_search(cost, finer(cost, starts, box, keep=3 if single else 1), box)
    return x, best, *ranges_within(cost, surfaces, best, x, mu, eps)


_TILT = 1e-9  # of a cost by μ, relative: more than rounding
_TRIALS = 512  # of which the distances at all nodes are in memory at a time
_BLOCK = 1 << 17  # elements of a block: repetitions × sizes × (trials + an eighth of the nodes)
