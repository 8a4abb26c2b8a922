"""Measurements that need not fit in memory: impacts in blocks, which are read again at each use.

    Blocks.of(impacts)        impacts that are in memory
    Blocks.survey(…, read)    those of a file: a first reading checks and counts the rows
    blocks.pick(sampled(…))   a random sample of them in memory

Computations trial by trial go over the blocks; fits, figures and pages use a sample.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.fingerprint import Fingerprint
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, Space

BLOCK = 1 << 15
"""Trials of a block: few enough that computations on them take a few hundred megabytes."""
LARGE = 50_000
"""Trials from which on data are read in blocks."""


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """Impacts of a source in blocks of the same fields; `read` starts again at each call.

    Args:
        source: in words.
        trials: of all blocks.
        sha256: of all names and numbers, see `Impacts.fingerprint`.
        space: the plane, or space.
        read: the blocks, in order.
        groups: see `Impacts.groups`, of impacts in memory.
    """

    source: str
    trials: int
    sha256: str
    space: Space
    read: Callable[[], Iterator[Impacts]]
    groups: Int[Tensor, " n"] | None = None

    @classmethod
    def of(cls, impacts: Impacts) -> "Blocks":
        """Return impacts in memory: in one block, or if they are many in several."""
        size = len(impacts)
        step = size if size <= LARGE else BLOCK

        def read() -> Iterator[Impacts]:
            for first in range(0, size, step):
                yield impacts if step == size else impacts[first : first + step]

        source, space, sha256 = impacts.source, impacts.space, impacts.fingerprint()
        return cls(source=source, trials=size, sha256=sha256, space=space, read=read, groups=impacts.groups)

    @classmethod
    def survey(cls, read: Callable[[], Iterator[Impacts]]) -> "Blocks":
        """Read all blocks once.

        Raises:
            DataError: what `read` raises, no trials, or a trial name that occurs twice.
        """
        digest, names, source, space = Fingerprint(), list[np.ndarray](), "", PLANE
        for block in read():
            block.add_to(digest)
            names.append(np.fromiter(map(hash, block.trial), np.int64, len(block)))
            source, space = block.source, block.space
        hashes = np.concatenate(names)
        _check_unique_trials(source, hashes, read)
        return cls(source=source, trials=len(hashes), sha256=digest.hexdigest(), space=space, read=read)

    def where(self, chosen: Bool[Tensor, " n"]) -> Iterator[Impacts]:
        """Yield the chosen trials, in order, block by block."""
        first = 0
        for block in self.read():
            part = chosen[first : first + len(block)]
            first += len(block)
            if part.any():
                yield block if part.all() else block[part]

    def pick(self, chosen: Bool[Tensor, " n"]) -> Impacts:
        """Return the chosen trials, in order, in memory."""
        return joined([*self.where(chosen)])


def sampled(trials: Bool[Tensor, " n"], most: int) -> Bool[Tensor, " n"]:
    """Choose `most` of the trials at random, always the same ones; all of them if they are no more."""
    rows = trials.nonzero()[:, 0]
    if len(rows) <= most:
        return trials
    few = torch.zeros_like(trials)
    few[rows[torch.randperm(len(rows), generator=torch.Generator().manual_seed(0))[:most]]] = True
    return few


def joined(parts: Sequence[Impacts]) -> Impacts:
    """Return impacts of the same fields one after the other."""
    if len(parts) == 1:
        return parts[0]
    values = {
        name: torch.cat([getattr(part, name) for part in parts])
        for name in (*parts[0].space.components, *parts[0].space.covariances)
        if getattr(parts[0], name) is not None
    }
    names = {
        field: tuple(name for part in parts for name in getattr(part, field))
        for field in ("trial", "object", "recording")
    }
    covariates = {
        name: torch.cat([part.covariates[name] for part in parts])  # pyright: ignore[reportArgumentType, reportCallIssue]
        if isinstance(one, Tensor)
        else tuple(name_of for part in parts for name_of in part.covariates[name])
        for name, one in parts[0].covariates.items()
    }
    return parts[0].replace(**values, **names, covariates=covariates)


def _check_unique_trials(source: str, hashes: np.ndarray, read: Callable[[], Iterator[Impacts]]) -> None:
    """Refuse a trial name that occurs twice; where hashes are equal the names are compared."""
    hashes.sort()
    twice = {*hashes[1:][hashes[1:] == hashes[:-1]].tolist()}
    seen: dict[str, int] = {}
    row = 0
    for block in read() if twice else ():
        for name in block.trial:
            row += 1
            if hash(name) in twice and seen.setdefault(name, row) != row:
                raise DataError(
                    f"{source}: trial names must be unique; row {row}, column trial repeats {name!r} of row "
                    f"{seen[name]} (leave one of them out)",
                    row=row,
                )
