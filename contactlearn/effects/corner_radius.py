"""The corners of the body are round."""

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.space import BOTH


class CornerRadius(Effect):
    """The corners of a polygon are arcs of radius ρ_c within its two sides, those of a solid spheres within its faces.

    The contact point lies ρ_c below the centre of the arc, so r is shorter than to the sharp vertex and moves along the
    corner with θ.  A body of another shape has no corners, and nothing depends on ρ_c; several polygons
    have the same ρ_c.  It is not a polygon of other sides (`shape_error`).
    """

    spaces = BOTH
    formula = "r ← r(θ) of the body with corners whose radius is larger by ρ_c"
    in_words = "the radius of the corners is larger by {rho_c}"
    source = "calibration"
    needs_shape = True
    rho_c: Tensor | float = parameter("ρ_c", "m", 0.0, 0.01)

    def state(self, state: State) -> State:
        turn, rounder = state.orientation, state.replace(corner=state.corner + self.rho_c)
        return rounder.replace(r=state.r + (rounder.contact_points(turn) - state.contact_points(turn)))
