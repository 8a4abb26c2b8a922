"""The body is harder or easier to turn than it was thought to be."""

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH, PLANE


class InertiaError(Effect):
    """The moment of inertia is e^κ times the nominal one.

    It is not an error of the mass, which velocities do not determine.
    """

    spaces = BOTH
    formula = "I ← I e^κ"
    in_words = "the moment of inertia is {kappa:exp} times the stated one"
    source = "calibration"
    adds_energy = True
    kappa: Tensor | float = parameter("κ", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        factor = torch.as_tensor(self.kappa).to(state.inertia).exp()
        return state.replace(inertia=state.inertia * (factor if state.space is PLANE else factor[..., None]))
