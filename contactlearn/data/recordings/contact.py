"""One contact between two free flights: instant, missing frames, velocities and pose, with their covariance.

At contact the flights before and after meet in all three coordinates.  About an instant t they are apart by

    d(δ) = p⁻ − p⁺ + (v⁻ − v⁺) δ        δ̂ = −(Δvᵀ S⁻¹ d) / (Δvᵀ S⁻¹ Δv)        S = cov p⁻ + cov p⁺

which gives the instant between frames, and with two degrees of freedom left tells whether they meet at all.  If the
recording skips m frames at contact without a gap in its time stamps, what is after contact happened m frame times later
than it says: each m is tried, and its probability follows from how well the flights then meet.

Not the impulse's own history: where friction and normal force act at different times the flights miss each other by
what their velocities differ in a part of the contact's duration, which `contact_time` allows for.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.detection import FlightOptions, Flights
from contactlearn.data.recordings.flight import Air, Flight, Indices, fit
from contactlearn.data.recordings.result import Hit
from contactlearn.data.recordings.track import Array, Track, turn

_SKIPS = 0.02  # prior probability that one more frame is missing
_QUARTER = 0.25  # of the contact's duration: by so much the instants of two coordinates differ
_ROUNDS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Meeting:
    """The two flights of a contact at the instant at which they meet.

    Args:
        time: of contact in s.
        missing: frames that the recording skips there.
        certainty: probability of that number.
        apart: squared distance in standard deviations, the contact's duration allowed for.
        distance: in m, of the two poses, without θ.
        gain: derivative [3] of the instant in the distance p⁻ − p⁺.
    """

    time: float
    missing: int
    certainty: float
    apart: float
    distance: float
    gain: Float[Array, "3"]


def meeting(before: Flight, after: Flight, window: tuple[float, float], step: float, options: FlightOptions) -> Meeting:
    """Find where two flights meet.

    Args:
        before: flight before contact.
        after: flight after contact.
        window: times in s of the last frame before contact and of the first after it.
        step: time between two frames in s.
        options: of the search.
    """
    skipped: Array = np.arange(options.most_missing + 1.0) * step
    low, high = window[0], window[1] + skipped
    time = (low + high) / 2
    told, gain = np.ones_like(time), np.zeros((len(time), 3))
    for _ in range(_ROUNDS):
        d, S, change = _apart(before, after, time, skipped)
        told = (change**2 / S).sum(1)
        gain = -change / S / told[:, None]
        time = np.clip(time + (gain * d).sum(1), low - 2 * step, high + 2 * step)
    d, S, change = _apart(before, after, time, skipped)
    S = S + (_QUARTER * options.contact_time * change) ** 2
    loose = (change**2 / S).sum(1)
    d = d - change * ((change * d / S).sum(1) / loose)[:, None]  # at the nearest point, in units of the softer scatter
    outside = np.maximum(np.maximum(low - time, time - high), 0.0)
    apart = (d**2 / S).sum(1) + (outside / (told**-0.5 + options.contact_time / 2)) ** 2
    weight = -(apart + np.log(loose) + np.log(S).sum(1)) / 2 + skipped / step * np.log(_SKIPS)
    share = np.exp(weight - weight.max())
    best = int(share.argmax())
    return Meeting(
        time=float(time[best]),
        missing=best,
        certainty=float(share[best] / share.sum()),
        apart=float(apart[best]),
        distance=float(np.hypot(d[best, 0], d[best, 1])),
        gain=gain[best],
    )


def _apart(before: Flight, after: Flight, time: Array, skipped: Array) -> tuple[Array, Array, Array]:
    """Distance p⁻ − p⁺ [M, 3], its variance and the difference of velocities, for each number of missing frames."""
    d = before.poses(time) - after.poses(time - skipped)
    d[:, 2] = turn(d[:, 2])
    S = before.spread(time) ** 2 + after.spread(time - skipped) ** 2
    return d, S, before.velocities(time) - after.velocities(time - skipped)


def cut(
    track: Track,
    flights: Sequence[Flight],
    meetings: Sequence[Meeting | None],
    found: Flights,
    options: FlightOptions,
) -> list[Flight]:
    """Fit flights again without frames that are nearer to a contact than its duration, or beyond it.

    Where no one contact ends a flight, frames of what is there may be among its own: see `_own`.

    Args:
        track: of the flights.
        flights: in their order.
        meetings: of each with the next, where one contact may be between them.
        found: noise of a frame, and width of a window.
        options: of the search.
    """
    sigma = found.sigma
    fitted: list[Flight] = []
    ends = (None, *meetings, None)
    for flight, start, end in zip(flights, ends, ends[1:], strict=False):
        when, kept = track.time[flight.frames], np.ones(len(flight.frames), dtype=np.bool_)
        if start is not None:
            kept &= when >= start.time - start.missing * track.step + options.contact_time
        if end is not None:
            kept &= when <= end.time - options.contact_time
        frames = flight.frames[kept]
        if len(frames) < 4:
            frames = flight.frames
        if start is None and flight.first > 0:
            frames = _own(track, frames[::-1], found, flight.air)[::-1]
        if end is None and flight.last < len(track) - 1:
            frames = _own(track, frames, found, flight.air)
        changed = len(frames) < len(flight.frames)
        fitted.append(fit(track.time, track.pose, frames, sigma, flight.air) if changed else flight)
    return fitted


def _own(track: Track, frames: Indices, found: Flights, air: Air) -> Indices:
    """Frames of a flight without its last one, and without those before it that are of something else.

    The last m frames are as they are left out if χ² of the flight falls by more than twice their 3 m numbers (Akaike
    1974): each of them may be near the flight where all of them together are not.  The others' errors are independent
    of what was asked.  A window of frames stays, with which a flight is not too short.
    """
    frames, sigma = frames[:-1], found.sigma
    most = min(len(frames) // 3, len(frames) - found.width)
    if most < 1:
        return frames
    fits = [fit(track.time, track.pose, np.sort(frames[: len(frames) - m]), sigma, air) for m in range(most + 1)]
    total = np.array([((one.residual / sigma) ** 2).sum() for one in fits])
    gain = total[0] - total - 6 * np.arange(most + 1)
    return frames[: len(frames) - int(gain.argmax())]


def close(before: Flight, after: Flight, options: FlightOptions) -> bool:
    """Whether so few frames are between two flights that it may be one contact."""
    return after.first - before.last - 1 <= 2 * options.most_missing + 2


def meet(track: Track, before: Flight, after: Flight, options: FlightOptions) -> Meeting:
    """Find where two flights of a track meet."""
    window = (float(track.time[before.last]), float(track.time[after.first]))
    return meeting(before, after, window, track.step, options)


def hit_of(track: Track, number: int, found: Meeting, flights: Sequence[Flight], place: int) -> Hit:
    """State before and after contact at its instant with all covariances; `place` is that of the flight before."""
    before, after = flights[place : place + 2]
    (a, A), (b, B) = before.at(found.time), after.at(found.time - found.missing * track.step)
    errors = np.zeros((12, 12))
    errors[:6, :6], errors[6:, 6:] = A, B
    instant = np.concatenate((found.gain, np.zeros(3), -found.gain, np.zeros(3)))
    trust = np.diag(A)[:3] / (np.diag(A)[:3] + np.diag(B)[:3])  # of the pose after contact
    apart = b[:3] - a[:3]
    apart[2] = turn(apart[2])
    pose = a[:3] + trust * apart
    pose[2] = turn(pose[2])
    moving = (1 - trust) * a[3:] + trust * b[3:]
    jacobian = np.zeros((10, 12))
    jacobian[:3, 3:6] = jacobian[3:6, 9:12] = np.eye(3)
    jacobian[:3] += np.outer(before.acceleration(a[3:]), instant)
    jacobian[3:6] += np.outer(after.acceleration(b[3:]), instant)
    jacobian[6:9, :3], jacobian[6:9, 6:9] = np.diag(1 - trust), np.diag(trust)
    jacobian[6:9] += np.outer(moving, instant)
    jacobian[9] = instant
    lost = int((~track.seen[before.last + 1 : after.first]).sum())
    return Hit(
        recording=track.name,
        number=number,
        time=found.time,
        v_pre=a[3:].copy(),
        v_post=b[3:].copy(),
        pose=pose,
        covariance=jacobian @ errors @ jacobian.T,
        missing=found.missing,
        certainty=found.certainty,
        lost=lost,
        apart=found.apart,
        flight=place,
    )
