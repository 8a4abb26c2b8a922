"""The recorded orientation differs from the true one, from impact to impact: noise of the instrument."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State, columns
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.scatter.base import Component, Perturbed


class Orientation(Component):
    """The recorded contact point r_k is turned by u_k about the mass centre, in space by three angles; the floor stays.

    It moves the contact point along the surface by u_k times its height, as `contact_point` does alike at all poses,
    and the contact's lever with it.  It is not the normal's scatter, which turns the contact frame, nor an offset that
    all recordings share (`orientation_offset`).
    """

    symbol = "θ"
    unit = "rad"
    highest = 0.1
    in_words = "the recorded orientation by {sigma}"
    source = "Fuller 1987"

    def deviations(self, space: Space) -> int:
        return 1 if space is PLANE else 3

    def of_instrument(self, impacts: Impacts) -> bool:
        return True

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n k"]
    ) -> Perturbed:
        if state.space is PLANE:
            moved = u * columns(-state.r[..., 1], state.r[..., 0])
        else:
            along, across, twist = u.unbind(-1)
            moved = torch.linalg.cross(*torch.broadcast_tensors(columns(across, -along, twist), state.r))
        return state.replace(r=state.r + moved), mu, eps
