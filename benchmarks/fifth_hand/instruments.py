"""Instruments: errors of velocities with four distributions, of the pose, memory, dependence on speed, and rounding."""

from dataclasses import dataclass

import numpy as np

STEPS = np.array([0.01, 0.01, 0.1])
"""To which velocities are rounded, in m/s and rad/s."""
SCATTER = (0.015, 0.04)
"""Standard deviations of ε and of ln μ where they scatter at random from impact to impact."""


def _gauss(rng, n):
    return rng.normal(size=(n, 3))


def _student(rng, n):
    return rng.standard_t(3.5, size=(n, 3)) / np.sqrt(3.5 / 1.5)


def _contaminated(rng, n):
    z = rng.normal(size=(n, 3)) * np.where(rng.random((n, 1)) < 0.06, 3.5, 1.0)
    return z / np.sqrt(0.94 + 0.06 * 3.5**2)


def _laplace(rng, n):
    return rng.laplace(size=(n, 3)) / np.sqrt(2)


KINDS = {"gauss": _gauss, "student": _student, "contaminated": _contaminated, "laplace": _laplace}
"""Errors [n, 3] of standard deviation 1: Gaussian, Student's t with 3.5 degrees, 6 % of them 3.5 times as large, or of
Laplace."""


@dataclass(frozen=True)
class Noise:
    """Errors of a laboratory's instruments.

    `scales` are the standard deviations of (v_x, v_y, ω) after impact in m/s and rad/s, `before` times those before.
    `angle` is that of θ in rad, `place` that of x in m, 0.7 of it that of y.  `rounded` velocities are those to STEPS.
    Errors `by_speed` grow with the speed of the trial.  `memory` is the correlation of an error with that of the trial
    before, and with `scatter` coefficients vary at random by SCATTER.
    """

    kind: str
    scales: tuple[float, float, float]
    before: float
    angle: float
    place: float
    rounded: bool = False
    by_speed: bool = False
    memory: float = 0.0
    scatter: bool = False

    def errors(self, rng, v):
        """Draw errors of velocities after and before impact [n, 3], and of (x, y, θ) [n, 3]."""
        n, size = len(v), 1.0
        if self.by_speed:
            square = v[:, 0] ** 2 + v[:, 1] ** 2
            size = np.sqrt(0.5 + 0.5 * square / np.mean(square))[:, None]
        after = self._drawn(rng, n) * self.scales * size
        before = self._drawn(rng, n) * self.scales * self.before * size
        return after, before, rng.normal(size=(n, 3)) * np.array([self.place, 0.7 * self.place, self.angle])

    def _drawn(self, rng, n):
        z = KINDS[self.kind](rng, n)
        if self.memory:
            for i in range(1, n):
                z[i] = self.memory * z[i - 1] + np.sqrt(1 - self.memory**2) * z[i]
        return z

    def read(self, v):
        """Velocities as the instrument shows them."""
        return np.round(v / STEPS) * STEPS if self.rounded else v
