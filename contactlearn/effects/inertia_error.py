"""The body is harder or easier to turn than it was thought to be."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.space import BOTH, PLANE, SPACE


class InertiaError(Effect):
    """The moment of inertia is not the nominal one.

        uniform    I e^κ, in space about all axes of the body
        x, y, z    in space I_x e^κ_x, or I_y or I_z alike: one principal moment is wrong
        axes       in space I_x e^κ_x, I_y e^κ_y and I_z e^κ_z

    It is not an error of the mass, which velocities do not determine.
    """

    place = "state"
    source = "calibration"
    adds_energy = True


class UniformInertiaError(InertiaError):
    """I → I e^κ.  All principal moments are off by one factor (`InertiaErrorOfAxes`)."""

    spaces = BOTH
    form = "uniform"
    formula = "I ← I e^κ"
    in_words = "the moment of inertia is {kappa:exp} times the stated one"
    kappa: Tensor | float = parameter("κ", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        factor = torch.as_tensor(self.kappa).to(state.inertia).exp()
        return state.replace(inertia=state.inertia * (factor if state.space is PLANE else factor[..., None]))


class InertiaErrorX(InertiaError):
    """I_x → I_x e^κ_x about the body's x alone (`UniformInertiaError`)."""

    spaces = (SPACE,)
    form = "x"
    formula = "I_x ← I_x e^κ_x"
    in_words = "the moment of inertia about the body's x is {kappa_x:exp} times the stated one"
    kappa_x: Tensor | float = parameter("κ_x", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        return _scaled(state, self.kappa_x, 0.0, 0.0)


class InertiaErrorY(InertiaError):
    """I_y → I_y e^κ_y about the body's y alone (`UniformInertiaError`)."""

    spaces = (SPACE,)
    form = "y"
    formula = "I_y ← I_y e^κ_y"
    in_words = "the moment of inertia about the body's y is {kappa_y:exp} times the stated one"
    kappa_y: Tensor | float = parameter("κ_y", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        return _scaled(state, 0.0, self.kappa_y, 0.0)


class InertiaErrorZ(InertiaError):
    """I_z → I_z e^κ_z about the body's z alone (`UniformInertiaError`)."""

    spaces = (SPACE,)
    form = "z"
    formula = "I_z ← I_z e^κ_z"
    in_words = "the moment of inertia about the body's z is {kappa_z:exp} times the stated one"
    kappa_z: Tensor | float = parameter("κ_z", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        return _scaled(state, 0.0, 0.0, self.kappa_z)


class InertiaErrorOfAxes(InertiaError):
    """Each principal moment has a factor of its own.  It is not one factor on all of them (`UniformInertiaError`)."""

    spaces = (SPACE,)
    form = "axes"
    formula = "I_x ← I_x e^κ_x, I_y ← I_y e^κ_y, I_z ← I_z e^κ_z"
    in_words = (
        "the moments of inertia about the body's x, y and z are {kappa_x:exp}, {kappa_y:exp} and {kappa_z:exp} times "
        "the stated ones"
    )
    kappa_x: Tensor | float = parameter("κ_x", "–", -1.0, 1.0)
    kappa_y: Tensor | float = parameter("κ_y", "–", -1.0, 1.0)
    kappa_z: Tensor | float = parameter("κ_z", "–", -1.0, 1.0)

    def state(self, state: State) -> State:
        return _scaled(state, self.kappa_x, self.kappa_y, self.kappa_z)


def _scaled(state: State, *logarithms: Float[Tensor, "..."] | float) -> State:
    """State with factors on the principal moments, by their logarithms."""
    return state.replace(
        inertia=state.inertia * columns(*(torch.as_tensor(x).to(state.inertia).exp() for x in logarithms))
    )
