"""Standardisation of what a learned model takes and gives, by the statistics of its training trials."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Standardisation:
    """x ↦ (x − mean) / scale with statistics [..., 1, D] of training data.

    A column that is constant there, such as the mass of a single body, has an infinite scale: it is
    0 wherever it is applied, for nothing has been learnt about it.
    """

    mean: Float[Tensor, "*batch 1 d"]
    scale: Float[Tensor, "*batch 1 d"]

    @classmethod
    def of(cls, x: Float[Tensor, "*batch n d"]) -> "Standardisation":
        """Return the standardisation of training values x [..., n, D]."""
        mean, spread = x.mean(-2, keepdim=True), x.std(-2, keepdim=True, correction=0)
        constant = spread <= 1e-9 * x.abs().amax(-2, keepdim=True)
        return cls(mean, torch.where(constant, torch.inf, spread))

    def apply(self, x: Float[Tensor, "*batch n d"]) -> Float[Tensor, "*more n d"]:
        """Standardised values [..., N, D]."""
        return (x - self.mean) / self.scale

    def undo(self, x: Float[Tensor, "*batch n d"]) -> Float[Tensor, "*more n d"]:
        """Values of `apply` in their own units again; a constant column is that constant."""
        return self.mean + self.spread * x

    @property
    def spread(self) -> Float[Tensor, "*batch 1 d"]:
        """The scale, 0 for a constant column."""
        return self.scale.nan_to_num(posinf=0.0)
