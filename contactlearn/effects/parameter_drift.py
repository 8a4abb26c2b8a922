"""The surfaces change while they are being measured."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class ParameterDrift(Effect):
    """ε or μ changes in proportion to the number k of trials before this one.

    It is not a dependence on the place on the floor (`location_dependent_restitution`).
    """

    formula: ClassVar = {"restitution": "ε ← ε + c k/1000", "friction": "μ ← μ + d k/1000"}
    source = "wear, temperature"
    c: Tensor | float = parameter("c", "per 1000 trials", -1.0, 1.0, form="restitution")
    d: Tensor | float = parameter("d", "per 1000 trials", -1.0, 1.0, form="friction")
    form: str = "restitution"

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        thousands = (state.order - 1) / 1000
        if self.form == "restitution":
            return mu, eps + self.c * thousands
        return mu + self.d * thousands, eps
