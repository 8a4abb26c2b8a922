"""Forms of the catalogue's effects of the set-up and of the motion beside the contact, and physics in no catalogue."""

import numpy as np

from second_nature.effect import Effect, Geometry
from second_nature.forms import FORMS, either, form

G = 9.81


def geometry(name, text, **fixed):
    """Register a builder rng → entries of `Geometry` as a form of the effect `name`."""

    def register(builder):
        return form(name, text, **fixed)(lambda rng: {"geometry": Geometry(**builder(rng))})

    return register


# --- State ---------------------------------------------------------------------------------------


@geometry("surface_tilt", "a sloping floor under a body whose contact point is seen", point="seen")
def _(rng):
    return {"slope": either(rng) * rng.uniform(0.03, 0.06)}


@geometry(
    "surface_tilt", "a sloping floor, contact point computed for a level one", bodies=("ellipse",), point="computed"
)
def _(rng):
    return {"slope": either(rng) * rng.uniform(0.03, 0.06)}


@geometry("surface_tilt", "the measurement frame is turned, the contact point is seen in it", point="seen")
def _(rng):
    return {"frame": either(rng) * rng.uniform(0.03, 0.06)}


ROUND_OR_BOX = ("ellipse", "rectangle", "square")


@geometry("com_offset", "ballast off the centre", bodies=ROUND_OR_BOX, point="computed")
def _(rng):
    return {"com": (either(rng) * rng.uniform(0.04, 0.08), either(rng) * rng.uniform(0.02, 0.06))}


@geometry("com_offset", "ballast along one axis of a ball", bodies=("disc",), point="computed")
def _(rng):
    return {"com": (either(rng) * rng.uniform(0.05, 0.1), 0.0)}


@geometry("inertia_error", "a shell taken for a solid body", bodies=ROUND_OR_BOX)
def _(rng):
    return {"inertia": rng.uniform(0.2, 0.4)}


@geometry("inertia_error", "a heavy core", bodies=ROUND_OR_BOX)
def _(rng):
    return {"inertia": -rng.uniform(0.2, 0.35)}


@geometry("orientation_offset", "the marker was glued on askew", bodies=("ellipse",), point="computed")
def _(rng):
    return {"angle": either(rng) * rng.uniform(0.05, 0.12)}


@geometry("orientation_offset", "the marker was glued on askew", bodies=("rectangle", "square"), point="computed")
def _(rng):
    return {"angle": either(rng) * rng.uniform(0.03, 0.05)}


@geometry("sampling_delay", "the pose is one frame old", bodies=("ellipse",), point="computed")
def _(rng):
    return {"delay": rng.uniform(0.004, 0.008)}


@geometry("sampling_delay", "the pose is one frame old", bodies=("rectangle", "square"), point="computed")
def _(rng):
    return {"delay": rng.uniform(0.0015, 0.003)}


@geometry("shape_error", "one axis was measured short", bodies=("ellipse",), point="computed")
def _(rng):
    return {"scale": (1.0 + rng.uniform(0.04, 0.08), 1.0)}


@geometry("shape_error", "round corners taken for sharp", bodies=("rectangle", "square"), point="computed")
def _(rng):
    return {"corner": rng.uniform(0.15, 0.3)}


# --- Velocity and spin beside the contact --------------------------------------------------------


@form("gravity_impulse", "the second velocity is taken late", bodies=ROUND_OR_BOX)
def _(rng):
    late = rng.uniform(0.012, 0.03)
    return {"after": lambda k, v: v - [0.0, G * late, 0.0]}


@form(
    "gravity_impulse",
    "a soft contact under its own weight: longer where the effective mass is larger",
    bodies=("ellipse",),
)
def _(rng):
    late = rng.uniform(0.012, 0.025)

    def after(k, v):
        duration = late * np.sqrt(1 / (k.contacts.mass * k.contacts.W[2]))
        return v - np.stack((0 * duration, G * duration, 0 * duration), -1)

    return {"after": after}


@form("spin_damping", "air: quadratic in the spin")
def _(rng):
    c = rng.uniform(0.15, 0.3)
    return {"after": lambda k, v: v / np.stack((1 + 0 * k.x, 1 + 0 * k.x, 1 + c * np.abs(v[:, 2]) * k.rho), -1)}


@form("spin_damping", "a drilling moment during contact, proportional to the present spin", bodies=ROUND_OR_BOX)
def _(rng):
    b = rng.uniform(0.1, 0.2)
    return {"moment": lambda k, v: -b * k.rho**2 * v[:, 2] / k.speed}


@form("side_drag", "air: quadratic in the speed")
def _(rng):
    c = rng.uniform(0.06, 0.12)
    return {"after": lambda k, v: _slower(v, 1 / (1 + c * np.hypot(v[:, 0], v[:, 1])))}


@form("side_drag", "guide walls rub: a share that levels off")
def _(rng):
    c = rng.uniform(0.08, 0.14)
    return {"after": lambda k, v: _slower(v, 1 - c * np.tanh(np.hypot(v[:, 0], v[:, 1]) / 0.5))}


def _slower(v, factor):
    return np.stack((v[:, 0] * factor, v[:, 1] * factor, v[:, 2]), -1)


RECENT = (
    "incidence_dependent_restitution",
    "incidence_dependent_friction",
    "orientation_dependent_friction",
    "orientation_dependent_moment",
)
NAMES = tuple(name for name in FORMS if name not in RECENT)
"""The names of the catalogue that are planted, those of its curves apart."""


# --- In no catalogue -----------------------------------------------------------------------------


def unknown(text, variables, tolerated=(), **fixed):
    """Register a builder rng → change of the velocity as physics in no catalogue.

    `tolerated` are names of the catalogue that describe a part of it.
    """

    def register(builder):
        UNKNOWN.append(lambda rng: Effect("unknown", text, tolerated, after=builder(rng), variables=variables, **fixed))
        return builder

    return register


UNKNOWN = []


def _kick(k, v, P_t=0.0, P_n=0.0, tau=0.0):
    """The velocity after a further impulse at the contact, in units of m (m/s), and moment in units of m ρ."""
    c = k.contacts
    spin = (c.r[:, 0] * P_n - c.r[:, 1] * P_t + tau * k.rho) * c.mass / c.inertia
    return v + np.stack((P_t + 0 * spin, P_n + 0 * spin, spin), -1)


@unknown(
    "a magnet in the body turns it: τ ∝ sin(θ − θ₀)",
    ("theta",),
    ("orientation_dependent_moment",),
    bodies=("disc", "ellipse"),
)
def _(rng):
    a, at = rng.uniform(0.15, 0.3), rng.uniform(-np.pi, np.pi)
    return lambda k, v: _kick(k, v, tau=a * np.sin(k.theta - at))


@unknown("lift: a sideways kick by spin times speed of fall", ("omega", "vn", "vy", "vt"))
def _(rng):
    a = either(rng) * rng.uniform(0.2, 0.4)
    return lambda k, v: v + np.stack((a * k.omega * k.rho * k.speed, 0 * k.x, 0 * k.x), -1)


@unknown("charge: a tangential kick by place times slip", ("x", "vt", "vx", "omega"))
def _(rng):
    a = either(rng) * rng.uniform(2, 3)
    return lambda k, v: _kick(k, v, P_t=a * k.x * np.tanh(k.slip))


@unknown("a floor that vibrates, slowly against the drops", ("order",), ("parameter_drift",))
def _(rng):
    a, periods = rng.uniform(0.15, 0.25), rng.integers(4, 6)
    return lambda k, v: _kick(k, v, P_n=a * np.sin(2 * np.pi * periods * k.share))


@unknown(
    "a loose mass inside takes part of the change of velocity along the body's axis",
    ("theta",),
    ("orientation_dependent_restitution",),
    bodies=("disc", "ellipse"),
)
def _(rng):
    share = rng.uniform(0.15, 0.25)

    def after(k, v):
        axis = np.stack((np.cos(k.theta), np.sin(k.theta)), -1)
        along = ((v - k.contacts.v)[:, :2] * axis).sum(1)
        return v - share * np.concatenate((along[:, None] * axis, 0 * along[:, None]), 1)

    return after


@unknown(
    "grooves: a tangential kick by three times the angle, times the fall",
    ("theta", "vn", "vy"),
    bodies=("disc", "ellipse"),
)
def _(rng):
    a = rng.uniform(0.12, 0.2)
    return lambda k, v: _kick(k, v, P_t=a * k.speed * np.sin(3 * k.theta))
