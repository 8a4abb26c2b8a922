"""A set and what is right to say about it.  The analysis is given the impacts alone."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from contactlearn.mechanics.impacts import Impacts


class Asked(StrEnum):
    """What is asked of the diagnosis of a set."""

    EXACT = "exact"  # these effects and no other; none where there is none
    INCLUDES = "includes"  # measured drops, which have effects of their own: the planted one must be among the named
    ORDERED = "ordered"  # the first names in this order
    UNKNOWN = "unknown"  # nothing of the catalogue: to be called unknown, with the right variable
    TWIN = "twin"  # the drops cannot tell the effect from its rivals: one is named and the other shown


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is hidden in a set.

    `effects` has the accepted names of each hidden effect, `rivals` those that these drops cannot tell from the first.
    `variables` are symbols of which an unknown effect depends on at least one; `tolerated` describe a part of it.
    `share` is that of all effects in the law's error and `shares` that of each (see `share`), NaN where no twin exists.
    """

    asked: Asked
    effects: tuple[tuple[str, ...], ...] = ()
    forms: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    variables: tuple[str, ...] = ()
    tolerated: tuple[str, ...] = ()
    share: float = float("nan")
    shares: tuple[float, ...] = ()
    noise: str = ""
    level: float = float("nan")


@dataclass(frozen=True)
class Planted:
    """The impacts and the truth about them."""

    impacts: Impacts
    truth: Truth


@dataclass(frozen=True, kw_only=True)
class PlantedSet:
    """A set of the benchmark: everything about it follows from its seed.

    `half` says whether its outcome may be looked at while the program is improved ("learn"), or only reported.
    """

    group: str
    seed: int
    n: int
    make: Callable[[np.random.Generator, int], Planted]

    @property
    def name(self) -> str:
        """Group and seed."""
        return f"{self.group}-{self.seed}"

    @property
    def half(self) -> str:
        """Even seeds learn, odd ones report."""
        return "report" if self.seed % 2 else "learn"

    def draw(self, n: int | None = None) -> Planted:
        """Make the set, or one like it with `n` trials."""
        return self.make(np.random.default_rng(self.seed), n or self.n)
