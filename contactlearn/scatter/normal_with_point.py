"""The normal differs from impact to impact, and a round body touches where its own surface faces it."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import Space
from contactlearn.scatter.base import Component, Perturbed
from contactlearn.scatter.normal import Normal

_SMALL_TURN = 1e-3  # rad
_MIN_MOVE = 0.3  # of the way of a sphere's contact point; those of rounded corners hardly move


class NormalWithPoint(Component):
    """The contact frame of impact k is turned by u_k, and the contact point moves to the body's lowest point in it.

    So a smooth round body meets a floor that is uneven over lengths of the body's own radius: a sphere's contact point
    moves by R u_k.  It is not grain of either surface, which turns the frame about the contact point alone (`normal`).
    A corner, sharp or rounded, touches with the same corner: there the two cannot be told apart.
    """

    symbol = "α"
    unit = "rad"
    highest = 0.15
    in_words = "the normal by {sigma}, and the contact point with it"
    source = "an uneven floor"

    def deviations(self, space: Space) -> int:
        return space.d - 1

    def suits(self, impacts: Impacts) -> bool:
        if impacts.shape is None:
            return False
        state = State.of(impacts)
        u = torch.full((len(impacts), self.deviations(impacts.space)), _SMALL_TURN, dtype=torch.float64)
        none = torch.zeros(len(impacts), dtype=torch.float64)
        moved = self.perturb(state, none, none, u)[0].r - Normal().perturb(state, none, none, u)[0].r
        size = _MIN_MOVE * _SMALL_TURN * impacts.r.norm(dim=-1)
        return bool((moved.norm(dim=-1) > size).double().mean() > 0.5)

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n k"]
    ) -> Perturbed:
        turned, _, _ = Normal().perturb(state, mu, eps, u)
        level = state.replace(r=state.contact_points(state.orientation))
        before, _, _ = Normal().perturb(level, mu, eps, u)
        return turned.replace(r=turned.r + (state.contact_points(turned.orientation) - before.r)), mu, eps
