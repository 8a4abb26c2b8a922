"""The camera's zero of the orientation is not the body's."""

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.space import BOTH


class OrientationOffset(Effect):
    """θ → θ + δ before the body's shape gives the contact point; in space a turn (δ_a, −δ, δ_c) about the body's axes.

    It is not a tilt of the floor, which also turns the velocities (`surface_tilt`).  Bodies of different shape all have
    the same δ.
    """

    formula = "θ ← θ + δ, r ← r(θ)"
    in_words = "the orientation is the recorded one plus {delta}[, {delta_a} about the body's x, {delta_c} about its z]"
    spaces = BOTH
    source = "calibration"
    mirror_symmetric = False
    needs_shape = True
    delta: Tensor | float = parameter("δ", "rad", -0.3, 0.3)
    delta_a: Tensor | float | None = parameter("δ_a", "rad", -0.3, 0.3, in_space=True)
    delta_c: Tensor | float | None = parameter("δ_c", "rad", -0.3, 0.3, in_space=True)

    def state(self, state: State) -> State:
        delta = torch.as_tensor(self.delta)
        if self.delta_a is None or self.delta_c is None:
            return state.turned(delta)
        about = columns(torch.as_tensor(self.delta_a), -delta, torch.as_tensor(self.delta_c))
        return state.turned(state.in_world(about))
