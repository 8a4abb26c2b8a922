"""Harder impacts rub differently."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.curve import CoefficientCurve
from contactlearn.effects.speed import SpeedReference
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class LoadDependentFriction(Effect):
    """μ is a function of the speed of approach, which stands for the load.

        power    μ (|v_n|/v_ref)^p
        curve    μ + s(|v_n|), see `contactlearn.effects.curve`

    It is not a dependence on the slip (`velocity_dependent_friction`).
    """

    source = "Hertzian contact, p = −1/3 of the load: Bowden & Tabor 1950"
    citations = ("bowden1950",)
    component = 1

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ(|v_n|) and ε."""


@dataclass(frozen=True, eq=False)
class PowerLawFriction(SpeedReference, LoadDependentFriction):
    """μ → μ (|v_n|/v_ref)^p.  It either grows or falls at every speed (`FrictionOverLoad`)."""

    form = "power"
    formula = "μ ← μ (|v_n|/v_ref)^p"
    p: Tensor | float = parameter("p", "–", -2.0, 2.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu * (state.v_n.abs() / known(self.v_ref)) ** self.p, eps


@dataclass(frozen=True, eq=False)
class FrictionOverLoad(CoefficientCurve, LoadDependentFriction):
    """μ → μ + s(|v_n|).  It is no law of the load (`PowerLawFriction`)."""

    form = "curve"
    formula = "μ ← μ + s(|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    variable, unit = "|v_n|", "m/s"

    def along(self, state: State) -> Float[Tensor, "... n"]:
        return state.v_n.abs()

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.change(self.along(state)), eps
