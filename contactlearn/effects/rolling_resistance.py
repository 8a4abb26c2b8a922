"""The contact resists the spin with a moment that follows the load."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class RollingResistance(Effect):
    """τ → τ − c P_n tanh(ω/ω_s), with the spin before contact; c is half the width that carries the load.

    It is not damping, which grows with the spin (`spin_damping`).
    """

    formula = "τ ← τ − c P_n tanh(ω/ω_s)"
    source = "Johnson 1985, §8.3"
    adds_energy = True
    c: Tensor | float = parameter("c", "m", 0.0, 0.01)
    omega_s: float = 1.0  # rad/s below which the moment fades

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        return columns(P_t, P_n, tau - self.c * P_n * (state.omega / self.omega_s).tanh())
