"""What is known of an apparatus in corrected units and axes: the other half of a correction of measurements.

A slope s and a zero of θ that is off by δ are told from heights y = s (x + r_x) − r_y at θ + δ, and to first order
s r_x is what a turn of the body by s does to r_y.  In axes in which x or θ is mirrored alone, that turn is taken for
one by −s: in the right axes δ differs by 2 s.  A mirror of both leaves −δ.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from contactlearn.mechanics.apparatus import Apparatus, Measured

Known = Callable[[Apparatus], Apparatus]


def kept(apparatus: Apparatus) -> Apparatus:
    """What is known, of units and axes that are as before."""
    return apparatus


def without(*names: str) -> Known:
    """Forget fields that are not mandatory, which make no sense in other units or axes."""
    return lambda apparatus: replace(apparatus, **dict.fromkeys(names))


def mirrored_x(apparatus: Apparatus) -> Apparatus:
    """x was mirrored, and θ was not."""
    slope, orientation = apparatus.slope, apparatus.orientation
    return replace(apparatus, slope=slope and slope.times(-1), orientation=_turned(orientation, slope, 1))


def mirrored_y(apparatus: Apparatus) -> Apparatus:
    """y was mirrored, and with it the heights that tell the zero of θ."""
    return replace(apparatus, slope=apparatus.slope and apparatus.slope.times(-1), orientation=None)


def mirrored_theta(apparatus: Apparatus) -> Apparatus:
    """θ was mirrored, and x was not."""
    return replace(apparatus, orientation=_turned(apparatus.orientation, apparatus.slope, -1))


def millimetres(apparatus: Apparatus) -> Apparatus:
    """Positions were in mm, and with them their second difference; heights were compared with a shape in m."""
    return replace(apparatus, gravity=apparatus.gravity.times(1e-3), orientation=None)


def _turned(orientation: Measured | None, slope: Measured | None, sense: int) -> Measured | None:
    """The zero ±(δ − 2 s); unknown with the slope."""
    if orientation is None or slope is None:
        return None
    return Measured(
        value=sense * (orientation.value - 2 * slope.value), error=math.hypot(orientation.error, 2 * slope.error)
    )
