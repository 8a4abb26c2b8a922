"""Oblique impacts rebound differently."""

from dataclasses import dataclass, replace

from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter, typical
from contactlearn.effects.state import State
from contactlearn.impacts import Impacts


@dataclass(frozen=True, eq=False)
class SlipDependentRestitution(Effect):
    """ε → ε + c |v_t|/v_ref, with the slip before contact.

    It is not a dependence on the speed of approach (`velocity_dependent_restitution`).
    """

    formula = "ε ← ε + c |v_t|/v_ref"
    source = "oblique impact"
    c: Tensor | float = parameter("c", "–", -1.0, 1.0)
    v_ref: float | None = None  # m/s; None: the median |v_t| of the measurements

    def prepare(self, impacts: Impacts) -> "SlipDependentRestitution":
        return self if self.v_ref is not None else replace(self, v_ref=typical(impacts.v_c[:, 0]))

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        return mu, eps + self.c * state.v_t.abs() / known(self.v_ref)
