"""What is known of an apparatus without any impact: from free flight, and from where contacts happen.

    gravity       of free flight: not 9.81 m/s² where the scale or the frame rate is wrong
    drag          of the air, which the velocities at contact already allow for
    slope         of the floor against the axis that is called up, from the heights of contacts and of bodies at rest
    orientation   by which the body's zero of θ is off, from the same heights, and from θ of bodies at rest
    delay         of the states at contact, which are those of the instant at which two flights meet

The parameters of effects that say the same are fitted between 0 and three standard errors beyond these values: what is
known bounds an effect, and leaves it free to be absent.
"""

from collections.abc import Iterator
from dataclasses import dataclass

REACH = 3.0
"""Standard errors from a measured value that are still in accord with it."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured value and its standard error."""

    value: float
    error: float

    def times(self, factor: float) -> "Measured":
        """The same in another unit or sense."""
        return Measured(value=factor * self.value, error=abs(factor) * self.error)

    @property
    def range(self) -> tuple[float, float]:
        """The values within three standard errors, and those between them and 0."""
        return min(self.value - REACH * self.error, 0.0), max(self.value + REACH * self.error, 0.0)


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """What is known of an apparatus; None where it is not.

    Args:
        gravity: in m/s².
        drag: linear drag of the air in 1/s.
        slope: of the floor in rad.
        orientation: that is to be added to θ, in rad.
        delay: in s.
    """

    gravity: Measured
    drag: Measured | None
    slope: Measured | None
    orientation: Measured | None
    delay: Measured

    def parameters(self) -> Iterator[tuple[str, Measured]]:
        """Return what is known of the parameters of effects, by `effect.parameter`."""
        known = (
            ("surface_tilt.phi", self.slope),
            ("orientation_offset.delta", self.orientation),
            ("sampling_delay.dt", self.delay),
            ("gravity_impulse.dt", self.delay),
        )
        return ((name, one) for name, one in known if one is not None)
