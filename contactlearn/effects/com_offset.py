"""The centre of mass is not where it was thought to be."""

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.rigid_body import swept
from contactlearn.mechanics.space import BOTH

_ALONG = "the body's x and {delta_b} along its y[ and {delta_c} along its z]"


class ComOffset(Effect):
    """The centre of mass lies (δ_a, δ_b), in space (δ_a, δ_b, δ_c), from the assumed one, along the body's axes.

        tracked    r → r − d,  v → v + ω × d, and back after contact: the tracked point was taken for the centre
        contact    r → r − d: velocities are those of the centre, and the contact point was computed from another

    The moment of inertia is taken to be about the centre of mass already.
    """

    place = "state"
    spaces = BOTH
    source = "calibration"
    mirror_symmetric = False
    last = True
    delta_a: Tensor | float = parameter("δ_a", "m", -0.02, 0.02)
    delta_b: Tensor | float = parameter("δ_b", "m", -0.02, 0.02)
    delta_c: Tensor | float | None = parameter("δ_c", "m", -0.02, 0.02, in_space=True)

    def shift(self, state: State) -> Tensor:
        """Return d [..., N, d] in m, in world axes."""
        return state.in_world(columns(*map(torch.as_tensor, self.values)))


class ComOffsetTracked(ComOffset):
    """The tracked velocity is that of another point, too.  It is no shift of the contact alone (`ComOffsetContact`)."""

    form = "tracked"
    formula = "d = R δ, δ along the body's axes; (r, v) ← (r − d, v + ω × d)"
    in_words = f"the centre of mass lies {{delta_a}} from the tracked point along {_ALONG}"
    adds_energy = True

    def state(self, state: State) -> State:
        d, linear, spin = self.shift(state), state.v_pre[..., : state.space.d], state.v_pre[..., state.space.d :]
        return state.replace(
            r=state.r - d,
            v_pre=columns(*(linear + swept(d, spin)).unbind(-1), *spin.unbind(-1)),
            offset=d if state.offset is None else state.offset + d,
        )


class ComOffsetContact(ComOffset):
    """Only the lever arm is another one.  The velocities are those of the centre of mass (`ComOffsetTracked`)."""

    form = "contact"
    formula = "d = R δ, δ along the body's axes; r ← r − d"
    in_words = f"the centre of mass lies {{delta_a}} from the assumed one along {_ALONG}"

    def state(self, state: State) -> State:
        return state.replace(r=state.r - self.shift(state))
