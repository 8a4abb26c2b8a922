"""Surprise: −log of the probability of a statistic, as the same statistics with random signs [flips, k] show it.

Statistics of different kinds are so made comparable, and the largest neg_log_p of all is compared with those of the
random signs.  The first row are the measured signs.  A statistic that no sign changes, for want of scores, is nan.
Sources: Wilson & Hilferty 1931 for sums of squares; Gumbel 1958 for maxima.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

_EULER = 0.5772156649


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
