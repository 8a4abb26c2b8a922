"""Properties of an apparatus that measurements show without any law of contact: the rig card.

    gravity       in free flight: differs from 9.81 m/s² where the scale or the frame rate is wrong
    drag          of the air, which the velocities at contact already allow for
    friction      μ of bodies that slide on a side until they stop, which need not be that of impacts
    delay         of the states at contact, which are those of the instant at which two flights meet
    late          time from the instant of a frame's angle to that of its position, from the heights of contacts
    slope         of the floor along x against the upward axis, in space slope_b along y, from the heights of contacts
                  and of bodies at rest
    orientation   offset of the body's zero of θ, from the same heights, and from θ of bodies at rest
    corner        radius of a polygon's corners, from the heights of contacts against θ
    oblong        change of an ellipse's longer semi-axis, the shorter one as stated: heights tell their difference
    middle        of the body's outline about the tracked point, in the body's axes, from the same heights
    centre        of mass about the tracked point, in the body's axes, from the wobble of free flights
    inertia       ln I/I₀ about the stated one, from the moment balance of impacts
    rocking       the same inertia and centre of mass as bodies show them that rock on an edge: other frames

Gravity, drag, friction, delay and what rocking shows are what they are; each of the others is an amount by which the
stated value is to be changed, and is 0 once it has been.  `Apparatus.rows` lists all of them beside the values that
were stated.

Fits keep an effect's parameter between 0 and three standard errors beyond its estimate from free flight: the estimate
bounds the effect, and leaves it free to be absent.

A slope s and a zero of θ that is off by δ follow from heights y = s (x + r_x) − r_y at θ + δ, and to first order s r_x
is what a turn of the body by s does to r_y.  In axes in which x or θ is mirrored alone, that turn is taken for one by
−s: in the right axes δ differs by 2 s.  A mirror of both leaves −δ.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

from contactlearn.core.numerics import READABLE_UNITS, measured, readable
from contactlearn.mechanics.rigid_body import GRAVITY

REACH = 3.0
"""Standard errors within which a value agrees with an estimate."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An estimated value and its standard error; of a change, also how much of it the data have already had."""

    value: float
    error: float
    applied: float = 0.0

    def times(self, factor: float) -> "Estimate":
        """Return the estimate in another unit or sense."""
        return Estimate(value=factor * self.value, error=abs(factor) * self.error, applied=factor * self.applied)

    def made(self) -> "Estimate":
        """Return what is left of a change after it was made: its error."""
        return replace(self, value=0.0, applied=self.applied + self.value)

    @property
    def range(self) -> tuple[float, float]:
        """The values within three standard errors, and those between them and 0."""
        return min(self.value - REACH * self.error, 0.0), max(self.value + REACH * self.error, 0.0)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One property on the rig card.

    Args:
        name: of the field of `Apparatus`.
        quantity: in words.
        symbol: of the quantity.
        unit: SI; – for a number.
        estimate: measured.
        stated: value that was stated or assumed; None where none was.
        known_from: what shows it, in words.
    """

    name: str
    quantity: str
    symbol: str
    unit: str
    estimate: Estimate
    stated: float | None
    known_from: str

    @property
    def differs(self) -> bool:
        """Whether the measured value differs from the stated one by more than three standard errors."""
        return self.stated is not None and abs(self._value - self.stated) > REACH * self.estimate.error

    @property
    def _value(self) -> float:
        return self.estimate.value + self.estimate.applied

    @property
    def measured(self) -> str:
        """Value and error as people read them: 1.96 ± 0.02°; an inertia as a ratio."""
        value, error = self._value, self.estimate.error
        if self.symbol == "κ":
            value, error = math.exp(value), math.exp(value) * error
        return readable(value, error, self.unit)

    @property
    def said(self) -> str:
        """The stated value as people read it; empty where none was."""
        unit, _ = READABLE_UNITS.get(self.unit, (self.unit, 1.0))
        return "" if self.stated is None else measured(self.stated + (self.name == "inertia"), None, unit)

    def __str__(self) -> str:
        return f"{self.quantity} {self.measured}"


_IN_THE_BODY = ("middle_a", "middle_b", "middle_c", "centre_a", "centre_b", "centre_c")
CHANGES = ("slope", "slope_b", "orientation", "late", "corner", "oblong", *_IN_THE_BODY, "inertia")
"""Fields of `Apparatus` by which impacts can be corrected."""
_OF_HEIGHTS = ("corner", "oblong")
ROCKING = ("rocking_inertia", "rocking_a", "rocking_b", "rocking_c")
"""Fields of `Apparatus` that bodies show which rock on an edge."""
_HEIGHTS, _EDGES = "heights of contacts against θ", "rocking on edges, measured independently"
_LISTED = (
    ("gravity", "gravity", "g", "m/s²", GRAVITY, "free flights"),
    ("drag", "drag of the air", "k", "1/s", None, "free flights"),
    ("friction", "friction of slides", "μ", "–", None, "slides on a side to rest"),
    ("delay", "delay of the states", "Δt", "s", 0.0, "contacts at which two flights meet"),
    ("slope", "slope of the floor", "φ", "rad", 0.0, "heights of contacts and rests"),
    ("slope_b", "slope of the floor along y", "ψ", "rad", 0.0, "heights of contacts and rests"),
    ("orientation", "zero of θ", "δ", "rad", 0.0, f"rests and {_HEIGHTS}"),
    ("late", "positions after angles by", "Δt_θ", "s", 0.0, _HEIGHTS),
    ("corner", "radius of the corners", "ρ_c", "m", 0.0, _HEIGHTS),
    ("oblong", "change of the longer semi-axis", "a", "m", 0.0, _HEIGHTS),
    ("middle_a", "middle of the outline along x", "m_a", "m", 0.0, _HEIGHTS),
    ("middle_b", "middle of the outline along y", "m_b", "m", 0.0, _HEIGHTS),
    ("middle_c", "middle of the outline along z", "m_c", "m", 0.0, _HEIGHTS),
    ("centre_a", "centre of mass along x", "δ_a", "m", 0.0, "wobble of flights, moment balance"),
    ("centre_b", "centre of mass along y", "δ_b", "m", 0.0, "wobble of flights, moment balance"),
    ("centre_c", "centre of mass along z", "δ_c", "m", 0.0, "wobble of flights, moment balance"),
    ("inertia", "inertia over the stated one", "κ", "–", 0.0, "moment balance of impacts"),
    ("rocking_inertia", "inertia over the stated one", "κ", "–", None, _EDGES),
    ("rocking_a", "centre of mass along x", "δ_a", "m", None, _EDGES),
    ("rocking_b", "centre of mass along y", "δ_b", "m", None, _EDGES),
    ("rocking_c", "centre of mass along z", "δ_c", "m", None, _EDGES),
)
PROPERTIES: dict[str, dict[str, Any]] = {
    name: {"quantity": quantity, "symbol": symbol, "unit": unit, "stated": stated, "known_from": known_from}
    for name, quantity, symbol, unit, stated, known_from in _LISTED
}
"""What `Row` says of each field of `Apparatus`."""


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """Estimates of an apparatus; None where there is none.  `PROPERTIES` has their units; changes are about 0."""

    gravity: Estimate
    drag: Estimate | None = None
    friction: Estimate | None = None
    delay: Estimate
    slope: Estimate | None = None
    slope_b: Estimate | None = None
    orientation: Estimate | None = None
    late: Estimate | None = None
    corner: Estimate | None = None
    oblong: Estimate | None = None
    middle_a: Estimate | None = None
    middle_b: Estimate | None = None
    middle_c: Estimate | None = None
    centre_a: Estimate | None = None
    centre_b: Estimate | None = None
    centre_c: Estimate | None = None
    inertia: Estimate | None = None
    rocking_inertia: Estimate | None = None
    rocking_a: Estimate | None = None
    rocking_b: Estimate | None = None
    rocking_c: Estimate | None = None

    def rows(self) -> tuple[Row, ...]:
        """The rig card: every estimate beside the stated value."""
        return tuple(
            Row(name=name, estimate=one, **known)
            for name, known in PROPERTIES.items()
            if (one := getattr(self, name)) is not None
        )

    @property
    def differing(self) -> tuple[Row, ...]:
        """Changes of what was stated that are sure, and not made yet."""
        return tuple(row for row in self.rows() if row.name in CHANGES and row.differs and not row.estimate.applied)

    @property
    def applied(self) -> tuple[Row, ...]:
        """Changes that were made."""
        return tuple(row for row in self.rows() if row.estimate.applied)

    @property
    def beside(self) -> tuple[float, float, float]:
        """Mass centre in m from the middle of the outline, along the body's axes, as far as corrections have moved it.

        Contact points have it; the shape, whose middle is its origin, does not.
        """
        made = {row.name: row.estimate.applied for row in self.applied}
        a, b, c = (made.get(f"centre_{axis}", 0.0) - made.get(f"middle_{axis}", 0.0) for axis in "abc")
        return a, b, c

    def parameters(self) -> Iterator[tuple[str, Estimate]]:
        """Yield the estimates of effects' parameters, by `effect.parameter`."""
        known = (
            ("surface_tilt.phi", self.slope),
            ("surface_tilt.psi", self.slope_b),
            ("orientation_offset.delta", self.orientation),
            ("sampling_delay.dt", self.delay),
            ("gravity_impulse.dt", self.delay),
            ("corner_radius.rho_c", self.corner),
            ("com_offset.delta_a", self.centre_a),
            ("com_offset.delta_b", self.centre_b),
            ("com_offset.delta_c", self.centre_c),
            ("inertia_error.kappa", self.inertia),
        )
        return ((name, one) for name, one in known if one is not None)

    def without(self, *names: str) -> "Apparatus":
        """Return the apparatus without some of its optional estimates, which make no sense in other units or axes.

        Rocking is left out with them.
        """
        return replace(self, **dict.fromkeys((*names, *ROCKING)))

    def with_x_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose x is mirrored, and whose θ is not."""
        return replace(
            self.without(*_IN_THE_BODY), slope=self.slope and self.slope.times(-1), orientation=self._turned(1)
        )

    def with_y_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose y is mirrored, and with it the heights that show the zero of θ."""
        return replace(self.without(*_IN_THE_BODY, "orientation"), slope=self.slope and self.slope.times(-1))

    def with_theta_mirrored(self) -> "Apparatus":
        """Return the estimates in axes whose θ is mirrored, and whose x is not."""
        return replace(self.without(*_IN_THE_BODY), orientation=self._turned(-1))

    def from_length(self, factor: float) -> "Apparatus":
        """Return the estimates for positions in another unit, that are to be multiplied by a factor."""
        return replace(self.without_outline(), gravity=self.gravity.times(factor))

    def without_outline(self) -> "Apparatus":
        """Return the estimates without those for which heights were compared with the shape."""
        return self.without(*_IN_THE_BODY, *_OF_HEIGHTS, "orientation")

    def _turned(self, sense: int) -> Estimate | None:
        """The zero ±(δ − 2 s); unknown with the slope."""
        zero, slope = self.orientation, self.slope
        if zero is None or slope is None:
            return None
        error = math.hypot(zero.error, 2 * slope.error)
        return Estimate(value=sense * (zero.value - 2 * slope.value), error=error)

    def to_columns(self) -> dict[str, float]:
        """Return the estimates as a table has them, by column."""
        known = {name: one for name in PAIRS if (one := getattr(self, name)) is not None}
        pairs = {PAIRS[name]: (one.value, one.error) for name, one in known.items()}
        columns = {name: x for names, pair in pairs.items() for name, x in zip(names, pair, strict=True)}
        applied = {APPLIED[name]: one.applied for name, one in known.items() if name in APPLIED and one.applied}
        return columns | applied


PAIRS = {field.name: (f"apparatus_{field.name}", f"apparatus_{field.name}_error") for field in fields(Apparatus)}
"""The columns of a value and its standard error, by the field of `Apparatus` that they fill."""
APPLIED = {name: f"apparatus_{name}_applied" for name in CHANGES}
"""The columns of what the data have had of a change, by the field of `Apparatus`; where it is not 0."""


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
