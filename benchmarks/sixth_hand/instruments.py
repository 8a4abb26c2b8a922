"""Instruments: errors of velocities with three distributions, growth with speed, memory and rounding, and of poses."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """Errors of a laboratory's instruments.

    `scales` are the standard deviations of (v_x, v_y, ω) after impact in m/s and rad/s, `before` times those before.
    `tails` are normal, student (4 degrees of freedom) or outliers (4 % of them five times as large).  Errors grow by
    `growth` of themselves with each root mean square of the speed.  Velocities are `rounded` to about so many scales.
    `memory` is the correlation of an error with that of the trial before.  μ and ε scatter from trial to trial by
    `scatter_mu` and `scatter_eps`.  `angle` in rad, `place` in m and `point` in m are the standard deviations of θ,
    of x and y, and of a contact point that was seen.  `factor` is that of the scales and the scatter, which the author
    found: with it what is hidden has its size.
    """

    scales: tuple[float, float, float]
    before: float = 0.5
    tails: str = "normal"
    growth: float = 0.0
    rounded: float = 0.0
    memory: float = 0.0
    scatter_mu: float = 0.0
    scatter_eps: float = 0.0
    angle: float = 1e-3
    place: float = 2e-4
    point: float = 0.0
    factor: float = 1.0

    def errors(self, rng: np.random.Generator, v: np.ndarray) -> np.ndarray:
        """Draw errors of velocities (v_x, v_y, ω) as large as these [n, 3]."""
        n = len(v)
        if self.tails == "student":
            z = rng.standard_t(4, (n, 3)) / np.sqrt(2.0)
        else:
            z = rng.standard_normal((n, 3))
            if self.tails == "outliers":
                z = np.where(rng.random((n, 1)) < 0.04, 5 * z, z)
        if self.memory:
            for i in range(1, n):
                z[i] = self.memory * z[i - 1] + np.sqrt(1 - self.memory**2) * z[i]
        rms = np.sqrt(np.mean(v**2, axis=0)) + 1e-12
        return z * self._scales * (1 + self.growth * np.abs(v) / rms)

    def coefficients(self, rng: np.random.Generator, n: int, mu: float, eps: float) -> tuple[np.ndarray, np.ndarray]:
        """Draw μ and ε of the trials about these."""
        of_mu, of_eps = (self.factor * size * rng.standard_normal(n) for size in (self.scatter_mu, self.scatter_eps))
        return np.maximum(mu + of_mu, 0.01), np.clip(eps + of_eps, 0.05, 0.98)

    def read(self, v: np.ndarray) -> np.ndarray:
        """Velocities as the instrument shows them."""
        if not self.rounded:
            return v
        digits = np.log10(self._scales * self.rounded)
        step = 10 ** np.floor(digits) * np.round(10 ** (digits % 1))
        return np.round(v / step) * step

    @property
    def _scales(self) -> np.ndarray:
        return self.factor * np.array(self.scales)
