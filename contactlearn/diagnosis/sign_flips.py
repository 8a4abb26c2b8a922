"""Tests by random signs: exact p-values of statistics of independent symmetric residuals.

Every statistic is computed with the measured signs of the residuals, in the first row, and with random signs of all
trials in the others.  Statistics of different kinds become comparable as −log p, by the distribution that fits their
values under random signs; the largest of all is then compared with the largest under random signs, so that the level
holds for all of them together.  A statistic that no sign changes, because all its scores are 0, is nan.
Sources: Efron 1969 and Wu 1986 for the signs; Wilson & Hilferty 1931 for sums of squares; Gumbel 1958 for maxima.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

SIGNS = 499
"""Random signs of all trials; the least p-value is 1/500."""
_SIGNS_OF_GAINS = 1999
_EULER = 0.5772156649


def random_signs(trials: int, count: int = SIGNS) -> Float[Tensor, "flips n"]:
    """Return signs of all trials, 1 in the first row and the same random ones for every call in all others."""
    signs = torch.randint(0, 2, (count, trials), generator=torch.Generator().manual_seed(0)).to(torch.float64)
    return torch.cat((torch.ones_like(signs[:1]), 2 * signs - 1))


def window_spread(flipped: Float[Tensor, "flips n c"]) -> Float[Tensor, "flips widths c"]:
    """Compute mean squares of sums over windows of 2, 4, 8 … trials, in those of a trial and up to a factor."""
    sums = torch.cat((torch.zeros_like(flipped[:, :1]), flipped.cumsum(1)), 1)
    widths = [2**k for k in range(1, int(math.log2(flipped.shape[1] / 3)) + 1)]
    windows = ((sums[:, w :: max(1, w // 4)], sums[:, : -w : max(1, w // 4)]) for w in widths)
    total = flipped.square().sum(1).clamp_min(1e-300)  # the mean is a part of it, which the random signs change
    return torch.stack([(last - first).square().sum(1) / total for last, first in windows], 1)


def periodogram_peak(flipped: Float[Tensor, "flips n c"]) -> tuple[Float[Tensor, "flips c"], Int[Tensor, "flips c"]]:
    """Compute the largest share of a period in the sum of squares, and the number of its halves in the sequence."""
    n = flipped.shape[1]
    power = torch.fft.rfft(flipped, 2 * n, dim=1).abs().square()[:, 2:] / flipped.square().sum(1, keepdim=True)
    peak, place = power.max(1)
    return peak, place + 2


def exceedance(statistic: Float[Tensor, " flips"]) -> float:
    """Compute the probability of the first, the measured one, among those with random signs."""
    # Not `>=`: a statistic that is not a number is no evidence, and has the probability 1.
    return ((~(statistic[1:] < statistic[0])).sum().item() + 1) / len(statistic)


def screened(neg_log_p: Float[Tensor, "flips k"], level: float) -> tuple[float, list[int]]:
    """Compute the p-value of independence, and the statistics that refute it at a level, most significant first."""
    every = neg_log_p.nan_to_num(0.0)  # of statistics that no sign changes
    largest = every.amax(1)
    chance, enough = exceedance(largest), largest[1:].quantile(1 - level)
    refuting = int((every[0] > enough).sum()) if chance <= level else 0
    return chance, every[0].argsort(descending=True, stable=True)[:refuting].tolist()


def chance_of_gain(gain: Float[Tensor, " n"]) -> float:
    """Compute the probability of so large a sum of gains under random signs; a few large ones may make it."""
    return exceedance(random_signs(len(gain), _SIGNS_OF_GAINS) @ gain)


def gamma_neg_log_p(spread: Float[Tensor, "flips k"]) -> Float[Tensor, "flips k"]:
    """Compute the neg_log_p of sums of squares, gamma-distributed."""
    mean, degrees = spread.mean(0), (spread.mean(0) / spread.std(0).clamp_min(1e-300)).square()
    z = 3 * degrees.sqrt() * ((spread / mean) ** (1 / 3) - 1 + 1 / (9 * degrees))
    return -torch.special.log_ndtr(-z)


def gumbel_neg_log_p(peak: Float[Tensor, "flips k"]) -> Float[Tensor, "flips k"]:
    """Compute the neg_log_p of maxima of exponential powers, of Gumbel's distribution."""
    scale = (peak.std(0) * math.sqrt(6) / math.pi).clamp_min(1e-300)
    reduced = (peak - peak.mean(0)) / scale + _EULER
    return -torch.log(-torch.expm1(-torch.exp(-reduced)))


def normal_neg_log_p(sums: Float[Tensor, "flips k"]) -> Float[Tensor, "flips k"]:
    """Compute the neg_log_p of sums with random signs, of either sign."""
    z = sums / sums.square().mean(0).sqrt().clamp_min(1e-300)
    return -math.log(2) - torch.special.log_ndtr(-z.abs())
