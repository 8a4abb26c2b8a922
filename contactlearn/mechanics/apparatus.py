"""Properties of an apparatus that recordings show without any impact: by free flight, and by where contacts happen.

    gravity       in free flight: differs from 9.81 m/s² where the scale or the frame rate is wrong
    drag          of the air, which the velocities at contact already allow for
    slope         of the floor against the upward axis, from the heights of contacts and of bodies at rest
    orientation   offset of the body's zero of θ, from the same heights, and from θ of bodies at rest
    delay         of the states at contact, which are those of the instant at which two flights meet

Fits keep an effect's parameter between 0 and three standard errors beyond its estimate from free flight: the estimate
bounds the effect, and leaves it free to be absent.

A slope s and a zero of θ that is off by δ follow from heights y = s (x + r_x) − r_y at θ + δ, and to first order s r_x
is what a turn of the body by s does to r_y.  In axes in which x or θ is mirrored alone, that turn is taken for one by
−s: in the right axes δ differs by 2 s.  A mirror of both leaves −δ.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

REACH = 3.0
"""Standard errors within which a value agrees with an estimate."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An estimated value and its standard error."""

    value: float
    error: float

    def times(self, factor: float) -> "Estimate":
        """Return the estimate in another unit or sense."""
        return Estimate(value=factor * self.value, error=abs(factor) * self.error)

    @property
    def range(self) -> tuple[float, float]:
        """The values within three standard errors, and those between them and 0."""
        return min(self.value - REACH * self.error, 0.0), max(self.value + REACH * self.error, 0.0)


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """Estimates of an apparatus; None where there is none.

    Args:
        gravity: in m/s².
        drag: linear drag of the air in 1/s.
        slope: of the floor in rad.
        orientation: to be added to θ, in rad.
        delay: in s.
    """

    gravity: Estimate
    drag: Estimate | None
    slope: Estimate | None
    orientation: Estimate | None
    delay: Estimate

    def parameters(self) -> Iterator[tuple[str, Estimate]]:
        """Yield the estimates of effects' parameters, by `effect.parameter`."""
        known = (
            ("surface_tilt.phi", self.slope),
            ("orientation_offset.delta", self.orientation),
            ("sampling_delay.dt", self.delay),
            ("gravity_impulse.dt", self.delay),
        )
        return ((name, one) for name, one in known if one is not None)

    def without(self, *names: str) -> "Apparatus":
        """Return the apparatus without some of its optional estimates, which make no sense in other units or axes."""
        return replace(self, **dict.fromkeys(names))

    def with_x_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose x is mirrored, and whose θ is not."""
        return replace(self, slope=self.slope and self.slope.times(-1), orientation=self._turned(1))

    def with_y_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose y is mirrored, and with it the heights that show the zero of θ."""
        return replace(self, slope=self.slope and self.slope.times(-1), orientation=None)

    def with_theta_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose θ is mirrored, and whose x is not."""
        return replace(self, orientation=self._turned(-1))

    def from_millimetres(self) -> "Apparatus":
        """Return the estimates for positions that were in mm; heights were compared with a shape in m."""
        return replace(self, gravity=self.gravity.times(1e-3), orientation=None)

    def _turned(self, sense: int) -> Estimate | None:
        """The zero ±(δ − 2 s); unknown with the slope."""
        zero, slope = self.orientation, self.slope
        if zero is None or slope is None:
            return None
        error = math.hypot(zero.error, 2 * slope.error)
        return Estimate(value=sense * (zero.value - 2 * slope.value), error=error)


@dataclass(frozen=True, kw_only=True)
class KnownParameter:
    """A fitted parameter that free flight has estimated as well.

    Args:
        name: `effect.parameter`.
        symbol: of the parameter.
        unit: of the numbers.
        value: fitted within the range that flight allows.
        alone: fitted to the impacts alone.
        flight: estimate from free flight.
    """

    name: str
    symbol: str
    unit: str
    value: float
    alone: Estimate
    flight: Estimate

    @property
    def contradicted(self) -> bool:
        """Whether impacts and flight differ by more than their errors."""
        apart = abs(self.alone.value - self.flight.value)
        return apart > REACH * math.hypot(self.alone.error, self.flight.error)

    @property
    def more(self) -> bool:
        """Whether the impacts alone exceed the range that flight allows."""
        low, high = self.flight.range
        return not low <= self.alone.value <= high

    @property
    def better_in_flight(self) -> bool:
        """Whether flight estimates it more precisely than the impacts."""
        return not self.alone.error < self.flight.error
