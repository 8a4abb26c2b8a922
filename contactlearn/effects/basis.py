"""Smooth functions along the floor."""

from collections.abc import Sequence

import torch
from torch import Tensor

from contactlearn.errors import ContactLearnError


def span(x: Tensor) -> tuple[float, float]:
    """Where the middle nine tenths of the measured places are, m, to a tenth of a millimetre outwards.

    Single trials far out would otherwise bend the functions to themselves.
    """
    low, high = x.quantile(torch.tensor((0.05, 0.95), dtype=x.dtype)).tolist()
    return round(low - 5e-5, 4), round(high + 5e-5, 4)


def smooth(x: Tensor, ends: tuple[float, float], coefficients: Sequence[Tensor | float]) -> Tensor:
    """Σ c_k P_k(u), k = 1, 2, …, with Legendre's polynomials; u in [−1, 1] is the place between the ends."""
    low, high = ends
    if not low < high:
        raise ContactLearnError(f"a span must be [low, high] of x in m with low < high, got {list(ends)}")
    u = ((2 * x - low - high) / (high - low)).clamp(-1, 1)
    before, now = torch.ones_like(u), u
    total = coefficients[0] * now
    for k, coefficient in enumerate(coefficients[1:], 2):
        before, now = now, ((2 * k - 1) * u * now - (k - 1) * before) / k
        total = total + coefficient * now
    return total
