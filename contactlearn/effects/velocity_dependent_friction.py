"""Friction depends on how fast the contact slips."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class VelocityDependentFriction(Effect):
    """μ as a function of the slip before contact.

        viscous    μ + c |v_t|
        stribeck   μ (1 + d exp(−|v_t|/v_s))      more friction at little slip

    It is not friction that changes while the slip does: one μ holds for the whole impact.
    """

    formula: ClassVar = {"viscous": "μ ← μ + c |v_t|", "stribeck": "μ ← μ (1 + d exp(−|v_t|/v_s))"}
    source = "Stribeck 1902"
    c: Tensor | float = parameter("c", "s/m", -0.3, 0.3, form="viscous")
    d: Tensor | float = parameter("d", "–", -1.0, 5.0, form="stribeck")
    v_s: Tensor | float = parameter("v_s", "m/s", 0.05, 5.0, vanishing=None, start=0.5, form="stribeck")
    form: str = "viscous"

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        slip = state.v_t.abs()
        if self.form == "viscous":
            return mu + self.c * slip, eps
        return mu * (1 + self.d * (-slip / self.v_s).exp()), eps
