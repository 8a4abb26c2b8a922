"""Unknown physics of the state of each impact: what it does at its place, (impact, amplitude, plain impact).

Sources are of the idea; the forms and the numbers are the author's.
"""

import numpy as np

from fifth_hand.known import lose_energy
from fifth_hand.laboratory import Impact
from fourth_hand.laboratory import turned
from third_hand.laws import impulse, inverse_mass


def step(z):
    """A logistic step from 0 to 1."""
    return 1 / (1 + np.exp(-np.clip(z, -50, 50)))


# --- Restitution or friction, as g of the impact ---------------------------------------------------


def loose_internal_mass(now):
    """A captive mass breaks loose above 1.55 m/s where its slot is upright (Pacheco-Vázquez & Dorbolo 2013)."""
    return -(np.sin(now.trials.theta - 0.4) ** 2) * step((np.abs(now.vn) - 1.55) / 0.06)


def beam_resonance(now):
    """A beam's second mode takes energy at its antinodes, near 2.1 m/s (Zener 1941; Goldsmith 1960)."""
    mode = np.sin(2 * np.pi * (now.trials.x + 0.15) / 0.3) ** 2
    return -mode / (1 + ((np.abs(now.vn) - 2.1) / 0.3) ** 2)


def half_filled_tank(now):
    """Liquid that rotation piles up on one side of a baffle: −tanh(ω/12) sin(θ − 0.9) (Andrade et al. 2023)."""
    return -np.tanh(now.trials.v[:, 2] / 12.0) * np.sin(now.trials.theta - 0.9)


def foam_bottoms_out(now):
    """Foam over a hard floor bottoms out at a normal energy v_n²/(2 W_nn) of 0.1 J (Gibson & Ashby)."""
    return step((0.5 * now.vn**2 / now.W[2] - 0.1) / 0.015)


def corner_digs_in(now):
    """Chalk that is pushed chatters: friction is high where the corner runs ahead of the centre (Leine et al. 2014)."""
    ahead = now.slip * now.r[:, 0] > 0
    return ahead * np.minimum(np.abs(now.r[:, 0]) / 0.02, 1)


def ratchet_floor(now):
    """A saw-tooth floor of pitch 60 mm: sign(v_t) saw(x/0.06) (Marchetti et al.)."""
    z = now.place / 0.06
    return np.sign(now.slip) * (2 * (z - np.floor(z)) - 1)


def joint_with_lip(now):
    """Joints of tiles each 0.1 m, one edge of which stands proud: it catches what slides to +x within 18 mm."""
    to_joint = np.abs(now.place / 0.1 - np.round(now.place / 0.1)) * 0.1
    return ((to_joint < 0.018) & (now.slip > 0)).astype(float)


def flash_melting(now):
    """Friction falls by a step where |v_t v_n| passes 2.2 m²/s² (Bowden & Tabor; Archard 1959)."""
    return -step((np.abs(now.slip * now.vn) - 2.2) / 0.15)


# --- Acting at their own places --------------------------------------------------------------------


def wet_half_film(now: Impact, a, plain):
    """ε (1 − a (0.8/|v_n|) (R/0.05)^{3/2}) where the floor is wet, x > 0; R is the radius of curvature at the contact.

    Davis, Serayssol & Hinch 1986; Gollwitzer et al. 2012; Müller & Huang 2016.
    """
    A, B = now.trials.bodies[0].size.tolist()
    R = A**2 * B**2 / (A**2 * np.sin(now.theta) ** 2 + B**2 * np.cos(now.theta) ** 2) ** 1.5
    loss = (R / 0.05) ** 1.5 * (0.8 / np.abs(now.vn)) * step(now.trials.x / 0.005)
    now.eps = now.eps * (1 - a * loss)


def charged_side(now: Impact, a, plain):
    """An image charge takes a exp(2.5 (cos(θ + 0.8) − 1)) J on leaving (Jungmann et al. 2018)."""
    lose_energy(now, a * np.exp(2.5 * (np.cos(now.trials.theta + 0.8) - 1)))


def eddy_current_brake(now: Impact, a, plain):
    """A magnet over a copper strip at x = 0.03 loses v_x, more of slow falls, whose stay is longer."""
    stay = np.minimum(1.2 / np.abs(now.trials.v[:, 1]), 3)
    kept = np.maximum(1 - a * (np.exp(-(((now.trials.x - 0.03) / 0.05) ** 2)) * stay), 0)
    now.post = now.post * np.stack([kept, np.ones_like(kept), np.ones_like(kept)], -1)


def air_cushion(now: Impact, a, plain):
    """A squeeze film of air under a closing face of a box, before contact (Reynolds).

    An upward impulse a m max(0, −v_n of the other corner)/(1 + (α/0.18)²) at the middle of the face, which stands at
    angle α, only where the rotation closes it.
    """
    corners, rows = now.trials.bodies[0].corners(now.theta), np.arange(len(now.corner))
    n = corners.shape[1]
    left, right = (now.corner - 1) % n, (now.corner + 1) % n
    other = np.where(corners[rows, left, 1] < corners[rows, right, 1], left, right)
    p, q = corners[rows, now.corner], corners[rows, other]
    alpha = np.arctan2(q[:, 1] - p[:, 1], np.abs(q[:, 0] - p[:, 0]))
    omega = now.v[:, 2]
    closing = np.maximum(0, -(now.v[:, 1] + omega * q[:, 0])) * (omega * (q[:, 0] - p[:, 0]) < 0)
    force = a * now.mass * closing / (1 + (alpha / 0.18) ** 2)
    arm = 0.5 * (p + q) * [1, 0]
    now.v = now.v + now.change(arm, 0 * force, force)


def second_corner(now: Impact, a, plain):
    """A neighbouring corner that comes down within a s bounces by the same law, before the velocity is taken.

    Clattering of a block (Goyal et al. 1998).
    """
    corners, rows = now.trials.bodies[0].corners(now.theta), np.arange(len(now.corner))
    height = corners[rows, now.corner, 1]
    best, arm = np.full(len(rows), np.inf), np.zeros((len(rows), 2))
    for side in (-1, 1):
        other = corners[rows, (now.corner + side) % corners.shape[1]]
        fall = -(now.post[:, 1] + now.post[:, 2] * other[:, 0])
        t = np.where(fall > 0.02, (other[:, 1] - height) / np.maximum(fall, 1e-9), np.inf)
        sooner = t < best
        best, arm = np.where(sooner, t, best), np.where(sooner[:, None], other, arm)
    hits = best < a
    arm = turned(arm, now.post[:, 2] * np.where(hits, best, 0))
    slip, vn = now.post[:, 0] - now.post[:, 2] * arm[:, 1], now.post[:, 1] + now.post[:, 2] * arm[:, 0]
    hits &= vn < -0.02
    W = inverse_mass(now.mass, now.inertia, *arm.T)
    Pt, Pn = impulse(now.law, W, slip, np.where(hits, vn, -1.0), now.mu, now.eps)
    now.post = now.post + now.change(arm, Pt * hits, Pn * hits)


def trampoline_slope(now: Impact, a, plain):
    """A membrane's slope under load grows with load and distance from the middle: the floor turns by a x |v_y|."""
    now.tilt = now.tilt + a * now.trials.x * np.abs(now.v[:, 1])


def one_way_clutch(now: Impact, a, plain):
    """A rotor on a freewheel joins, with inertia a I, only where the impact speeds the body up counter-clockwise."""

    def moment(Pt, Pn):
        return now.r[:, 0] * Pn - now.r[:, 1] * Pt

    joined = now.inertia * (1 + a)
    Pt, Pn = impulse(now.law, inverse_mass(now.mass, joined, *now.r.T), now.slip, now.vn, now.mu, now.eps)
    J = moment(Pt, Pn)
    on = (moment(now.Pt, now.Pn) > 0) & (J > 0)
    now.Pt, now.Pn = np.where(on, Pt, now.Pt), np.where(on, Pn, now.Pn)
    now.moment = np.where(on, J * now.inertia / joined - J, now.moment)


def magnus_force(now: Impact, a, plain):
    """Lift on a light spinning ball between impact and the frame: a ω × v (Magnus; Kutta–Joukowski)."""
    vx, vy, omega = now.post.T
    now.post = now.post + np.stack([-a * omega * vy, a * omega * vx, 0 * omega], -1)
