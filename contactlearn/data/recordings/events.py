"""What happens between the free flights of a track: contacts, and everything else with its reason and number.

before the first flight, after the last   a hand, a body at rest, rolling or sliding, or frames that are too few
between two flights                       one contact if both meet at an instant; otherwise
    frames that are in neither flight       several hits, sliding, rest, a hand
    flights that miss each other            several hits within a frame
    no change of velocity                   frames that are missing in the middle of a flight
    more frames lost than can be counted    whatever happened there
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from contactlearn.data.recordings.contact import Meeting, close, cut, hit_of, meet
from contactlearn.data.recordings.detection import FlightOptions, Flights, apart, find_flights
from contactlearn.data.recordings.flight import Flight
from contactlearn.data.recordings.result import Found, Hit, Reason, Refusal
from contactlearn.data.recordings.thresholds import FlightThresholds
from contactlearn.data.recordings.track import Track, turn

_EDGES = 2  # frames that a flight may be shorter than a window, if it is seen where it ends


def find_contacts(
    track: Track, options: FlightOptions = FlightOptions(), limits: FlightThresholds = FlightThresholds()
) -> Found:
    """Find the contacts of a track between free flights, and refuse everything else."""
    found = find_flights(track, options, limits)
    flights, contacts, refusals = list(found.flights), list[Hit](), list[Refusal]()
    if not flights:
        refusals = [_gap(track, 0, len(track) - 1, found, limits)]
        return Found(track=track, sigma=found.sigma, flights=(), contacts=(), refusals=tuple(refusals))
    if flights[0].first > 0:
        refusals.append(_gap(track, 0, flights[0].first - 1, found, limits))
    meetings = [_one_contact(track, *pair, options, limits) for pair in pairwise(flights)]
    flights = cut(track, flights, meetings, found, options)
    known = [flights[0].first == 0, *(close(*pair, options) for pair in pairwise(flights))]
    known.append(flights[-1].last == len(track) - 1)
    for k, (before, after) in enumerate(pairwise(flights)):
        result = _between(track, before, after, (known[k], known[k + 2]), found, options, limits)
        if isinstance(result, Meeting):
            contacts.append(hit_of(track, len(contacts) + 1, result, flights, k))
        else:
            refusals.append(result)
    if flights[-1].last < len(track) - 1:
        refusals.append(_gap(track, flights[-1].last + 1, len(track) - 1, found, limits))
    return Found(
        track=track, sigma=found.sigma, flights=tuple(flights), contacts=tuple(contacts), refusals=tuple(refusals)
    )


def _one_contact(
    track: Track, before: Flight, after: Flight, options: FlightOptions, limits: FlightThresholds
) -> Meeting | None:
    """Where two flights meet if one contact may be between them: it then ends both."""
    if not close(before, after, options):
        return None
    met = meet(track, before, after, options)
    return met if met.apart <= limits.meets and _neither(track, before, after, met, options) <= 1 else None


def _neither(track: Track, before: Flight, after: Flight, met: Meeting, options: FlightOptions) -> int:
    """Frames in neither flight that are further from a contact than its duration."""
    between = slice(before.last + 1, after.first)
    far = np.abs(track.time[between] - met.time) > options.contact_time
    return int((track.seen[between] & far).sum())


def _between(
    track: Track,
    before: Flight,
    after: Flight,
    known: tuple[bool, bool],
    found: Flights,
    options: FlightOptions,
    limits: FlightThresholds,
) -> Meeting | Refusal:
    """Where two flights meet at a contact, or why there is none; `known` says whether it is seen what ends them."""
    first, last = before.last, after.first
    if not close(before, after, options):
        return _gap(track, first + 1, last - 1, found, limits)
    met = meet(track, before, after, options)
    change, _ = apart(before, after, met.time)
    errors = before.covariance[3:, 3:] + after.covariance[3:, 3:]
    moved = float(change[3:] @ np.linalg.solve(errors, change[3:]))
    lost = int((~track.seen[first + 1 : last]).sum())
    neither = _neither(track, before, after, met, options)
    few = _too_few((before, after), known, found, options)
    jump = 1e3 * float(np.hypot(*change[:2]))
    skipped = _skipped(before, after, met.time, track.step, options.most_missing, limits.same)
    reasons = (
        (skipped > 0, Reason.LOST_FRAMES, "frames skipped in flight", skipped, "frames"),
        (lost > options.most_missing, Reason.LOST_FRAMES, "frames lost at contact", lost, "frames"),
        (moved < limits.moved, Reason.LOST_FRAMES, "jump without a change of velocity", jump, "mm"),
        (neither > 1, Reason.DOUBLE_HIT, "frames in neither flight", neither, "frames"),
        (met.apart > limits.meets, Reason.DOUBLE_HIT, "distance of the flights", 1e3 * met.distance, "mm"),
        (met.certainty < limits.certainty, Reason.LOST_FRAMES, "certainty of the missing frames", met.certainty, "–"),
        (few > 0, Reason.TOO_FEW_FRAMES, "frames of a flight", few, "frames"),
    )
    for holds, reason, quantity, value, unit in reasons:
        if holds:
            return _refusal(track, first, last, reason, quantity, value, unit)
    return met


def _too_few(flights: tuple[Flight, Flight], known: tuple[bool, bool], found: Flights, options: FlightOptions) -> int:
    """Frames of the shorter flight of those with too few, or 0.

    One that ends at no contact that is told apart may have frames of what follows: it needs a whole window.
    """
    counts = [
        len(flight.frames)
        for flight, ends in zip(flights, known, strict=True)
        if len(flight.frames) < max(options.fewest, found.width - _EDGES * ends)
    ]
    return min(counts, default=0)


def _skipped(before: Flight, after: Flight, time: float, step: float, most: int, same: float) -> int:
    """Frames that a recording skips if two flights are one but for them, or 0."""
    for count in range(1, most + 1):
        (a, A), (b, B) = before.at(time), after.at(time - count * step)
        difference = b - a
        difference[2] = turn(difference[2])
        if difference @ np.linalg.solve(A + B, difference) <= same:
            return count
    return 0


def _gap(track: Track, first: int, last: int, found: Flights, limits: FlightThresholds) -> Refusal:
    """Why frames from the first to the last are in no flight."""
    frames = np.arange(first, last + 1)
    seen = frames[track.seen[frames]]
    if len(seen) < max(2, len(frames) // 2):
        lost = len(frames) - len(seen)
        return _refusal(track, first, last, Reason.LOST_FRAMES, "frames lost", lost, "frames")
    heights = track.pose[track.seen, 1]
    above, most = float(track.pose[seen, 1].mean() - heights.min()), float(np.ptp(heights))
    few = found.width // 2 if found.flights else found.width
    if above > limits.high * most and most > limits.uneven * found.sigma[1] and len(seen) >= few:
        return _refusal(track, first, last, Reason.HAND_OR_WALL, "height above the lowest frame", 1e3 * above, "mm")
    if len(seen) < found.width:
        ends = first == 0 or last == len(track) - 1
        reason = Reason.TOO_FEW_FRAMES if ends else Reason.DOUBLE_HIT
        return _refusal(track, first, last, reason, "frames in no flight", len(seen), "frames")
    speed = _speed(track, seen)
    reason = Reason.REST if speed < limits.still else Reason.SLIDING
    return _refusal(track, first, last, reason, "median speed", speed, "m/s")


def _speed(track: Track, frames: Sequence[int] | np.ndarray) -> float:
    """Median speed in m/s over a tenth of the frames, which takes the noise away; a turn of θ counts as 10 mm/rad."""
    stride = max(1, len(frames) // 10)
    moved = np.diff(track.pose[frames][::stride], axis=0) * (1.0, 1.0, 0.01)
    return float(np.median(np.linalg.norm(moved, axis=1) / np.diff(track.time[frames][::stride])))


def _refusal(track: Track, first: int, last: int, reason: Reason, quantity: str, value: float, unit: str) -> Refusal:
    return Refusal(
        recording=track.name,
        reason=reason,
        quantity=quantity,
        value=value,
        unit=unit,
        time=(float(track.time[first]), float(track.time[last])),
    )
