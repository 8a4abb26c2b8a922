"""The surfaces change while they are being measured."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import ChangesFriction, ChangesRestitution, Effect, parameter
from contactlearn.effects.functions import TRIAL, Spline, TrialShare
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH

_STEP = 0.03  # width of a step as a share of all trials


class ParameterDrift(Effect):
    """ε or μ changes with the number k of trials before this one.

        restitution, friction                      in proportion: ε + c k/1000
        settling_restitution, settling_friction    towards a value: ε + a (1 − exp(−λ k/N)), N trials in all
        restitution_step, friction_step            at once: ε + a/(1 + exp(−(k/N − t)/0.03)), a surface that is changed
        restitution_curve, friction_curve          ε + s(k), see `functions.Spline`

    It is not a dependence on the place on the floor (`location_dependent_restitution`).
    """

    place = "law"
    spaces = BOTH
    source = "wear, temperature"


class RestitutionDrift(ChangesRestitution, ParameterDrift):
    """ε → ε + c k/1000.  It is not a drift of the friction (`FrictionDrift`)."""

    form = "restitution"
    formula = "ε ← ε + c k/1000"
    in_words = "ε changes by {c}"
    c: Tensor | float = parameter("c", "per 1000 trials", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.c * _thousands(state)


class FrictionDrift(ChangesFriction, ParameterDrift):
    """μ → μ + d k/1000.  It is not a drift of the restitution (`RestitutionDrift`)."""

    form = "friction"
    formula = "μ ← μ + d k/1000"
    in_words = "μ changes by {d}"
    d: Tensor | float = parameter("d", "per 1000 trials", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return value + self.d * _thousands(state)


class _Settling(TrialShare):
    """a (1 − exp(−λ k/N)): a change that comes to an end."""

    formula = "{quantity} ← {quantity} + a (1 − exp(−λ k/N)), N trials in all"
    in_words = "{quantity} changes by {a} and settles at a rate of {rate} per sequence"
    a: Tensor | float = parameter("a", "–", -0.5, 0.5)
    rate: Tensor | float = parameter("λ", "–", 0.5, 20.0, vanishing=None, start=3.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient of each trial [..., N]."""
        return value + self.a * -torch.expm1(-self.rate * self.share(state))


class _Step(TrialShare):
    """a/(1 + exp(−(k/N − t)/0.03)): a change within a few per cent of the trials about one."""

    formula = "{quantity} ← {quantity} + a/(1 + exp(−(k/N − t)/0.03)), N trials in all"
    in_words = "{quantity} changes by {a} after {t:%} of the trials"
    a: Tensor | float = parameter("a", "–", -0.5, 0.5)
    t: Tensor | float = parameter("t", "–", 0.0, 1.0, vanishing=None, start=0.5)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient of each trial [..., N]."""
        return value + self.a * torch.sigmoid((self.share(state) - self.t) / _STEP)


class _CurveOverOrder(Spline):
    """s(k): a change at any pace."""

    formula = "{quantity} ← {quantity} + s(k), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = TRIAL


class SettlingRestitution(_Settling, ChangesRestitution, ParameterDrift):
    """ε → ε + a (1 − exp(−λ k/N)), as surfaces run in.  It does not go on for ever (`RestitutionDrift`)."""

    form = "settling_restitution"


class SettlingFriction(_Settling, ChangesFriction, ParameterDrift):
    """μ → μ + a (1 − exp(−λ k/N)), as surfaces run in.  It does not go on for ever (`FrictionDrift`)."""

    form = "settling_friction"


class RestitutionStep(_Step, ChangesRestitution, ParameterDrift):
    """ε → ε + a/(1 + exp(−(k/N − t)/0.03)), as where a surface is changed.  It is not wear (`SettlingRestitution`)."""

    form = "restitution_step"


class FrictionStep(_Step, ChangesFriction, ParameterDrift):
    """μ → μ + a/(1 + exp(−(k/N − t)/0.03)), as where a surface is changed.  It is not wear (`SettlingFriction`)."""

    form = "friction_step"


class RestitutionDriftCurve(_CurveOverOrder, ChangesRestitution, ParameterDrift):
    """ε → ε + s(k).  It need not settle (`SettlingRestitution`)."""

    form = "restitution_curve"


class FrictionDriftCurve(_CurveOverOrder, ChangesFriction, ParameterDrift):
    """μ → μ + s(k).  It need not settle (`SettlingFriction`)."""

    form = "friction_curve"


def _thousands(state: State) -> Float[Tensor, "... n"]:
    """Thousands of trials before each one, k/1000."""
    return (state.order - 1) / 1000
