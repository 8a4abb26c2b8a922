"""Contacts of a track between two free flights, with their covariance; everything else is refused with its number.

At contact the flights before and after meet in all k coordinates, three in the plane and six in space.  About an
instant t they are apart by

    d(δ) = p⁻ − p⁺ + (v⁻ − v⁺) δ        δ̂ = −(Δvᵀ S⁻¹ d) / (Δvᵀ S⁻¹ Δv)        S = cov p⁻ + cov p⁺

which gives the instant between frames; the k − 1 degrees of freedom that are left test whether they meet at all.  If
the recording skips m frames at contact without a gap in its time stamps, whatever follows contact happened m frame
times later than it states: each m is tried, and its probability follows from how well the flights then meet.

The history of the impulse is not resolved: friction and normal force act at different times, and lever arms turn, so
the flights miss each other by the difference of their velocities in a part of the contact's duration, which is allowed
for.  A contact lasts as long as frames about its instant are in neither flight, or for the longest time that is allowed
where a shorter one does not explain by how much its flights miss each other.

before the first flight, after the last   a hand, a body at rest, rolling or sliding, or frames that are too few
between two flights                       one contact if both meet at an instant; otherwise
    frames that are in neither flight       several hits, sliding, rest, a hand
    flights that miss each other            several hits within a frame
    no change of velocity                   frames that are missing in the middle of a flight
    more frames lost than can be counted    unknown
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.flights import (
    Flight,
    FlightModel,
    FlightOptions,
    Flights,
    Indices,
    find_flights,
    fit,
    restore_skipped_frames,
    same_flight,
    state_difference,
)
from contactlearn.data.recordings.poses import Array, arms, away, displaced, levers, orientation
from contactlearn.data.recordings.result import Reason, RecordedContact, Refusal, SearchedTrack
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Track, about_centre

_SKIPS = 0.02  # prior probability that one more frame is missing
_BRIEF = 5e-4  # s, of a contact without a frame, unless its flights show a longer one
_QUARTER = 0.25  # of the contact's duration: by so much rotations meet at another instant, since lever arms turn
_ASIDE = 0.01  # of the whole change in the duration, in units of the noise: friction does not follow the normal force
_PRIOR_OF_LONG_CONTACT = 0.01  # prior probability that a contact lasts longer than its frames show
_ROUNDS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactFit:
    """The two flights of a contact at the instant at which they meet.

    Args:
        time: of contact in s.
        missing: frames that the recording skips there.
        certainty: probability of that number.
        chi_square: squared distance in standard deviations, the contact's duration allowed for.
        distance: in m, of the two positions.
        gain: derivative [k] of the instant in the distance p⁻ − p⁺.
        lasting: s about the instant in which frames are in no flight.
    """

    time: float
    missing: int
    certainty: float
    chi_square: float
    distance: float
    gain: Float[Array, "k"]
    lasting: float


def fit_contact(
    before: Flight,
    after: Flight,
    window: tuple[float, float],
    step: float,
    most_missing: int,
    lasting: tuple[float, float],
) -> ContactFit:
    """Find where two flights meet.

    Args:
        before: flight before contact.
        after: flight after contact.
        window: times in s of the last frame before contact and of the first after it.
        step: time between two frames in s.
        most_missing: frames that may be missing.
        lasting: durations of the contact in s, shown by frames and at most; the longer one is improbable.
    """
    skipped: Array = np.arange(most_missing + 1.0) * step
    low, high = window[0], window[1] + skipped
    time = (low + high) / 2
    information, gain = np.ones_like(time), np.zeros((len(time), before.air.k))
    for _ in range(_ROUNDS):
        d, S, change = _differences(before, after, time, skipped)
        information = (change**2 / S).sum(1)
        gain = -change / S / information[:, None]
        time = np.clip(time + (gain * d).sum(1), low - 2 * step, high + 2 * step)
    d, S, change = _differences(before, after, time, skipped)
    lasts, rotates = np.array(lasting)[:, None], np.arange(before.air.k) >= before.air.d
    aside = _ASIDE * before.sigma * np.linalg.norm(change / before.sigma, axis=1, keepdims=True)
    S = S + lasts[..., None] ** 2 * ((_QUARTER * change * rotates) ** 2 + aside**2)
    loose = (change**2 / S).sum(-1)
    d = d - change * ((change * d / S).sum(-1) / loose)[..., None]  # at the nearest point, in units of this scatter
    outside = np.maximum(np.maximum(low - time, time - high), 0.0)
    chi_square = (d**2 / S).sum(-1) + (outside / (information**-0.5 + lasts / 2)) ** 2
    weight = -(chi_square + np.log(loose) + np.log(S).sum(-1)) / 2 + skipped / step * np.log(_SKIPS)
    weight[1:] += np.log(_PRIOR_OF_LONG_CONTACT)
    share = np.exp(weight - weight.max())
    how, best = np.unravel_index(int(share.argmax()), share.shape)
    return ContactFit(
        time=float(time[best]),
        missing=int(best),
        certainty=float(share[:, best].sum() / share.sum()),
        chi_square=float(chi_square[how, best]),
        distance=float(np.linalg.norm(d[how, best, : before.air.d])),
        gain=gain[best],
        lasting=float(lasting[how]),
    )


def _differences(before: Flight, after: Flight, time: Array, skipped: Array) -> tuple[Array, Array, Array]:
    """Distance p⁻ − p⁺ [M, k], its variance and the difference of velocities, for each number of missing frames."""
    (p, u), (q, v) = before.states(time), after.states(time - skipped)
    return away(p, q), before.spread(time) ** 2 + after.spread(time - skipped) ** 2, u - v


def cut(
    track: Track,
    flights: Sequence[Flight],
    contacts: Sequence[ContactFit | None],
    search: Flights,
    contact_time: float,
) -> list[Flight]:
    """Fit flights again without frames that are nearer to a contact than its duration, or beyond it.

    A flight that ends at no contact may include frames of something else: see `_trim_flight_end`.

    Args:
        track: of the flights.
        flights: in their order.
        contacts: of each with the next, where one contact may be between them.
        search: noise of a frame, and width of a window.
        contact_time: longest contact in s; frames within half of it are left out, for one that bends them by less than
            the noise.
    """
    trimmed: list[Flight] = []
    ends = (None, *contacts, None)
    for flight, start, end in zip(flights, ends, ends[1:], strict=False):
        when, kept = track.time[flight.frames], np.ones(len(flight.frames), dtype=np.bool_)
        if start is not None:
            kept &= when >= start.time - start.missing * track.step + max(start.lasting, contact_time / 2)
        if end is not None:
            kept &= when <= end.time - max(end.lasting, contact_time / 2)
        frames = flight.frames[kept]
        if len(frames) < 4:
            frames = flight.frames
        if start is None and flight.first > 0:
            frames = _trim_flight_end(track, frames[::-1], search, flight)[::-1]
        if end is None and flight.last < len(track) - 1:
            frames = _trim_flight_end(track, frames, search, flight)
        changed = len(frames) < len(flight.frames)
        trimmed.append(fit(track.time, track.pose, frames, flight.sigma, flight.air) if changed else flight)
    return trimmed


def _trim_flight_end(track: Track, frames: Indices, search: Flights, flight: Flight) -> Indices:
    """Frames of a flight without its last one, and without those before it that are of something else.

    The last m frames are as they are left out if χ² of the flight falls by more than twice their k m numbers (Akaike
    1974): each of them may be near the flight where all of them together are not.  The errors of the other
    frames are independent of this decision.  At least a window of frames stays.
    """
    if len(frames) < _MIN_FLIGHT_FRAMES:
        return frames
    frames, sigma, air = frames[:-1], flight.sigma, flight.air
    most = min(len(frames) // 3, len(frames) - search.width)
    if most < 1:
        return frames
    fits = [fit(track.time, track.pose, np.sort(frames[: len(frames) - m]), sigma, air) for m in range(most + 1)]
    total = np.array([((one.residual / sigma) ** 2).sum() for one in fits])
    scatter = max(1.0, total[-1] / (air.k * (len(fits[-1].frames) - 2)))
    gain = (total[0] - total) / scatter - 2 * air.k * np.arange(most + 1)
    return frames[: len(frames) - int(gain.argmax())]


def close(before: Flight, after: Flight, options: FlightOptions) -> bool:
    """Whether so few frames are between two flights that it may be one contact."""
    return after.first - before.last - 1 <= 2 * options.most_missing + 2


def fit_between(track: Track, before: Flight, after: Flight, options: FlightOptions) -> tuple[ContactFit, int]:
    """Find where two flights of a track meet, and how many frames are in neither though the contact does not last.

    A contact without a frame in neither flight may last as well, which the flights show that miss each other.
    """
    window = (float(track.time[before.last]), float(track.time[after.first]))
    between = np.arange(before.last + 1, after.first)
    times, brief = track.time[between[track.seen[between]]], min(_BRIEF, options.contact_time)
    durations = (brief, options.contact_time)
    contact = fit_contact(before, after, window, track.step, options.most_missing, durations)
    away = np.minimum(np.abs(times - contact.time), np.abs(times + contact.missing * track.step - contact.time))
    within = away <= options.contact_time
    seen = float(away[within].max(initial=brief))
    if seen > brief:
        contact = fit_contact(before, after, window, track.step, options.most_missing, (seen, options.contact_time))
    return contact, int((~within).sum())


def recorded_contact(
    track: Track, number: int, contact: ContactFit, flights: Sequence[Flight], place: int, centre: Sequence[float]
) -> RecordedContact:
    """State of the tracked point before and after contact at its instant, with all covariances.

    Args:
        track: of the centre of mass.
        number: of the contact.
        contact: of its flights.
        flights: of the track.
        place: of the flight before contact.
        centre: of mass, about the tracked point.
    """
    before, after = flights[place : place + 2]
    time_after = contact.time - contact.missing * track.step  # by the clock of the flight after contact
    (p, u, A), (q, v, B) = before.at(contact.time), after.at(time_after)
    d, k = before.air.d, before.air.k
    errors = np.zeros((4 * k, 4 * k))
    errors[: 2 * k, : 2 * k], errors[2 * k :, 2 * k :] = A, B  # of p, u and q, v: two flights are independent
    weight = np.diag(A)[:k] / (np.diag(A)[:k] + np.diag(B)[:k])  # of the pose after contact
    pose = displaced(p, weight * away(q, p))

    # Of (v_pre, v_post, pose, time) in (p, u, q, v).  The instant is that at which p and q are nearest, and it moves
    # along both flights whatever is evaluated there.
    jacobian, pre, post, at = np.zeros((3 * k + 1, 4 * k)), np.s_[:k], np.s_[k : 2 * k], np.s_[2 * k : 3 * k]
    instant = np.concatenate((contact.gain, np.zeros(k), -contact.gain, np.zeros(k)))
    jacobian[pre, k : 2 * k] = jacobian[post, 3 * k :] = np.eye(k)
    jacobian[at, :k], jacobian[at, 2 * k : 3 * k] = np.diag(1 - weight), np.diag(weight)
    jacobian[pre] += np.outer(before.acceleration(contact.time), instant)
    jacobian[post] += np.outer(after.acceleration(time_after), instant)
    jacobian[at] += np.outer((1 - weight) * u + weight * v, instant)
    jacobian[3 * k] = instant

    # From the centre of mass to the tracked point, an arm −c away: its velocity has −ω × c, and turns with the pose.
    arm = arms(centre, orientation(pose))
    lever, to_point = levers(arm), np.eye(3 * k + 1)
    for row, w in ((0, u), (k, v)):
        to_point[row : row + d, row + d : row + k] = lever
        to_point[row : row + d, 2 * k + d : 3 * k] = _swept_matrix(w[d:]) @ lever
    to_point[2 * k : 2 * k + d, 2 * k + d : 3 * k] = lever
    jacobian = to_point @ jacobian
    v_pre, v_post = (np.append(w[:d] + lever @ w[d:], w[d:]) for w in (u, v))
    return RecordedContact(
        recording=track.name,
        number=number,
        time=contact.time,
        v_pre=v_pre,
        v_post=v_post,
        pose=np.append(pose[:d] - arm, pose[d:]),
        covariance=jacobian @ errors @ jacobian.T,
        missing=contact.missing,
        certainty=contact.certainty,
        lost=int((~track.seen[before.last + 1 : after.first]).sum()),
        chi_square=contact.chi_square,
        lasting=contact.lasting,
        flight=place,
    )


def _swept_matrix(spin: Float[Array, " s"]) -> Float[Array, "d d"]:
    """Matrix of ω × c in c."""
    return -levers(spin) if len(spin) == 3 else np.array(((0.0, -spin[0]), (spin[0], 0.0)))


_MIN_FLIGHT_FRAMES = 3  # frames of any flight: two are no test of one
_EDGES = 2  # frames that a flight may be shorter than a window, if it is seen where it ends


def find_contacts(
    track: Track,
    model: FlightModel = FlightModel(),
    options: FlightOptions = FlightOptions(),
    limits: TrackThresholds = TrackThresholds(),
) -> SearchedTrack:
    """Find the contacts of a track between free flights, and refuse everything else."""
    track = restore_skipped_frames(about_centre(track, model.centre), model.air, options, limits)
    search = find_flights(track, model.air, options, limits)
    flights, contacts, refusals = list(search.flights), list[RecordedContact](), list[Refusal]()
    if not flights:
        refusals = [_refused_gap(track, 0, len(track) - 1, search, limits)]
        return SearchedTrack(track=track, sigma=search.sigma, flights=(), contacts=(), refusals=tuple(refusals))
    if flights[0].first > 0:
        refusals.append(_refused_gap(track, 0, flights[0].first - 1, search, limits))
    fits = [_one_contact(track, *pair, options, limits) for pair in pairwise(flights)]
    flights = cut(track, flights, fits, search, options.contact_time)
    known = [flights[0].first == 0, *(close(*pair, options) for pair in pairwise(flights))]
    known.append(flights[-1].last == len(track) - 1)
    for k, (before, after) in enumerate(pairwise(flights)):
        result = _between(track, before, after, (known[k], known[k + 2]), search, options, limits)
        if isinstance(result, ContactFit):
            contacts.append(recorded_contact(track, len(contacts) + 1, result, flights, k, model.centre))
        else:
            refusals.append(result)
    if flights[-1].last < len(track) - 1:
        refusals.append(_refused_gap(track, flights[-1].last + 1, len(track) - 1, search, limits))
    return SearchedTrack(
        track=track, sigma=search.sigma, flights=tuple(flights), contacts=tuple(contacts), refusals=tuple(refusals)
    )


def _one_contact(
    track: Track, before: Flight, after: Flight, options: FlightOptions, limits: TrackThresholds
) -> ContactFit | None:
    """Where two flights meet if one contact may be between them: it then ends both."""
    if not close(before, after, options):
        return None
    contact, neither = fit_between(track, before, after, options)
    return contact if contact.chi_square <= limits.meets_in(track.k) and neither <= 1 else None


def _between(
    track: Track,
    before: Flight,
    after: Flight,
    known: tuple[bool, bool],
    search: Flights,
    options: FlightOptions,
    limits: TrackThresholds,
) -> ContactFit | Refusal:
    """Where two flights meet at a contact, or why not; `known` states whether the event that ends each is seen."""
    first, last = before.last, after.first
    if not close(before, after, options):
        return _refused_gap(track, first + 1, last - 1, search, limits)
    contact, neither = fit_between(track, before, after, options)
    change, errors = state_difference(before, after, contact.time)
    k, d = track.k, track.d
    changed = float(change[k:] @ np.linalg.solve(errors[k:, k:], change[k:]))
    lost = int((~track.seen[first + 1 : last]).sum())
    few = _too_few((before, after), known, search.width - math.ceil(options.contact_time / 2 / track.step))
    jump = 1e3 * float(np.linalg.norm(change[:d]))
    counts = range(1, options.most_missing + 1)  # of frames but for which the two flights are one
    skipped = next((n for n in counts if same_flight(before, after, contact.time, limits, n * track.step)), 0)
    reasons = (
        (skipped > 0, Reason.LOST_FRAMES, "frames skipped in flight", skipped, "frames"),
        (lost > options.most_missing, Reason.LOST_FRAMES, "frames lost at contact", lost, "frames"),
        (changed < limits.velocity_change, Reason.LOST_FRAMES, "jump without a change of velocity", jump, "mm"),
        (neither > 1, Reason.DOUBLE_HIT, "frames in neither flight", neither, "frames"),
        (
            contact.chi_square > limits.meets_in(k),
            Reason.DOUBLE_HIT,
            "distance of the flights",
            1e3 * contact.distance,
            "mm",
        ),
        (
            contact.certainty < limits.certainty,
            Reason.LOST_FRAMES,
            "certainty of the missing frames",
            contact.certainty,
            "–",
        ),
        (few > 0, Reason.TOO_FEW_FRAMES, "frames of a flight", few, "frames"),
    )
    for holds, reason, quantity, value, unit in reasons:
        if holds:
            return refuse(track, first, last, reason, quantity, value, unit)
    return contact


def _too_few(flights: tuple[Flight, Flight], known: tuple[bool, bool], fewest: int) -> int:
    """Frames of the shorter flight of those with too few, or 0.

    A flight whose end is not seen may include frames of the next event: it needs a whole window, without the frames
    that the contact may bend.
    """
    counts = [len(flight.frames) for flight in flights]
    return min(
        (n for n, ends in zip(counts, known, strict=True) if n < max(fewest - _EDGES * ends, _MIN_FLIGHT_FRAMES)),
        default=0,
    )


def _refused_gap(track: Track, first: int, last: int, search: Flights, limits: TrackThresholds) -> Refusal:
    """Why frames from the first to the last are in no flight."""
    frames = np.arange(first, last + 1)
    seen = frames[track.seen[frames]]
    if len(seen) < max(2, len(frames) // 2):
        lost = len(frames) - len(seen)
        return refuse(track, first, last, Reason.LOST_FRAMES, "frames lost", lost, "frames")
    heights = track.height[track.seen]
    above, most = float(track.height[seen].mean() - heights.min()), float(np.ptp(heights))
    few = search.width // 2 if search.flights else search.width
    rises = most > limits.height_range * search.sigma[track.d - 1]
    if above > limits.hand_height * most and rises and len(seen) >= few:
        return refuse(track, first, last, Reason.HAND_OR_WALL, "height above the lowest frame", 1e3 * above, "mm")
    if len(seen) < search.width:
        ends = first == 0 or last == len(track) - 1
        reason = Reason.TOO_FEW_FRAMES if ends else Reason.DOUBLE_HIT
        return refuse(track, first, last, reason, "frames in no flight", len(seen), "frames")
    stride = max(1, len(seen) // 10)  # which takes the noise away; a turn of θ counts as 10 mm/rad
    poses, weight = track.pose[seen][::stride], np.where(np.arange(track.k) < track.d, 1.0, 0.01)
    moves = away(poses[1:], poses[:-1]) * weight
    speed = float(np.median(np.linalg.norm(moves, axis=1) / np.diff(track.time[seen][::stride])))
    if speed < limits.rest_speed:
        return refuse(track, first, last, Reason.REST, "median speed", speed, "m/s")
    if track.low is not None:
        height = float(np.median(track.low[seen]) - np.nanmin(track.low))
        if height > limits.lies_height:
            return refuse(
                track,
                first,
                last,
                Reason.IN_THE_AIR,
                "height of the lowest corner above its lowest",
                1e3 * height,
                "mm",
            )
    return refuse(track, first, last, Reason.SLIDING, "median speed", speed, "m/s")


def refuse(track: Track, first: int, last: int, reason: Reason, quantity: str, value: float, unit: str) -> Refusal:
    """Return the refusal of frames of a track, from the first to the last, with the quantity that decides."""
    return Refusal(
        recording=track.name,
        reason=reason,
        quantity=quantity,
        value=value,
        unit=unit,
        time=(float(track.time[first]), float(track.time[last])),
    )
