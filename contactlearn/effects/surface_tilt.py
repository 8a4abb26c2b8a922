"""The floor is not where it was thought to be: its normal leans."""

from dataclasses import dataclass

from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics import rotate


@dataclass(frozen=True, eq=False)
class SurfaceTilt(Effect):
    """The contact frame is turned by φ against the world's axes.

        r, v, θ → R(−φ) r, R(−φ) v, θ − φ;      where the shape is known, r also moves to the body's lowest
        point above the tilted floor

    It is not an error of the body's orientation, which leaves the velocities alone (`orientation_offset`).
    """

    formula = "(r, v, θ) ← (R(−φ) r, R(−φ) v, θ − φ), r at the lowest point"
    source = "calibration"
    mirror_symmetric = False
    phi: Tensor | float = parameter("φ", "rad", -0.2, 0.2)

    def state(self, state: State) -> State:
        phi = self.phi
        r = rotate(state.r, -phi)
        theta = state.theta - phi
        if state.shape is not None:
            r = r + (state.lowest(theta) - rotate(state.lowest(state.theta), -phi))
        return state.replace(
            r=r,
            q=columns(*rotate(state.q[..., :2], -phi).unbind(-1), theta),
            v_pre=columns(*rotate(state.v_pre[..., :2], -phi).unbind(-1), state.omega),
            tilt=phi if state.tilt is None else state.tilt + phi,
            offset=None if state.offset is None else rotate(state.offset, -phi),
        )
