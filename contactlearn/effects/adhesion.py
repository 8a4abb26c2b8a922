"""The surfaces cling before they part."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Coefficients, Effect, parameter
from contactlearn.effects.state import State, altered
from contactlearn.mechanics.space import BOTH


class Adhesion(Effect):
    """Parting takes an impulse or an energy that does not grow with the speed, up to all of the rebound.

        impulse    P_n → P_n − c
        work       v_n⁺ → √(v_n⁺² − 2 w W_nn), by P_n alone
        speed      ε → √(ε² − s/v_n²), so that the law of contact knows of it

    In all but the last P_t stays: adhesion carries the friction as a load would, so P_t may exceed μ P_n.  It is not a
    lower restitution, whose loss grows with the speed.
    """

    place = "wrench"
    spaces = BOTH
    source = "Johnson, Kendall & Roberts 1971"
    citations = ("johnson1971",)


class AdhesionImpulse(Adhesion):
    """P_n → P_n − c, at most the rebound v_n⁺/W_nn.  It is not a work of adhesion (`WorkOfAdhesion`)."""

    form = "impulse"
    formula = "P_n ← P_n − c, at most the rebound"
    in_words = "parting takes an impulse of {c}"
    c: Tensor | float = parameter("c", "N s", 0.0, 0.05)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        rebound, w_nn = state.contact_after(wrench)[..., -1].clamp_min(0), state.W[..., -1, -1]
        return altered(wrench, state.space.d - 1, -torch.minimum(torch.as_tensor(self.c), rebound / w_nn))


class WorkOfAdhesion(Adhesion):
    """v_n⁺ → √(v_n⁺² − 2 w W_nn), or 0 if w exceeds the energy of the rebound.

    It is not a fixed loss of impulse (`AdhesionImpulse`), which takes more energy from a faster rebound.
    """

    form = "work"
    formula = "v_n⁺ ← √(v_n⁺² − 2 w W_nn), by P_n"
    in_words = "parting takes a work of {w}"
    w: Tensor | float = parameter("w", "J", 0.0, 0.1)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        rebound, w_nn = state.contact_after(wrench)[..., -1].clamp_min(0), state.W[..., -1, -1]
        squared = rebound.square() - 2 * self.w * w_nn  # of v_n⁺ after parting
        parts = squared > 0
        slower = torch.where(parts, torch.where(parts, squared, 1.0).sqrt(), 0.0)
        return altered(wrench, state.space.d - 1, (slower - rebound) / w_nn)


class AdhesionSpeed(Adhesion):
    """ε → √(ε² − s/v_n²), or 0: impacts slower than √s/ε stick, whatever the lever, and friction acts on the rest.

    The work grows with the mass that the contact feels (`WorkOfAdhesion`).
    """

    place = "law"
    form = "speed"
    formula = "ε ← √(ε² − s/v_n²)"
    in_words = "the squared speed of the rebound is less by {s}"
    source = "Thornton & Ning 1998"
    citations = ("thornton1998",)
    s: Tensor | float = parameter("s", "m²/s²", 0.0, 2.0)

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        squared = eps.square() - self.s / state.v_n.square()
        rebounds = squared > 0
        return mu, torch.where(rebounds, torch.where(rebounds, squared, 1.0).sqrt(), 0.0)
