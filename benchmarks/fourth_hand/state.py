"""Unknown physics of the state of each impact, in products and thresholds: (laboratory, amplitude) → change.

The sources are from memory of the literature, but for those of `ratchet` and `gas`, which were looked up.  They are
sources of the idea; the forms and the numbers are the author's.
"""

import numpy as np

from fourth_hand.known import centred
from fourth_hand.laboratory import Change, G, turned


def magnet(lab, a):
    """A magnetised body above a strip of alternating poles in the floor, whose field turns once per 0.08 m.

    An angular impulse as sin(θ − 2π x/0.08 − 0.6)/|v_y| (dipole in a field: Jackson 1999, ch. 5; strips: Mallinson
    1973); the stay is longer at lower speed.  Neither θ nor x alone says anything.
    """
    g = np.sin(lab.theta - 2 * np.pi * lab.x / 0.08 - 0.6) / np.abs(lab.v[:, 1])
    return Change(after=np.stack([0 * g, 0 * g, a * g], -1))


def ratchet(lab, a):
    """Scaled skin that turns with the body: μ (1 + a sign(v_t) sin 2(θ − 0.35)).

    Snake skin: Filippov & Gorb 2016; Hancock et al. 2012.
    """
    return Change(friction=1 + a * (np.sign(lab.slip) * np.sin(2 * (lab.theta - 0.35))))


def curved_yield(lab, a):
    """Elastic up to a normal energy v_n²/(2 W_nn R²) over the radius of curvature R at the contact, plastic above.

    Restitution steps down (Johnson 1985, sec. 11.5; Thornton 1997).
    """
    R = np.zeros(len(lab.x))
    for mine, body in lab.by_body():
        A, B = body.size.tolist()
        h = np.sqrt((A * np.sin(lab.theta[mine])) ** 2 + (B * np.cos(lab.theta[mine])) ** 2)
        R[mine] = A * A * B * B / h**3
    q = np.log(0.5 * lab.vn**2 / (1 / lab.mass + lab.r[:, 0] ** 2 / lab.inertia) / R**2)
    return Change(restitution=a * centred(-np.tanh((q - np.median(q)) / 0.08)))


def magnus(lab, a):
    """Magnus force on the spinning body between impact and the second frame: c ω⁺ × v⁺.

    Magnus 1852; Rubinow & Keller 1961.
    """
    vx, vy, omega = lab.post.T
    return Change(after=np.stack([-a * omega * vy, a * omega * vx, 0 * vx], -1))


def loose_ball(lab, a):
    """A loose ball in a bore along the body stays in the end that was lower at the release, and shifts the mass centre.

    Weightless in the fall, so its side follows from the orientation θ − ω t at the release, t = |v_y|/g (captured
    particle: Masri & Caughey 1966).  It enters through r alone.
    """
    released = lab.theta - lab.v[:, 2] * np.abs(lab.v[:, 1]) / G
    side = np.where(np.sin(released) < 0, 1.0, -1.0)
    axis = np.stack([np.cos(lab.theta), np.sin(lab.theta)], -1)
    return Change(arm=-a * side[:, None] * axis)


def ringing_floor(lab, a):
    """The release starts the floor plate ringing at 41 Hz; its phase at impact is that of the time of fall |v_y|/g.

    Forced bouncing: Luck & Mehta 1993; Tufillaro 1986.
    """
    fall = np.abs(lab.v[:, 1])
    return Change(floor=a * (np.sin(2 * np.pi * 41.0 * fall / G + 0.7) * np.exp(-fall / G / 0.5)))


def gas(lab, a):
    """A squeeze film of air under the lower face, before contact: width³ × closing speed / (far corner's gap + 3 mm).

    It acts at the face's middle (Reynolds 1886; Bird, Stewart & Lightfoot; Smith, Li & Wu 2003): a product of gap,
    size, v_y and ω.
    """
    dv = np.zeros((len(lab.x), 3))
    for mine, body in lab.by_body():
        corners = body.corners(lab.theta[mine])
        order, rows = np.argsort(corners[:, :, 1], 1), np.arange(len(mine))
        p, q = corners[rows, order[:, 0]], corners[rows, order[:, 1]]
        gap, width, middle = q[:, 1] - p[:, 1], np.abs(q[:, 0] - p[:, 0]), 0.5 * (p + q)
        closing = np.maximum(-(lab.v[mine, 1] + middle[:, 0] * lab.v[mine, 2]), 0)
        force = a * ((width / 0.06) ** 3 * closing / (gap / 0.01 + 0.3)) * 0.1
        dv[mine, 1], dv[mine, 2] = force / body.mass, middle[:, 0] * force / body.inertia
    return Change(before=dv)


def flash(lab, a):
    """Above a frictional power density |v_n v_t| the surface melts, and friction falls by a step.

    Bowden & Hughes 1939; Archard 1959.
    """
    q = np.log(np.abs(lab.slip * lab.vn) + 1e-9)
    g = -0.5 * (1 + np.tanh((q - np.quantile(q, 0.6)) / 0.06))
    return Change(friction=1 + a * centred(g))


def curtain(lab, a):
    """A soft curtain at x = 0.125, which the body's rightmost point brushes before the floor is reached.

    A sideways impulse at that point, in proportion to the overlap.
    """
    dv = np.zeros((len(lab.x), 3))
    for mine, body in lab.by_body():
        rightmost = turned(body.lowest(lab.theta[mine] - np.pi / 2), np.pi / 2)
        force = -a * (np.maximum(lab.x[mine] + rightmost[:, 0] - 0.125, 0) / 0.02) * body.mass
        dv[mine, 0], dv[mine, 2] = force / body.mass, -rightmost[:, 1] * force / body.inertia
    return Change(before=dv)
