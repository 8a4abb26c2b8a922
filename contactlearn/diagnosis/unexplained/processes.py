"""Gaussian processes that learn the wrench that a model leaves, from the full state and the order of the trials."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.noise_weight import noise_weight
from contactlearn.models.features import Standardisation

if TYPE_CHECKING:  # GPyTorch takes long to load
    from contactlearn.models.gp.exact import ExactGPs

_INPUTS = ("m", "I", "rx", "ry", "x", "y", "theta", "vx", "vy", "omega", "order")


@dataclass(frozen=True)
class Processes:
    """Gaussian processes of each fold for the three components of the residual wrench.

    `x` are the inputs, `unit` the unit of the wrench of each trial: mass, mass, inertia.
    """

    x: Float[Tensor, "n d"]
    unit: Float[Tensor, "n 3"]
    inputs: Standardisation
    outputs: Standardisation
    gps: "ExactGPs"

    @classmethod
    def of(cls, impacts: Impacts, residual: Float[Tensor, "n 3"], rows: Int[Tensor, "b m"]) -> "Processes":
        """Fit the processes to the rows of each fold.

        Raises:
            DataError: fewer than two rows.
        """
        from contactlearn.models.gp.exact import ExactGPs

        if rows.shape[-1] < 2:
            raise DataError(f"what remains needs at least 2 trials to learn from, got {rows.shape[-1]}")
        x = torch.cat([columns for columns in input_columns(impacts).values()], -1)
        unit = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
        residual = residual / unit
        inputs, outputs = Standardisation.of(x[rows]), Standardisation.of(residual[rows])
        weight = noise_weight(impacts, "wrench")
        gps = ExactGPs(
            inputs.apply(x[rows]), outputs.apply(residual[rows]).mT, None if weight is None else weight[rows].mT
        )
        gps.fit()
        return cls(x, unit, inputs, outputs, gps)

    def at(self, rows: Int[Tensor, "b m"], x: Float[Tensor, "b m d"] | None = None) -> Float[Tensor, "b m 3"]:
        """Predict the wrench of the rows, or of other inputs of theirs, in their units."""
        mean = self.gps.mean(self.inputs.apply(self.x[rows] if x is None else x))
        return self.outputs.undo(mean.mT) * self.unit[rows]


def input_columns(impacts: Impacts) -> dict[str, Float[Tensor, "n _"]]:
    """Compute the inputs by symbol, θ as (cos θ, sin θ)."""
    known = of_state(State.of(impacts))
    theta = torch.stack((known["theta"].cos(), known["theta"].sin()), -1)
    return {name: theta if name == "theta" else known[name][:, None] for name in _INPUTS}
