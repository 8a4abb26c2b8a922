"""Hidden effects in restitution and friction.  Each builder takes the amplitude and what else its formula has.

Effects on restitution add to ε; those on friction multiply μ by 1 + f, at least by 0.02.
"""

import numpy as np

from third_hand.effect import Effect


def restitution(what, change):
    """ε → ε + change(state)."""

    def law(state):
        state["eps"] = state["eps"] + change(state)

    return Effect(what=what, law=law)


def friction(what, change):
    """μ → μ max(1 + change(state), 0.02)."""

    def law(state):
        state["mu"] = state["mu"] * np.maximum(1 + change(state), 0.02)

    return Effect(what=what, law=law)


def _speed(state):
    return np.abs(state["vn"])


# --- Restitution -----------------------------------------------------------------------------------


def saturating(c, v0, middle):
    """ε falls with speed and settles."""
    return restitution("restitution falls with speed", lambda s: c * (np.exp(-_speed(s) / v0) - np.exp(-middle / v0)))


def falling(c, middle, floor):
    """ε falls by c per m/s, down to the floor."""
    return restitution(
        "restitution falls with speed", lambda s: np.maximum(-c * (_speed(s) - middle), floor - s["eps"])
    )


def logarithmic(c, middle):
    """ε falls with the logarithm of the speed."""
    return restitution("restitution falls with speed", lambda s: -c * np.log(_speed(s) / middle))


def sides(c, times, at):
    """The sides of the body differ, `times` around it."""
    return restitution("restitution by side of the body", lambda s: c * np.cos(times * (s["theta"] - at)))


def soft_spot(c, at, width):
    """A taped spot on the body."""
    return restitution("restitution by side of the body", lambda s: -c * np.exp(-(1 - np.cos(s["theta"] - at)) / width))


def soft_floor(c, at, span):
    """A plate that is soft between its supports."""
    return restitution("restitution by place", lambda s: -c * np.cos(np.pi * (s["x"] - at) / span) ** 2)


def vibrating_body(c):
    """Vibration takes energy where the body is hit away from its centre: −c (|r_x|/ρ)^1.5."""
    return restitution("restitution by lever", lambda s: -c * s["lever"] ** 1.5)


def settling(c, trials):
    """ε settles over the session."""
    return restitution("restitution settles", lambda s: c * np.exp(-s["order"] / trials))


def by_incidence(c):
    """−c s²/(1 + s²), s = v_t/v_n."""

    def change(state):
        s = state["vt"] / state["vn"]
        return -c * (s * s / (1 + s * s))

    return restitution("restitution by incidence", change)


# --- Friction --------------------------------------------------------------------------------------


def stripe(c, at, width):
    """A dusty stripe on the floor."""
    return friction("friction by place", lambda s: -c * np.exp(-((s["x"] - at) ** 2) / 2 / width**2))


def two_sheets(c, at):
    """A floor of two sheets."""
    return friction("friction by place", lambda s: c * np.where(s["x"] > at, 1, -1))


def brushed(c):
    """Friction by the direction of the slip."""
    return friction("friction by direction", lambda s: c * np.sign(s["vt"]))


def by_slip(c, v0):
    """Friction falls with the slip speed: c exp(−|v_t|/v₀)."""
    return friction("friction falls with slip", lambda s: c * np.exp(-np.abs(s["vt"]) / v0))


def by_load(c, v0):
    """Friction falls with the load: c ((v₀/|v_n|)^½ − 1)."""
    return friction("friction falls with load", lambda s: c * ((v0 / _speed(s)) ** 0.5 - 1))


def polishing(c, trials):
    """Friction settles over the session."""
    return friction("friction settles", lambda s: c * np.exp(-s["order"] / trials))
