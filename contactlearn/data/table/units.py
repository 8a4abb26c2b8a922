"""Units of a table's columns, as settings state them or as the columns' names do.

Four units are stated, and the sense in which θ and ω are positive; all others follow: velocities are lengths a time, an
inertia is a mass times a squared length, a covariance is the product of its two velocities.  Rotations that are
positive clockwise are angles with a negative factor.  A unit in the name of a column holds for that column.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.mechanics.space import SPACE

COMPOUND = ("rev", "min", "h", "km", "mi")
"""Units of rpm, km/h and mph, which say nothing about other columns."""

SI = MappingProxyType({"length": "m", "mass": "kg", "angle": "rad", "time": "s", "rotation": "counterclockwise"})
"""The stated units of a table as `save` writes it."""

STATED = MappingProxyType({**dict.fromkeys(("length", "mass", "angle", "time")), "rotation": "counterclockwise"})
"""The units that are stated by default: none, so that names of columns state them, or they are SI."""

UNIT_FACTORS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048, "mi": 1609.344},
    "mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "lb": 0.45359237, "oz": 0.028349523125},
    "angle": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "rotation": {"counterclockwise": 1.0, "clockwise": -1.0},
}
"""Factors to SI by quantity and unit."""

_LENGTH, _VELOCITY, _SPIN = {"length": 1}, {"length": 1, "time": -1}, {"angle": 1, "time": -1}
_ANGLE, _INERTIA, _MOMENTUM = {"angle": 1}, {"mass": 1, "length": 2}, {"mass": 1, "length": 1, "time": -1}
POWERS: dict[str, dict[str, int]] = {
    "mass": {"mass": 1},
    **dict.fromkeys(("rx", "ry", "rz", "x", "y", "z"), _LENGTH),
    "theta": _ANGLE,
    **dict.fromkeys(("vx", "vy", "vz"), _VELOCITY),
    **dict.fromkeys(("omega", "wx", "wy", "wz"), _SPIN),
    "time": {"time": 1},
    **dict.fromkeys(("inertia", *SPACE.inertia), _INERTIA),
    "speed": _VELOCITY,
    **dict.fromkeys(("momentum", "px", "py", "pz"), _MOMENTUM),
    "angular_momentum": {"mass": 1, "length": 2, "time": -1},
    "height": _LENGTH,
    **dict.fromkeys(("direction", "direction_normal", "direction_floor"), _ANGLE),
}
"""Powers of the quantities in the unit of a column, of which those after contact and covariances follow."""


class Units:
    """The units of a table; those that are neither stated nor in names are SI.

    Args:
        stated: the unit of each quantity, None where names of columns or SI say it.
        columns: units that the names of single columns state, by our name of the column.

    Raises:
        DataError: not a mapping of quantities to units.
        UnknownNameError: a quantity or unit that does not exist.
    """

    def __init__(self, stated: Mapping[str, str | None], columns: Mapping[str, Mapping[str, str]] | None = None):
        if not isinstance(stated, Mapping):
            raise DataError(f"data.units is given as {{length: mm, angle: deg}}, got {stated!r}")
        for quantity, unit in stated.items():
            if quantity not in UNIT_FACTORS:
                raise UnknownNameError("quantity in data.units:", str(quantity), UNIT_FACTORS)
            if unit is not None and unit not in UNIT_FACTORS[quantity]:
                raise UnknownNameError(f"unit in data.units.{quantity}:", str(unit), UNIT_FACTORS[quantity])
        self.stated = {quantity: unit for quantity, unit in stated.items() if unit is not None}
        self._columns = columns or {}

    def factor(self, column: str) -> float:
        """Return the factor that takes the numbers of a column to SI."""
        if len(both := _velocities(column)) == 2:
            return self.factor(both[0]) * self.factor(both[1])
        powers, units = powers_of(column), self._units(column)
        powers |= {"rotation": powers.get("angle", 0)}
        return math.prod(UNIT_FACTORS[quantity][units[quantity]] ** power for quantity, power in powers.items())

    def text(self, column: str) -> str:
        """Return the unit of a column as it is written in the table."""
        if column == "order":
            return "trials"
        if len(both := _velocities(column)) == 2 and self._columns:
            return " ".join(dict.fromkeys(map(self.text, both)))
        over, under = (
            " ".join(
                self._units(column)[quantity] + {1: "", 2: "²"}[abs(power)]
                for quantity in ("mass", "length", "angle", "time")
                if (power := powers_of(column).get(quantity, 0)) * sign > 0
            )
            for sign in (1, -1)
        )
        return f"{over}/{under}" if under else over

    def _units(self, column: str) -> Mapping[str, str]:
        return {**SI, **self.stated, **self._columns.get(column, {})}


def _velocities(column: str) -> list[str]:
    """The two columns of which a covariance is that; no two for any other column."""
    end = "_post" if column.endswith("_post") else ""
    return [f"{name}{end}" for name in column.removesuffix("_post").split("_")[1:]] if column.startswith("cov_") else []


def powers_of(column: str) -> dict[str, int]:
    """Return the powers of the quantities in the unit of a column; none where it is always the same."""
    name = column.removesuffix("_post")
    if not name.startswith("cov_"):
        return {**POWERS.get(name, {})}
    first, second = (POWERS[part] for part in name.split("_")[1:])
    return {quantity: first.get(quantity, 0) + second.get(quantity, 0) for quantity in (*first, *second)}
