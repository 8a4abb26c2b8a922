"""The floor is not where it was thought to be: its normal leans."""

from typing import Self

import torch
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation, turn_quaternion
from contactlearn.mechanics.space import BOTH


class SurfaceTilt(Effect):
    """The contact frame is turned by φ against the world's axes.

        computed    r, v, θ → R(−φ) r, R(−φ) v, θ − φ, and r moves to the body's lowest point above the tilted floor
        seen        r, v, θ → R(−φ) r, R(−φ) v, θ − φ: the contact point is where it was measured

    In space the normal also leans along y, by ψ: the contact frame is turned about (ψ, −φ, 0).

    Both are the same on a polygon that touches with the same vertex.  A measurement frame that is
    turned by −φ against a level floor is the same as a floor that leans by φ: positions, velocities and orientation
    are taken to the floor's axes, and the outcome back.  It is not an error of the body's orientation, which leaves
    the velocities alone (`orientation_offset`).
    """

    place = "state"
    spaces = BOTH
    source = "calibration"
    in_words = "the floor is tilted by {phi}[ along x and {psi} along y]"
    mirror_symmetric = False
    phi: Tensor | float = parameter("φ", "rad", -0.2, 0.2)
    psi: Tensor | float | None = parameter("ψ", "rad", -0.2, 0.2, in_space=True)

    def turned(self, state: State) -> State:
        """Return the state in axes that are turned, with the contact point as it was."""
        phi = torch.as_tensor(self.phi)
        if self.psi is None:
            return state.tilted(phi, state.theta - phi)
        vector = columns(torch.as_tensor(self.psi), -phi, torch.zeros_like(phi))
        level = columns(torch.ones_like(phi), *[torch.zeros_like(phi)] * 3)
        return state.tilted(rotation(turn_quaternion(level, vector)), turn_quaternion(state.orientation, -vector))


class SurfaceTiltComputed(SurfaceTilt):
    """The contact point was computed above a level floor.  It was not seen (`SurfaceTiltSeen`)."""

    form = "computed"
    needs_shape = True
    formula = "(r, v, θ) ← (R(−φ) r, R(−φ) v, θ − φ), r at the lowest point"

    def prepare(self, impacts: Impacts) -> Self:
        try:
            return super().prepare(impacts)
        except DataError as error:
            raise DataError(
                f"{error}; or take effect.surface_tilt.form=seen for a contact point that was seen"
            ) from None

    def state(self, state: State) -> State:
        tilted, level = self.turned(state), state.replace(r=state.contact_points(state.orientation))
        return tilted.replace(r=tilted.r + (state.contact_points(tilted.orientation) - self.turned(level).r))


class SurfaceTiltSeen(SurfaceTilt):
    """The contact point was seen, so it stays.  It was not computed from the shape (`SurfaceTiltComputed`)."""

    form = "seen"
    formula = "(r, v, θ) ← (R(−φ) r, R(−φ) v, θ − φ), r as it was seen"

    def state(self, state: State) -> State:
        return self.turned(state)
