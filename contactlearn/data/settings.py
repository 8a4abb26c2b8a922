"""Settings of simulated sources, checked, and their random numbers."""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from contactlearn.errors import DataError


def random(draw: Callable[..., Tensor], shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """float64 numbers of `torch.rand` or `torch.randn` from a generator."""
    return draw(shape, generator=generator, dtype=torch.float64)


def number(name: str, value: float, low: float, high: float = math.inf, above: bool = False) -> float:
    """`value` as a finite float in [low, high], or greater than low if `above`."""
    span = f"in [{low}, {high}]" if high < math.inf else f"{'greater than' if above else 'at least'} {low}"
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not (low < found if above else low <= found) or not found <= high or math.isinf(found):
        raise DataError(f"{name} must be a finite number {span}, got {value!r}")
    return found


def integer(name: str, value: int, low: int) -> int:
    """`value` as a whole number from low up."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value < 2**63:
        raise DataError(f"{name} must be an integer, at least {low}, got {value!r}")
    return value
