"""Faster impacts rebound less."""

from dataclasses import dataclass, replace
from typing import ClassVar

from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter, typical
from contactlearn.effects.state import State
from contactlearn.impacts import Impacts


@dataclass(frozen=True, eq=False)
class VelocityDependentRestitution(Effect):
    """ε falls with the normal velocity of approach.

        power           ε (|v_n|/v_ref)^(−p)                         plastic yield, p = 1/4
        kuwabara_kono   ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))          viscoelastic

    ε is the restitution at v_ref.  It is not a dependence on the slip (`slip_dependent_restitution`).
    """

    formula: ClassVar = {
        "power": "ε ← ε (|v_n|/v_ref)^(−p)",
        "kuwabara_kono": "ε ← ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))",
    }
    source = "Johnson 1985, §11.5; Kuwabara & Kono 1987"
    p: Tensor | float = parameter("p", "–", -1.0, 1.0, form="power")
    C: Tensor | float = parameter("C", "–", -1.0, 4.0, form="kuwabara_kono")
    form: str = "power"
    v_ref: float | None = None  # m/s; None: the median |v_n| of the measurements

    def prepare(self, impacts: Impacts) -> "VelocityDependentRestitution":
        return self if self.v_ref is not None else replace(self, v_ref=typical(impacts.v_c[:, 1]))

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        speed = state.v_n.abs() / known(self.v_ref)
        if self.form == "power":
            return mu, eps * speed**-self.p
        return mu, eps * (1 - self.C * (speed**0.2 - 1))
