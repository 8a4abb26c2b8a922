"""Errors of a laboratory's instruments in the velocities, and scatter of the material from impact to impact."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """Standard deviations: of v in m/s and ω in rad/s after impact, `before` times these before it.

    `eps` and `mu` scatter from impact to impact.  `kind` is how the errors after impact are distributed: independent
    ("iid"), heavy-tailed ("t5"), following one another ("ar1"), a slow wander with v_x and ω correlated ("wander"), 4 %
    gross ("outliers"), growing with the speed ("hetero").
    """

    v: float
    omega: float
    before: float = 0.0
    eps: float = 0.0
    mu: float = 0.0
    kind: str = "iid"

    def errors(self, after, rng):
        """Errors [n, 3] of the velocities after and before, of trials with the velocities `after` [n, 3]."""
        n = len(after)
        scale = np.array([self.v, self.v, self.omega])
        normal = rng.normal(size=(n, 3))
        z = _KINDS[self.kind](normal, after, rng)
        return z * scale, rng.normal(size=(n, 3)) * scale * self.before


def _heavy(z, after, rng):
    return rng.standard_t(5, z.shape) / np.sqrt(5 / 3)


def _following(z, after, rng):
    for i in range(1, len(z)):
        z[i] = 0.8 * z[i - 1] + 0.6 * z[i]
    return z


def _wandering(z, after, rng):
    wander = np.cumsum(rng.normal(size=z.shape), 0)
    z = 0.6 * (wander - wander.mean(0)) / wander.std(0) + 0.8 * z
    z[:, 2] = 0.6 * z[:, 2] - 0.8 * z[:, 0]
    return z


def _gross(z, after, rng):
    z[rng.random(len(z)) < 0.04] *= 9
    return z


def _by_speed(z, after, rng):
    speed, spin = np.hypot(after[:, 0], after[:, 1]), np.abs(after[:, 2])
    z *= (0.35 + 0.8 * speed / speed.mean() * 0.8)[:, None]
    z[:, 2] *= 0.5 + spin / (spin.mean() + 1e-9) * 0.5
    return z


_KINDS = {
    "iid": lambda z, after, rng: z,
    "t5": _heavy,
    "ar1": _following,
    "wander": _wandering,
    "outliers": _gross,
    "hetero": _by_speed,
}
