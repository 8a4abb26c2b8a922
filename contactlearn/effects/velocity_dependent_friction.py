"""Friction depends on how fast the contact slips."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class VelocityDependentFriction(Effect):
    """μ as a function of the slip v, averaged over the slip of the impact.

        viscous    μ + c v
        stribeck   μ (1 + d exp(−v/v_s))      more friction at little slip

    The slip goes from |v_t| to what the law's own μ and ε would leave of it, or to 0; the average is Simpson's.
    It is not friction that changes with the load (`load_dependent_friction`).
    """

    formula: ClassVar = {
        "viscous": "μ ← μ + c v̄, v̄ the mean slip",
        "stribeck": "μ ← μ (1 + d s̄), s̄ the mean of exp(−v/v_s) over the slip",
    }
    source = "Stribeck 1902"
    c: Tensor | float = parameter("c", "s/m", -0.3, 0.3, form="viscous")
    d: Tensor | float = parameter("d", "–", -1.0, 5.0, form="stribeck")
    v_s: Tensor | float = parameter("v_s", "m/s", 0.05, 5.0, vanishing=None, start=0.5, form="stribeck")
    form: str = "viscous"

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        first, last = state.v_t.abs(), slip_left(state, mu, eps)
        if self.form == "viscous":
            return mu + self.c * (first + last) / 2, eps
        weakened = [(-slip / self.v_s).exp() for slip in (first, (first + last) / 2, last)]
        return mu * (1 + self.d * (weakened[0] + 4 * weakened[1] + weakened[2]) / 6), eps


def slip_left(state: State, mu: Tensor, eps: Tensor) -> Tensor:
    """|v_t| after an impact that slides throughout, or 0 where it would have stopped, m/s."""
    direction = state.v_t.sign()
    w_tt, w_tn, w_nn = state.W[..., 0, 0], state.W[..., 0, 1], state.W[..., 1, 1]
    stiffness = w_nn - direction * mu * w_tn
    P_n = torch.where(stiffness > 0, (1 + eps) * state.approach[..., 1].abs() / stiffness.clamp_min(1e-300), torch.inf)
    braking = direction * (direction * mu * w_tt - w_tn)  # of |v_t|, per normal impulse
    return torch.where(braking > 0, (state.v_t.abs() - braking.clamp_min(0) * P_n).clamp_min(0), state.v_t.abs())
