"""An effect of one's own: a cable that twists the body back while it is in contact.

    PYTHONPATH=examples contactlearn train +effect.cable._target_=cable_torque.CableTorque

A test module of one's own holds it to what every effect must obey:

    from contactlearn.testing import EffectContract

    class TestCableTorque(EffectContract):
        effect = CableTorque()
"""

from torch import Tensor

import contactlearn as cl


class CableTorque(cl.effects.Effect):
    """τ → τ − k sin θ.  It is not a resistance to the spin (`rolling_resistance`)."""

    formula = "τ ← τ − k sin θ"
    in_words = "the cable twists the body back by {k} times sin θ"
    source = "a cable that hangs off the body"
    adds_energy = True
    k: Tensor | float = cl.effects.parameter("k", "N m s", -0.001, 0.001)

    def wrench(self, state: cl.effects.State, wrench: Tensor) -> Tensor:
        P_t, P_n, tau = wrench.unbind(-1)
        return cl.effects.columns(P_t, P_n, tau - self.k * state.theta.sin())
