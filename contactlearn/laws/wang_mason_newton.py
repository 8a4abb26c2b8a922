"""Wang & Mason (1992): Routh's path in impulse space with Newton restitution.

The path is that of `wang_mason`; contact ends where v_n = −ε v_n⁻ on it.  The slip may end on the way, in stick or in
reversed sliding, so it differs from Whittaker's law, whose sliding keeps its direction, and it can add energy where
the slip ends early.  It is not one of the paper's six.
"""

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values
from contactlearn.laws.hodograph import Hodograph, until
from contactlearn.laws.wang_mason import routh_path


class WangMasonNewton(Law):
    """Routh's path in impulse space with Newton restitution; it can add energy.

    It is not Poisson's restitution, which ends the contact by its normal impulse (`WangMason`).
    """

    label = "Wang–Mason Newton"
    citations = ("wang1992",)
    adds_energy = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        path = routh_path(contact, mu)
        return path.impulse(path.until(-(1 + eps) * contact.v_n))

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s; see `hodograph`."""
        path = Hodograph(contact, mu)
        return path.restored(path.compressed(), *(until(-e * contact.v_n) for e in (1.0, eps)))
