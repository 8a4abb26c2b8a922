"""How bodies are dropped and thrown: each design makes (rng, n) → the states that a laboratory wants, by trial.

The last six, from `ascending` on, cannot tell some causes apart: heights that grow from trial to trial, one angle, a
wheel that rolls off a table, drops that are nearly vertical, trials that all slide one way, one corner again and again.
"""

import numpy as np

G = 9.81


def drop(height=(0.05, 0.5), vx=0.5, spin=6.0, levels=None):
    """Dropped from `height`, or from one of some `levels`, in m."""

    def draw(rng, n):
        h = rng.uniform(*height, n) if levels is None else rng.choice(levels, n) + rng.normal(0, 0.003, n)
        vy = -np.sqrt(2 * G * np.abs(h))
        vx_, omega = rng.normal(0, vx, n), rng.normal(0, spin, n)
        return {
            "vy": vy, "vx": vx_, "omega": omega, "theta": rng.uniform(-np.pi, np.pi, n), "x": rng.normal(0, 0.15, n),
        }  # fmt: skip

    return draw


def throw(speed, angle, spin):
    """Thrown to both sides with a speed in m/s at an angle below the horizontal in degrees."""

    def draw(rng, n):
        v, down = rng.uniform(*speed, n), np.deg2rad(rng.uniform(*angle, n))
        side = rng.choice([-1, 1], n)
        return {
            "vx": side * v * np.cos(down),
            "vy": -v * np.sin(down),
            "omega": rng.normal(0.0, spin, n),
            "theta": rng.uniform(-np.pi, np.pi, n),
            "x": rng.uniform(-0.3, 0.3, n),
        }

    return draw


def air_table(speed, angle, spin):
    """Pucks on a tilted air table, at up to `angle` degrees from the normal."""

    def draw(rng, n):
        v = speed[0] + (speed[1] - speed[0]) * rng.beta(2, 2, n)
        aside = np.deg2rad(rng.uniform(-angle, angle, n))
        return {
            "vx": v * np.sin(aside),
            "vy": -v * np.cos(aside),
            "omega": rng.normal(0, spin, n),
            "theta": rng.uniform(-np.pi, np.pi, n),
            "x": rng.normal(0, 0.25, n),
        }

    return draw


def ascending(rng, n):
    v = np.linspace(0.9, 3.4, n)
    v = v + rng.normal(0, 0.012, n)
    vx, omega = rng.normal(0.4, 0.15, n), rng.normal(0, 2, n)
    theta = rng.uniform(-np.pi, np.pi, n)
    return {"vy": -v, "vx": vx, "omega": omega, "theta": theta, "x": rng.normal(0, 0.05, n)}


def one_angle(rng, n):
    v = rng.uniform(0.8, 4.5, n)
    down = np.deg2rad(40 + rng.normal(0, 0.25, n))
    omega, theta = rng.normal(0, 0.3, n), rng.uniform(-np.pi, np.pi, n)
    return {
        "vx": v * np.cos(down),
        "vy": -v * np.sin(down),
        "omega": omega,
        "theta": theta,
        "x": rng.normal(0, 0.02, n),
    }


def roll_off(rng, n, radius=0.06):
    time = np.sqrt(2 * rng.choice([0.25, 0.40, 0.60], n) / G)
    v = rng.uniform(0.6, 1.7, n)
    x = 0.1 + v * time
    theta = (-x / radius + np.pi) % (2 * np.pi) - np.pi
    return {"vx": v, "vy": -G * time, "omega": -v / radius, "theta": theta, "x": x}


def nearly_vertical(rng, n):
    vx, vy = rng.normal(0, 0.5, n), -np.sqrt(2 * G * rng.uniform(0.1, 0.7, n))
    omega, theta = rng.normal(0, 12, n), rng.uniform(-np.pi, np.pi, n)
    return {"vx": vx, "vy": vy, "omega": omega, "theta": theta, "x": rng.normal(0, 0.1, n)}


def sliding_one_way(rng, n):
    v = rng.uniform(1.5, 4.0, n)
    down = np.deg2rad(rng.uniform(15, 30, n))
    omega, theta = rng.uniform(5, 25, n), rng.uniform(-np.pi, np.pi, n)
    return {"vx": v * np.cos(down), "vy": -v * np.sin(down), "omega": omega, "theta": theta, "x": rng.normal(0, 0.1, n)}


def one_corner(rng, n):
    vx, vy = rng.normal(0, 0.008, n), -2.2 + rng.normal(0, 0.01, n)
    omega, theta = rng.normal(0, 0.05, n), 0.6 + rng.normal(0, 0.004, n)
    return {"vx": vx, "vy": vy, "omega": omega, "theta": theta, "x": rng.normal(0, 0.003, n)}
