"""A law of one's own: a floor without friction.

    PYTHONPATH=examples contactlearn evaluate law._target_=smooth_floor.SmoothFloor model=[]

A test module of one's own holds it to what every law must obey:

    from contactlearn.testing import LawContract

    class TestSmoothFloor(LawContract):
        law = SmoothFloor()
"""

import contactlearn as cl


class SmoothFloor(cl.laws.Law):
    """Newton restitution without friction; μ has no meaning.  It is not a law at μ = 0 of a body that rolls."""

    def solve(self, contact: cl.laws.Contact, mu, eps):
        """P_t = 0, P_n = −(1 + ε) v_n / W_nn, in N s."""
        P_n = -(1 + eps) * contact.v_n / contact.w_nn
        return 0 * P_n, P_n
