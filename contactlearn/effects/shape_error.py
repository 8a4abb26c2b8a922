"""The body is not as long or as wide as it was thought to be."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State
from contactlearn.shapes import contact_point


@dataclass(frozen=True, eq=False)
class ShapeError(Effect):
    """The body is stretched by 1 + s_a and 1 + s_b along its own axes: the semi-axes of an ellipse, the sides of a box.

    Its moment of inertia stays (`inertia_error`), and so does its centre of mass (`com_offset`).
    """

    formula = "r ← r(θ) of the body stretched by (1 + s_a, 1 + s_b)"
    source = "calibration"
    needs_shape = True
    s_a: Tensor | float = parameter("s_a", "–", -0.3, 0.3)
    s_b: Tensor | float = parameter("s_b", "–", -0.3, 0.3)

    def state(self, state: State) -> State:
        scale = 1 + self.s_a, 1 + self.s_b
        stretched = contact_point(state.shape, state.theta, scale)
        return state.replace(r=state.r + (stretched - contact_point(state.shape, state.theta)))
