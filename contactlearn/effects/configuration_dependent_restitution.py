"""Impacts far from the centre of mass lose more."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect, parameter
from contactlearn.effects.functions import LEVER, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class ConfigurationDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the lever r_x/ρ, ρ² = I/m: the longer it is, the more goes into vibration.

        quadratic    ε − c (r_x/ρ)²
        linear       ε − c |r_x|/ρ
        curve        ε + s(|r_x|/ρ), see `functions.Spline`

    It is not a soft spot of the body, which need not follow the lever arm (`orientation_dependent_restitution`).
    """

    spaces = BOTH
    source = "Stoianovici & Hurmuzlu 1996"
    citations = ("stoianovici1996",)


class QuadraticLeverRestitution(ConfigurationDependentRestitution):
    """ε → ε − c (r_x/ρ)².  It is small near the centre (`LinearLeverRestitution`)."""

    form = "quadratic"
    formula = "ε ← ε − c (r_x/ρ)²"
    in_words = "ε changes by {c:-} times (r_x/ρ)²"
    c: Tensor | float = parameter("c", "–", -0.5, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value - self.c * state.lever**2


class LinearLeverRestitution(ConfigurationDependentRestitution):
    """ε → ε − c |r_x|/ρ.  It does not spare contacts near the centre (`QuadraticLeverRestitution`)."""

    form = "linear"
    formula = "ε ← ε − c |r_x|/ρ"
    in_words = "ε changes by {c:-} times |r_x|/ρ"
    c: Tensor | float = parameter("c", "–", -0.5, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value - self.c * state.lever


class RestitutionOverLever(Spline, ConfigurationDependentRestitution):
    """ε → ε + s(|r_x|/ρ).  It need not fall with the lever (`QuadraticLeverRestitution`)."""

    formula = "ε ← ε + s(|r_x|/ρ), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = LEVER
