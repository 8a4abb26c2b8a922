"""The floor is rougher in one direction than across it."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns
from contactlearn.laws.contact import SpatialContact
from contactlearn.laws.wang_mason import WangMason
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import SPACE

_LEAST = 1e-30  # square of the anisotropy, for its root
_ROUTH = WangMason()


class AnisotropicFriction(Effect):
    """An elliptic friction cone, |D⁻¹ P_t| ≤ μ P_n with D = exp((p, q), (q, −p)), of most dissipation.

    μ is e^s times the mean one along the bearing β and e^−s times across it, (p, q) = s (cos 2β, sin 2β), and friction
    is turned from the slip towards the rougher direction.  With P_t = D P̃_t, and D v_t in place of v_t, the cone is
    round again, so that Routh's path is the same in these variables; what that changes of it is added to what the law
    gives.  It is not rougher one way than the opposite one (`directional_friction`).
    """

    spaces = (SPACE,)
    formula = "|D⁻¹ P_t| ≤ μ P_n, D = exp((p, q), (q, −p)), at every instant"
    in_words = "ln μ is {p} larger along x than in the mean, and {q} larger along the diagonal x = y"
    source = "Zmitrowicz 1981"
    citations = ("zmitrowicz1981",)
    mirror_symmetric = False
    adds_energy = True
    p: Tensor | float = parameter("p", "–", -1.0, 1.0)
    q: Tensor | float = parameter("q", "–", -1.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        p, q = (torch.as_tensor(x).to(wrench) for x in (self.p, self.q))
        size = (p.square() + q.square()).clamp_min(_LEAST).sqrt()
        mean, per = size.cosh(), size.sinh() / size
        zero, unit = torch.zeros_like(size), torch.ones_like(size)
        rows = (mean + per * p, per * q, zero), (per * q, mean - per * p, zero), (zero, zero, unit)
        D = torch.stack([columns(*row) for row in rows], -2)
        round_cone = _impulse(state, state.W, state.approach)
        change = matvec(D, _impulse(state, D @ state.W @ D, matvec(D, state.approach))) - round_cone
        return wrench + torch.nn.functional.pad(change, (0, 3))


def _impulse(state: State, W: Float[Tensor, "... n 3 3"], v_c: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
    """Impulse of Routh's path with Poisson's restitution."""
    contact, (c, s) = SpatialContact.of(W, v_c)
    P_1, P_2, P_n = _ROUTH.solve_in_space(contact, *state.coefficients)
    return columns(c * P_1 - s * P_2, s * P_1 + c * P_2, P_n)
