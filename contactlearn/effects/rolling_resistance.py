"""The contact resists the spin with a moment that follows the load."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.path import retraced
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class RollingResistance(Effect):
    """τ → τ − c P_n s̄, where s̄ is the mean sign of the spin on its way from ω to ω⁺; c is half a width.

        s̄ = (ω⁺ + ω) / (√(ω⁺² + ω_s²) + √(ω² + ω_s²)),      the mean of ω/√(ω² + ω_s²)

    It takes at most the spin ω⁺ that there would be without it, and the contact responds while it lasts
    (`path.retraced`).  It is not damping, which grows with the spin (`spin_damping`).
    """

    formula = "τ ← τ − c P_n s̄ while the contact lasts, s̄ the mean sign of the spin"
    source = "Johnson 1985, §8.3"
    citations = ("johnson1985",)
    adds_energy = True
    c: Tensor | float = parameter("c", "m", 0.0, 0.005)
    omega_s: float = 1.0  # rad/s below which the moment fades

    def __post_init__(self):
        super().__post_init__()
        known(self.omega_s)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        before, after = state.omega, state.v_after(wrench)[..., 2]
        size = (before.square() + self.omega_s**2).sqrt() + (after.square() + self.omega_s**2).sqrt()
        arm = self.c * (before + after) / size
        most = state.inertia * after.abs() / wrench[..., 1].clamp_min(1e-300)
        return retraced(state, wrench, arm=-torch.maximum(torch.minimum(arm, most), -most))
