"""Where a model fails: regions of the input space in which its error is clearly higher than in the rest.

A region is a window of one variable of the contact before impact, or one contact mode as predicted:

    |θ − 90°| < 20° (mod 180°): error 2.3 times the rest, 132 trials, p = 3e-8

Search and test never see the same trials.  On a random half of them every window between rounded
quantiles of every variable is scored by how far the mean rank of its errors stands out.  The best is
kept, its trials and a margin of one quantile set aside, and the search repeated on what is left, a few
times: so each region says something that those before it do not, and the shadow of one in a related
variable has nothing left to stand out.  On the other half each of the few is tested once, likewise
without the trials of those before it, by the one-sided rank-sum test with the correction of Holm.
However many windows were searched, where errors do not depend on the inputs the probability of
reporting anything at all is no more than 5 %.

A higher error is not yet a missing effect: noise, or the error relative to a slow outcome, may be larger there.
Sources: Wilcoxon 1945; Holm 1979; peeling as in Friedman & Fisher 1999.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from scipy.stats import rankdata
from torch import Tensor

from contactlearn.diagnosis.failure.variables import Grid, variables
from contactlearn.errors import DataError
from contactlearn.evaluation.metrics import mass_error
from contactlearn.impacts import Impacts, Prediction

_GROSS = 5.0  # medians of the errors of a region, or of the rest: what is beyond counts as that
_NEW = 0.5  # of a region's trials, at least, that are in none before it


@dataclass(frozen=True, eq=False)
class Region:
    """Trials with the `variable` in [low, high), SI units, infinite if open; [low, low + period) may go beyond ±π.

    `ratio` of the mean error, gross ones curbed, to that of the rest, its 95 % `interval` and the corrected `p_value`
    are of the half that was not searched, so that the search does not flatter them, and of trials that no region
    found before it has; `trials` and `rows` [N] (bool) are all of the region, in both halves.
    """

    variable: str
    low: float
    high: float
    where: str
    ratio: float
    interval: tuple[float, float]
    p_value: float
    rows: Tensor

    @property
    def trials(self) -> int:
        return int(self.rows.sum())

    def __str__(self) -> str:
        times = f"{self.ratio:.1f}" if self.ratio < 10 else f"{self.ratio:.0f}"
        digit, exponent = f"{self.p_value:.0e}".split("e")
        p = f"{digit}e{int(exponent)}" if self.p_value < 1e-3 else f"{self.p_value:.1g}"
        return f"{self.where}: error {times} times the rest, {self.trials} trials, p = {p}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON: an open limit is None, rows are indices from 0."""
        plain = {name: getattr(self, name) for name in ("variable", "where", "ratio", "trials", "p_value")}
        limits = {name: x if math.isfinite(x) else None for name, x in (("low", self.low), ("high", self.high))}
        rows = self.rows.nonzero()[:, 0].tolist()
        return plain | limits | {"interval": list(self.interval), "rows": rows, "sentence": str(self)}


def find_regions(
    impacts: Impacts,
    prediction: Prediction,
    *,
    generator: torch.Generator,
    most: int = 5,
    smallest: int = 10,
    clearly: float = 1.5,
    level: float = 0.05,
) -> list[Region]:
    """Regions in which `mass_error` of a prediction is clearly higher than in the rest, the surest first.

    Args:
        generator: of the random halves.
        most: regions that are tested.
        smallest: trials of a region in the half that is searched, at least.
        clearly: ratio of the errors from which on a region is worth a sentence; noise alone, in v_pre as in v_post,
            makes it 1.3 between some orientations of the published ellipse.
        level: probability of reporting anything where errors do not depend on the inputs.

    Raises:
        DataError: an error is not finite.
    """
    errors = mass_error(impacts, prediction).reshape(-1, len(impacts)).mean(0)
    if not errors.isfinite().all():
        row = int(errors.isfinite().logical_not().nonzero()[0, 0]) + 1
        raise DataError(f"{impacts.source}: row {row}: its error must be finite, got {errors[row - 1]:g}", row=row)
    searched = torch.zeros(len(impacts), dtype=torch.bool)
    searched[torch.randperm(len(impacts), generator=generator)[: len(impacts) // 2]] = True
    grids = [Grid.of(variable, searched) for variable in variables(impacts, prediction)]
    candidates = _search(grids, errors, searched, most, smallest)
    p_values = _holm([_p_value(errors, rows, left & ~searched) for *_, rows, left in candidates])
    regions = []
    for (grid, window, rows, left), p_value in zip(candidates, p_values, strict=True):
        ratio, interval = _ratio(errors[rows & left & ~searched], errors[~rows & ~searched])
        if p_value <= level and ratio >= clearly and interval[0] > 1:
            name, limits = grid.variable.name, grid.limits[window].tolist()
            regions.append(Region(name, *limits, grid.variable.said(*limits), ratio, interval, p_value, rows))
    return sorted(regions, key=lambda region: region.p_value)


@dataclass(frozen=True)
class Improvement:
    """Mean error of a region, and of the other trials, before and after a change of the model.

    `change` of the region's mean error has its 95 % `interval`, of paired trials, and so has what it is `beyond` the
    change of the others; `share` is the part of the change summed over all trials that comes from the region, 0
    where that sum is.
    """

    region: Region
    before: float
    after: float
    rest_before: float
    rest_after: float
    interval: tuple[float, float]
    beyond: tuple[float, float]
    share: float

    @property
    def change(self) -> float:
        return self.after - self.before

    @property
    def helped(self) -> bool:
        """Whether the error of the region surely fell, and by more than elsewhere."""
        return self.interval[1] < 0 and self.beyond[1] < 0

    def __str__(self) -> str:
        rest = f"(rest {self.rest_before:.3g} → {self.rest_after:.3g})"
        return f"{self.region.where}: error {self.before:.3g} → {self.after:.3g} {rest}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        names = ("before", "after", "rest_before", "rest_after", "share", "helped")
        plain = {name: getattr(self, name) for name in names}
        return {"where": self.region.where} | plain | {"interval": list(self.interval), "sentence": str(self)}


def improvement_by_region(regions: Sequence[Region], errors_before: Tensor, errors_after: Tensor) -> list[Improvement]:
    """Where a change of the model, such as an added effect, helped; errors [N] of the same trials, both held out."""
    found, change = [], errors_after - errors_before
    for region in regions:
        inside, outside = region.rows, ~region.rows
        n, mean, rest = region.trials, change[inside].mean().item(), change[outside].mean().item()
        variance, of_rest = (change[rows].var().item() / rows.sum().item() for rows in (inside, outside))
        margin, wider = 1.959964 * math.sqrt(variance), 1.959964 * math.sqrt(variance + of_rest)
        means = (errors[rows].mean().item() for rows in (inside, outside) for errors in (errors_before, errors_after))
        share = n * mean / change.sum().item() if change.sum() else 0.0
        beyond = mean - rest - wider, mean - rest + wider
        found.append(Improvement(region, *means, (mean - margin, mean + margin), beyond, share))
    return found


def _search(
    grids: Sequence[Grid], errors: Tensor, searched: Tensor, most: int, smallest: int
) -> list[tuple[Grid, int, Tensor, Tensor]]:
    """The best windows, best first: the grid, the window, its trials, and those that are in none before it, [N]."""
    found, left = [], torch.ones_like(searched)
    size = [grid.sums(searched.double())[0] for grid in grids]
    while len(found) < most and (searched & left).sum() >= 2 * smallest:
        within = (searched & left).double()
        ranks = _ranks(errors, searched & left)
        best = (0.0, None, 0)
        for grid, all_trials in zip(grids, size, strict=True):
            trials, total = grid.sums(within, ranks)
            allowed = (trials >= smallest) & (within.sum() - trials >= smallest) & (trials >= _NEW * all_trials)
            score = torch.where(allowed, _standardised(trials, total, ranks, within), 0.0)
            if len(score) and score.max() > best[0]:
                best = (score.max().item(), grid, int(score.argmax()))
        _, grid, window = best
        if grid is None:
            break
        found.append((grid, window, grid.rows(window), left))
        left = left & ~grid.rows(window, margin=0 if grid.variable.labels else 1)
    return found


def _ranks(errors: Tensor, within: Tensor) -> Tensor:
    """Ranks [N] of the errors among those within, 0 for the others and on the average; ties share theirs."""
    ranks = torch.zeros_like(errors)
    ranks[within] = torch.from_numpy(rankdata(errors[within].numpy()))
    return torch.where(within, ranks - (within.sum() + 1) / 2, 0.0)


def _standardised(trials: Tensor, total: Tensor, ranks: Tensor, within: Tensor) -> Tensor:
    """Sum of the ranks of some of the trials within, in standard deviations of one drawn at random."""
    n = within.sum()
    spread = trials * (n - trials) / n * ranks.square().sum() / (n - 1)
    return total / spread.clamp_min(1e-9).sqrt()


def _p_value(errors: Tensor, rows: Tensor, within: Tensor) -> float:
    """One-sided, that errors [N] within are no higher at `rows`: the normal limit, cautious far out."""
    ranks = _ranks(errors, within)
    score = _standardised((rows & within).sum(), ranks[rows].sum(), ranks, within)
    return torch.special.erfc(score / math.sqrt(2)).div(2).clamp_min(1e-300).item()


def _holm(p_values: Sequence[float]) -> list[float]:
    """Corrected for their number, in the given order."""
    corrected, floor = list(p_values), 0.0
    for rank, k in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        floor = corrected[k] = max(floor, min(1.0, (len(p_values) - rank) * p_values[k]))
    return corrected


def _ratio(inside: Tensor, outside: Tensor) -> tuple[float, tuple[float, float]]:
    """Ratio of the mean errors, gross ones curbed, with its 95 % interval by the delta method; 1 if too few."""
    if min(len(inside), len(outside)) < 2 or not inside.median() * outside.median() > 0:
        return 1.0, (0.0, math.inf)
    inside, outside = (errors.clamp_max(_GROSS * errors.median()) for errors in (inside, outside))
    ratio = (inside.mean() / outside.mean()).item()
    spread = math.sqrt(sum((e.var() / (len(e) * e.mean() ** 2)).item() for e in (inside, outside)))
    return ratio, (ratio * math.exp(-1.959964 * spread), ratio * math.exp(1.959964 * spread))
