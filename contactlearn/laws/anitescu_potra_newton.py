"""Anitescu & Potra (1997) with Newton restitution: one complementarity problem.

    0 ≤ P_n ⊥ v_n⁺ + ε v_n ≥ 0,   P_t = −σ μ P_n against the *final* slip σ, or stick in the cone.

It differs from Whittaker only where the slip reverses, and like it can add energy.
"""

from torch import Tensor

from contactlearn.laws.base import Contact, complementary


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) in N s as in the module's formula."""
    return complementary(contact, mu, -(1 + eps) * contact.v_n)


VARIANTS = {"textbook": textbook, "fazeli2017": textbook}
