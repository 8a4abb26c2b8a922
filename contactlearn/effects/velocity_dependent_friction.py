"""Friction depends on how fast the contact slips."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import ChangesFriction, Effect, parameter
from contactlearn.effects.functions import SLIP, Argument, Spline
from contactlearn.effects.impulse_path import perturbed_path_in_space, smooth_norm
from contactlearn.effects.state import Coefficients, State
from contactlearn.mechanics.space import BOTH, SPACE

_SIMPSON = torch.tensor((1, 4, 2, 4, 1))
_ROUNDS = 3  # of the end of the slip and the mean friction up to it
_LEAST_BRAKING = 0.05  # as by this μ on a level path


class VelocityDependentFriction(Effect):
    """μ is a function of the slip v of the instant.

        viscous, viscous_path      μ + c v
        stribeck, stribeck_path    μ (1 + d exp(−v/v_s))      more friction at little slip
        curve, curve_path          μ + s(v), see `functions.Spline`
        initial                    μ + s(|v_t|), of the slip before contact

    In the plane it is averaged over the normal impulse that the contact takes while it slips: the slip goes from |v_t|
    to its `final_slip` and stays longest where it is braked least, dP_n = dv/b(v) with the braking b of Routh's path;
    the average is Simpson's.  In space Routh's path is followed as the slip turns (`perturbed_path_in_space`).
    It is not friction that changes with the load (`load_dependent_friction`).
    """

    place = "law"
    source = "Stribeck 1902"
    citations = ("stribeck1902",)


class _OverSlip(Frozen, ABC):
    """A change of μ at every slip."""

    @abstractmethod
    def at_slip(self, slip: Float[Tensor, "..."], mu: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the change of μ at a slip in m/s."""


class _Averaged(_OverSlip):
    """Its mean over the slip of a contact in the plane."""

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return (μ, ε) of each impact."""
        assert isinstance(self, Effect)  # as every class that this is a part of
        return mu + _mean(lambda slip: self.at_slip(slip, mu), state, mu, eps, self.values), eps


class _AlongPath(_OverSlip):
    """The change at each slip along the path of a contact in space."""

    spaces = (SPACE,)
    adds_energy = True

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        """Return the wrench in contact axes."""
        assert isinstance(self, Effect)
        mu, _ = state.coefficients
        return perturbed_path_in_space(
            state, wrench, self.values, friction=lambda slip: self.at_slip(smooth_norm(slip), mu)
        )


class _Viscous(_OverSlip):
    in_words = "μ changes by {c} of slip"
    c: Tensor | float = parameter("c", "s/m", -0.3, 0.3)

    def at_slip(self, slip: Float[Tensor, "..."], mu: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return self.c * slip


class ViscousFriction(_Viscous, _Averaged, VelocityDependentFriction):
    """μ → μ + c v̄, v̄ the mean slip.  It does not level off at speed (`StribeckFriction`)."""

    form = "viscous"
    formula = "μ ← μ + c v̄, v̄ the mean slip"


class ViscousFrictionInSpace(_Viscous, _AlongPath, VelocityDependentFriction):
    """μ → μ + c v along the path of a contact in space.  It does not level off at speed (`StribeckFrictionInSpace`)."""

    form = "viscous_path"
    formula = "μ ← μ + c v, v the slip along the path of the contact"


class _Stribeck(_OverSlip):
    in_words = "μ changes by {d:%} at little slip, which fades over {v_s}"
    d: Tensor | float = parameter("d", "–", -1.0, 5.0)
    v_s: Tensor | float = parameter("v_s", "m/s", 0.05, 5.0, vanishing=None, start=0.5)

    def at_slip(self, slip: Float[Tensor, "..."], mu: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return mu * self.d * (-slip / self.v_s).exp()


class StribeckFriction(_Stribeck, _Averaged, VelocityDependentFriction):
    """μ → μ (1 + d s̄), s̄ the mean of exp(−v/v_s) over the slip.  It does not grow with the slip (`ViscousFriction`)."""

    form = "stribeck"
    formula = "μ ← μ (1 + d s̄), s̄ the mean of exp(−v/v_s) over the slip"


class StribeckFrictionInSpace(_Stribeck, _AlongPath, VelocityDependentFriction):
    """μ → μ (1 + d exp(−v/v_s)) along the path of a contact in space.

    It does not grow with the slip (`ViscousFrictionInSpace`).
    """

    form = "stribeck_path"
    formula = "μ ← μ (1 + d exp(−v/v_s)), v the slip along the path of the contact"


class _Curve(Spline, _OverSlip):
    argument = Argument("v", "m/s", lambda state: torch.cat((state.slip, state.slip / 2), -1))
    # at first, and later if the contact sticks

    def at_slip(self, slip: Float[Tensor, "..."], mu: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        return self.change(slip)


class FrictionOverSlip(_Curve, _Averaged, VelocityDependentFriction):
    """μ → μ + s̄, the mean of s(v) over the slip.  It is no law of lubrication (`StribeckFriction`)."""

    formula = "μ ← μ + s̄, the mean over the slip v of a smooth s that rises by c₁, c₂, c₃ from knot to knot"


class FrictionOverSlipInSpace(_Curve, _AlongPath, VelocityDependentFriction):
    """μ → μ + s(v) along the path of a contact in space.  It is no law of lubrication (`StribeckFrictionInSpace`)."""

    form = "curve_path"
    formula = "μ ← μ + s(v) along the path of the contact, a smooth s that rises by c₁, c₂, c₃ from knot to knot"


class FrictionOverInitialSlip(Spline, ChangesFriction, VelocityDependentFriction):
    """μ → μ + s(|v_t|): one coefficient for the whole contact, as its first slip has it (`FrictionOverSlip`)."""

    spaces = BOTH
    form = "initial"
    formula = "μ ← μ + s(|v_t|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    argument = SLIP


def _mean(
    change: Callable[[Tensor], Tensor],
    state: State,
    mu: Float[Tensor, "..."],
    eps: Float[Tensor, "..."],
    parameters: Sequence[Float[Tensor, "..."]],
) -> Float[Tensor, "... n"]:
    """Mean of a change of μ over the normal impulse of the slip, after Simpson; the end of the slip depends on it.

    The parameters of the change broadcast against μ.
    """
    first, *_ = torch.broadcast_tensors(state.slip, mu, *parameters)
    mean, simpson, place = torch.zeros_like(first), *(part.to(first) for part in (_SIMPSON, torch.linspace(0, 1, 5)))
    simpson, place = (part.view(-1, *[1] * first.ndim) for part in (simpson, place))
    for _ in range(_ROUNDS):
        last = final_slip(state, mu + mean, eps)
        changes = change(last + (first - last) * place)
        weights = simpson / braking(state, mu + changes).clamp_min(_LEAST_BRAKING * state.W[..., 0, 0])
        mean = (weights * changes).sum(0) / weights.sum(0)
    return mean


def braking(state: State, mu: Float[Tensor, "..."]) -> Float[Tensor, "... n"]:
    """Fall of the slip per normal impulse, in 1/kg."""
    return mu * state.W[..., 0, 0] - state.v_t.sign() * state.W[..., 0, 1]


def final_slip(state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Float[Tensor, "... n"]:
    """Slip in m/s after an impact that slides throughout, or 0 where the slip would have ended."""
    stiffness = state.W[..., 1, 1] - mu * state.v_t.sign() * state.W[..., 0, 1]
    P_n = torch.where(stiffness > 0, (1 + eps) * state.approach[..., 1].abs() / stiffness.clamp_min(1e-300), torch.inf)
    slows = braking(state, mu)
    return torch.where(slows > 0, (state.slip - slows.clamp_min(0) * P_n).clamp_min(0), state.slip)
