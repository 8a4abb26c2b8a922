"""Other forms of the effects of the law, from the literature of contact mechanics and friction.

They were written by someone who had seen neither the catalogue's forms nor those of `forms` and `setup`.  `OTHER` maps
a name to builders rng → `Effect`, like `FORMS`.  The wrench, the set-up and the motion are in `other_setup`.
"""

from collections import defaultdict

import numpy as np

from second_nature.effect import ANY, Effect
from second_nature.forms import either

OTHER = defaultdict(list)
UNEQUAL = tuple(kind for kind in ANY if kind != "disc")
"""Bodies whose contact point leaves the vertical through the centre."""
NOT_THREEFOLD = tuple(kind for kind in ANY if kind != "triangle")
"""Bodies that do not repeat themselves every third of a turn."""


def other(name, text, also=(), **fixed):
    """Register a builder rng → hooks as a form of the effect `name`; `also` are names of the same physics."""

    def register(build):
        accepted = (name, *also)
        OTHER[name].append(lambda rng: Effect(name, text, accepted, **fixed, **build(rng)))
        return build

    return register


def approach(k):
    """|v_n|, at least 0.05 m/s, so that its powers and inverse exist [n]."""
    return np.maximum(k.speed, 0.05)


def incidence(k):
    """|v_t|/|v_n| [n]."""
    return np.abs(k.slip) / approach(k)


def bump(x, centre, width):
    """1 at the centre, Gaussian in ln x."""
    return np.exp(-((np.log(np.maximum(x, 1e-6) / centre) / width) ** 2))


def sector(angle, half):
    """1 within `half` of angle 0, else 0."""
    return 1.0 * (np.cos(angle) > np.cos(half))


def rise(x, centre, width):
    """A smooth step from 0 to 1."""
    return 0.5 * (1 + np.tanh((x - centre) / width))


# --- Restitution ---------------------------------------------------------------------------------


@other("velocity_dependent_restitution", "elastic below the speed of yield, elastic–plastic above (Thornton 1997)")
def _(rng):
    yielding = rng.uniform(0.4, 0.8)

    def eps(k):
        x = np.minimum(yielding / approach(k), 1)
        unloading = (x / (x + 2 * np.sqrt(1.2 - 0.2 * x**2))) ** 0.25
        return np.sqrt(1.2 * np.sqrt(3) * (1 - x**2 / 6)) * unloading - 0.85

    return {"eps": eps}


@other("velocity_dependent_restitution", "rubber near its loss peak rebounds least at a middle speed (Calvit 1967)")
def _(rng):
    c, centre, width = rng.uniform(0.2, 0.32), rng.uniform(1.2, 2.0), rng.uniform(0.3, 0.45)
    return {"eps": lambda k: 0.1 - c * bump(approach(k), centre, width)}


@other("slip_dependent_restitution", "a chip is ploughed out beyond a threshold of slip, and costs rebound (Hutchings)")
def _(rng):
    c, start, width = rng.uniform(0.2, 0.32), rng.uniform(0.6, 1.2), rng.uniform(0.6, 1.2)
    return {"eps": lambda k: 0.08 - c * np.clip((np.abs(k.slip) - start) / width, 0, 1)}


@other("slip_dependent_restitution", "squeal in a band of slips takes energy from the normal motion (Ibrahim 1994)")
def _(rng):
    c, centre, width = rng.uniform(0.22, 0.34), rng.uniform(0.7, 1.3), rng.uniform(0.5, 0.8)
    return {"eps": lambda k: 0.1 - c * bump(np.abs(k.slip), centre, width)}


@other("orientation_dependent_restitution", "a soft sector of the rim, with sharp borders")
def _(rng):
    c, at, half = rng.uniform(0.18, 0.3), rng.uniform(-np.pi, np.pi), rng.uniform(0.6, 1.1)
    return {"eps": lambda k: 0.06 - c * sector(k.theta - at, half)}


@other("orientation_dependent_restitution", "three stiff ribs inside the body", bodies=NOT_THREEFOLD)
def _(rng):
    c, at = rng.uniform(0.1, 0.17), rng.uniform(-np.pi, np.pi)
    return {"eps": lambda k: c * np.tanh(2 * np.cos(3 * (k.theta - at)))}


@other("location_dependent_restitution", "two plates of different stiffness meet at a seam in the floor")
def _(rng):
    c, seam = either(rng) * rng.uniform(0.08, 0.14), rng.uniform(-0.06, 0.06)
    return {"eps": lambda k: c * np.sign(k.x - seam)}


@other("location_dependent_restitution", "a floor on battens: softer between them, every ten centimetres or so")
def _(rng):
    c, pitch, phase = rng.uniform(0.12, 0.18), rng.uniform(0.09, 0.18), rng.uniform(0, 2 * np.pi)
    return {"eps": lambda k: c * np.cos(2 * np.pi * k.x / pitch + phase)}


@other("configuration_dependent_restitution", "the first bending mode answers only beyond a lever", bodies=UNEQUAL)
def _(rng):
    c, start, width = rng.uniform(0.25, 0.4), rng.uniform(0.1, 0.3), rng.uniform(0.25, 0.5)
    return {"eps": lambda k: 0.1 - c * np.clip((np.abs(k.lever) - start) / width, 0, 1)}


@other("configuration_dependent_restitution", "no loss at the node of a free bar's first mode", bodies=UNEQUAL)
def _(rng):
    c, node = rng.uniform(0.25, 0.4), rng.uniform(0.4, 0.6)
    return {"eps": lambda k: 0.1 - c * np.minimum((1 - (k.lever / node) ** 2) ** 2, 1.5)}


@other("incidence_dependent_restitution", "restitution grows towards grazing and saturates (Louge & Adams 2002)")
def _(rng):
    c, most = rng.uniform(0.14, 0.22), rng.uniform(1.3, 2.0)
    return {"eps": lambda k: c * (np.minimum(incidence(k), most) - 0.7)}


@other("incidence_dependent_restitution", "a dip at the angle where the contact goes over from sliding to sticking")
def _(rng):
    c, centre, width = rng.uniform(0.22, 0.34), rng.uniform(0.5, 0.9), rng.uniform(0.14, 0.22)
    return {"eps": lambda k: 0.1 - c * np.exp(-(((np.arctan(incidence(k)) - centre) / width) ** 2))}


@other("parameter_drift", "the floor warms and rebounds better, and cools at every pause: a sawtooth")
def _(rng):
    c, pauses = either(rng) * rng.uniform(0.22, 0.34), rng.uniform(2.2, 4.5)
    return {"eps": lambda k: c * (0.68 - np.exp(-3 * np.mod(pauses * k.share, 1)))}


@other("parameter_drift", "running-in: friction climbs to a peak early in the session and settles (Blau 1981)")
def _(rng):
    c, peak = rng.uniform(1.0, 1.6), rng.uniform(0.08, 0.2)
    return {"mu": lambda k: 0.5 + c * k.share / peak * np.exp(1 - k.share / peak)}


# --- Friction ------------------------------------------------------------------------------------


@other("velocity_dependent_friction", "friction grows with the logarithm of the present slip (Dieterich 1979)")
def _(rng):
    c, slow = rng.uniform(0.25, 0.4), rng.uniform(0.05, 0.15)
    return {"friction": lambda slip: 0.2 + c * np.log1p(np.abs(slip) / slow)}


@other("velocity_dependent_friction", "rubber's bell over the logarithm of the present slip (Grosch 1963)")
def _(rng):
    c, centre, width = rng.uniform(1.0, 1.8), rng.uniform(0.4, 0.9), rng.uniform(0.6, 1.0)
    return {"friction": lambda slip: 0.7 + c * bump(np.abs(slip), centre, width)}


@other("load_dependent_friction", "an oxide film breaks through beyond a load, and the metals weld (Whitehead 1950)")
def _(rng):
    c, centre, width = rng.uniform(0.9, 1.6), rng.uniform(1.4, 2.1), rng.uniform(0.1, 0.3)
    return {"mu": lambda k: 0.8 + c * rise(k.speed, centre, width)}


@other("load_dependent_friction", "shearing falls and ploughing grows with load: least in between (Bowden & Tabor)")
def _(rng):
    c, centre = rng.uniform(1.8, 2.8), rng.uniform(1.2, 1.7)

    def mu(k):
        load = approach(k) / centre
        return 0.6 + c * np.minimum(0.6 * load**-0.8 + 0.4 * load**1.2 - 1, 1.5)

    return {"mu": mu}


@other("directional_friction", "a pile that lies down one way: along the path, full only beyond a slip")
def _(rng):
    c, slow = either(rng) * rng.uniform(0.4, 0.65), rng.uniform(0.2, 0.6)
    return {"friction": lambda slip: 1 + c * np.tanh(slip / slow)}


@other("directional_friction", "barbs catch one way and let go when the slip is fast")
def _(rng):
    c, way, fast = rng.uniform(1.2, 2.0), either(rng), rng.uniform(1.2, 2.5)
    return {"friction": lambda slip: 0.8 + c * (way * slip > 0) * np.exp(-np.abs(slip) / fast)}


@other("location_dependent_friction", "a film of oil with a sharp border on part of the floor")
def _(rng):
    c, at, half = rng.uniform(0.55, 0.8), rng.uniform(-0.07, 0.07), rng.uniform(0.04, 0.07)
    return {"mu": lambda k: 1.2 - c * (np.abs(k.x - at) < half)}


@other("location_dependent_friction", "stripes of tape across the floor")
def _(rng):
    c, pitch, phase = rng.uniform(0.45, 0.7), rng.uniform(0.08, 0.16), rng.uniform(0, 2 * np.pi)
    return {"mu": lambda k: 1 + c * np.sign(np.sin(2 * np.pi * k.x / pitch + phase))}


@other("incidence_dependent_friction", "cutting is strongest at a middle angle of attack (Finnie 1960)")
def _(rng):
    c, centre, width = rng.uniform(1.2, 2.0), rng.uniform(0.5, 0.85), rng.uniform(0.2, 0.3)
    return {"mu": lambda k: 0.7 + c * np.exp(-(((np.arctan(incidence(k)) - centre) / width) ** 2))}


@other("incidence_dependent_friction", "at grazing incidence the body planes on a fluid film")
def _(rng):
    c, centre, width = rng.uniform(0.7, 0.95), rng.uniform(0.7, 1.2), rng.uniform(0.15, 0.4)
    return {"mu": lambda k: 1.4 - 1.4 * c * rise(incidence(k), centre, width)}


@other("orientation_dependent_friction", "one part of the rim is lacquered, the rest is bare")
def _(rng):
    c, at, half = rng.uniform(0.55, 0.8), rng.uniform(-np.pi, np.pi), rng.uniform(0.9, 1.7)
    return {"mu": lambda k: 1.3 - 1.3 * c * sector(k.theta - at, half)}


@other("orientation_dependent_friction", "end grain and long grain take turns around a piece of wood")
def _(rng):
    c, at = rng.uniform(1.0, 1.6), rng.uniform(-np.pi, np.pi)
    return {"mu": lambda k: 0.5 + c * np.abs(np.sin(k.theta - at))}
