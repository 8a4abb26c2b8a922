"""How bodies are thrown: numbers of a protocol → (generator, number of trials) → (v_x, v_y, ω) before impact [n, 3]."""

from collections.abc import Callable, Sequence

import numpy as np

G = 9.81
Throw = Callable[[np.random.Generator, int], np.ndarray]


def drops(low: float, high: float, vx: float, omega: float) -> Throw:
    """Speeds −v_y from low to high; v_x and ω scatter."""
    return lambda rng, n: np.stack([rng.normal(0, vx, n), -rng.uniform(low, high, n), rng.normal(0, omega, n)], 1)


def heights(levels: Sequence[float], vx: float, omega: float) -> Throw:
    """From some heights in m."""

    def draw(rng: np.random.Generator, n: int) -> np.ndarray:
        vy = -np.sqrt(2 * G * rng.choice(levels, n)) * (1 + 0.01 * rng.standard_normal(n))
        return np.stack([rng.normal(0, vx, n), vy, rng.normal(0, omega, n)], 1)

    return draw


def gun(speeds: Sequence[float], elevations: Sequence[float], omega: float) -> Throw:
    """From both sides with some speeds, at some angles in degrees from the floor."""

    def draw(rng: np.random.Generator, n: int) -> np.ndarray:
        speed = rng.choice(speeds, n) * (1 + 0.02 * rng.standard_normal(n))
        down = np.radians(rng.choice(elevations, n) + rng.normal(0, 1.0, n))
        side = rng.choice([-1.0, 1.0], n)
        return np.stack([side * speed * np.cos(down), -speed * np.sin(down), rng.normal(0, omega, n)], 1)

    return draw


def ramp(low: float, high: float, along: float, vx: float, omega: float) -> Throw:
    """From one side, with a part of the spin of rolling."""

    def draw(rng: np.random.Generator, n: int) -> np.ndarray:
        speed = along + rng.normal(0, vx, n)
        return np.stack([speed, -rng.uniform(low, high, n), -omega * speed + rng.normal(0, 0.5 * omega, n)], 1)

    return draw
