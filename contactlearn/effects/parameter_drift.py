"""The surfaces change while they are being measured."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class ParameterDrift(Effect):
    """ε or μ changes in proportion to the number k of trials before this one.

    It is not a dependence on the place on the floor (`location_dependent_restitution`).
    """

    source = "wear, temperature"

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ and ε, one of them with its drift."""


@dataclass(frozen=True, eq=False)
class RestitutionDrift(ParameterDrift):
    """ε → ε + c k/1000.  It is not a drift of the friction (`FrictionDrift`)."""

    form = "restitution"
    formula = "ε ← ε + c k/1000"
    c: Tensor | float = parameter("c", "per 1000 trials", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.c * _thousands(state)


@dataclass(frozen=True, eq=False)
class FrictionDrift(ParameterDrift):
    """μ → μ + d k/1000.  It is not a drift of the restitution (`RestitutionDrift`)."""

    form = "friction"
    formula = "μ ← μ + d k/1000"
    d: Tensor | float = parameter("d", "per 1000 trials", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.d * _thousands(state), eps


def _thousands(state: State) -> Float[Tensor, "... n"]:
    """k/1000, thousands of trials before each one."""
    return (state.order - 1) / 1000
