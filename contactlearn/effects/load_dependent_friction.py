"""Harder impacts rub differently."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.speed import SpeedReference
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class LoadDependentFriction(SpeedReference, Effect):
    """μ → μ (|v_n|/v_ref)^p, with the speed of approach in place of the load.

    It is not a dependence on the slip (`velocity_dependent_friction`).
    """

    formula = "μ ← μ (|v_n|/v_ref)^p"
    source = "Hertzian contact, p = −1/3 of the load: Bowden & Tabor 1950"
    citations = ("bowden1950",)
    component = 1
    p: Tensor | float = parameter("p", "–", -2.0, 2.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu * (state.v_n.abs() / known(self.v_ref)) ** self.p, eps
