"""Results of identification: shared parameters of a law, and those of every single trial."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import measured
from contactlearn.laws import Law

if TYPE_CHECKING:
    from pandas import DataFrame


_ROUNDING = 1e-9  # relative spread of parameters that counts as none


@dataclass(frozen=True)
class Box:
    """Bounds of μ and ε, and the number of grid nodes along each."""

    mu: tuple[float, float] = (0.0, 1.0)
    eps: tuple[float, float] = (0.0, 1.0)
    nodes: int = 64

    def __post_init__(self) -> None:
        for name, (low, high) in (("mu", self.mu), ("eps", self.eps)):
            if not 0 <= low < high:
                raise DataError(f"bounds of {name} must be 0 ≤ low < high, got {[low, high]}")
        if self.eps[1] > 1:
            raise DataError(f"bounds of eps must end at 1 or below, got {list(self.eps)}")
        if self.nodes < 3:
            raise DataError(f"the grid needs at least 3 nodes a parameter, got {self.nodes}")

    @property
    def low(self) -> Float[Tensor, "2"]:
        """Lower bounds of (μ, ε)."""
        return torch.tensor((self.mu[0], self.eps[0]), dtype=torch.float64)

    @property
    def high(self) -> Float[Tensor, "2"]:
        """Upper bounds of (μ, ε)."""
        return torch.tensor((self.mu[1], self.eps[1]), dtype=torch.float64)

    def axes(self) -> tuple[Tensor, Tensor]:
        """Grid nodes of μ and of ε, [nodes] each."""
        mu, eps = (torch.linspace(*ends, self.nodes, dtype=torch.float64) for ends in (self.mu, self.eps))
        return mu, eps


@dataclass(frozen=True, repr=False)
class SubsetFit:
    """Parameters identified from subsets of trials: [m, S] for m repetitions and S subset sizes."""

    law: Law
    sizes: tuple[int, ...]
    mu: Tensor
    eps: Tensor
    cost: Tensor  # mean ‖P − P̂‖ over the subset, N s
    mu_range: Tensor  # [m, S, 2]
    eps_range: Tensor
    mu_flat: Tensor  # whether the subset leaves μ undetermined: mu_range spans over a tenth of the box

    def __repr__(self) -> str:
        """Write mean and standard deviation of (μ, ε) over the subsets of the largest size."""
        values = zip("με", self.mean(), self.std(), strict=True)
        listed = ", ".join(f"{symbol} = {measured(value, std)}" for symbol, value, std in values)
        subsets = f"{len(self.mu)} subsets" if len(self.mu) > 1 else "1 subset"
        return f"SubsetFit({self.law.name} ({self.law.variant}): {listed} over {subsets} of {self.sizes[-1]} trials)"

    def _repr_html_(self) -> str:
        return self.to_frame().to_html(float_format="{:.4g}".format)

    def to_frame(self) -> "DataFrame":
        """Return a table with a row for each subset size: mean and deviation of μ and ε, and the cost in N s."""
        from pandas import DataFrame, Index  # takes long to load

        columns = {
            "mu": self.mu.mean(0), "mu_std": self.mu.std(0), "eps": self.eps.mean(0), "eps_std": self.eps.std(0),
            "cost": self.cost.mean(0), "mu_undetermined": self.mu_flat.double().mean(0),
        } if len(self.mu) > 1 else {"mu": self.mu[0], "eps": self.eps[0], "cost": self.cost[0]}  # fmt: skip
        return DataFrame({name: x.tolist() for name, x in columns.items()}, index=Index(self.sizes, name="trials"))

    def mean(self) -> tuple[float, float]:
        """Mean (μ, ε) over the repetitions, at the largest size."""
        return self.mu[:, -1].mean().item(), self.eps[:, -1].mean().item()

    def std(self) -> tuple[float, float]:
        """Standard deviation of (μ, ε) over the repetitions, at the largest size; nan where all have one value."""
        mu, eps = (_spread(values[:, -1]) for values in (self.mu, self.eps))
        return mu, eps

    def to_law(self) -> Law:
        """The law at the mean parameters, as the paper uses it."""
        return self.law.at(*self.mean())


def _spread(values: Float[Tensor, " m"]) -> float:
    """Standard deviation; nan for a single value, or several that only rounding tells apart."""
    std = values.std().item() if len(values) > 1 else 0.0
    return std if std > _ROUNDING * values.abs().max().item() else math.nan


@dataclass(frozen=True, repr=False)
class TrialFit:
    """Optimum of every trial: μ, ε, error ‖P − P̂‖ (N s), and the range of μ that fits equally well, each [N].

    Where `mu_high` exceeds `mu_low` the trial does not determine μ: it sticks at every μ above `mu_low`.
    """

    law: Law
    mu: Tensor
    eps: Tensor
    error: Tensor
    mu_low: Tensor
    mu_high: Tensor

    def __repr__(self) -> str:
        """Write medians and the middle halves of (μ, ε) over the trials."""
        quartiles = torch.tensor([0.5, 0.25, 0.75], dtype=self.mu.dtype, device=self.mu.device)
        listed = ", ".join(
            "{} = {:.3f} ({:.3f} to {:.3f})".format(symbol, *values.quantile(quartiles).tolist())
            for symbol, values in (("μ", self.mu), ("ε", self.eps))
        )
        stick = int(self.flat.sum())
        law = f"{self.law.name} ({self.law.variant})"
        return f"TrialFit({law}: median {listed} of {len(self.mu)} trials, {stick} of which leave μ open)"

    def _repr_html_(self) -> str:
        return self.to_frame().to_html(float_format="{:.4g}".format, max_rows=10)

    def to_frame(self) -> "DataFrame":
        """Return a table with a row for each trial: mu, eps, error in N s, and the range of μ that fits as well."""
        from pandas import DataFrame, RangeIndex  # takes long to load

        names = ("mu", "eps", "error", "mu_low", "mu_high")
        columns = {name: getattr(self, name).tolist() for name in names}
        return DataFrame(columns, index=RangeIndex(1, len(self.mu) + 1, name="trial"))

    @property
    def flat(self) -> Tensor:
        """Whether μ is left undetermined [N]."""
        return self.mu_high - self.mu_low > 1e-6
