"""Effects where they vanish, for derivatives in their own parameters alone.

In a model with many candidates an effect takes part in the derivatives of all before it, though where it vanishes it
hands them on as they are.  A `Vanishing` one acts on constants, and adds the change, 0, to what has derivatives.
"""

from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects import Effect, State


@dataclass(frozen=True)
class Vanishing:
    """An effect at values at which it changes nothing; else it is like the effect itself."""

    effect: Effect

    def __getattr__(self, name: str) -> Any:
        return getattr(self.effect, name)

    def at(self, values: Float[Tensor, "... k"]) -> "Vanishing":
        """Return the effect with tensors of the same values."""
        return Vanishing(self.effect.at(values))

    def state(self, state: State) -> State:
        """Return the same state, with derivatives."""
        return state.plus(self.effect.state(state.constant))

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        """Return the same coefficients, with derivatives."""
        changed = self.effect.law(state.constant, mu.detach(), eps.detach())
        return mu + (changed[0] - mu.detach()), eps + (changed[1] - eps.detach())

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        """Return the same wrench, with derivatives."""
        return wrench + (self.effect.wrench(state.constant, wrench.detach()) - wrench.detach())

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        """Return the same velocity, with derivatives."""
        return v_post + (self.effect.velocity(state.constant, v_post.detach()) - v_post.detach())
