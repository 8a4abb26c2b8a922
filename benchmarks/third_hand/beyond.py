"""What no catalogue of missing effects has: physics with variables outside the table, and mistakes of measurement."""

import numpy as np

from third_hand.effect import Effect
from third_hand.material import friction, restitution

# --- Physics beyond the table ----------------------------------------------------------------------


def place_and_spin(c):
    """ε depends on a product of place and spin."""
    return restitution("product of place and spin", lambda s: c * np.tanh(s["x"] * s["omega"] / 0.5))


def latch(c):
    """The body has two states that nobody records: 35 % of the trials are softer."""
    return restitution("hidden state of the body", lambda s: -c * (s["u1"] < 0.35))


def previous_trial(c, middle):
    """The mat is still compressed from the trial before."""
    return restitution("mat remembers", lambda s: -c * np.r_[0, np.abs(s["vn"][:-1]) - middle])


def vibrating_floor(speed, frequency):
    """The floor moves up and down, at times that are not in the table."""

    def up(state):
        return speed * np.sin(2 * np.pi * frequency * state["time"])

    def before(state, record):
        state["vy"] = state["vy"] - up(state)

    def after(state, v):
        v["vy"] = v["vy"] + up(state)

    return Effect(what="floor vibrates", before=before, after=after)


def wiped(c, every):
    """The floor is wiped every so many trials, and dust settles between."""
    return friction("floor wiped now and then", lambda s: -c * ((s["order"] % every) / every - 0.5))


def loose_bead(share):
    """A bead in a slot along the body's first axis, free towards one end only, keeps its velocity."""

    def after(state, v):
        c, s = np.cos(state["theta"]), np.sin(state["theta"])
        change = (v["vx"] - state["vx"]) * c + (v["vy"] - state["vy"]) * s
        lost = share * change * (np.sin(state["theta"]) > 0)
        v["vx"], v["vy"] = v["vx"] - lost * c, v["vy"] - lost * s

    return Effect(what="loose bead", after=after)


# --- Mistakes of measurement -----------------------------------------------------------------------


def revolutions():
    """Spin in revolutions per second."""

    def instrument(record):
        record["omega"], record["omega_post"] = record["omega"] / (2 * np.pi), record["omega_post"] / (2 * np.pi)

    return Effect(what="spin in revolutions", instrument=instrument)


def clockwise():
    """Spin counted clockwise."""

    def instrument(record):
        record["omega"], record["omega_post"] = -record["omega"], -record["omega_post"]

    return Effect(what="spin clockwise", instrument=instrument)


def swapped():
    """The components of the contact point are swapped."""

    def instrument(record):
        record["rx"], record["ry"] = record["ry"], record["rx"]

    return Effect(what="contact point swapped", instrument=instrument)


def frame_rate(ratio):
    """The camera after impact has another frame rate than assumed: its velocities are `ratio` times the true ones."""

    def instrument(record):
        for column in ("vx_post", "vy_post", "omega_post"):
            record[column] = record[column] * ratio

    return Effect(what="frame rate after impact wrong", instrument=instrument)
