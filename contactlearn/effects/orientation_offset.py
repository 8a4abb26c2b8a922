"""The camera's zero of the orientation is not the body's."""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State


@dataclass(frozen=True, eq=False)
class OrientationOffset(Effect):
    """θ → θ + δ before the body's shape gives the contact point.

    It is not a tilt of the floor, which also turns the velocities (`surface_tilt`).  Bodies of different shape all have
    the same δ.
    """

    formula = "θ ← θ + δ, r ← r(θ)"
    in_words = "the orientation is the recorded one plus {delta}"
    source = "calibration"
    mirror_symmetric = False
    needs_shape = True
    delta: Tensor | float = parameter("δ", "rad", -0.3, 0.3)

    def state(self, state: State) -> State:
        return state.turned(torch.as_tensor(self.delta))
