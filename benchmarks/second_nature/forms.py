"""Forms of the catalogue's effects in the law and in the wrench, each not the obvious one.

`FORMS` maps a name to builders: amplitudes are drawn from plausible ranges, signs at random where both occur.
Effects of the set-up and of the motion are in `setup`.
"""

from collections import defaultdict

import numpy as np

from second_nature.compliant import Compliance
from second_nature.effect import CORNERED, OBLONG, Effect

FORMS = defaultdict(list)


def form(name, text, **fixed):
    """Register a builder rng → hooks as a form of the effect `name`."""

    def register(builder):
        FORMS[name].append(lambda rng: Effect(name, text, (name,), **fixed, **builder(rng)))
        return builder

    return register


def either(rng):
    """A sign at random."""
    return rng.choice([-1.0, 1.0])


# --- Restitution ---------------------------------------------------------------------------------


@form("velocity_dependent_restitution", "settles at speed: ε∞ + Δ exp(−|v_n|/v₀)")
def _(rng):
    d, v0 = rng.uniform(0.35, 0.5), rng.uniform(0.6, 1.1)
    return {"eps": lambda c: d * (np.exp(-c.speed / v0) - np.exp(-1.5 / v0))}


@form("velocity_dependent_restitution", "elastic up to a yield speed, then falls as its −1/4 power")
def _(rng):
    v_y, top = rng.uniform(0.5, 0.8), rng.uniform(0.15, 0.25)
    return {"eps": lambda c: top * (np.maximum(c.speed / v_y, 1) ** -0.25 - (1.5 / v_y) ** -0.25) * 4}


@form("velocity_dependent_restitution", "Hunt–Crossley contact, in time", bodies=("disc",))
def _(rng):
    return {"compliance": Compliance(hunt=rng.uniform(0.3, 0.6))}


@form("slip_dependent_restitution", "saturates: c |v_t| / (|v_t| + v₀)")
def _(rng):
    c, v0 = either(rng) * rng.uniform(0.25, 0.35), rng.uniform(0.5, 1.0)
    return {"eps": lambda k: c * (np.abs(k.slip) / (np.abs(k.slip) + v0) - 0.5)}


@form("slip_dependent_restitution", "quadratic, levels off: −c (1 − exp(−v_t²/v₀²))")
def _(rng):
    c, v0 = rng.uniform(0.2, 0.3), rng.uniform(0.8, 1.4)
    return {"eps": lambda k: c * (np.exp(-((k.slip / v0) ** 2)) - 0.5)}


@form("orientation_dependent_restitution", "one half of the body is softer, with a smooth seam", bodies=("ellipse",))
def _(rng):
    c, at, width = rng.uniform(0.1, 0.15), rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 0.5)
    return {"eps": lambda k: c * np.tanh(np.sin(k.theta - at) / width)}


@form("orientation_dependent_restitution", "a soft corner", bodies=CORNERED)
def _(rng):
    c, at = rng.uniform(0.2, 0.3), rng.uniform(-np.pi, np.pi)
    return {"eps": lambda k: -c * np.exp((np.cos(k.theta - at) - 1) / 0.35)}


@form("location_dependent_restitution", "two plates side by side")
def _(rng):
    c, at = either(rng) * rng.uniform(0.07, 0.1), rng.uniform(-0.04, 0.04)
    return {"eps": lambda k: c * np.tanh((k.x - at) / 0.01)}


@form("location_dependent_restitution", "a floor that bends in the middle of its span")
def _(rng):
    c = rng.uniform(0.2, 0.3)
    return {"eps": lambda k: -c * (np.clip(1 - (k.x / 0.15) ** 2, 0, None) ** 2 - 0.53)}


@form("configuration_dependent_restitution", "loss linear in the lever: −c |r_x|/ρ", bodies=OBLONG)
def _(rng):
    c = rng.uniform(0.2, 0.35)
    return {"eps": lambda k: c * (0.3 - np.abs(k.lever))}


@form(
    "configuration_dependent_restitution",
    "loss saturates with the lever: −c tanh²(2 r_x/ρ)",
    bodies=("ellipse", "square"),
)
def _(rng):
    c = rng.uniform(0.25, 0.35)
    return {"eps": lambda k: c * (0.3 - np.tanh(2 * k.lever) ** 2)}


@form("parameter_drift", "ε settles: Δ exp(−t/t₀)")
def _(rng):
    c, t = either(rng) * rng.uniform(0.25, 0.35), rng.uniform(0.2, 0.4)
    return {"eps": lambda k: c * (np.exp(-k.share / t) - t)}


@form("parameter_drift", "ε jumps where the surface was changed")
def _(rng):
    c, at = either(rng) * rng.uniform(0.07, 0.1), rng.uniform(0.35, 0.65)
    return {"eps": lambda k: c * np.sign(k.share - at)}


@form("parameter_drift", "μ wears in: grows as √t")
def _(rng):
    c = rng.uniform(0.8, 1.2)
    return {"mu": lambda k: 0.6 + c * np.sqrt(k.share)}


# --- Friction ------------------------------------------------------------------------------------


@form("velocity_dependent_friction", "Stribeck as 1/(1 + (v/v_s)²), along the path")
def _(rng):
    top, v_s = rng.uniform(1.5, 2.5), rng.uniform(0.5, 0.9)
    return {"friction": lambda s: 0.5 + top / (1 + (s / v_s) ** 2)}


@form("velocity_dependent_friction", "rate strengthening: 1 + a ln(1 + v/v₀), along the path")
def _(rng):
    a, v0 = rng.uniform(0.5, 0.8), rng.uniform(0.2, 0.4)
    return {"friction": lambda s: 0.5 + a * np.log1p(np.abs(s) / v0)}


@form("load_dependent_friction", "falls with load: 1/(1 + |v_n|/v₀)")
def _(rng):
    v0 = rng.uniform(0.5, 1.0)
    return {"mu": lambda k: 3 / (1 + k.speed / v0)}


@form("load_dependent_friction", "grows with load and levels off")
def _(rng):
    v0 = rng.uniform(1.5, 2.5)
    return {"mu": lambda k: 0.2 + 1.6 * np.tanh(k.speed / v0)}


@form("directional_friction", "fur: the present slip decides, with a smooth change")
def _(rng):
    a = either(rng) * rng.uniform(0.4, 0.6)
    return {"friction": lambda s: 1 + a * np.tanh(s / 0.1)}


@form("directional_friction", "saw teeth: μ doubles against them")
def _(rng):
    way = either(rng)
    return {"friction": lambda s: np.where(way * s > 0, 1.5, 0.75)}


@form("location_dependent_friction", "a greasy patch")
def _(rng):
    at, width = rng.uniform(-0.08, 0.08), rng.uniform(0.04, 0.06)
    return {"mu": lambda k: 1.3 - 1.1 * np.exp(-(((k.x - at) / width) ** 2))}


@form("location_dependent_friction", "worn towards one end")
def _(rng):
    way = either(rng)
    return {"mu": lambda k: 1 + 0.7 * way * np.tanh(k.x / 0.1)}


# --- Over incidence and orientation -----------------------------------------------------------------


@form("incidence_dependent_restitution", "steep impacts lose more, with a limit: c tanh²(|v_t|/|v_n|)")
def _(rng):
    c = rng.uniform(0.25, 0.35)
    return {"eps": lambda k: c * (np.tanh(k.slip / k.speed) ** 2 - 0.4)}


@form("incidence_dependent_restitution", "a rise about one angle of incidence, as of a plate that ploughs")
def _(rng):
    c, at = rng.uniform(0.25, 0.35), rng.uniform(0.7, 0.9)
    return {"eps": lambda k: c * np.exp(-(((np.arctan2(np.abs(k.slip), k.speed) - at) / 0.25) ** 2)) - 0.1}


@form("incidence_dependent_friction", "ploughing: more friction in steep impacts")
def _(rng):
    c = rng.uniform(1.5, 2.5)
    return {"mu": lambda k: 0.5 + c / (1 + (k.slip / k.speed) ** 2)}


@form("incidence_dependent_friction", "grazing impacts slide on an air film")
def _(rng):
    at = rng.uniform(0.6, 0.8)
    return {"mu": lambda k: 0.85 - 0.55 * np.tanh((np.abs(k.slip) / k.speed - at) / 0.2)}


@form("orientation_dependent_friction", "sandpaper on a third of the body", bodies=("disc", "ellipse"))
def _(rng):
    at = rng.uniform(-np.pi, np.pi)
    return {"mu": lambda k: 1.25 + 0.75 * np.tanh((np.cos(k.theta - at) - 0.5) / 0.15)}


@form("orientation_dependent_friction", "one greasy corner", bodies=("rectangle", "square"))
def _(rng):
    at = rng.choice([-0.75, -0.25, 0.25, 0.75]) * np.pi
    return {"mu": lambda k: 1.3 - 1.1 * np.exp((np.cos(k.theta - at) - 1) / 0.4)}


@form("orientation_dependent_moment", "a bump that takes the contact aside", bodies=("disc", "ellipse"))
def _(rng):
    arm, at = either(rng) * rng.uniform(0.25, 0.35), rng.uniform(-np.pi, np.pi)
    return {"moment": lambda k, v: arm * k.rho * np.exp((np.cos(k.theta - at) - 1) / 0.15)}


@form("orientation_dependent_moment", "three feet", bodies=("disc", "ellipse"))
def _(rng):
    arm, at = rng.uniform(0.12, 0.18), rng.uniform(-np.pi, np.pi)
    return {"moment": lambda k, v: arm * k.rho * np.sin(3 * (k.theta - at))}


# --- Wrench --------------------------------------------------------------------------------------


@form("tangential_restitution", "the tangential impulse that stopped the slip is given back in restitution")
def _(rng):
    return {"rebound": rng.uniform(0.5, 0.8)}


@form("tangential_restitution", "a bilinear tangential spring, in time", bodies=("disc",))
def _(rng):
    return {"compliance": Compliance(tangential=rng.uniform(0.9, 1.3))}


@form("adhesion", "a constant work of separation", bodies=("ellipse", "rectangle", "square"))  # of a disc: ε by speed
def _(rng):
    w = rng.uniform(0.12, 0.25)  # (m/s)²: work per effective mass of a central impact

    def after(k, v):
        c = k.contacts
        v_n = np.maximum(c.approach(v), 0.0)
        slower = np.sqrt(np.maximum(v_n**2 - 2 * w * c.mass * c.W[2] * 0.5, 0.0))
        P_n = (slower - v_n) / c.W[2]
        return v + np.stack((0 * P_n, P_n / c.mass, c.r[:, 0] * P_n / c.inertia), -1)

    return {"after": after}


@form("adhesion", "bonds made in compression pull in restitution, in time", bodies=("ellipse",))
def _(rng):
    return {"compliance": Compliance(pull=rng.uniform(300, 500))}


@form("contact_patch", "the pressure's centre lags behind the lever: τ = −w tanh(r_x/w₀) P_n", bodies=OBLONG)
def _(rng):
    w = rng.uniform(0.1, 0.2)
    return {"moment": lambda k, v: -w * k.rho * np.tanh(2 * k.lever)}


@form("contact_patch", "a lop-sided pad: τ = c P_n")
def _(rng):
    w = either(rng) * rng.uniform(0.06, 0.12)
    return {"moment": lambda k, v: w * k.rho}


@form("rolling_resistance", "Coulomb's: a constant arm against the present spin", bodies=("disc", "ellipse"))
def _(rng):
    arm = rng.uniform(0.07, 0.12)
    return {"moment": lambda k, v: -arm * k.rho * np.tanh(v[:, 2] / 0.3)}


@form("rolling_resistance", "the arm grows with speed of impact and levels off", bodies=("disc", "square"))
def _(rng):
    arm = rng.uniform(0.1, 0.15)
    return {"moment": lambda k, v: -arm * k.rho * np.tanh(k.speed / 1.0) * np.tanh(v[:, 2] / 0.5)}
