"""Faster impacts rebound less."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, known, parameter
from contactlearn.effects.speed import SpeedReference
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class VelocityDependentRestitution(SpeedReference, Effect):
    """ε falls with the normal velocity of approach.

        power           ε (|v_n|/v_ref)^(−p)                         plastic yield, p = 1/4
        kuwabara_kono   ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))          viscoelastic

    ε is the restitution at v_ref.  It is not a dependence on the slip (`slip_dependent_restitution`).
    """

    source = "Johnson 1985, §11.5; Kuwabara & Kono 1987"
    citations = (
        "johnson1985",
        "kuwabara1987",
    )
    component = 1

    @abstractmethod
    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return μ and ε(|v_n|)."""


@dataclass(frozen=True, eq=False)
class PowerLawRestitution(VelocityDependentRestitution):
    """ε → ε (|v_n|/v_ref)^(−p), plastic yield with p = 1/4.  It has no elastic limit (`KuwabaraKonoRestitution`)."""

    form = "power"
    formula = "ε ← ε (|v_n|/v_ref)^(−p)"
    p: Tensor | float = parameter("p", "–", -1.0, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        speed = state.v_n.abs() / known(self.v_ref)
        return mu, eps * speed**-self.p


@dataclass(frozen=True, eq=False)
class KuwabaraKonoRestitution(VelocityDependentRestitution):
    """ε → ε (1 − C ((|v_n|/v_ref)^(1/5) − 1)), viscoelastic spheres.  It is not plastic (`PowerLawRestitution`)."""

    form = "kuwabara_kono"
    formula = "ε ← ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))"
    C: Tensor | float = parameter("C", "–", -1.0, 4.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        speed = state.v_n.abs() / known(self.v_ref)
        return mu, eps * (1 - self.C * (speed**0.2 - 1))
