"""Hidden effects of the set-up, of the wrench and of the motion after contact.

Each builder takes the amplitude, in SI units, and what else its formula has.
"""

import numpy as np

from third_hand.bodies import contact_points
from third_hand.designs import G
from third_hand.effect import Effect


def _touch(state, slope=0.0, stretch=(1.0, 1.0)):
    """The arm of the true outline at the true angle."""
    state["rx"], state["ry"] = contact_points(state["bodies"], state["ib"], state["theta"], slope, stretch)


# --- Set-up ----------------------------------------------------------------------------------------


def tilt(angle):
    """The normal of the floor is turned by `angle` against the axes of the measurement."""

    def before(state, record):
        state["phi"] = angle
        _touch(state, slope=angle)
        if state["seen"]:
            record["rx"], record["ry"] = state["rx"], state["ry"]
        height = -np.sin(angle) * state["rx"] + np.cos(angle) * state["ry"]
        record["y"] = -height / np.cos(angle) + state["x"] * np.tan(angle)

    return Effect(what="floor tilted", before=before)


def mass_centre(offset, at):
    """The mass centre is `offset` from the centre that is tracked, in the body's direction `at` in rad."""

    def shift(state):
        return offset * np.cos(state["theta"] + at), offset * np.sin(state["theta"] + at)

    def before(state, record):
        dx, dy = shift(state)
        state["rx"], state["ry"] = state["rx"] - dx, state["ry"] - dy
        state["vx"], state["vy"] = state["vx"] - state["omega"] * dy, state["vy"] + state["omega"] * dx

    def after(state, v):
        dx, dy = shift(state)
        v["vx"], v["vy"] = v["vx"] + v["omega"] * dy, v["vy"] - v["omega"] * dx

    return Effect(what="mass centre off the tracked centre", before=before, after=after)


def inertia(log_ratio):
    """The true moment of inertia is exp(`log_ratio`) times that of the table."""

    def before(state, record):
        state["inertia"] = record["inertia"] * np.exp(log_ratio)

    return Effect(what="moment of inertia wrong", before=before)


def marker(angle):
    """The true angle of the body is `angle` more than the recorded one."""

    def before(state, record):
        state["theta"] = record["theta"] + angle
        _touch(state)
        record["y"] = -state["ry"]

    return Effect(what="orientation marker turned", before=before)


def early_pose(delay):
    """The pose is recorded `delay` before contact, and the arm computed from it."""

    def before(state, record):
        state["theta"] = record["theta"] + delay * state["omega"]
        _touch(state)
        record["y"] = -state["ry"] - delay * state["vy"]

    return Effect(what="pose recorded early", before=before)


def longer(share):
    """The first dimension of the body is 1 + `share` times the nominal one."""

    def before(state, record):
        _touch(state, stretch=(1 + share, 1.0))
        record["y"] = -state["ry"]

    return Effect(what="dimension of the body wrong", before=before)


# --- Wrench ----------------------------------------------------------------------------------------


def patch(share):
    """The centre of pressure of a patch lies towards the mass centre: the true arm r_x is shorter by `share`."""

    def before(state, record):
        state["rx"] = state["rx"] * (1 - share)

    return Effect(what="contact is a patch", before=before)


def rolling(arm, spin):
    """A moment −arm P_n tanh(ω/spin) where it opposes the spin after contact; it does not reverse it."""

    def moment(state):
        most = state["inertia"] * np.abs(state["w1"])
        torque = np.clip(-arm * state["Pn"] * np.tanh(state["omega"] / spin), -most, most)
        return np.where(torque * state["w1"] < 0, torque, 0.0)

    return Effect(what="rolling resistance", moment=moment)


def tangential(top, steepness):
    """A contact that sticks gives back v_t⁺ = −β v_t within the cone, β = top (1 − |v_t/v_n|/steepness) or 0."""

    def impulse(state, Pt, Pn):
        tt, tn, _ = state["W"]
        stuck = np.abs(state["vt"] + tt * Pt + tn * Pn) < 1e-9
        beta = top * np.maximum(0, 1 - np.abs(state["vt"] / state["vn"]) / steepness)
        most = state["mu"] * Pn
        return np.where(stuck, np.clip(Pt - beta * state["vt"] / tt, -most, most), Pt), Pn

    return Effect(what="tangential compliance", impulse=impulse)


def adhesion(speed):
    """P_n falls by `speed` times the mass, P_t in proportion; the body is never pulled through the floor."""

    def impulse(state, Pt, Pn):
        _, tn, nn = state["W"]
        rise = np.maximum(state["vn"] + tn * Pt + nn * Pn, 0)
        loss = np.minimum(speed * state["mass"], 0.95 * rise / nn)
        return Pt * (1 - loss / Pn), Pn - loss

    return Effect(what="adhesion", impulse=impulse)


# --- Motion after contact --------------------------------------------------------------------------


def late_frame(delay):
    """Gravity acts for `delay` before the velocity after contact is measured."""

    def after(state, v):
        v["vy"] = v["vy"] - G * delay

    return Effect(what="late frame", after=after)


def air_drag(share, speed):
    """Quadratic drag: v⁺ → v⁺/(1 + share |v⁺|/speed)."""

    def after(state, v):
        kept = 1 / (1 + share * (np.hypot(v["vx"], v["vy"]) / speed))
        v["vx"], v["vy"] = v["vx"] * kept, v["vy"] * kept

    return Effect(what="air drag", after=after)


def walls(share):
    """Velocity is lost in proportion: v⁺ → v⁺/(1 + share)."""

    def after(state, v):
        v["vx"], v["vy"] = v["vx"] / (1 + share), v["vy"] / (1 + share)

    return Effect(what="velocity lost in proportion", after=after)


def guide_plates(share):
    """v_x⁺ alone is lower by `share`."""

    def after(state, v):
        v["vx"] = v["vx"] * (1 - share)

    return Effect(what="sideways motion slowed", after=after)


def spin_loss(share):
    """ω⁺ → ω⁺/(1 + share)."""

    def after(state, v):
        v["omega"] = v["omega"] / (1 + share)

    return Effect(what="spin lost in proportion", after=after)


def fast_spin_loss(share, spin):
    """ω⁺ → ω⁺/(1 + share |ω⁺|/spin)."""

    def after(state, v):
        v["omega"] = v["omega"] / (1 + share * (np.abs(v["omega"]) / spin))

    return Effect(what="spin lost, more of fast spin", after=after)
