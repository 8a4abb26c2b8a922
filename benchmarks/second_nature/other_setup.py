"""Other forms of the effects of the wrench, of the set-up and of the motion beside the contact; see `other_forms`."""

import numpy as np

from second_nature.effect import CORNERED, OBLONG, Geometry
from second_nature.forms import either
from second_nature.other_forms import NOT_THREEFOLD, OTHER, UNEQUAL, approach, incidence, other

G = 9.81


def pushed(k, v, P_t=0.0, P_n=0.0):
    """The velocity after another impulse at the contact point [n, 3]."""
    c = k.contacts
    spin = (c.r[:, 0] * P_n - c.r[:, 1] * P_t) / c.inertia
    return v + np.stack((P_t / c.mass + 0 * spin, P_n / c.mass + 0 * spin, spin), -1)


def held_back(k, v, loss):
    """The velocity when the contact point leaves slower by `loss` m/s, at most not at all [n, 3]."""
    leaving = np.maximum(k.contacts.approach(v), 0)
    return pushed(k, v, P_n=-np.minimum(loss, leaving) / k.contacts.W[2])


def wound(k, v, beta):
    """A contact that ended in sticking springs back at −β v_t, as far as the cone and the floor allow [n, 3]."""
    c = k.contacts
    w_tt, w_tn, _ = c.W
    before, (P_t, P_n) = c.slip(c.v), ((v - c.v)[:, :2] * c.mass[:, None]).T
    stuck = np.abs(c.slip(v)) < 0.02 * np.abs(before) + 2e-3
    more = np.clip(P_t - beta * before / w_tt, -c.mu * P_n, c.mu * P_n) - P_t
    return pushed(k, v, P_t=np.where(stuck & (c.approach(v) + w_tn * more > 0), more, 0.0))


# --- Wrench --------------------------------------------------------------------------------------


@other("tangential_restitution", "the wound-up contact springs back best at steep incidence (Foerster and others 1994)")
def _(rng):
    beta, last = rng.uniform(0.6, 0.9), rng.uniform(1.5, 2.5)
    return {"after": lambda k, v: wound(k, v, beta * np.maximum(1 - incidence(k) / last, 0))}


@other("tangential_restitution", "a rubber ball springs back the better the harder it is pressed (Cross 2002)")
def _(rng):
    beta, half = rng.uniform(0.7, 1.0), rng.uniform(0.4, 1.0)
    return {"after": lambda k, v: wound(k, v, beta * approach(k) / (approach(k) + half))}


@other(
    "adhesion",
    "parting takes a constant work of adhesion; the slowest stay (Thornton & Ning 1998)",
    also=("velocity_dependent_restitution",),
)
def _(rng):
    u = rng.uniform(0.4, 0.65)

    def after(k, v):
        leaving = np.maximum(k.contacts.approach(v), 0)
        left = leaving**2 - u**2 * k.contacts.mass * k.contacts.W[2]
        return held_back(k, v, leaving - np.sqrt(np.maximum(left, 0)))

    return {"after": after}


@other("adhesion", "a tacky film pulls for as long as a Hertzian contact lasts, v^(−1/5)")
def _(rng):
    u = rng.uniform(0.2, 0.35)
    return {"after": lambda k, v: held_back(k, v, u * k.contacts.mass * k.contacts.W[2] * approach(k) ** -0.2)}


@other("contact_patch", "the pressure's centre moves back under the body, up to the edge of the patch", bodies=UNEQUAL)
def _(rng):
    part, edge = rng.uniform(0.4, 0.7), rng.uniform(0.12, 0.22)
    return {"moment": lambda k, v: -edge * k.rho * np.tanh(part * k.lever / edge)}


@other("contact_patch", "a patch that grows with the load as in Hertz's theory, v^(2/5)", bodies=UNEQUAL)
def _(rng):
    part = rng.uniform(0.2, 0.35)
    return {"moment": lambda k, v: -part * k.contacts.r[:, 0] * approach(k) ** 0.4}


@other("orientation_dependent_moment", "two flats on the rim: the centre of pressure wanders across each")
def _(rng):
    c, half, at, apart = rng.uniform(0.25, 0.4), rng.uniform(0.4, 0.7), rng.uniform(-np.pi, np.pi), rng.uniform(2, 3.5)

    def across(angle):
        angle = np.mod(angle + np.pi, 2 * np.pi) - np.pi
        return np.where(np.abs(angle) < half, angle / half, 0.0)

    return {"moment": lambda k, v: c * k.rho * (across(k.theta - at) + across(k.theta - at - apart))}


@other("orientation_dependent_moment", "a fluted rim bears beside its lowest point", bodies=NOT_THREEFOLD)
def _(rng):
    c, at = rng.uniform(0.09, 0.16), rng.uniform(-np.pi, np.pi)
    return {"moment": lambda k, v: c * k.rho * np.sin(3 * (k.theta - at))}


@other("rolling_resistance", "a viscous foam resists by the root of the present spin")
def _(rng):
    c = rng.uniform(0.1, 0.2)
    return {"moment": lambda k, v: -c * k.rho * np.sign(v[:, 2]) * np.sqrt(np.abs(v[:, 2]) * k.rho)}


@other("rolling_resistance", "hysteresis of a soft tread, at work only while the contact rolls and does not slide")
def _(rng):
    c, slow = rng.uniform(0.15, 0.28), rng.uniform(0.2, 0.5)

    def moment(k, v):
        rolling = 1 / (1 + (k.contacts.slip(v) / slow) ** 2)
        return -c * k.rho * rolling * np.tanh(v[:, 2] * k.rho / 0.05)

    return {"moment": moment}


@other("spin_damping", "bristles take spin in proportion to its square")
def _(rng):
    c = rng.uniform(0.2, 0.5)
    return {"after": lambda k, v: _spinning(v, 1 / (1 + c * np.abs(v[:, 2]) * k.rho))}


@other("spin_damping", "a dry pivot takes the same spin each time, and all of it where there is little")
def _(rng):
    u = rng.uniform(0.15, 0.3)
    return {"after": lambda k, v: _spinning(v, np.maximum(1 - u / np.maximum(np.abs(v[:, 2]) * k.rho, 1e-9), 0))}


def _spinning(v, part):
    return np.concatenate((v[:, :2], (part * v[:, 2])[:, None]), 1)


# --- Set-up --------------------------------------------------------------------------------------


@other("surface_tilt", "the camera is rolled against the floor", point="seen")
def _(rng):
    return {"geometry": Geometry(frame=either(rng) * rng.uniform(0.025, 0.09))}


@other("surface_tilt", "a wedge under the plate on which corners land", bodies=CORNERED)
def _(rng):
    return {"geometry": Geometry(slope=either(rng) * rng.uniform(0.02, 0.05))}


@other("com_offset", "a slug of lead off both axes", bodies=UNEQUAL, point="computed")
def _(rng):
    return {"geometry": Geometry(com=(either(rng) * rng.uniform(0.05, 0.1), either(rng) * rng.uniform(0.05, 0.1)))}


@other("com_offset", "one end is heavier", point="computed")
def _(rng):
    return {"geometry": Geometry(com=(either(rng) * rng.uniform(0.08, 0.16), 0.0))}


@other("inertia_error", "hollow, and declared full")
def _(rng):
    return {"geometry": Geometry(inertia=rng.uniform(0.25, 0.5))}


@other("inertia_error", "a dense core that the declared density does not know")
def _(rng):
    return {"geometry": Geometry(inertia=-rng.uniform(0.25, 0.6))}


@other("orientation_offset", "the marker is glued on askew", bodies=UNEQUAL, point="computed")
def _(rng):
    return {"geometry": Geometry(angle=either(rng) * rng.uniform(0.05, 0.14))}


@other("sampling_delay", "the last frame before contact of a slow camera", bodies=UNEQUAL, point="computed")
def _(rng):
    return {"geometry": Geometry(delay=rng.uniform(0.003, 0.009))}


@other("sampling_delay", "the pose is extrapolated too far, past the contact", bodies=UNEQUAL, point="computed")
def _(rng):
    return {"geometry": Geometry(delay=-rng.uniform(0.003, 0.007))}


@other("shape_error", "worn smaller all around", bodies=UNEQUAL, point="computed")
def _(rng):
    worn = 1 - rng.uniform(0.1, 0.2)
    return {"geometry": Geometry(scale=(worn, worn))}


@other("shape_error", "pressed flat at the same area", bodies=OBLONG, point="computed")
def _(rng):
    wider = 1 + rng.uniform(0.06, 0.14)
    return {"geometry": Geometry(scale=(wider, 1 / wider))}


# --- Motion --------------------------------------------------------------------------------------


@other("gravity_impulse", "a soft body falls on during a contact of Hertz's duration, v^(−1/5)")
def _(rng):
    lasts = rng.uniform(0.015, 0.035)
    return {"after": lambda k, v: v - G * lasts * approach(k)[:, None] ** -0.2 * np.array([0, 1, 0])}


@other("gravity_impulse", "the first frame after contact comes at any time within a period")
def _(rng):
    period = rng.uniform(0.03, 0.06)
    return {"after": lambda k, v: v - G * period * np.mod(1e4 * k.x, 1)[:, None] * np.array([0, 1, 0])}


@other("side_drag", "drag of the air, by the square of the speed")
def _(rng):
    c = rng.uniform(0.05, 0.12)
    return {"after": lambda k, v: _slowed(v, 1 / (1 + c * np.hypot(*v.T[:2])))}


@other("side_drag", "rubbing on guide walls takes the same speed each time")
def _(rng):
    u = rng.uniform(0.12, 0.25)
    return {"after": lambda k, v: _slowed(v, np.maximum(1 - u / np.maximum(np.hypot(*v.T[:2]), 1e-9), 0))}


def _slowed(v, part):
    return v * np.stack((part, part, np.ones_like(part)), -1)


OTHER_NAMES = tuple(OTHER)
