"""Results of the search for regions: windows of a variable in which a model fails, and the effect of a change there."""

import math
from dataclasses import dataclass

from contactlearn.inference.evaluation.metrics import Interval


@dataclass(frozen=True, kw_only=True)
class Region:
    """Trials with a variable of the contact before impact in [low, high), where the law's error is clearly higher.

    Args:
        variable: by name, see `failure.variables`.
        where: the window in words.
        low: lower limit in SI units; None if open.
        high: upper limit likewise; of a periodic variable it may lie beyond ±π.
        ratio: mean error inside to that of the rest, with its 95 % interval, on trials that were not searched.
        p_value: of the one-sided rank-sum test on the same trials, corrected for the number of regions.
        rows: all trials inside, counted from 0.
    """

    variable: str
    where: str
    low: float | None
    high: float | None
    ratio: Interval
    p_value: float
    rows: tuple[int, ...]

    @property
    def trials(self) -> int:
        """Number of trials inside."""
        return len(self.rows)

    @property
    def limits(self) -> tuple[float, float]:
        """[low, high), infinite where open."""
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high


@dataclass(frozen=True, kw_only=True)
class Improvement:
    """Mean errors inside a region and in the rest, before and after an effect is added.

    `change` is that of the mean error inside, `excess` the change inside minus that of the rest, both with 95 %
    intervals over paired trials; `share` is the part of the change summed over all trials that comes from inside.
    """

    before: float
    after: float
    rest_before: float
    rest_after: float
    change: Interval
    excess: Interval
    share: float

    @property
    def helped(self) -> bool:
        """Whether the error inside fell beyond chance, and by more than in the rest."""
        return self.change.high < 0 and self.excess.high < 0
