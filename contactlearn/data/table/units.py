"""Units and sense of rotation in which a table is written, and the factors that take its numbers to SI, y up.

Four units are stated, and the sense in which θ and ω are positive; all others follow from them: velocities are lengths
a time, an inertia is a mass times a squared length, a covariance is the product of its two velocities.  Rotations that
are positive clockwise are angles with a negative factor.  What is known of the apparatus (`known`) is always in SI.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType

from contactlearn.core.errors import DataError, UnknownNameError

SI = MappingProxyType({"length": "m", "mass": "kg", "angle": "rad", "time": "s", "rotation": "counterclockwise"})
"""The stated units of a table as `save` writes it."""

CHOICES: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254},
    "mass": {"kg": 1.0, "g": 1e-3},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "time": {"s": 1.0, "ms": 1e-3},
    "rotation": {"counterclockwise": 1.0, "clockwise": -1.0},
}
"""Factors to SI by quantity and unit."""

_LENGTH, _VELOCITY = {"length": 1}, {"length": 1, "time": -1}
_POWERS: dict[str, dict[str, int]] = {
    "mass": {"mass": 1},
    "inertia": {"mass": 1, "length": 2},
    "rx": _LENGTH,
    "ry": _LENGTH,
    "x": _LENGTH,
    "y": _LENGTH,
    "theta": {"angle": 1},
    "vx": _VELOCITY,
    "vy": _VELOCITY,
    "omega": {"angle": 1, "time": -1},
    "time": {"time": 1},
}
"""Dimensions of columns, of which those after contact and covariances follow."""


class Units:
    """The stated units of a table; those that are not stated are SI.

    Raises:
        DataError: not a mapping of quantities to units.
        UnknownNameError: a quantity or unit that does not exist.
    """

    def __init__(self, stated: Mapping[str, str]):
        if not isinstance(stated, Mapping):
            raise DataError(f"data.units is given as {{length: mm, angle: deg}}, got {stated!r}")
        for quantity, unit in stated.items():
            if quantity not in CHOICES:
                raise UnknownNameError("quantity in data.units:", str(quantity), CHOICES)
            if unit not in CHOICES[quantity]:
                raise UnknownNameError(f"unit in data.units.{quantity}:", str(unit), CHOICES[quantity])
        self._stated = {**SI, **stated}

    def factor(self, column: str) -> float:
        """Return the factor that takes the numbers of a column to SI."""
        powers = _powers(column)
        powers |= {"rotation": powers.get("angle", 0)}
        return math.prod(CHOICES[quantity][self._stated[quantity]] ** power for quantity, power in powers.items())

    def text(self, column: str) -> str:
        """Return the unit of a column as it is written in the table."""
        if column == "order":
            return "trials"
        over, under = (
            " ".join(
                self._stated[quantity] + {1: "", 2: "²"}[abs(power)]
                for quantity in ("mass", "length", "angle", "time")
                if (power := _powers(column).get(quantity, 0)) * sign > 0
            )
            for sign in (1, -1)
        )
        return f"{over}/{under}" if under else over


def _powers(column: str) -> dict[str, int]:
    """Powers of the quantities in the unit of a column; none where it is always the same."""
    name = column.removesuffix("_post")
    if not name.startswith("cov_"):
        return {**_POWERS.get(name, {})}
    first, second = (_POWERS[part] for part in name.split("_")[1:])
    return {quantity: first.get(quantity, 0) + second.get(quantity, 0) for quantity in (*first, *second)}
