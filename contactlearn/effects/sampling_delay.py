"""The last frame before contact is not the moment of contact."""

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.space import BOTH, PLANE


class SamplingDelay(Effect):
    """The body moves on for Δt after the last frame, and so touches the floor with another point.

        (x, y, θ) → (x, y, θ) + Δt (v_x, v_y, ω),      r → r(θ)

    The velocities stay: it is not gravity acting on a late frame (`gravity_impulse`).
    """

    formula = "(x, y, θ) ← (x, y, θ) + Δt v, r ← r(θ)"
    in_words = "the time from the recorded pose to contact is {dt}"
    source = "frame rate"
    spaces = BOTH
    needs_shape = True
    of_recording = True
    dt: Tensor | float = parameter("Δt", "s", -0.02, 0.02)

    def state(self, state: State) -> State:
        d, dt = state.space.d, torch.as_tensor(self.dt)
        moved = (state.q[..., k] + dt * state.v_pre[..., k] for k in range(d))
        turn = dt * state.omega if state.space is PLANE else dt[..., None] * state.v_pre[..., d:]
        return state.replace(q=columns(*moved, *state.q.unbind(-1)[d:])).turned(turn)
