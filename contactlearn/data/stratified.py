"""A stratified sample of many trials: all objects, the whole sequence, and all combinations of their inputs.

Trials are sorted into cells: equal shares of cos θ, sin θ, v_x, v_y and ω before contact, objects, and eighths of the
sequence; the larger the sample, the finer the shares.  From every cell the same number is drawn, and from cells with
fewer all, so that rare combinations and objects are there.  One pass picks a random sample that tells the shares, one
draws.
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.data.blocks import Blocks, sampled
from contactlearn.impacts import Impacts

_PARTS = 8  # of the sequence
_IN_A_CELL = 4  # trials, about, where all cells are as full
_SEEN = 5_000  # random trials that tell the shares


def stratified(blocks: Blocks, size: int, seed: int = 0) -> Bool[Tensor, " n"]:
    """Choose `size` of the trials, for `Blocks.pick`; all if they are no more."""
    every = torch.ones(blocks.trials, dtype=torch.bool)
    if blocks.trials <= size:
        return every
    shares = max(1, int((size / (_IN_A_CELL * _PARTS)) ** (1 / 5)))
    inner = torch.linspace(0, 1, shares + 1, dtype=torch.float64)[1:-1]
    edges = _inputs(blocks.pick(sampled(every, _SEEN))).quantile(inner, dim=0)
    objects: dict[str, int] = {}
    cells = torch.cat([_cells(block, edges, objects) for block in blocks.read()])
    part = torch.arange(blocks.trials) * _PARTS // blocks.trials
    keys = torch.randperm(blocks.trials, generator=torch.Generator().manual_seed(seed))
    order = keys[torch.argsort((cells * _PARTS + part)[keys], stable=True)]  # by cell, at random within each
    _, counts = (cells * _PARTS + part).unique(return_counts=True)
    rank = torch.arange(blocks.trials) - torch.repeat_interleave(counts.cumsum(0) - counts, counts)
    chosen = torch.zeros_like(every)
    ties = torch.randperm(blocks.trials, generator=torch.Generator().manual_seed(seed + 1))
    chosen[order[(rank * blocks.trials + ties).argsort()[:size]]] = True  # the first of every cell, then the second …
    return chosen


def _inputs(impacts: Impacts) -> Float[Tensor, "n 5"]:
    theta = impacts.q[:, 2, None]
    return torch.cat((theta.cos(), theta.sin(), impacts.v_pre), -1)


def _cells(impacts: Impacts, edges: Float[Tensor, "k 5"], objects: dict[str, int]) -> Int[Tensor, " n"]:
    """Number of the cell of each trial; `objects` learns those that it meets."""
    inputs = _inputs(impacts)
    cell = torch.tensor([objects.setdefault(name, len(objects)) for name in impacts.object])
    for column, inner in zip(inputs.T, edges.T, strict=True):
        cell = cell * (len(edges) + 1) + torch.searchsorted(inner.contiguous(), column.contiguous())
    return cell
