"""Thresholds of recordings: every number that decides which contacts are accepted and which conventions are found.

Each field has its unit, its reason, and the row of `benchmarks/thresholds.py` that shows false alarms and power over
a range of its values.
"""

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class FlightThresholds:
    """Limits of free flights, and of what may happen between two of them."""

    rest_power: float = 150.0
    """χ² that a body at rest makes in the shortest window that is taken for a flight
    (row tracks.flight.rest_power)."""
    excess: float = 6.0
    """Standard deviations of χ² above its mean up to which a window is a flight (row tracks.flight.excess)."""
    continued: float = 3.0
    """Standard deviations up to which a frame continues a flight (row tracks.flight.continued)."""
    same: float = 60.0
    """χ² with six degrees of freedom up to which two flights are one (row tracks.flight.same)."""
    meets: float = 18.0
    """Squared distance in standard deviations, with two degrees of freedom, up to which two flights meet: one of 8000
    by chance (row tracks.flight.meets)."""
    certainty: float = 0.95
    """Probability of the number of missing frames, at least (row tracks.flight.certainty)."""
    moved: float = 25.0
    """Squared change of velocity in standard deviations: less is no contact (row tracks.flight.moved)."""
    still: float = 0.03
    """Speed in m/s below which a body that is not in flight is at rest, and above which it slides
    (row tracks.flight.still)."""
    high: float = 0.3
    """Height above the lowest frame over the range of heights, from which on a hand or a wall was touched
    (row tracks.flight.high)."""
    uneven: float = 20.0
    """Range of heights in standard deviations of a frame, from which on heights differ at all
    (row tracks.flight.uneven)."""


@dataclass(frozen=True, kw_only=True)
class FrameThresholds:
    """Limits of units, axes and orders, stated or found."""

    scale: float = 0.03
    """Relative distance of a measured gravity from 9.81 m/s² (row tracks.frame.scale)."""
    upright: float = math.radians(2)
    """Angle in rad of gravity from an axis of the file that is taken for up (row tracks.frame.upright)."""
    leaning: float = math.radians(10)
    """Angle in rad of gravity from an axis that is stated to be up (row tracks.frame.leaning)."""
    aligned: float = math.radians(8)
    """Angle in rad of the axis of rotation from the normal of the plane of motion, and of the turn of a body in eight
    frames, without which no order of the quaternion is seen (row tracks.frame.aligned)."""
    flat: float = 0.2
    """Spread across the plane over that along it, up to which positions show the plane (row tracks.frame.flat)."""
    reading: float = 0.3
    """Share of the moment balance that the best reading of angles leaves over, of what any other leaves
    (row tracks.frame.reading)."""
    lean_sigmas: float = 2.0
    """Standard errors, which are on the large side, of a gravity that leans: its error would be one of all velocities
    alike (row tracks.frame.lean_sigmas)."""
    drag_sigmas: float = 3.0
    """Standard errors of a drag that is allowed for (row tracks.frame.drag_sigmas)."""


@dataclass(frozen=True, kw_only=True)
class RestThresholds:
    """Limits of bodies at rest."""

    moves: float = 1.5
    """Change of a mean pose over a tenth of a second in standard deviations of a frame, up to which a body is still:
    one that rocks moves by more (row tracks.rest.moves)."""
    lasts: float = 0.3
    """Time in s for which it is (row tracks.rest.lasts)."""


@dataclass(frozen=True, kw_only=True)
class FloorThresholds:
    """Limits of the floor that contacts share."""

    off_sigmas: float = 8.0
    """Height of a contact above the floor in robust standard deviations (row tracks.floor.off_sigmas)."""
    off_least: float = 1e-3
    """The same height in m, at least (row tracks.floor.off_least)."""
    contacts_of_a_slope: int = 12
    """Contacts and bodies at rest that tell the floor's slope; twice as many contacts tell the body's zero of θ
    (row tracks.floor.contacts_of_a_slope)."""
    rests_of_a_zero: int = 6
    """Bodies at rest that tell the zero of θ where the slope is told (row tracks.floor.rests_of_a_zero)."""
    leaning: float = math.radians(10)
    """Angle in rad between a body at rest and the nearest side that it can lie on: one that is further off leans
    against something (row tracks.floor.leaning)."""


@dataclass(frozen=True, kw_only=True)
class TrackThresholds:
    """Limits of every decision between recordings and impacts."""

    apart: float = 0.005
    """Distance in m of the tracked point from the plane of motion (row tracks.apart)."""
    tilted: float = math.radians(5)
    """Tilt in rad of the body out of it (row tracks.tilted)."""
    flight: FlightThresholds = field(default_factory=FlightThresholds)
    """Of flights and contacts."""
    frame: FrameThresholds = field(default_factory=FrameThresholds)
    """Of conventions."""
    rest: RestThresholds = field(default_factory=RestThresholds)
    """Of bodies at rest."""
    floor: FloorThresholds = field(default_factory=FloorThresholds)
    """Of the floor."""
