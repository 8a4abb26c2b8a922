"""Oblique impacts rebound differently."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.speed import SpeedReference
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class SlipDependentRestitution(SpeedReference, Effect):
    """ε → ε + c |v_t|/v_ref, with the slip before contact.

    It is not a dependence on the speed of approach (`velocity_dependent_restitution`).
    """

    formula = "ε ← ε + c |v_t|/v_ref"
    source = "oblique impact"
    component = 0
    c: Tensor | float = parameter("c", "–", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.c * state.v_t.abs() / known(self.v_ref)
