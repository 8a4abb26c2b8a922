"""The centre of mass is not the point that was tracked."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns, perpendicular
from contactlearn.mechanics import rotate


@dataclass(frozen=True, eq=False)
class ComOffset(Effect):
    """The centre of mass lies (δ_a, δ_b) from the tracked point, along the body's axes.

        d = R(θ) (δ_a, δ_b):      r → r − d,  v → v + ω ẑ × d, and back after contact

    The moment of inertia is taken to be about the centre of mass already.  It is not a shift of the
    contact point alone, for the tracked velocity is then another one too.
    """

    formula = "d = R(θ) (δ_a, δ_b); (r, v) ← (r − d, v + ω ẑ × d)"
    source = "calibration"
    mirror_symmetric = False
    adds_energy = True
    last = True
    delta_a: Tensor | float = parameter("δ_a", "m", -0.02, 0.02)
    delta_b: Tensor | float = parameter("δ_b", "m", -0.02, 0.02)

    def state(self, state: State) -> State:
        d = rotate(columns(self.delta_a, self.delta_b), state.theta)
        velocity = state.v_pre[..., :2] + state.omega[..., None] * perpendicular(d)
        return state.replace(
            r=state.r - d,
            v_pre=columns(*velocity.unbind(-1), state.omega),
            offset=d if state.offset is None else state.offset + d,
        )
