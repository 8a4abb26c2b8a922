"""The contact resists the spin about the normal."""

from abc import abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter, require_positive
from contactlearn.effects.state import State, altered
from contactlearn.mechanics.rigid_body import inverse
from contactlearn.mechanics.space import SPACE

_LEAST = 1e-9  # m/s, for the derivative of a contact at rest


class TorsionalFriction(Effect):
    """A moment about the normal opposes the spin ω_n about it, and stops it at most: τ_n → τ_n − arm P_n.

        dry        c s̄, with the mean sign of ω_n on its way through the contact
        sliding    c c ω̄_n/√(μ² v̄_t² + c² ω̄_n²): the less, the faster the contact slides

    c is the coefficient of friction times the mean radius of the contact.  The moment is added to what the law gives.
    It is not a resistance to rolling (`rolling_resistance`), and bodies in a plane do not have it.
    """

    spaces = (SPACE,)
    source = "Goyal, Ruina & Papadopoulos 1991; Contensou 1963, Zhuravlev 1998"
    citations = ("goyal1991", "zhuravlev1998")
    adds_energy = True
    in_words = "friction against the spin about the normal acts at a radius times μ of {c}"
    c: Tensor | float = parameter("c", "m", 0.0, 0.01)

    @abstractmethod
    def arm(self, state: State, wrench: Tensor, spins: tuple[Tensor, Tensor]) -> Tensor:
        """Return the arm [..., N] in m from ω_n before and after a wrench without it."""

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        before, after = state.v_pre[..., 5], state.v_after(wrench)[..., 5]
        most = after.abs() / inverse(state.world_inertia)[..., 2, 2]
        tau = self.arm(state, wrench, (before, after)) * wrench[..., 2]
        return altered(wrench, 5, -torch.maximum(torch.minimum(tau, most), -most))


class DryTorsionalFriction(TorsionalFriction):
    """τ_n → τ_n − c P_n s̄, s̄ the mean sign of ω_n.  Sliding does not lessen it (`SlidingTorsionalFriction`)."""

    form = "dry"
    formula = "τ_n ← τ_n − c P_n s̄, s̄ the mean sign of ω_n, until it stops"
    omega_s: float = 1.0

    def arm(self, state: State, wrench: Tensor, spins: tuple[Tensor, Tensor]) -> Tensor:
        (before, after), fades = spins, require_positive(self.omega_s) ** 2
        return self.c * (before + after) / ((before.square() + fades).sqrt() + (after.square() + fades).sqrt())


class SlidingTorsionalFriction(TorsionalFriction):
    """τ_n → τ_n − c P_n c ω̄_n/√(μ² v̄_t² + c² ω̄_n²), of most dissipation on an ellipsoidal limit surface.

    A contact that slides resists the spin as a viscous one does; v̄_t and ω̄_n are means of before and after.
    It is not as large in slip as in rest (`DryTorsionalFriction`).
    """

    form = "sliding"
    formula = "τ_n ← τ_n − c P_n c ω̄_n/√(μ² v̄_t² + c² ω̄_n²), until it stops"
    refines = ("torsional_friction",)

    def arm(self, state: State, wrench: Tensor, spins: tuple[Tensor, Tensor]) -> Tensor:
        slip = (state.v_c + state.contact_after(wrench))[..., :2] / 2 * state.coefficients[0][..., None]
        turning = self.c * (spins[0] + spins[1]) / 2
        return self.c * turning / (slip.square().sum(-1) + turning.square() + _LEAST**2).sqrt()
