"""Restitution differs from impact to impact."""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State
from contactlearn.scatter.base import Component, Perturbed


class Restitution(Component):
    """ε_k = ε + u_k, within 0 ≤ ε_k ≤ 1.

    It grows with the normal impulse, which noise of the instrument does not.  It is not wear, which follows the
    sequence (`parameter_drift`), nor a dependence on speed or pose.
    """

    symbol = "ε"
    unit = "–"
    highest = 0.3
    in_words = "restitution by {sigma}"
    source = "Stoianovici & Hurmuzlu 1996"

    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n 1"]
    ) -> Perturbed:
        return state, mu, (eps + u[..., 0]).clamp(0, 1)
