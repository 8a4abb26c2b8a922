"""How many samples show a quantity of recordings: one table for all of its modules.

With fewer samples a quantity is not stated, or asked for.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Sufficiency:
    """Numbers of samples, at least."""

    frames_of_recording: int = 2
    """Frames of a recording, which then has a time between two of them."""
    windows_of_gravity: int = 6
    """Windows with one acceleration that is taken for gravity: a few agree by chance."""
    runs_without_gravity: int = 8
    """Runs from hit to hit that show whether their accelerations have a direction in common."""
    flights_of_drag: int = 4
    """Flights for each unknown of gravity and drag, for the scatter between them to show the error of a drag."""
    flights_of_accelerations: int = 8
    """Flights whose accelerations of their own show those of all."""
    flights_of_centre: int = 8
    """Flights that show the error of a mass centre, by leaving out each (jackknife)."""
    slides_of_friction: int = 8
    """Slides whose quartiles show the error of their median."""
    recordings_of_rocking: int = 12
    """Recordings with rocking, for the scatter between them to show the error of inertia and mass centre."""
    markers_of_hull: int = 3
    """Markers with a hull in the plane."""
    contacts_of_reading: int = 3
    """Contacts that compare readings of angles."""
    heights_of_slope: int = 3
    """Heights to which a slope is fitted, so that those off it can be refused."""
    heights_of_error: int = 4
    """Heights that scatter about a floor with a slope: its plane goes through three or fewer."""
    rests_of_scatter: int = 6
    """Bodies at rest whose heights show their own scatter; fewer are believed as contacts are."""


NEEDED = Sufficiency()
