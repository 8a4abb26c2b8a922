"""Impacts far from the centre of mass lose more."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class ConfigurationDependentRestitution(Effect):
    """ε → ε − c (r_x/ρ)², ρ² = I/m: the longer the lever arm, the more goes into vibration.

    It is not a soft spot of the body, which need not follow the lever arm (`orientation_dependent_restitution`).
    """

    formula = "ε ← ε − c (r_x/ρ)²"
    source = "Stoianovici & Hurmuzlu 1996"
    citations = ("stoianovici1996",)
    c: Tensor | float = parameter("c", "–", -0.5, 1.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps - self.c * state.r[..., 0] ** 2 * (state.mass / state.inertia)
