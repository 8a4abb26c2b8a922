"""The objects of a table rub differently."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect
from contactlearn.effects.by_body import ByBody
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class BodyDependentFriction(ByBody, Effect):
    """Each object has its own μ: that of the law for the first, another by Δ for each of the others.

    It is not a change in time, which objects that were measured one after the other would show too
    (`parameter_drift`).
    """

    formula = "μ ← μ + Δ(object), 0 for the first object"
    source = "materials"

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu + self.change(state), eps
