"""Effects of the package's catalogue, after its own formulas: (laboratory, amplitude) → change."""

import numpy as np

from fourth_hand.laboratory import Change


def centred(g):
    """Of mean 0."""
    return g - g.mean()


def restitution_by_lever(lab, a):
    lever = lab.r[:, 0] / np.sqrt(lab.inertia / lab.mass)
    return Change(restitution=-a * centred(lever**2))


def friction_falls_with_slip(lab, a):
    return Change(friction=1 + a * (np.exp(-np.abs(lab.slip) / 0.7) - 0.3))


def restitution_settles(lab, a):
    return Change(restitution=a * centred(np.exp(-lab.order / (0.25 * len(lab.x)))))


def friction_drifts(lab, a):
    return Change(friction=1 + a * (lab.order / len(lab.x) - 0.5))


def rolling_resistance(lab, a):
    return Change(moment=lambda Pn, r, v: -a * Pn * np.tanh(v[:, 2] / 0.3))


def restitution_by_side(lab, a):
    return Change(restitution=a * (np.cos(lab.theta - 0.8) + 0.5 * np.cos(2 * lab.theta + 0.3)))


def tilted_floor(lab, a):
    return Change(tilt=a)


def restitution_falls_with_speed(lab, a):
    return Change(restitution=lab.scene.eps * ((np.abs(lab.vn) / 1.3) ** (-a) - 1))


def tangential_restitution(lab, a):
    return Change(tangential=a)


def patch(lab, a):
    return Change(moment=lambda Pn, r, v: -a * r[:, 0] * Pn)


def mass_centre(lab, a):
    c, s = np.cos(lab.theta), np.sin(lab.theta)
    return Change(arm=-a * np.stack([0.8 * c - 0.6 * s, 0.8 * s + 0.6 * c], -1))


def friction_by_place(lab, a):
    return Change(friction=1 + a * np.sin(2 * np.pi * (lab.x + 0.04) / 0.36))
