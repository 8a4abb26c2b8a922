"""Guide walls or air slow the body before it is measured again."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.space import BOTH, SPACE

_LEAST = 1e-9  # m/s, for the derivative of a body at rest


class SideDrag(Effect):
    """(v_x, v_y) keeps its direction after contact and falls by a share.

        linear       c, whatever the speed
        quadratic    k v/(1 + k v), which grows with the speed v, as in air
        horizontal   in space c of (v_x, v_y) alone, while v_z stays: air that blows between walls, brushes

    It is not a lower restitution: v_x shrinks as well, however the contact ends.
    """

    place = "velocity"
    spaces = BOTH
    source = "guide walls, air"


class LinearSideDrag(SideDrag):
    """(v_x, v_y) → (1 − c) (v_x, v_y).  The share does not grow with the speed (`QuadraticSideDrag`)."""

    form = "linear"
    formula = "(v_x⁺, v_y⁺) ← (1 − c) (v_x⁺, v_y⁺)"
    in_words = "the body loses {c:%} of its speed after contact"
    c: Tensor | float = parameter("c", "–", 0.0, 0.5)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return _slowed(state, v_post, 1 - torch.as_tensor(self.c))


class QuadraticSideDrag(SideDrag):
    """(v_x, v_y) → (v_x, v_y)/(1 + k v): a drag that is quadratic in the speed v, for a while.

    It is not a share that is the same for slow and fast bodies (`LinearSideDrag`).
    """

    form = "quadratic"
    formula = "(v_x⁺, v_y⁺) ← (v_x⁺, v_y⁺)/(1 + k v⁺), v⁺ the speed"
    in_words = "the body loses a share of {k} after contact"
    k: Tensor | float = parameter("k", "s/m", 0.0, 0.5)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        speed = (v_post[..., : state.space.d].square().sum(-1) + _LEAST**2).sqrt()
        return _slowed(state, v_post, 1 / (1 + self.k * speed))


class HorizontalSideDrag(SideDrag):
    """(v_x, v_y) → (1 − c) (v_x, v_y) of a body in space, whose v_z stays as it is (`LinearSideDrag`)."""

    spaces = (SPACE,)
    form = "horizontal"
    formula = "(v_x⁺, v_y⁺) ← (1 − c) (v_x⁺, v_y⁺), v_z⁺ as it is"
    in_words = "the body loses {c:%} of its velocity along the floor after contact"
    c: Tensor | float = parameter("c", "–", 0.0, 0.5)

    def velocity(self, state: State, v_post: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        v_x, v_y, *others = v_post.unbind(-1)
        kept = 1 - torch.as_tensor(self.c)
        return columns(kept * v_x, kept * v_y, *others)


def _slowed(state: State, v_post: Float[Tensor, "... n D"], kept: Float[Tensor, "..."]) -> Float[Tensor, "... n D"]:
    """The velocity with a share of that of the mass centre kept."""
    d = state.space.d
    return columns(*(kept * part if k < d else part for k, part in enumerate(v_post.unbind(-1))))
