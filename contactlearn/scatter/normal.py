"""The normal differs from impact to impact: the floor is rough."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State, columns
from contactlearn.mechanics.rigid_body import rotation, turn_quaternion
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.scatter.base import Component, Perturbed


class Normal(Component):
    """The contact frame of impact k is turned by u_k about the contact point, in space by (u_k1, u_k2) along x and y.

    It is not a tilt of the floor, which is the same for all impacts (`surface_tilt`), nor an error of the recorded
    orientation, which leaves the frame alone (`orientation_offset`).
    """

    symbol = "φ"
    unit = "rad"
    highest = 0.15
    in_words = "the normal by {sigma}"
    source = "roughness of both surfaces"

    def deviations(self, space: Space) -> int:
        return space.d - 1

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n k"]
    ) -> Perturbed:
        if state.space is PLANE:
            return state.tilted(u[..., 0], state.theta - u[..., 0]), mu, eps
        along, across = u.unbind(-1)
        vector = columns(across, -along, torch.zeros_like(along))
        level = columns(torch.ones_like(along), *[torch.zeros_like(along)] * 3)
        turn = rotation(turn_quaternion(level, vector))
        return state.tilted(turn, turn_quaternion(state.orientation, -vector)), mu, eps
