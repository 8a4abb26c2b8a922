"""The contact resists the spin with a moment that follows the load."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.moment import with_arm
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class RollingResistance(Effect):
    """τ → τ − c P_n s̄, where s̄ is the mean sign of the spin while it goes from ω to ω⁺; c is half a width.

        s̄ = (ω⁺ + ω) / (√(ω⁺² + ω_s²) + √(ω² + ω_s²)),      the mean of ω/√(ω² + ω_s²), smooth at ω_s

    It is not damping, which grows with the spin (`spin_damping`).
    """

    formula = "τ ← τ − c P_n s̄, s̄ the mean sign of the spin"
    source = "Johnson 1985, §8.3"
    adds_energy = True
    c: Tensor | float = parameter("c", "m", 0.0, 0.01)
    omega_s: float = 1.0  # rad/s below which the moment fades

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        before, after = state.omega, state.v_after(wrench)[..., 2]
        size = (before.square() + self.omega_s**2).sqrt() + (after.square() + self.omega_s**2).sqrt()
        return with_arm(state, wrench, -self.c * (before + after) / size)
