"""The body loses a part of its spin."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.impulse_path import perturbed_path
from contactlearn.effects.state import State, columns
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.space import BOTH


class SpinDamping(Effect):
    """A moment opposes the spin and grows with it.

        after        τ → τ − c I ω⁺, with the spin ω⁺ that the body has without it
        quadratic    τ → τ − I ω⁺ k |ω⁺|/(1 + k |ω⁺|), as in air
        during       τ → τ − b (I/m) ω̄ P_n, ω̄ the mean of ω and that ω⁺; the contact responds (`perturbed_path`)
        lasting      τ → τ − d I ω̄, spread over P_n: a contact that lasts equally long at every speed; likewise

    It is not rolling resistance, which does not grow with the spin (`rolling_resistance`).
    """

    place = "wrench"
    source = "air, guide walls, cables"
    adds_energy = True


class SpinDampingAfter(SpinDamping):
    """τ → τ − c I ω⁺: the spin falls by the share c.  It does not act on the contact (`SpinDampingDuring`)."""

    spaces = BOTH
    form = "after"
    formula = "τ ← τ − c I ω⁺"
    in_words = "the spin falls by {c:%} after contact"
    c: Tensor | float = parameter("c", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        d = state.space.d
        spun = rigid_body.spin_momentum(state.world_inertia, state.v_after(wrench)[..., d:])
        tau = wrench[..., d:] - torch.as_tensor(self.c).to(spun)[..., None] * spun
        return columns(*wrench[..., :d].unbind(-1), *tau.unbind(-1))


class QuadraticSpinDamping(SpinDamping):
    """ω⁺ → ω⁺/(1 + k |ω⁺|): a moment that is quadratic in the spin, for a while.

    It is not a share that is the same for slow and fast spin (`SpinDampingAfter`).
    """

    spaces = BOTH
    form = "quadratic"
    formula = "τ ← τ − I ω⁺ k |ω⁺|/(1 + k |ω⁺|)"
    in_words = "the spin falls by a share of {k}"
    k: Tensor | float = parameter("k", "s/rad", 0.0, 0.2)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        d, k = state.space.d, torch.as_tensor(self.k)
        after = state.v_after(wrench)[..., d:]
        spun, speed = rigid_body.spin_momentum(state.world_inertia, after), after.norm(dim=-1)
        tau = wrench[..., d:] - (k * speed / (1 + k * speed))[..., None] * spun
        return columns(*wrench[..., :d].unbind(-1), *tau.unbind(-1))


class SpinDampingDuring(SpinDamping):
    """τ → τ − b (I/m) ω̄ P_n while the contact lasts, which responds.

    It is not a loss between contact and the second measurement (`SpinDampingAfter`).
    """

    form = "during"
    formula = "τ ← τ − b (I/m) ω̄ P_n while the contact lasts, ω̄ the mean of ω and ω⁺"
    in_words = "the spin falls by a share of {b} of normal impulse per mass"
    b: Tensor | float = parameter("b", "s/m", 0.0, 0.3)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        after = state.v_after(wrench)[..., 2]
        return perturbed_path(state, wrench, arm=-self.b * state.inertia / state.mass * (state.omega + after) / 2)


class SpinDampingLasting(SpinDamping):
    """τ → τ − d I ω̄ while the contact lasts, which responds: the spin falls by the share d at every speed of impact.

    It does not grow with the normal impulse (`SpinDampingDuring`).
    """

    form = "lasting"
    formula = "τ ← τ − d I ω̄ while the contact lasts, ω̄ the mean of ω and ω⁺"
    in_words = "the spin falls by {d:%} during contact"
    d: Tensor | float = parameter("d", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        after, P_n = state.v_after(wrench)[..., 2], wrench[..., 1]
        arm = torch.where(P_n > 0, state.inertia / torch.where(P_n > 0, P_n, 1.0), 0.0)
        return perturbed_path(state, wrench, arm=-self.d * arm * (state.omega + after) / 2)
