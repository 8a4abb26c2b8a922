"""Draw a subsample that is even over objects, the sequence of the trials, and the inputs.

The trials of each object are halved at the median of the order, each half at that of θ, and so on through the inputs,
as a k-d tree is built, until the cells hold a few trials.  In the order of the cells every k-th trial is taken, a
random one of its cell.  So every trial is as likely to be taken as any other, and means over the sample are those of
the table; but each corner of the space has its share, which a random draw may miss.
Sources: Bentley 1975, for the tree; Madow & Madow 1944, for the systematic draw.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.mechanics.impacts import Impacts


def space_filling(impacts: Impacts, size: int, generator: torch.Generator) -> Int[Tensor, " size"]:
    """Draw rows, ascending, without repetition.

    An object without a trial takes the place of one of another object that has several, unless there are more objects
    than half of the rows.

    Args:
        impacts: measurements.
        size: rows, as many as there are at most.
        generator: of the choice within cells.
    """
    n = len(impacts)
    shuffled = torch.randperm(n, generator=generator)  # ties, and places within a cell, are at random
    objects = object_numbers(impacts)
    along = _cells(impacts, objects, size, shuffled)
    place = (torch.arange(size, dtype=torch.float64) + torch.rand(1, generator=generator).double()) * (n / size)
    rows = along[place.long().clamp_max(n - 1)]
    return _with_every_object(rows, objects, shuffled).sort().values


def object_numbers(impacts: Impacts) -> Int[Tensor, " n"]:
    """Number the objects from 0, in the order in which they appear."""
    known = {name: k for k, name in enumerate(dict.fromkeys(impacts.object))}
    return torch.tensor([known[name] for name in impacts.object])


def _cells(impacts: Impacts, objects: Int[Tensor, " n"], size: int, shuffled: Tensor) -> Int[Tensor, " n"]:
    """The rows, cell after cell."""
    inputs = _inputs(impacts)[shuffled]
    cell = objects[shuffled]
    halvings = math.ceil(math.log2(max(2, size / (1 + int(objects.max())))))
    for level in range(halvings):
        order = inputs[:, level % inputs.shape[1]].argsort(stable=True)
        order = order[cell[order].argsort(stable=True)]
        here, counts = cell[order].unique_consecutive(return_counts=True)
        first = (counts.cumsum(0) - counts).repeat_interleave(counts)
        upper = 2 * (torch.arange(len(order)) - first) >= counts.repeat_interleave(counts)
        cell[order] = 2 * here.repeat_interleave(counts) + upper
    return shuffled[cell.argsort(stable=True)]


def _inputs(impacts: Impacts) -> Float[Tensor, "n d"]:
    """Columns in the order in which they are halved; the sequence twice, for what changes along it is often sudden."""
    order, theta = impacts.order, impacts.q[:, 2].remainder(2 * math.pi)
    columns = (order, theta, *impacts.v_c.unbind(-1), impacts.v_pre[:, 2], order, impacts.r[:, 0], impacts.q[:, 0])
    return torch.stack(columns, -1)


def _with_every_object(
    rows: Int[Tensor, " size"], objects: Int[Tensor, " n"], shuffled: Int[Tensor, " n"]
) -> Int[Tensor, " size"]:
    """The rows with one of each object that has none, in place of some whose object has several."""
    drawn = objects[rows]
    seen = torch.bincount(drawn, minlength=int(objects.max()) + 1)
    missing = (seen == 0).nonzero()[:, 0]
    if not len(missing) or len(seen) > len(rows) // 2:
        return rows
    order = drawn.argsort(stable=True)
    several = order[1:][drawn[order].diff() == 0]
    rows[several[torch.linspace(0, len(several) - 1, len(missing)).long()]] = torch.zeros(
        len(seen), dtype=torch.long
    ).scatter(0, objects[shuffled], shuffled)[missing]
    return rows
