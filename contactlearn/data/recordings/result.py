"""Results of the step from a track to impacts: contacts between free flights, and refusals with reason and number."""

from dataclasses import dataclass
from enum import StrEnum

from jaxtyping import Float

from contactlearn.data.recordings.flights import Flight
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.track import Track


class Reason(StrEnum):
    """Why a recording, or a part of it, is no impact between two free flights."""

    DOUBLE_HIT = "double_hit"
    SECOND_CORNER = "second_corner"
    SLIDING = "sliding"
    IN_THE_AIR = "in_the_air"
    REST = "rest"
    TOO_FEW_FRAMES = "too_few_frames"
    LOST_FRAMES = "lost_frames"
    HAND_OR_WALL = "hand_or_wall"
    OUT_OF_PLANE = "out_of_plane"
    NOT_READ = "not_read"


REASONS = {
    Reason.DOUBLE_HIT: "several hits",
    Reason.SECOND_CORNER: "a second corner may have hit too",
    Reason.SLIDING: "sliding or rolling",
    Reason.IN_THE_AIR: "off the floor, but in no free flight",
    Reason.REST: "at rest",
    Reason.TOO_FEW_FRAMES: "too few frames",
    Reason.LOST_FRAMES: "frames lost at the wrong moment",
    Reason.HAND_OR_WALL: "a hand or a wall",
    Reason.OUT_OF_PLANE: "out of the plane",
    Reason.NOT_READ: "could not be read",
}
"""Reasons of refusals as a person writes them."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Refusal:
    """A recording, or a part of it, that is no impact.

    Args:
        recording: its name.
        reason: of the refusal.
        quantity: name of the number that decided.
        value: that number.
        unit: of the number.
        time: s, from the first frame concerned to the last.
        message: the error, of a recording that could not be read.
    """

    recording: str
    reason: Reason
    quantity: str
    value: float
    unit: str
    time: tuple[float, float] = (0.0, 0.0)
    message: str = ""


@dataclass(frozen=True, eq=False, kw_only=True, slots=True)
class RecordedContact:
    """One contact between two free flights, at the instant at which they meet.

    Args:
        recording: name of its recording.
        number: among the contacts of the recording, from 1.
        time: of contact in s.
        v_pre: (v_x, v_y, ω) before contact; in space six.
        v_post: those after it.
        pose: (x, y, θ) at contact, θ in [−π, π); in space a position and a quaternion.
        covariance: of the errors of (v_pre, v_post, pose, time), those of a pose in space by `poses.away`.
        missing: frames at contact that the recording skips without a gap in its time stamps.
        certainty: probability that this is their number.
        lost: frames at contact that are marked as lost.
        chi_square: squared distance of the two flights there in standard deviations; 2 is expected, 5 in space.
        lasting: s about its instant in which frames are in no flight.
        flight: place of the flight before contact among those of its track; the one after contact is the next.
    """

    recording: str
    number: int
    time: float
    v_pre: Float[Array, "k"]
    v_post: Float[Array, "k"]
    pose: Float[Array, "m"]
    covariance: Float[Array, "c c"]
    missing: int
    certainty: float
    lost: int
    chi_square: float
    lasting: float
    flight: int

    @property
    def name(self) -> str:
        """Trial name: recording name and contact number."""
        return f"{self.recording}#{self.number}"


@dataclass(frozen=True, eq=False, kw_only=True, slots=True)
class Rest:
    """A body that is still.

    Args:
        recording: name of its recording.
        pose: mean (x, y, θ), θ in [−π, π); in space a position and a quaternion.
        error: standard errors of the mean (x, y, θ), six in space, from the scatter of its parts, without the error
            that all of them share.
    """

    recording: str
    pose: Float[Array, "m"]
    error: Float[Array, "k"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SlideToRest:
    """A body that slides on a side until it stops.

    Args:
        recording: name of its recording.
        deceleration: in m/s².
        speed: mean in m/s.
    """

    recording: str
    deceleration: float
    speed: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchedTrack:
    """Flights, contacts, refusals, rests and slides of one track.

    Args:
        track: in the plane of motion or in space, of the centre of mass.
        sigma: standard deviations of a frame's (x, y, θ), in space six, about the flights, in m and rad.
        flights: free flights, in their order.
        contacts: accepted contacts.
        refusals: of the other parts.
        rests: where the body is still.
        slides: where it slides until it stops.
        wobbles: of the flights, see `wobble`.
        rocking: on edges, see `rocking`.
    """

    track: Track
    sigma: Float[Array, "k"]
    flights: tuple[Flight, ...]
    contacts: tuple[RecordedContact, ...]
    refusals: tuple[Refusal, ...]
    rests: tuple[Rest, ...] = ()
    slides: tuple[SlideToRest, ...] = ()
    wobbles: tuple[Float[Array, "d e"], ...] = ()
    rocking: Float[Array, "w 4 18"] | None = None
