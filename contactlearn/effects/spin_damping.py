"""The body leaves with a part of its spin lost."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class SpinDamping(Effect):
    """τ → τ − c I ω⁺, with the spin ω⁺ that the body has without it.

    It is not rolling resistance, which does not grow with the spin (`rolling_resistance`).
    """

    formula = "τ ← τ − c I ω⁺"
    source = "air, guide walls, cables"
    c: Tensor | float = parameter("c", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        return columns(P_t, P_n, tau - self.c * state.inertia * state.v_after(wrench)[..., 2])
