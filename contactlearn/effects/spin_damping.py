"""The body loses a part of its spin."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.path import retraced
from contactlearn.effects.state import State, columns


@dataclass(frozen=True, eq=False)
class SpinDamping(Effect):
    """A moment that grows with the spin.

        after     τ → τ − c I ω⁺, with the spin ω⁺ that the body has without it
        during    τ → τ − b (I/m) ω̄ P_n, ω̄ the mean of ω and that ω⁺; the contact responds (`path.retraced`)

    It is not rolling resistance, which does not grow with the spin (`rolling_resistance`).
    """

    formula: ClassVar = {
        "after": "τ ← τ − c I ω⁺",
        "during": "τ ← τ − b (I/m) ω̄ P_n while the contact lasts, ω̄ the mean of ω and ω⁺",
    }
    source = "air, guide walls, cables"
    adds_energy = True
    c: Tensor | float = parameter("c", "–", 0.0, 1.0, form="after")
    b: Tensor | float = parameter("b", "s/m", 0.0, 0.3, form="during")
    form: str = "after"

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        after = state.v_after(wrench)[..., 2]
        if self.form == "after":
            return columns(P_t, P_n, tau - self.c * state.inertia * after)
        return retraced(state, wrench, arm=-self.b * state.inertia / state.mass * (state.omega + after) / 2)
