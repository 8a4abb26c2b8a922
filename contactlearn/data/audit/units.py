"""Units and signs in which columns may have been written by mistake, known before any body is measured.

    millimetres, centimetres, inches, feet        positions and the contact point; _shape: the stated shape
    …, kmh, mph _velocity, _velocity_pre, _post   velocities of the centre of mass
    degrees, rpm, revolutions _omega, …           spins
    mirrored _omega_pre, _omega_post              spins of one side, as of a second camera from behind
    grams, ounces, pounds                         the mass

`MISWRITTEN` has each by the name of its correction, with its words, its factor to SI and the columns that it converts.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Miswritten:
    """Columns that are written in another unit than they should be.

    Args:
        words: the mistake, for the user.
        factor: that converts them.
        columns: among `place` (positions and contact points), `theta`, `velocity_pre`, `velocity_post`, `omega_pre`,
            `omega_post`, `mass` and `shape`.
    """

    words: str
    factor: float
    columns: tuple[str, ...]


_DEGREE = math.pi / 180
_LENGTHS = {"millimetres": ("mm", 1e-3), "centimetres": ("cm", 1e-2), "inches": ("in", 0.0254), "feet": ("ft", 0.3048)}
_SPELT = {"inches": "inches", "feet": "feet"}  # “in in” reads badly
_SPEEDS = {name: (f"{unit}/s", factor) for name, (unit, factor) in _LENGTHS.items()}
_SPEEDS |= {"kmh": ("km/h", 1 / 3.6), "mph": ("mph", 0.44704)}
_SPINS = {"degrees": ("°/s", _DEGREE), "rpm": ("rev/min", 2 * math.pi / 60), "revolutions": ("rev/s", 2 * math.pi)}
_MASSES = {"grams": ("g", 1e-3), "ounces": ("oz", 0.028349523125), "pounds": ("lb", 0.45359237)}
_TIMES = {"": ("pre", "post"), "_pre": ("pre",), "_post": ("post",)}
_WHEN = {"": "", "_pre": " before impact", "_post": " after impact"}


def _listed() -> dict[str, Miswritten]:
    found = {
        f"{name}_omega{time}": Miswritten(
            f"ω{_WHEN[time]} is in {unit}", factor, tuple(f"omega_{one}" for one in _TIMES[time])
        )
        for time in _TIMES
        for name, (unit, factor) in _SPINS.items()
    }
    found |= {
        f"mirrored_omega{time}": Miswritten(f"ω{_WHEN[time]} has the other sign", -1.0, (f"omega{time}",))
        for time in ("_pre", "_post")
    }
    found["degrees_theta"] = Miswritten("θ is in degrees", _DEGREE, ("theta",))
    found["degrees"] = Miswritten("θ is in degrees and ω in °/s", _DEGREE, ("theta", "omega_pre", "omega_post"))
    found |= {
        name: Miswritten(f"positions and the contact point are in {_SPELT.get(name, unit)}", factor, ("place",))
        for name, (unit, factor) in _LENGTHS.items()
    }
    found |= {
        f"{name}_velocity{time}": Miswritten(
            f"velocities{_WHEN[time]} are in {unit}", factor, tuple(f"velocity_{one}" for one in _TIMES[time])
        )
        for time in _TIMES
        for name, (unit, factor) in _SPEEDS.items()
    }
    found |= {name: Miswritten(f"the mass is in {unit}", factor, ("mass",)) for name, (unit, factor) in _MASSES.items()}
    found["radians_omega"] = Miswritten("ω is in rad/s, and was read in °/s", 1 / _DEGREE, ("omega_pre", "omega_post"))
    twice = "the stated shape has diameters for radii, or edges for half edges"
    found["doubled_shape"] = Miswritten(twice, 0.5, ("shape",))
    return found | {
        f"{name}_shape": Miswritten(f"the stated shape is in {_SPELT.get(name, unit)}", factor, ("shape",))
        for name, (unit, factor) in _LENGTHS.items()
    }


MISWRITTEN = _listed()
"""By the name of the correction; the order is that in which several are applied."""
