"""How bodies are thrown: (generator, number, reach of each body in m) → x, v_x, v_y, ω, each of one laboratory."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

G = 9.81


def drop(rng, n, reach):
    """From a gripper at 0.05 to 0.8 m."""
    vy = -np.sqrt(2 * G * rng.uniform(0.05, 0.8, n))
    vx, omega = rng.normal(0, 0.25, n), rng.normal(0, 3, n)
    return rng.normal(0, 0.06, n), vx, vy, omega


def ramp(rng, n, reach):
    """Off a ramp, rolling with slip, to the right more often than to the left."""
    v, slope = rng.uniform(0.6, 2.5, n), np.radians(rng.uniform(5, 40, n))
    side = rng.choice([-1, 1], n, p=[0.35, 0.65])
    vy = -np.sqrt((v * np.sin(slope)) ** 2 + 2 * G * rng.uniform(0.03, 0.35, n))
    omega = -np.clip(side * v / reach * rng.uniform(0.2, 0.9, n), -40, 40)
    return 0.25 * side * rng.uniform(0.3, 1.2, n), side * v * np.cos(slope), vy, omega


def pendulum(rng, n, reach):
    """Let go by a pendulum of 0.45 m, from either side."""
    v, slope, side = rng.uniform(0.8, 3.2, n), np.radians(rng.uniform(20, 80, n)), rng.choice([-1, 1], n)
    omega = side * v / 0.45 + rng.normal(0, 3, n)
    return rng.normal(0, 0.08, n), side * v * np.cos(slope), -v * np.sin(slope) - 0.2, omega


def robot(rng, n, reach):
    """Thrown by a robot at levels of v_x, v_y and ω."""
    vx = rng.choice([-1.6, -0.8, -0.3, 0.3, 0.8, 1.6], n) + rng.normal(0, 0.06, n)
    vy = -rng.choice([0.6, 1.0, 1.5, 2.1, 2.8], n) + rng.normal(0, 0.05, n)
    omega = rng.choice([-12, -6, 0, 6, 12], n) + rng.normal(0, 0.5, n)
    return rng.uniform(-0.2, 0.2, n), vx, vy, omega


def spin(rng, n, reach):
    """Spun fast, with little v_x."""
    vx, vy, omega = rng.normal(0, 0.35, n), -rng.uniform(0.6, 2.6, n), rng.uniform(-32, 32, n)
    return rng.normal(0, 0.08, n), vx, vy, omega


@dataclass(frozen=True)
class Throw:
    """A way, or several of which one is chosen for each trial, with a range of x in m, or faces nearly level, instead.

    `faces` is the standard deviation in rad about the four angles at which a box lies flat; without it θ is anything.
    """

    ways: tuple[Callable[[Any, int, Any], tuple], ...]
    x: tuple[float, float] | None = None
    faces: float | None = None

    def draw(self, rng, n, reach):
        """θ, x and (v_x, v_y, ω) [n, 3]."""
        if len(self.ways) > 1:
            rng.uniform(-np.pi, np.pi, n)  # an angle that the author drew and did not use
        thrown = [self._drawn(way, rng, n, reach) for way in self.ways]
        which = rng.integers(0, len(self.ways), n) if len(self.ways) > 1 else np.zeros(n, int)
        theta, x, *v = (np.choose(which, some) for some in zip(*thrown, strict=True))
        return theta, x, np.stack(v, -1)

    def _drawn(self, way, rng, n, reach):
        theta = rng.uniform(-np.pi, np.pi, n)
        x, vx, vy, omega = way(rng, n, reach)
        if self.faces is not None:
            theta = rng.choice([0, np.pi / 2, np.pi, -np.pi / 2], n) + rng.normal(0, self.faces, n)
        if self.x is not None:
            x = rng.uniform(*self.x, n)
        return theta, x, vx, vy, omega


DROP, RAMP, PENDULUM, ROBOT, SPIN = (Throw((way,)) for way in (drop, ramp, pendulum, robot, spin))
MIXED = Throw((drop, robot, pendulum))
