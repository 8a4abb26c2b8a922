"""Thresholds of recordings: every number that decides which contacts are accepted and which conventions are found.

Each field has its unit, its reason, and the row of `benchmarks/sensitivity` that shows false alarms and power over a
range of its values.  Constants of the numerical methods stand beside their code.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrackThresholds:
    """Limits of every decision between recordings and impacts."""

    plane_distance: float = 0.005
    """Distance in m of the tracked point from the plane of motion (row tracks.plane_distance)."""
    plane_tilt: float = math.radians(5)
    """Tilt in rad of the body out of it (row tracks.plane_tilt)."""
    excess: float = 6.0
    """Standard deviations of χ² above its mean up to which a window is a flight (row tracks.excess)."""
    meets: float = 18.0
    """Squared distance in standard deviations, with two degrees of freedom, up to which two flights meet: one of 8000
    by chance (row tracks.meets)."""
    certainty: float = 0.95
    """Probability of the number of missing frames, at least (row tracks.certainty)."""
    velocity_change: float = 25.0
    """Squared change of velocity in standard deviations: less is no contact (row tracks.velocity_change)."""
    one_flight: float = 60.0
    """χ² with twice as many degrees of freedom as a pose has coordinates, up to which two flights agree and are one; 5
    to 180 decide alike (row tracks.one_flight)."""
    continues: float = 3.0
    """Standard deviations up to which a frame continues a flight; less loses contacts, 10 decides alike
    (row tracks.continues)."""
    rest_speed: float = 0.03
    """Speed in m/s below which a body that is not in flight is at rest, and above which it slides
    (row tracks.rest_speed)."""
    lies_height: float = 0.006
    """Median height in m of the lowest point of a body in space above that of its lowest frame, up to which the body
    slides: round corners and the axes of a marker set leave some mm (row tracks.lies_height)."""
    hand_height: float = 0.3
    """Height above the lowest frame over the range of heights, from which on a hand or a wall was touched
    (row tracks.hand_height)."""
    height_range: float = 20.0
    """Range of the heights of a recording in standard deviations of a frame, below which no hand or wall is named; 20
    to 80 decide alike (row tracks.height_range)."""
    wrap: float = 0.3
    """Share of the period of an angle: from frame to frame it turns by less, or jumps by a period less that; its range
    exceeds the period by less as well.  A body that turns by more is too fast to follow modulo that period
    (row tracks.wrap)."""
    scale: float = 0.03
    """Relative distance of a measured gravity from 9.81 m/s² (row tracks.scale)."""
    leaning: float = math.radians(10)
    """Angle in rad of gravity from an axis that is stated to be up, and of a body at rest from the nearest side that it
    can lie on: one that is further off leans against something; for bodies at rest 10° to 90° decide alike
    (row tracks.leaning)."""
    aligned: float = math.radians(8)
    """Angle in rad of the axis of rotation from the normal of the plane of motion, and of the turn of a body in eight
    frames, without which no order of the quaternion is found (row tracks.aligned)."""
    reading: float = 0.3
    """Residual of the moment balance with the best reading of angles, relative to any other (row tracks.reading)."""
    likely: float = 0.6
    """The same, up to which the best reading is taken and the next one named; the audit's balance then decides."""
    off_sigmas: float = 8.0
    """Height of a contact above the floor in robust standard deviations (row tracks.off_sigmas)."""
    off_least: float = 1e-3
    """The same height in m, at least (row tracks.off_least)."""
    contacts_of_a_slope: int = 12
    """Contacts and bodies at rest that show the floor's slope; twice as many contacts, or half as many bodies at rest
    among them, show the body's zero of θ (row tracks.contacts_of_a_slope)."""

    def meets_in(self, coordinates: int) -> float:
        """The same distance with one degree of freedom less than a pose has coordinates, as rare by chance."""
        from scipy.special import chdtri  # SciPy takes long to load

        return self.meets if coordinates == 3 else float(chdtri(coordinates - 1, math.exp(-self.meets / 2)))
