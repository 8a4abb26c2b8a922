"""The contact point differs from impact to impact: another grain of the surface touches."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State, columns
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import Space
from contactlearn.scatter.base import Component, Perturbed

_POSE_ERROR = 0.004  # rad; orientations of motion capture err by 1 to 4 mrad


class ContactPoint(Component):
    """The contact point of impact k is off by u_k along the surface, in space by (u_k1, u_k2) along x and y.

    It is the only component that changes the moment of a given impulse about the mass centre.  It is not an offset of
    the mass centre, which turns with the body (`com_offset`), nor a moment over a patch of area (`contact_patch`).
    """

    symbol = "r"
    unit = "m"
    highest = 0.005
    in_words = "the contact point by {sigma}"
    source = "roughness of both surfaces"

    def deviations(self, space: Space) -> int:
        return space.d - 1

    def of_instrument(self, impacts: Impacts) -> bool:
        """A turn of the body by as little as recorded orientations err moves the contact point as far."""
        return self.sigma <= _POSE_ERROR * impacts.r.norm(dim=-1).median().item()

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n k"]
    ) -> Perturbed:
        parts = [u[..., k] for k in range(u.shape[-1])]
        return state.replace(r=state.r + columns(*parts, torch.zeros_like(parts[0]))), mu, eps
