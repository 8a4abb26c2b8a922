"""The contact resists the spin with a moment that follows the load."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import Effect, parameter, require_positive
from contactlearn.effects.functions import ARM, Argument, Spline
from contactlearn.effects.impulse_path import perturbed_path, perturbed_path_in_space
from contactlearn.effects.state import State, altered
from contactlearn.mechanics.space import BOTH, SPACE


class RollingResistance(Effect):
    """A moment per normal impulse opposes the spin on its way from ω to ω⁺: τ → τ − arm P_n.

        smoothed    c s̄, with the mean sign of the spin
        curve       s(|ω̄|) sign(ω̄), ω̄ the mean of ω and ω⁺, see `functions.Spline`
        path        c sign(ω), with the spin of the instant, in space
        before      c sign(ω), with the spin before contact
        point       r_x → r_x − c sign(ω): the law acts ahead of the contact point, with the velocity there

    In all but the last two the contact responds while it lasts (`perturbed_path`).  In space ω is the spin along the
    floor.  It is not damping in proportion to the spin and the moment of inertia (`spin_damping`), nor friction against
    the spin about the normal (`torsional_friction`).
    """

    place = "wrench"
    usual_range = ARM
    source = "Johnson 1985, §8.3"
    citations = ("johnson1985",)
    adds_energy = True


class _ConstantArm(Frozen):
    """An arm c in m, half a width, that fades below a spin `omega_s` in rad/s."""

    in_words = "the normal impulse acts {c} ahead of the contact point, as the body rolls"

    c: Tensor | float = parameter("c", "m", 0.0, 0.005)
    omega_s: float = 1.0

    def _smoothed(self, spin: Float[Tensor, "... n k"]) -> Float[Tensor, "... n"]:
        """|ω| in rad/s, which does not vanish."""
        return (spin.square().sum(-1) + require_positive(self.omega_s) ** 2).sqrt()


class SmoothedRollingResistance(_ConstantArm, RollingResistance):
    """τ → τ − c P_n s̄, where s̄ is the mean sign of the spin on its way from ω to ω⁺; c is half a width.

        s̄ = (ω⁺ + ω) / (√(ω⁺² + ω_s²) + √(ω² + ω_s²)),      the mean of ω/√(ω² + ω_s²)

    It takes at most the spin ω⁺ that there would be without it.  It does not grow with the spin
    (`RollingResistanceCurve`).
    """

    form = "smoothed"
    formula = "τ ← τ − c P_n s̄ while the contact lasts, s̄ the mean sign of the spin"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        before, after = state.omega, state.v_after(wrench)[..., 2]
        resisted = (before + after) / (self._smoothed(before[..., None]) + self._smoothed(after[..., None]))
        most = state.inertia * after.abs() / wrench[..., 1].clamp_min(1e-300)
        return perturbed_path(state, wrench, arm=-torch.maximum(torch.minimum(self.c * resisted, most), -most))


class RollingResistanceInSpace(_ConstantArm, RollingResistance):
    """dτ/dP_n = −c ω/√(|ω|² + ω_s²) along Routh's path, with the spin ω of the instant along the floor.

    It is not the spin before contact, which friction changes (`RollingResistanceBefore`).
    """

    spaces = (SPACE,)
    form = "path"
    formula = "dτ/dP_n = −c ω/|ω|, smoothed, along the path of the contact"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        def against_rolling(spin: Float[Tensor, "3 ... n"]) -> Float[Tensor, "3 ... n"]:
            along_floor = torch.cat((spin[:2], torch.zeros_like(spin[:1])))
            return -self.c * along_floor / self._smoothed(spin[:2].movedim(0, -1))

        return perturbed_path_in_space(state, wrench, self.values, moment=against_rolling)


class RollingResistanceCurve(Spline, RollingResistance):
    """τ → τ − s(|ω̄|) sign(ω̄) P_n while the contact lasts.  It need not level off (`SmoothedRollingResistance`)."""

    formula = (
        "τ ← τ − s(|ω̄|) sign(ω̄) P_n while the contact lasts, a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    )
    argument = Argument("|ω̄|", "rad/s", lambda state: _mean_spin(state).abs())
    at_rest = True

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        mean = (state.omega + state.v_after(wrench)[..., 2]) / 2
        return perturbed_path(state, wrench, arm=-mean.sign() * self.change(mean.abs()))


class RollingResistanceBefore(_ConstantArm, RollingResistance):
    """τ → τ − c P_n ω/√(|ω|² + ω_s²), with the spin ω that the body comes in with.

    The contact does not respond to it, and it goes on where the spin is reversed (`SmoothedRollingResistance`).
    """

    spaces = BOTH
    form = "before"
    formula = "τ ← τ − c P_n sign(ω), smoothed, ω the spin before contact"

    def wrench(self, state: State, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        d = state.space.d
        spin = state.v_pre[..., d : d + 2]
        moment = (self.c * wrench[..., d - 1] / self._smoothed(spin))[..., None] * spin
        return wrench - pad(moment, (d, d - 2))


class RollingResistanceAtPoint(_ConstantArm, RollingResistance):
    """r_x → r_x − c ω/√(ω² + ω_s²): the law of contact acts ahead of the contact point, with the velocity there.

    The contact point does not keep its own restitution (`SmoothedRollingResistance`).
    """

    place = "state"
    form = "point"
    formula = "r_x ← r_x − c sign(ω), smoothed, where the law acts"

    def state(self, state: State) -> State:
        shift = -self.c * state.omega / self._smoothed(state.omega[..., None])
        return state.replace(r=altered(state.r, 0, shift))


def _mean_spin(state: State) -> Float[Tensor, "... n"]:
    """Mean spin over a contact without friction at a restitution of 1/2, rad/s."""
    P_n = -1.5 * state.v_n / state.W[..., 1, 1]
    return state.omega + state.r[..., 0] * P_n / state.inertia / 2
