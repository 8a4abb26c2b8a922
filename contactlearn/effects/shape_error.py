"""The body is not as long or as wide as it was thought to be."""

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class ShapeError(Effect):
    """The body is stretched by 1 + s_a and 1 + s_b (and 1 + s_c) along its own axes, such as the sides of a box.

    Its moment of inertia stays (`inertia_error`), and so does its centre of mass (`com_offset`).
    Bodies of different shape are all stretched by the same shares.
    """

    formula = "r ← r(θ) of the body stretched by (1 + s_a, 1 + s_b)"
    in_words = (
        "the stated lengths of the body change by {s_a:%} along its x and {s_b:%} along its y[ and {s_c:%} along its z]"
    )
    spaces = BOTH
    source = "calibration"
    needs_shape = True
    s_a: Tensor | float = parameter("s_a", "–", -0.3, 0.3)
    s_b: Tensor | float = parameter("s_b", "–", -0.3, 0.3)
    s_c: Tensor | float | None = parameter("s_c", "–", -0.3, 0.3, in_space=True)

    def state(self, state: State) -> State:
        turn, by = state.orientation, (*self.values, 0.0)[:3]
        longer = state.replace(stretch=tuple(k * (1 + s) for k, s in zip(state.stretch, by, strict=True)))
        return longer.replace(r=state.r + (longer.contact_points(turn) - state.contact_points(turn)))
