"""Smooth functions along the floor."""

from collections.abc import Sequence

from torch import Tensor


def span(x: Tensor) -> tuple[float, float]:
    """Ends of the measured places, m, to a tenth of a millimetre outwards."""
    low, high = x.min().item(), x.max().item()
    return round(low - 5e-5, 4), round(high + 5e-5, 4)


def smooth(x: Tensor, ends: tuple[float, float], coefficients: Sequence[Tensor | float]) -> Tensor:
    """c_1 P_1(u) + c_2 P_2(u) + c_3 P_3(u) with Legendre's polynomials; u in [−1, 1] is the place between the ends."""
    low, high = ends
    u = ((2 * x - low - high) / (high - low)).clamp(-1, 1)
    c_1, c_2, c_3 = coefficients
    return c_1 * u + c_2 * (1.5 * u**2 - 0.5) + c_3 * (2.5 * u**3 - 1.5 * u)
