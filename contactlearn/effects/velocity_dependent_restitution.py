"""Faster impacts rebound less."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesRestitution, Effect, parameter
from contactlearn.effects.functions import APPROACH, SpeedReference, Spline
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH

_STEP = 0.02  # of v_s, width of a threshold: no trial is far from one side of it, and v_s keeps a gradient


class VelocityDependentRestitution(ChangesRestitution, Effect):
    """ε is a function of the normal velocity of approach.

        power           ε (|v_n|/v_ref)^(−p)                         plastic yield, p = 1/4
        kuwabara_kono   ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))          viscoelastic
        linear          ε (1 − k (|v_n|/v_ref − 1))                  damping that grows with the load
        slow            ε + a exp(−|v_n|/v_s)                        another restitution at low speed
        threshold       ε (1 − b S((v_s − |v_n|)/w))                 switched off below a speed, as engines do
        curve           ε + s(|v_n|), see `functions.Spline`

    At v_ref the restitution is ε.  It is not a dependence on the slip (`slip_dependent_restitution`).
    """

    spaces = BOTH
    source = "Johnson 1985, §11.5; Kuwabara & Kono 1987"
    citations = ("johnson1985", "kuwabara1987")
    speed = APPROACH


class PowerLawRestitution(SpeedReference, VelocityDependentRestitution):
    """ε → ε (|v_n|/v_ref)^(−p), plastic yield with p = 1/4.  It has no elastic limit (`KuwabaraKonoRestitution`)."""

    form = "power"
    formula = "ε ← ε (|v_n|/v_ref)^(−p)"
    in_words = "ε changes by {p:-doubled} when the approach speed doubles"
    p: Tensor | float = parameter("p", "–", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value * self.ratio(state) ** -self.p


class KuwabaraKonoRestitution(SpeedReference, VelocityDependentRestitution):
    """ε → ε (1 − C ((|v_n|/v_ref)^(1/5) − 1)), viscoelastic spheres.  It is not plastic (`PowerLawRestitution`)."""

    form = "kuwabara_kono"
    formula = "ε ← ε (1 − C ((|v_n|/v_ref)^(1/5) − 1))"
    in_words = "ε changes viscoelastically with the approach speed, C = {C}"
    C: Tensor | float = parameter("C", "–", -1.0, 4.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value * (1 - self.C * (self.ratio(state) ** 0.2 - 1))


class LinearFallRestitution(SpeedReference, VelocityDependentRestitution):
    """ε → ε (1 − k (|v_n|/v_ref − 1)).  It does not level off (`SlowImpactRestitution`)."""

    form = "linear"
    formula = "ε ← ε (1 − k (|v_n|/v_ref − 1))"
    in_words = "ε changes by {k:-%} from the median approach speed to twice that"
    source = "Hunt & Crossley 1975"
    citations = ("hunt1975",)
    k: Tensor | float = parameter("k", "–", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value * (1 - self.k * (self.ratio(state) - 1))


class SlowImpactRestitution(VelocityDependentRestitution):
    """ε → ε + a exp(−|v_n|/v_s), so ε is that of fast impacts.  It does not fall for ever (`PowerLawRestitution`)."""

    form = "slow"
    formula = "ε ← ε + a exp(−|v_n|/v_s)"
    in_words = "ε changes by {a} in slow impacts, over {v_s}"
    a: Tensor | float = parameter("a", "–", -1.0, 1.0)
    v_s: Tensor | float = parameter("v_s", "m/s", 0.05, 5.0, vanishing=None, start=1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.a * (-state.v_n.abs() / self.v_s).exp()


class ThresholdRestitution(VelocityDependentRestitution):
    """ε → ε (1 − b S((v_s − |v_n|)/w)), S a logistic step of width w = 0.02 v_s.

    With b = 1 slow impacts do not rebound.  It does not fall gradually (`SlowImpactRestitution`).
    """

    form = "threshold"
    formula = "ε ← ε (1 − b / (1 + exp((|v_n| − v_s)/(0.02 v_s))))"
    in_words = "ε falls by {b:%} below an approach speed of {v_s}"
    source = "bounce thresholds of PhysX, Bullet and Box2D"
    citations = ()
    b: Tensor | float = parameter("b", "–", 0.0, 1.0)
    v_s: Tensor | float = parameter("v_s", "m/s", 0.05, 3.0, vanishing=None, start=0.5)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        step = ((self.v_s - state.v_n.abs()) / (_STEP * self.v_s)).sigmoid()
        return value * (1 - self.b * step)


class RestitutionOverSpeed(Spline, VelocityDependentRestitution):
    """ε → ε + s(|v_n|).  It is no law of a material (`KuwabaraKonoRestitution`)."""

    formula = "ε ← ε + s(|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = APPROACH
