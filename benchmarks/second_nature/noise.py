"""Errors of instruments: of the velocities before and after contact alike, [n, 3] in (m/s, m/s, rad/s).

`level` is the standard deviation of a measured velocity in m/s; that of ω is level / ρ of the body.

    gaussian       independent
    components     v_x and ω err together (ρ = 0.7): both come from one outline
    coarse         rounded to steps of √12 level
    heavy          Student's t with three degrees of freedom, of the same standard deviation
    growing        in proportion to each trial's speed, the mean square is the same
    tracker        from trial to trial AR(1) with coefficient 0.85–0.95, half of it before and after alike
    wander         a slow swing over the session and a third of independent noise
"""

import numpy as np

KINDS = ("gaussian", "components", "coarse", "heavy", "growing")
TRACKERS = ("tracker", "wander")


def errors(kind, level, velocities, rho, rng):
    """Errors [n, 2, 3] of velocities [n, 2, 3] (before, after), for ρ [n]."""
    n = len(velocities)
    unit = level * np.stack((np.ones(n), np.ones(n), 1 / rho), -1)[:, None]
    white = rng.standard_normal((n, 2, 3))
    if kind == "components":
        white[..., 2] = 0.7 * white[..., 0] + np.sqrt(1 - 0.7**2) * white[..., 2]
    elif kind == "heavy":
        white = rng.standard_t(3, (n, 2, 3)) / np.sqrt(3)
    elif kind == "growing":
        speed = np.sqrt((velocities[..., :2] ** 2).sum(-1) + (rho[:, None] * velocities[..., 2]) ** 2)
        white = white * (speed / np.sqrt((speed**2).mean()))[..., None]
    elif kind == "tracker":
        shared = _autoregressive(rng.standard_normal((n, 1, 3)), rng.uniform(0.85, 0.95))
        white = np.sqrt(0.5) * (shared + _autoregressive(white, rng.uniform(0.85, 0.95)))
    elif kind == "wander":
        phase, turns = rng.uniform(0, 2 * np.pi, (1, 2, 3)), rng.uniform(0.7, 2.5, (1, 2, 3))
        swing = np.sqrt(2) * np.sin(2 * np.pi * turns * np.arange(n)[:, None, None] / n + phase)
        white = np.sqrt(8 / 9) * swing + white / 3
    elif kind == "coarse":
        step = np.sqrt(12) * unit
        return np.round(velocities / step) * step - velocities
    elif kind != "gaussian":
        raise ValueError(f"noise must be one of {', '.join(KINDS + TRACKERS)}, got {kind!r}")
    return unit * white


def _autoregressive(white, coefficient):
    """AR(1) of unit variance along the first axis."""
    out = white.copy()
    for i in range(1, len(out)):
        out[i] = coefficient * out[i - 1] + np.sqrt(1 - coefficient**2) * white[i]
    return out
