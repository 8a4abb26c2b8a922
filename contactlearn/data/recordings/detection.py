"""Free flights of a track: runs of windows that one flight explains, without bad frames, joined where they agree.

Contacts are where flights end: change-point detection by ballistic fits.  In a window of w frames a free flight is six
numbers, and the squared residual in units of the noise follows χ² with 3 (w − 2) degrees of freedom; a contact inside
the window, a floor below the body or a hand makes it larger by orders of magnitude.  The window is as long as it must
be to tell a body at rest from one in flight.  A single frame without which a window is a flight is a bad frame.

Source of the idea: detection of impacts from tracked poses of free flights by the TU/e impact laboratory (I.AM.); for
changes between piecewise fits Bai & Perron 1998.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from contactlearn.data.recordings.flight import Air, Flight, Indices, Windows, fit, window_blocks, windows
from contactlearn.data.recordings.thresholds import FlightThresholds
from contactlearn.data.recordings.track import Array, Mask, Track, finite, turn

_LEAST_NOISE = np.array((1e-7, 1e-7, 1e-6))  # m, m, rad: rounding of exact tracks
_WIDEST = 80  # frames
_MARGIN = 3  # frames of a window on each side of a bad one


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """Options of the search for flights and contacts.

    Args:
        air: gravity and drag of free flight.
        fewest: frames of a flight, at least.
        contact_time: duration of a contact in s: frames nearer to its instant are in no flight, and flights may miss
            each other by what their velocities differ in a quarter of it.
        most_missing: frames that may be missing at contact.
    """

    air: Air = Air()
    fewest: int = 8
    contact_time: float = 5e-4
    most_missing: int = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """Free flights of a track, and the noise of a frame's (x, y, θ) about them."""

    flights: tuple[Flight, ...]
    sigma: Float[Array, "3"]
    width: int


def find_flights(
    track: Track, options: FlightOptions = FlightOptions(), limits: FlightThresholds = FlightThresholds()
) -> Flights:
    """Find the free flights of a track."""
    pose, time = track.pose.copy(), track.time
    sigma = frame_noise(time, pose, options.fewest)
    width = min(_width(sigma, track.step, options, limits.rest_power), len(track))
    if width < options.fewest:
        return Flights(flights=(), sigma=sigma, width=options.fewest)
    if width > options.fewest:
        sigma = frame_noise(time, pose, width)
    good = np.zeros(0, dtype=np.bool_)
    for _ in range(3):
        good, bad_frames = _judged(time, pose, width, options.air, sigma, limits.excess)
        if not bad_frames.any():
            break
        pose[bad_frames] = np.nan
    found = [_first(time, pose, run, sigma, options.air, width) for run in _runs(good, width)]
    found = _joined(time, track.pose, [flight for flight in found if flight is not None], sigma, width, limits.same)
    found = [_extended(track, flight, sigma, width, limits.continued) for flight in found]
    sigma = _pooled(found, sigma)
    return Flights(
        flights=tuple(fit(time, track.pose, f.frames, sigma, f.air) for f in found), sigma=sigma, width=width
    )


def frame_noise(time: Float[Array, " t"], pose: Float[Array, "t 3"], width: int) -> Float[Array, "3"]:
    """Standard deviations of a frame about anything smooth: the median over windows of residuals of parabolas."""
    if len(time) < width:
        return _LEAST_NOISE
    counts, squares = list[Indices](), list[Array]()
    for block in window_blocks(len(time), width):
        fits = windows(time[block], pose[block], width, 2, None)
        counts.append(fits.count)
        squares.append((fits.residual**2).sum(1))
    count = np.concatenate(counts)
    enough = count > 4
    if not enough.any():
        return _LEAST_NOISE
    freedom = count[enough] - 3
    share = np.concatenate(squares)[enough] / freedom[:, None]
    typical = (1 - 2 / (9 * np.median(freedom))) ** 3  # median of χ² over its mean; Wilson & Hilferty 1931
    return np.maximum(np.sqrt(np.median(share, 0) / typical), _LEAST_NOISE)


def _width(sigma: Array, step: float, options: FlightOptions, power: float) -> int:
    """Frames of the shortest window in which a body at rest makes so large a χ² that it is no free flight."""
    n = np.arange(options.fewest, _WIDEST + 1)
    bend = np.hypot(*options.air.gravity) / 2 * step**2
    told = bend**2 * n * (n**2 - 1) * (n**2 - 4) / 180 / sigma[:2].max() ** 2
    return int(n[min(int(np.searchsorted(told, power)), len(n) - 1)])


def _judged(time: Array, pose: Array, width: int, air: Air, sigma: Array, excess: float) -> tuple[Mask, Mask]:
    """Windows that are flights, and frames without which others would be."""
    good, votes = list[Mask](), np.zeros(len(time), dtype=np.intp)
    for block in window_blocks(len(time), width):
        fits = windows(time[block], pose[block], width, 1, air)
        flies, worst = _worst(fits, sigma, excess)
        good.append(flies)
        votes[block] += np.bincount(worst, minlength=block.stop - block.start)
    return np.concatenate(good), votes >= 2


def _worst(fits: Windows, sigma: Array, excess: float) -> tuple[Mask, Indices]:
    """Windows that are flights, and of each of the others that would be one without a frame, this frame."""
    width = fits.residual.shape[1]
    each = (fits.residual / sigma) ** 2
    total, freedom = each.sum((1, 2)), 3 * (fits.count - 2)
    enough = fits.count >= max(5, 0.7 * width)
    good = enough & (total <= _limit(freedom, excess))
    taken = (each / np.maximum(1 - fits.leverage, 1e-3)).sum(2)
    taken[:, : min(_MARGIN, width // 3)] = taken[:, width - min(_MARGIN, width // 3) :] = 0
    worst = taken.argmax(1)
    without = total - taken[np.arange(len(total)), worst]
    mended = enough & ~good & (without <= _limit(freedom - 3, excess))
    return good, (np.arange(len(total)) + worst)[mended]


def _limit(freedom: Indices, excess: float) -> Array:
    return freedom + excess * np.sqrt(2 * np.maximum(freedom, 1))


def _runs(good: Bool[Mask, " s"], width: int) -> list[tuple[int, int]]:
    """First and last frames of runs of good windows; frames that two runs claim are nobody's."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], good.astype(np.int8), [0]))))
    runs = [(int(a), int(b) + width - 2) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for k in range(len(runs) - 1):
        (a, b), (c, d) = runs[k], runs[k + 1]
        if c <= b:
            runs[k], runs[k + 1] = (a, c - 1), (b + 1, d)
    return [(a, b) for a, b in runs if b - a >= 3]


def _first(time: Array, pose: Array, run: tuple[int, int], sigma: Array, air: Air, width: int) -> Flight | None:
    """The flight of a run without its outermost frames, where contacts begin."""
    a, b = run
    trim = min(2, max(0, b - a - width + 2))
    frames = np.arange(a + trim, b + 1 - trim)
    frames = frames[finite(pose[frames])]
    return fit(time, pose, frames, sigma, air) if len(frames) >= 4 else None


def apart(one: Flight, other: Flight, time: float) -> tuple[Float[Array, "6"], float]:
    """Difference of two flights' states at an instant, and its squared size in standard deviations."""
    (a, A), (b, B) = one.at(time), other.at(time)
    difference = b - a
    difference[2] = turn(difference[2])
    return difference, float(difference @ np.linalg.solve(A + B, difference))


def _joined(time: Array, pose: Array, found: Sequence[Flight], sigma: Array, width: int, same: float) -> list[Flight]:
    """Neighbouring flights that agree, as one: only bad or lost frames were between them."""
    joined: list[Flight] = []
    for flight in found:
        if joined:
            last = joined[-1]
            middle = (time[last.last] + time[flight.first]) / 2
            if flight.first - last.last <= 2 * width and apart(last, flight, middle)[1] <= same:
                between = np.arange(last.first, flight.last + 1)
                between = between[finite(pose[between])]
                joined[-1] = fit(time, pose, between, sigma, flight.air)
                continue
        joined.append(flight)
    return joined


def _extended(track: Track, flight: Flight, sigma: Array, reach: int, limit: float) -> Flight:
    """A flight with the frames before and after it that continue it, up to three in a row that do not."""
    frames = flight.frames
    for side in (-1, 1):
        edge = flight.first if side < 0 else flight.last
        near = edge + side * np.arange(1, 2 * reach + 1)
        near = near[(near >= 0) & (near < len(track))]
        near = near[track.seen[near]]
        away = track.pose[near] - flight.poses(track.time[near])
        away[:, 2] = turn(away[:, 2])
        scaled = np.abs(away) / np.hypot(sigma, flight.spread(track.time[near]))
        continues = scaled.max(1, initial=0.0) <= limit
        following = np.append(continues, (False, False))
        ends = np.append(np.flatnonzero(~continues & ~following[1:-1] & ~following[2:]), len(near))
        frames = np.concatenate((frames, near[: ends[0]][continues[: ends[0]]]))
    return replace(flight, frames=np.unique(frames))


def _pooled(found: Sequence[Flight], sigma: Array) -> Array:
    """Noise about the flights, as if eight frames more had that of the windows."""
    freedom = sum(len(f.residual) - 2 for f in found)
    total = sum(((f.residual**2).sum(0) for f in found), np.zeros(3))
    return np.maximum(np.sqrt((total + 8 * sigma**2) / (freedom + 8)), _LEAST_NOISE)
