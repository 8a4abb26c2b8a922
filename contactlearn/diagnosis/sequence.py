"""Dependence along the sequence of the measurements, tested on what a model leaves.

    dependence   whether residuals of neighbouring trials resemble each other: a drift, a wandering calibration
    drift_kind   whether the measurement wanders, alike for every impact, or a parameter of the model does
    blocks       contiguous parts of the sequence to hold out, where neighbours resemble each other

Sums of neighbouring residuals over windows of 2, 4, 8 … trials spread more than their signs allow if neighbours
resemble each other.  The windows of all components are judged together: the largest excess in standard deviations,
against the same of residuals with random signs.  That is exact for independent symmetric residuals, however heavy their
tails and however much their scatter differs from trial to trial.
Source: Cochrane 1988, "How big is the random walk in GNP?", for the windows; Wu 1986 for the signs.
"""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import MAD_SCALE, Z_95

SIGNS = 499
"""Random signs of all trials; the least p-value is 1/500."""
_CLIP = 2.5  # robust standard deviations beyond which a residual counts no more
_FEWEST = 20  # trials below which nothing is said
_LAGS = 60  # of the autocorrelation at most, and no more than a quarter of the trials
_SCALES = 24  # correlation times that are tried
_CURVES = 40  # cosines over the sequence at most, and no more than a quarter of the trials
_DECIDES = 6.0  # difference of BIC: "strong evidence", Kass & Raftery 1995


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Residuals of neighbouring trials that resemble each other.

    Args:
        p_value: of independence, over all components and time scales.
        correlation: of a trial with the next, mean of the components.
        interval: of the same, 95 %, as if there were no other dependence.
        time_scale: trials after which the dependent part has forgotten all but 1/e.
        size: standard deviation of the dependent part in v_x, v_y (m/s) and ω (rad/s).
        share: of the residual variance that is dependent, mean of the components.
        block: length of blocks for folds, in trials, beyond which hardly anything is remembered.
    """

    p_value: float
    correlation: float
    interval: tuple[float, float]
    time_scale: float
    size: tuple[float, float, float]
    share: float
    block: int


def dependence(
    residual: Float[Tensor, "n 3"],
    order: Float[Tensor, " n"],
    inliers: Bool[Tensor, " n"] | None = None,
    level: float = 0.005,
) -> Dependence | None:
    """Test whether residuals depend on their place in the sequence; None where independence is not refuted.

    Args:
        residual: of the velocity after impact in (m/s, m/s, rad/s).
        order: place of each trial in the sequence.
        inliers: trials that are used; all if None.
        level: p-value below which independence is refuted.
    """
    rows = order.argsort(stable=True)
    rows = rows if inliers is None else rows[inliers[rows]]
    if len(rows) < _FEWEST:
        return None
    white, scale = _winsorised(residual[rows])
    chance = _chance(white)
    if chance > level:
        return None
    lags = torch.arange(1, min(_LAGS, len(rows) // 4) + 1)
    correlation = torch.stack([(white[k:] * white[:-k]).sum(0) for k in lags.tolist()]) / white.square().sum(0)
    time_scale, shares = _decay(correlation, lags, len(rows))
    first, error = correlation[0].mean().item(), Z_95 / math.sqrt(3 * len(rows))
    v_x, v_y, omega = (scale * (shares * white.var(0)).sqrt()).tolist()
    return Dependence(
        p_value=chance,
        correlation=first,
        interval=(first - error, first + error),
        time_scale=time_scale,
        size=(v_x, v_y, omega),
        share=shares.mean().item(),
        block=max(2, min(math.ceil(3 * time_scale), len(rows) // 10)),
    )


def _winsorised(residual: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "3"]]:
    """Residuals in robust standard deviations, at most so many of them, about 0; and these deviations."""
    centred = residual - residual.median(0).values
    scale = (MAD_SCALE * centred.abs().median(0).values).clamp_min(1e-300)
    white = (centred / scale).clamp(-_CLIP, _CLIP)
    return white - white.mean(0), scale


def _chance(white: Float[Tensor, "n 3"]) -> float:
    """Probability of so large an excess over all windows and components under random signs."""
    flipped = random_signs(len(white))[..., None] * white
    spread = window_spread(flipped - flipped.mean(1, keepdim=True))
    spread = torch.cat((spread / spread.mean(0), (spread / spread.mean(0)).mean(-1, keepdim=True)), -1)
    excess = ((spread - spread[1:].mean(0)) / spread[1:].std(0).clamp_min(1e-12)).flatten(1).amax(1)
    return exceedance(excess)


def random_signs(trials: int) -> Float[Tensor, "flips n"]:
    """Return signs of all trials, 1 in the first row and the same random ones for every call in all others."""
    signs = torch.randint(0, 2, (SIGNS, trials), generator=torch.Generator().manual_seed(0)).to(torch.float64)
    return torch.cat((torch.ones_like(signs[:1]), 2 * signs - 1))


def window_spread(flipped: Float[Tensor, "flips n c"]) -> Float[Tensor, "flips widths c"]:
    """Compute mean squares of sums over windows of 2, 4, 8 … trials, in those of a trial and up to a factor."""
    sums = torch.cat((torch.zeros_like(flipped[:, :1]), flipped.cumsum(1)), 1)
    widths = [2**k for k in range(1, int(math.log2(flipped.shape[1] / 3)) + 1)]
    windows = ((sums[:, w :: max(1, w // 4)], sums[:, : -w : max(1, w // 4)]) for w in widths)
    total = flipped.square().sum(1)  # the mean is a part of it, which the random signs change
    return torch.stack([(last - first).square().sum(1) / total for last, first in windows], 1)


def exceedance(statistic: Float[Tensor, " flips"]) -> float:
    """Compute the probability of the first, the measured one, among those with random signs."""
    return ((statistic[1:] >= statistic[0]).sum().item() + 1) / len(statistic)


def _decay(
    correlation: Float[Tensor, "lags 3"], lags: Int[Tensor, " lags"], trials: int
) -> tuple[float, Float[Tensor, "3"]]:
    """Time scale T and shares s of the autocorrelation s exp(−lag/T), by least squares over a grid of T."""
    scales = torch.logspace(math.log10(0.5), math.log10(trials / 2), _SCALES, dtype=correlation.dtype)
    curves = (-lags / scales[:, None]).exp()  # [scales, lags]
    shares = ((curves @ correlation) / curves.square().sum(-1, keepdim=True)).clamp(0, 1)
    misfit = (correlation - curves[..., None] * shares[:, None]).square().sum((1, 2))
    best = int(misfit.argmin())
    return scales[best].item(), shares[best]


# --- What drifts -----------------------------------------------------------------------------------


def drift_kind(
    residual: Float[Tensor, "n 3"], sensitivity: Float[Tensor, "n 3 k"], order: Float[Tensor, " n"]
) -> Literal["measurement", "parameter", "undecided"]:
    """Tell a measurement that wanders, alike for every impact, from a parameter of the model that does.

    Both are smooth functions of the order: the one added to each component, the other times the derivative of v_post in
    each parameter.  The marginal likelihoods of both, over their variances and time scale, are compared by BIC.

    Args:
        residual: of the velocity after impact in (m/s, m/s, rad/s).
        sensitivity: derivative of v_post in k parameters.
        order: place of each trial in the sequence.
    """
    n, parts = len(residual), sensitivity.shape[-1]
    rows = order.argsort(stable=True)
    white, scale = _winsorised(residual[rows])
    slopes = sensitivity[rows] / scale[:, None]
    slopes = slopes / slopes.square().mean((0, 1)).sqrt().clamp_min(1e-300)
    alike = torch.eye(3, dtype=white.dtype).expand(n, 3, 3)
    measurement = _evidence(white, alike) - 0.5 * 4 * math.log(3 * n)
    parameter = _evidence(white, slopes) - 0.5 * (parts + 1) * math.log(3 * n)
    difference = 2 * (measurement - parameter)
    if abs(difference) <= _DECIDES:
        return "undecided"
    return "measurement" if difference > 0 else "parameter"


def _evidence(white: Float[Tensor, "n 3"], columns: Float[Tensor, "n 3 k"]) -> float:
    """Log marginal likelihood of a smooth function of the order times each column, at its best variances."""
    n, parts = len(white), columns.shape[-1]
    waves = torch.arange(1, min(_CURVES, n // 4) + 1, dtype=white.dtype)
    place = (torch.arange(n, dtype=white.dtype) + 0.5) / n
    curves = math.sqrt(2) * (math.pi * place[:, None] * waves).cos()  # [n, q]
    design = (columns[..., None, :] * curves[:, None, :, None]).reshape(3 * n, -1)  # [3n, q k]
    gram, moment, total = design.mT @ design, design.mT @ white.reshape(-1), white.square().sum()
    variances = torch.cat((torch.zeros(1), torch.logspace(-3, 1, 9))).to(white.dtype)
    best = -math.inf
    for scale in (n / 60, n / 20, n / 6, n / 2):  # trials
        spectrum = 1 / (1 + (math.pi * waves * scale / n) ** 2)
        spectrum = (spectrum / spectrum.sum())[:, None]
        chosen = torch.full((parts,), 0.1, dtype=white.dtype)
        for part in (*range(parts), *range(parts)):
            tried = chosen.repeat(len(variances), 1)
            tried[:, part] = variances
            prior = (spectrum * tried[:, None]).flatten(1)  # [tried, q k]
            found = _likelihood(gram, moment, total, prior, 3 * n)
            chosen = tried[found.argmax()]
            best = max(best, found.max().item())
    return best


def _likelihood(
    gram: Float[Tensor, "p p"], moment: Float[Tensor, " p"], total: Tensor, prior: Float[Tensor, "b p"], count: int
) -> Float[Tensor, " b"]:
    """Log marginal likelihood of a linear model with Gaussian coefficients of variances `prior` σ², at its best σ²."""
    root = prior.sqrt()
    inner = root[:, :, None] * gram * root[:, None, :] + torch.eye(len(gram), dtype=gram.dtype)
    factor = torch.linalg.cholesky(inner)
    inside = torch.linalg.solve_triangular(factor, (root * moment)[..., None], upper=False)[..., 0]
    left = (total - inside.square().sum(-1)).clamp_min(1e-300)
    return -0.5 * count * (left / count).log() - factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)


# --- Folds -----------------------------------------------------------------------------------------


def blocks(order: Float[Tensor, " n"], length: int, folds: int, generator: torch.Generator) -> Int[Tensor, "folds m"]:
    """Draw the held-out rows of each fold as contiguous blocks of the sequence, as many in each fold.

    Blocks are a little longer than `length` where that leaves fewer trials over; those left over, at a random place of
    the sequence, are never held out.

    Raises:
        DataError: fewer trials than one block a fold.
    """
    if not 1 <= length * folds <= len(order):
        raise DataError(f"{folds} folds of blocks of {length} trials need at least {folds * length}, got {len(order)}")
    each = len(order) // (folds * length)
    size = len(order) // (folds * each)
    used = folds * each * size
    first = int(torch.randint(len(order) - used + 1, (1,), generator=generator))
    place = torch.arange(len(order)).roll(-first)[:used].sort().values
    parts = order.argsort(stable=True)[place].view(-1, size)
    return parts[torch.randperm(len(parts), generator=generator)].view(folds, -1)
