"""The effects that may be hidden, by name.

`EFFECTS` are names of the catalogue of effects, so that what was found can be compared with what was
hidden; their forms are nature's own, and most are not among those that an analysis would try first.
`UNKNOWN` are in no catalogue, and hidden only if asked for by name.  `RIVALS` are groups that leave
nearly the same trace: at most one of each is drawn.
"""

import math
import random

from contactlearn.core.errors import UnknownNameError
from contactlearn.simulation.hidden_effects import camera, floor, unknown
from contactlearn.simulation.hidden_effects.forms import KNOWN, OTHERS, Form

_FILLED_BY = camera, floor, unknown

EFFECTS = tuple(sorted(KNOWN))
UNKNOWN = tuple(sorted(OTHERS))
RIVALS = (
    {"rolling_resistance", "spin_damping"},
    {"velocity_dependent_restitution", "adhesion"},
    {"orientation_dependent_restitution", "configuration_dependent_restitution"},
    {"gravity_impulse", "side_drag"},
    {"orientation_offset", "surface_tilt"},
    {"inertia_error", "contact_patch"},
)


# The catalogue's parameters as they follow from nature's, where both mean the same.
_MEANT = {
    "surface_tilt": lambda p: {"phi": p["φ"]},
    "com_offset": lambda p: {"delta_a": p["δ_a"], "delta_b": p["δ_b"]},
    "inertia_error": lambda p: {"kappa": p["κ"]},
    "orientation_offset": lambda p: {"delta": p["δ"]},
    "sampling_delay": lambda p: {"dt": p["Δt"]},
    "shape_error": lambda p: {"s_a": p["s_a"], "s_b": p["s_b"]},
    "gravity_impulse": lambda p: {"dt": p["Δt"]},
    "side_drag": lambda p: {"c": 1 - math.exp(-p["c"])},
    "load_dependent_friction": lambda p: {"p": p["k"]},
    "directional_friction": lambda p: {"a": p["a"]},
    "rolling_resistance": lambda p: {"c": p["c"]},
    "contact_patch": lambda p: {"k": p["k"], "c": 0.0},
}


def meant(name: str, parameters: dict[str, float]) -> dict[str, float]:
    """Values that the catalogue's parameters of an effect should be found at; empty where its form is another one."""
    return _MEANT[name](parameters) if name in _MEANT else {}


def forms(name: str) -> list[Form]:
    """The forms of an effect; UnknownNameError where there is none of that name."""
    table = KNOWN | OTHERS
    if name not in table:
        raise UnknownNameError("hidden effect", name, table)
    return table[name]


def choose(rng: random.Random) -> list[str]:
    """One to three effects of the catalogue that leave different traces."""
    count = rng.randint(1, 3)
    while True:
        names = sorted(rng.sample(EFFECTS, count))
        if all(len(group.intersection(names)) < 2 for group in RIVALS):
            return names
