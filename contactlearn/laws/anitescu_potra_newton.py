"""Anitescu & Potra (1997) with Newton restitution: one complementarity problem.

    0 ≤ P_n ⊥ v_n⁺ + ε v_n ≥ 0,   P_t = −σ μ P_n against the *final* slip σ, or stick in the cone.

It differs from Whittaker only where the slip reverses, and like it can add energy.
"""

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values, complementary, complementary_in_space


class AnitescuPotraNewton(Law):
    """Newton restitution and Coulomb friction against the *final* slip in one complementarity problem.

    It can add energy where the slip reverses.
    """

    label = "Anitescu–Potra Newton"
    citations = ("anitescu1997",)
    paper = 2
    adds_energy = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        return complementary(contact, mu, -(1 + eps) * contact.v_n)

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s, of a circular cone."""
        return complementary_in_space(contact, mu, -(1 + eps) * contact.v_n)
