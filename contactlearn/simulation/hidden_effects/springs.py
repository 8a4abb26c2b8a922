"""Nature's contact with compliance: springs between body and floor, followed in time.

    normal       F_n = k δ while the indentation δ grows, then k/ε² (δ − (1 − ε²) δ_max), never negative:
                 the stiffer way back keeps 1 − ε² of the normal work, whatever the tangent does
    tangential   a spring of stiffness k/c with a dashpot beside it, together stretched by ξ, in series with
                 a Coulomb slider: F_t = −(k/c) (ξ + T dξ/dt) while it holds, and |F_t| ≤ μ F_n

The tangential spring may spin the body back, as a superball does.  Its c = k_n/k_t is between 1 and 1.5
for an elastic sphere (Mindlin 1949), and T says how slowly its stretch changes: for a resilience of 1
the dashpot is absent, T = 0, and for one of 0 it is rigid, T = ∞, and the contact sticks or slides at
once.  Only ratios matter: time is counted in units in which k W_nn = 1, so that compression alone takes
π/2.  The normal step is a leapfrog; the tangential one is implicit, so that a rigid contact is no
special case, and loses a little energy but never gains any.
Sources: Maw, Barber & Fawcett (1976); Walton & Braun (1986); Walton (1993).
"""

import math

import torch
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.mechanics.rigid_body import apply_wrench, contact_velocity, inverse_inertia
from contactlearn.simulation.hidden_effects.nature import ContactState

STEPS = 400  # of a free compression
_TENDENCY = 1e-12  # m/s: the slip of a contact that is about to slip, for its sign alone


def collide_on_springs(contact: ContactState, compliance: float, resilience: float, steps: int = STEPS) -> Tensor:
    """Velocity of the centre of mass [N, 3] after contact.

    Args:
        contact: N contacts on approach with ε > 0; restitution is energetic in any case.
        compliance: c = k_n/k_t of the tangential spring, at least 0.
        resilience: s in [0, 1], T = (1/s − 1) times a free compression.
        steps: of a free compression; the error falls as 1 / steps.

    Raises:
        DataError: a contact that does not come to its end, as with numbers that are not finite.
    """
    W = inverse_inertia(contact.mass, contact.inertia, contact.r)
    w_tt, w_tn, w_nn = W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]
    turn_t, turn_n = -contact.r[:, 1] / contact.inertia, contact.r[:, 0] / contact.inertia
    v_t, v_n = contact_velocity(contact.r, contact.v).unbind(-1)
    omega = contact.v[:, 2]
    dt = 0.5 * math.pi / steps
    depth = deepest = stretch = P_t = p = tau = torch.zeros_like(v_n)
    give = compliance * w_nn  # of the tangential spring: stretch per force
    recall = resilience / (resilience * dt + (1 - resilience) * 0.5 * math.pi)  # 1 / (dt + T)
    normal = torch.zeros_like(v_n)
    for _ in range(50 * steps):
        middle = depth - 0.5 * dt * v_n
        deepest = torch.maximum(deepest, middle)
        back = (middle - (1 - contact.eps**2) * deepest) / contact.eps**2
        normal = torch.minimum(middle, back).clamp_min(0) / w_nn
        if bool((normal == 0).all()):
            return apply_wrench(contact.mass, contact.inertia, contact.r, contact.v, torch.stack((P_t, p, tau), -1))
        lever = contact.lever(omega)
        free = v_t + dt * (w_tn + turn_t * lever) * normal
        tangential = -(recall * stretch + free) / (recall * give + dt * w_tt)
        mu = contact.friction(-tangential.sign() * v_t.abs().clamp_min(_TENDENCY))
        tangential = tangential.clamp(-mu * normal, mu * normal)
        stretch = stretch - dt * recall * (stretch + give * tangential)  # the slider takes the rest
        v_t = free + dt * w_tt * tangential
        v_n = v_n + dt * ((w_nn + turn_n * lever) * normal + w_tn * tangential)
        omega = omega + dt * ((turn_n + lever / contact.inertia) * normal + turn_t * tangential)
        depth = middle - 0.5 * dt * v_n
        P_t, p, tau = P_t + dt * tangential, p + dt * normal, tau + dt * lever * normal
    raise DataError(
        f"{int(normal.count_nonzero())} simulated contacts do not come to an end: are their numbers finite?"
    )
