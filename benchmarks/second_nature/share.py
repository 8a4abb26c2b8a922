"""How much of a law's error hidden effects make: by twins that differ in nothing else.

The error is the mean over trials of the mass error √(eᵀMe)/√(v_postᵀMv_post) of nature's own path with constant (μ, ε),
those that fit this very table best.  The **share** of hidden effects is 1 − e₀/e₁: e₁ is the error on the table, e₀
that on its twin of the same drops, scatter and noise without the effects.  Nothing held out, no catalogue, no search.
"""

import numpy as np

from second_nature import path
from second_nature.nature import Record


def law_error(record: Record, restitution: str, steps: int = 24) -> tuple[float, np.ndarray]:
    """Mean mass error of the best constant (μ, ε), and their values: damped Gauss–Newton on (ln μ, ε)."""
    weight = np.stack((np.ones_like(record.mass), np.ones_like(record.mass), np.sqrt(record.inertia / record.mass)), -1)
    norm = np.linalg.norm(weight * record.v_post, axis=1, keepdims=True)

    def residuals(p):
        mu, eps = np.exp(p[0]) + 0 * record.mass, np.clip(p[1], 0.01, 1) + 0 * record.mass
        contacts = path.Contacts(record.mass, record.inertia, record.r, record.v, mu, eps)
        with np.errstate(all="ignore"):
            v_post = path.impact(contacts, restitution, steps=steps).v
        return np.nan_to_num(weight * (v_post - record.v_post) / norm)

    p, step = np.array([np.log(0.2), 0.6]), np.array([0.02, 0.005])
    now = residuals(p)
    for _ in range(8):
        slopes = np.stack([(residuals(p + d) - now).ravel() / d.sum() for d in np.diag(step)], -1)
        move = np.linalg.lstsq(slopes, -now.ravel(), rcond=None)[0]
        move *= min(1.0, 0.7 / max(np.abs(move).max(), 1e-12))
        for _ in range(4):
            then = residuals(p + move)
            if (then**2).sum() < (now**2).sum():
                break
            move = move / 3
        else:
            break
        p, gain, now = p + move, (now**2).sum() - (then**2).sum(), then
        if gain < 1e-4 * (now**2).sum():
            break
    return float(np.linalg.norm(now, axis=1).mean()), np.array([np.exp(p[0]), p[1]])
