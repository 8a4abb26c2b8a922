"""The floor rebounds more in some places than in others."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect
from contactlearn.effects.basis import AlongFloor
from contactlearn.effects.state import Coefficients, State


@dataclass(frozen=True, eq=False)
class LocationDependentRestitution(AlongFloor, Effect):
    """ε depends on the place along the floor.  It is not a drift in time (`parameter_drift`)."""

    formula = "ε ← ε + Σ c_k P_k(u), k = 1 … 5, u = x on its span"
    source = "non-uniform or bending floor"
    mirror_symmetric = False

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        return mu, eps + self.change(state.x)
