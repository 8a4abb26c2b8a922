"""Impact through a compliant contact, in time: normal spring and dashpot, tangential spring within the cone.

    F_n = k δ (1 + χ δ̇)          linear dashpot (constant ε) or Hunt–Crossley (ε falls with speed)
    F_t = −k_t z, |F_t| ≤ μ F_n   a spring that slips at the cone (bilinear); rigid friction where k_t = 0

The contact point stays where it is while the short contact lasts.  Only ratios of time matter, so k is one number;
the contact's duration sets how much gravity acts during it.
"""

from dataclasses import dataclass

import numpy as np

from second_nature.path import Contacts, Outcome


@dataclass(frozen=True)
class Compliance:
    """A contact of `duration` seconds (undamped half-period).

    `hunt` is Hunt and Crossley's χ in s/m: F_n = k δ (1 + χ δ̇), with the dashpot of ε left out.  `tangential` is
    k_t W_tt / (k_n W_nn), the squared ratio of the tangential to the normal frequency; 0 is rigid friction.
    `pull` is a constant adhesive force, in units of the weight, of bonds made by compression: it acts in restitution.
    """

    duration: float = 1e-4
    hunt: float = 0.0
    tangential: float = 0.0
    pull: float = 0.0
    gravity: float = 0.0


def impact(contacts: Contacts, compliance: Compliance, steps: int = 1200) -> Outcome:
    """Integrate until the surfaces part, at most twice the undamped half-period and a bit."""
    c, v = contacts, contacts.v.copy()
    w_tt, _, w_nn = c.W
    dt = compliance.duration / steps
    k = (np.pi / compliance.duration) ** 2 / w_nn
    damping = np.log(1 / c.eps) / np.hypot(np.pi, np.log(1 / c.eps))  # ζ of a half-period that gives ε
    dashpot = np.where(compliance.hunt > 0, 0.0, 2 * damping * np.sqrt(k / w_nn))
    k_t = compliance.tangential * k * w_nn / w_tt
    depth, stretch, P = np.zeros(len(k)), np.zeros(len(k)), np.zeros((len(k), 2))
    touching = np.ones(len(k), bool)
    pull = compliance.pull * c.mass * 9.81
    for _ in range(4 * steps):
        rate = -c.approach(v)
        elastic = k * depth * (1 + compliance.hunt * rate) + dashpot * rate
        F_n = np.maximum(elastic, 0.0)
        touching &= (depth >= 0) & ((elastic > 0) | (rate > 0))
        if not touching.any():
            break
        cone = c.mu * F_n
        if compliance.tangential:
            stretch = stretch + c.slip(v) * dt
            F_t = np.clip(-k_t * stretch, -cone, cone)
            stretch = np.where(touching, -F_t / k_t, stretch)
        else:
            F_t = np.clip(-c.slip(v) / (w_tt * dt), -cone, cone)
        on = touching * dt
        dP = np.stack((F_t * on, (F_n - pull * (rate < 0)) * on), -1)
        v = v + np.stack(
            (
                dP[:, 0] / c.mass,
                dP[:, 1] / c.mass - compliance.gravity * on,
                (c.r[:, 0] * dP[:, 1] - c.r[:, 1] * dP[:, 0]) / c.inertia,
            ),
            -1,
        )
        P += dP
        depth = depth - c.approach(v) * on
    return Outcome(np.where(touching[:, None], np.nan, v), P)
