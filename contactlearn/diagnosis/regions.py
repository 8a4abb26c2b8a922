"""Regions of the input space in which the error of a model is clearly higher than in the rest.

A region is a window of one variable of the contact before impact, or one contact mode as predicted:

    |θ − 90°| < 20° (mod 180°): error 2.3 times the rest, 132 trials, p = 3e-8

Search and test never see the same trials.  On a random half of them every window between rounded quantiles of every
variable is scored by how far the mean rank of its errors stands out.  The best is kept, its trials and a margin of one
quantile set aside, and the search repeated on the other trials, a few times: so each region adds to those before it,
and its shadow in a related variable does not stand out.  On the other half each of the few is tested once, likewise
without the trials of those before it, by the one-sided rank-sum test with the correction of Holm.  However many windows
were searched, where errors do not depend on the inputs the probability of reporting any region is at most 5 %.

A higher error is not yet a missing effect: noise, or the error relative to a slow outcome, may be larger there.

Sources: Wilcoxon 1945; Holm 1979; peeling as in Friedman & Fisher 1999.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import Z_95
from contactlearn.diagnosis.result.effects import Improvement, Region
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.inference.evaluation.variables import Variable, variables
from contactlearn.mechanics.impacts import Impacts, Prediction

_CELLS, _OF_MANY = 48, 200  # quantiles of a variable, at most; of tables that leave each of them `_MANY` trials
_MANY = 250
_FINEST = 4  # trials between two of them in the half that is searched, at least
_MAX_REGIONS = 5  # regions that are tested; the correction for their number costs power
_GROSS = 5.0  # medians at which an error is curbed, inside and in the rest, so that no outlier makes a region
_NEW = 0.5  # share of a region's trials that are in no region before it
_SMALLEST = 10  # trials of a region, and of its rest, in the half that is searched


@dataclass(frozen=True)
class Grid:
    """A variable in cells of about equal number, its windows from one cell up to another, and their limits."""

    variable: Variable
    cell: Int[Tensor, " n"]
    count: int
    ends: Int[Tensor, "c 2"]
    limits: Float[Tensor, "c 2"]

    @classmethod
    def of(cls, variable: Variable, searched: Bool[Tensor, " n"]) -> "Grid":
        """Divide a variable by quantiles of the trials that are searched."""
        period, values = variable.period, variable.values
        values = values.remainder(period) if period else values.contiguous()
        cuts = _cuts(variable, values[searched])
        cell, count = torch.searchsorted(cuts, values, right=True), len(cuts) + 1
        bounds = pad(pad(cuts, (1, 0), value=-math.inf), (0, 1), value=math.inf)
        if period and count > 1:  # the first and the last cell are one, and windows may go on around the circle
            cell, count = cell.remainder(count - 1), count - 1
            bounds = torch.cat((cuts[-1:] - period, cuts, cuts + period))
        start = torch.arange(count)[:, None]
        length = torch.arange(1, 2 if variable.labels else max(count, 2))
        ends = torch.stack(torch.broadcast_tensors(start, start + length), -1).reshape(-1, 2)
        ends = ends[ends[:, 1] < len(bounds)]
        return cls(variable, cell, count, ends, bounds[ends])

    def rows(self, window: int, margin: int = 0) -> Bool[Tensor, " n"]:
        """Find the trials in a window and in `margin` more cells on either side."""
        start, stop = self.ends[window].tolist()
        place = self.cell - (start - margin)
        place = place.remainder(self.count) if self.variable.period else place
        return (place >= 0) & (place < stop - start + 2 * margin)

    def sums(self, *weights: Float[Tensor, " n"]) -> Float[Tensor, "w c"]:
        """Sum each of the weights over the trials of each window."""
        cells = torch.stack([torch.bincount(self.cell, weight, minlength=self.count) for weight in weights])
        up_to = pad(torch.cat((cells, cells), -1).cumsum(-1), (1, 0))
        return up_to[:, self.ends[:, 1]] - up_to[:, self.ends[:, 0]]


def _cuts(variable: Variable, values: Float[Tensor, " m"]) -> Float[Tensor, " k"]:
    """Limits between cells of about equal number, ascending, rounded as they are written."""
    if variable.labels:
        return torch.arange(len(variable.labels) - 1, dtype=torch.float64) - 0.5
    cells = min(max(_CELLS, min(_OF_MANY, len(values) // _MANY)), len(values) // _FINEST)
    if cells < 2 or values.min() == values.max():
        return values[:0]
    values = variable.scale * values
    low, *inner, high = values.quantile(torch.linspace(0, 1, cells + 1, dtype=torch.float64)).tolist()
    span = inner[-1] - inner[0] or high - low
    step = 2.0 if variable.period else 10.0 ** math.floor(math.log10(span / max(50, cells)))
    step = max(step, 1.0) if variable.name == "order" else step
    rounded = {round(x / step) for x in (low, *inner) if low < round(x / step) * step < high}
    return step * torch.tensor(sorted(rounded), dtype=torch.float64) / variable.scale


# --- Regions ---------------------------------------------------------------------------------------


def find_regions(
    impacts: Impacts,
    prediction: Prediction,
    *,
    generator: torch.Generator,
    thresholds: Thresholds = Thresholds(),
    worst: float = 1.0,
) -> tuple[Region, ...]:
    """Find regions in which the mass error of a prediction is clearly higher than in the rest, the surest first.

    Args:
        impacts: measurements.
        prediction: of their outcomes; leading axes are averaged over.
        generator: of the random halves.
        thresholds: limits of what is reported.
        worst: share of the trials, those with the largest errors, whose ranks decide; all others count alike, so that a
            small region of gross errors stands out before a large one of slightly larger errors.

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
    ranked = errors
    if worst < 1:
        ranked = errors.clamp_min(errors.sort().values[int((1 - worst) * len(errors))].item())
    windows = _search(grids, ranked, searched)
    p_values = _holm([_p_value(ranked, window.rows, window.free & ~searched) for window in windows])
    regions = []
    for window, p_value in zip(windows, p_values, strict=True):
        ratio = _ratio(errors[window.rows & window.free & ~searched], errors[~window.rows & ~searched])
        if p_value <= thresholds.region_level and ratio.mean >= thresholds.region_ratio and ratio.low > 1:
            regions.append(window.region(ratio, p_value))
    return tuple(sorted(regions, key=lambda region: region.p_value))


def improvement_by_region(
    regions: Sequence[Region], errors_before: Float[Tensor, " n"], errors_after: Float[Tensor, " n"]
) -> tuple[Improvement, ...]:
    """Compute the change of the error inside each region and outside it, from errors of the same trials."""
    improvements, change = [], errors_after - errors_before
    for region in regions:
        inside = torch.zeros(len(change), dtype=torch.bool)
        inside[list(region.rows)] = True
        outside = ~inside
        mean, rest = change[inside].mean().item(), change[outside].mean().item()
        variance, of_rest = (change[rows].var().item() / rows.sum().item() for rows in (inside, outside))
        margin, wider = Z_95 * math.sqrt(variance), Z_95 * math.sqrt(variance + of_rest)
        before, after, rest_before, rest_after = (
            errors[rows].mean().item() for rows in (inside, outside) for errors in (errors_before, errors_after)
        )
        improvement = Improvement(
            before=before,
            after=after,
            rest_before=rest_before,
            rest_after=rest_after,
            change=Interval(mean, mean - margin, mean + margin),
            excess=Interval(mean - rest, mean - rest - wider, mean - rest + wider),
            share=region.trials * mean / change.sum().item() if change.sum() else 0.0,
        )
        improvements.append(improvement)
    return tuple(improvements)


@dataclass(frozen=True)
class _Window:
    """A window of a grid: its trials, and the trials that no window before it has taken."""

    grid: Grid
    index: int
    rows: Bool[Tensor, " n"]
    free: Bool[Tensor, " n"]

    def region(self, ratio: Interval, p_value: float) -> Region:
        """The window as a result."""
        low, high = self.grid.limits[self.index].tolist()
        return Region(
            variable=self.grid.variable.name,
            where=self.grid.variable.window_text(low, high),
            low=low if math.isfinite(low) else None,
            high=high if math.isfinite(high) else None,
            ratio=ratio,
            p_value=p_value,
            rows=tuple(self.rows.nonzero()[:, 0].tolist()),
        )


def _search(grids: Sequence[Grid], errors: Float[Tensor, " n"], searched: Bool[Tensor, " n"]) -> list[_Window]:
    """The best windows, best first; each without the trials of those before it."""
    windows, free = [], torch.ones_like(searched)
    size = [grid.sums(searched.double())[0] for grid in grids]
    while len(windows) < _MAX_REGIONS and (searched & free).sum() >= 2 * _SMALLEST:
        within = (searched & free).double()
        ranks = _ranks(errors, searched & free)
        best = (0.0, None, 0)
        for grid, all_trials in zip(grids, size, strict=True):
            trials, total = grid.sums(within, ranks)
            enough = (trials >= _SMALLEST) & (within.sum() - trials >= _SMALLEST)
            allowed = enough & (trials >= _NEW * all_trials)
            score = torch.where(allowed, _standardised(trials, total, ranks, within), 0.0)
            if len(score) and score.max() > best[0]:
                best = (score.max().item(), grid, int(score.argmax()))
        _, grid, index = best
        if grid is None:
            break
        windows.append(_Window(grid, index, grid.rows(index), free))
        free = free & ~grid.rows(index, margin=0 if grid.variable.labels else 1)
    return windows


def _ranks(errors: Float[Tensor, " n"], within: Bool[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Ranks of the errors among those within, 0 for the others and on the average; ties share theirs."""
    ranks = torch.zeros_like(errors)
    _, place, count = errors[within].unique(return_inverse=True, return_counts=True)
    ranks[within] = (count.cumsum(0) - (count - 1) / 2).to(ranks)[place]
    return torch.where(within, ranks - (within.sum() + 1) / 2, 0.0)


def _standardised(trials: Tensor, total: Tensor, ranks: Tensor, within: Tensor) -> Tensor:
    """Sum of the ranks of some of the trials within, in standard deviations of one drawn at random."""
    n = within.sum()
    spread = trials * (n - trials) / n * ranks.square().sum() / (n - 1)
    return total / spread.clamp_min(1e-9).sqrt()


def _p_value(errors: Float[Tensor, " n"], rows: Bool[Tensor, " n"], within: Bool[Tensor, " n"]) -> float:
    """One-sided p-value of errors no higher at `rows` than elsewhere within: the normal limit, cautious far out."""
    ranks = _ranks(errors, within)
    score = _standardised((rows & within).sum(), ranks[rows].sum(), ranks, within)
    return torch.special.erfc(score / math.sqrt(2)).div(2).clamp_min(1e-300).item()


def _holm(p_values: Sequence[float]) -> list[float]:
    """Corrected for their number, in the given order."""
    corrected, floor = list(p_values), 0.0
    for rank, k in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        floor = corrected[k] = max(floor, min(1.0, (len(p_values) - rank) * p_values[k]))
    return corrected


def _ratio(inside: Float[Tensor, " a"], outside: Float[Tensor, " b"]) -> Interval:
    """Ratio of the mean errors, gross ones curbed, with its 95 % interval by the delta method; 1 if too few."""
    if min(len(inside), len(outside)) < 2 or not inside.median() * outside.median() > 0:
        return Interval(1.0, 0.0, math.inf)
    inside, outside = (errors.clamp_max(_GROSS * errors.median()) for errors in (inside, outside))
    ratio = (inside.mean() / outside.mean()).item()
    spread = math.sqrt(sum((e.var() / (len(e) * e.mean() ** 2)).item() for e in (inside, outside)))
    return Interval(ratio, ratio * math.exp(-Z_95 * spread), ratio * math.exp(Z_95 * spread))
