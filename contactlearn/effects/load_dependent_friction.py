"""Harder impacts rub differently."""

from dataclasses import dataclass, replace

from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter, typical
from contactlearn.effects.state import State
from contactlearn.impacts import Impacts


@dataclass(frozen=True, eq=False)
class LoadDependentFriction(Effect):
    """μ → μ (|v_n|/v_ref)^p, with the speed of approach in place of the load.

    It is not a dependence on the slip (`velocity_dependent_friction`).
    """

    formula = "μ ← μ (|v_n|/v_ref)^p"
    source = "Hertzian contact, p = −1/3 of the load: Bowden & Tabor 1950"
    p: Tensor | float = parameter("p", "–", -2.0, 2.0)
    v_ref: float | None = None  # m/s; None: the median |v_n| of the measurements

    def prepare(self, impacts: Impacts) -> "LoadDependentFriction":
        return self if self.v_ref is not None else replace(self, v_ref=typical(impacts.v_c[:, 1]))

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        return mu * (state.v_n.abs() / known(self.v_ref)) ** self.p, eps
