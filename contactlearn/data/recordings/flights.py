"""Free flights of a track: robust fits with covariance, and the runs of windows that one flight explains.

    x = x₀ + v_x s(τ) + g_x b(τ)      v = v e^{−cτ} + g s(τ)        s(τ) = (1 − e^{−cτ})/c → τ
    y = y₀ + v_y s(τ) + g_y b(τ)                                    b(τ) = (τ − s(τ))/c → τ²/2
    θ = θ₀ + ω τ                                                    as the drag c → 0

with τ from a reference instant, gravity (g_x, g_y) and a linear drag c that are known.  Each coordinate is then linear
in two numbers, so that any number of windows is fitted at once in closed form.

Contacts are where flights end: change-point detection by ballistic fits.  In a window of w frames a free flight is six
numbers, and the squared residual in units of the noise follows χ² with 3 (w − 2) degrees of freedom; a contact inside
the window, a floor below the body or a hand makes it larger by orders of magnitude.  The window is as long as it must
be to distinguish a body at rest from one in flight.  A single frame without which a window is a flight is a bad frame.

Source of the idea: detection of impacts from tracked poses of free flights by the TU/e impact laboratory (I.AM.); for
changes between piecewise fits Bai & Perron 1998.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Array, Mask, Track, finite, turn
from contactlearn.mechanics.rigid_body import GRAVITY

Indices = NDArray[np.intp]
_REJECTED = 4.5  # standard deviations of a frame's residual; one of 150 000 frames by chance
_ROUNDS = 4
_BLOCK = 2048  # windows, some tens of MB
_NOTHING = 1e-30  # s², of a window without frames


@dataclass(frozen=True, kw_only=True)
class Air:
    """Accelerations of free flight: gravity (g_x, g_y) in m/s² and a linear drag in 1/s."""

    gravity: tuple[float, float] = (0.0, -GRAVITY)
    drag: float = 0.0

    def basis(self, tau: Array) -> tuple[Array, Array]:
        """s(τ) and b(τ) of the module's table, in s and s²."""
        c = self.drag
        if c == 0:
            return tau, tau**2 / 2
        if abs(c) * max(float(np.abs(tau).max(initial=0.0)), 1e-12) < 1e-4:  # the closed form loses its digits
            return tau - c * tau**2 / 2, tau**2 / 2 - c * tau**3 / 6
        s = -np.expm1(-c * tau) / c
        return s, (tau - s) / c

    def fallen(self, tau: Array) -> Float[Array, "... 3"]:
        """Part of the pose [..., 3] that gravity makes."""
        return self.basis(tau)[1][..., None] * np.array((*self.gravity, 0.0))

    def slopes(self, tau: Array) -> Float[Array, "... 3"]:
        """Derivative of the pose in the velocity at the reference."""
        slopes = np.empty((*tau.shape, 3))
        slopes[..., :2], slopes[..., 2] = self.basis(tau)[0][..., None], tau
        return slopes


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A free flight.

    Args:
        frames: of the track that it was fitted to.
        reference: instant in s at which its state is given.
        state: (x, y, θ, v_x, v_y, ω) at the reference.
        covariance: of the state.
        residual: of the frames, (x, y, θ) each.
        air: gravity and drag.
    """

    frames: Int[Indices, " n"]
    reference: float
    state: Float[Array, "6"]
    covariance: Float[Array, "6 6"]
    residual: Float[Array, "n 3"]
    air: Air

    @property
    def first(self) -> int:
        """First frame."""
        return int(self.frames[0])

    @property
    def last(self) -> int:
        """Last frame."""
        return int(self.frames[-1])

    def poses(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Poses at instants."""
        tau = np.asarray(time) - self.reference
        return self.state[:3] + self.state[3:] * self.air.slopes(tau) + self.air.fallen(tau)

    def spread(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Standard deviations of the poses at instants, of the fit alone."""
        s = self.air.slopes(np.asarray(time) - self.reference)
        variance = self.covariance.diagonal()
        pp, pv, vv = variance[:3], self.covariance[range(3), range(3, 6)], variance[3:]
        return np.sqrt(pp + 2 * pv * s + vv * s**2)

    def velocities(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Velocities (v_x, v_y, ω) at instants."""
        tau = np.asarray(time) - self.reference
        fall = self.air.basis(tau)[0][..., None] * np.array((*self.air.gravity, 0.0))
        if self.air.drag == 0:
            return self.state[3:] + fall
        return self.state[3:] * np.exp(-np.array((self.air.drag, self.air.drag, 0.0)) * tau[..., None]) + fall

    def at(self, time: float) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
        """State at an instant, and its covariance."""
        tau, c = np.asarray(time - self.reference), self.air.drag
        decay = np.array((np.exp(-c * tau), np.exp(-c * tau), 1.0))
        move = np.eye(6)
        move[range(3), range(3, 6)] = self.air.slopes(tau)
        move[range(3, 6), range(3, 6)] = decay
        fall = np.append(np.asarray(self.air.gravity) * float(self.air.basis(tau)[0]), 0.0)
        state = move @ self.state + np.concatenate((self.air.fallen(tau), fall))
        return state, move @ self.covariance @ move.T

    def acceleration(self, velocity: Float[Array, "3"]) -> Float[Array, "3"]:
        """Acceleration at a velocity (v_x, v_y, ω)."""
        return np.append(np.asarray(self.air.gravity) - self.air.drag * velocity[:2], 0.0)


def fit(
    time: Float[Array, " t"],
    pose: Float[Array, "t 3"],
    frames: Int[Indices, " n"],
    sigma: Float[Array, "3"],
    air: Air,
    *,
    reference: float | None = None,
) -> Flight:
    """Fit a flight to frames of a track, without those whose residual is far beyond the noise.

    Args:
        time: of all frames in s.
        pose: of all frames.
        frames: to fit to, three or more.
        sigma: standard deviations of a frame's (x, y, θ).
        air: gravity and drag.
        reference: instant in s; the middle frame's if None.
    """
    if reference is None:
        reference = float(time[frames[len(frames) // 2]])
    flight = _flight(time, pose, frames, sigma, air, reference)
    for _ in range(_ROUNDS):
        apart = pose[frames] - flight.poses(time[frames])
        apart[:, 2] = turn(apart[:, 2])
        kept = frames[np.max(np.abs(apart) / sigma, 1) <= _REJECTED]
        if len(kept) < max(3, len(frames) // 2) or np.array_equal(kept, flight.frames):
            break
        flight = _flight(time, pose, kept, sigma, air, reference)
    return flight


def _flight(time: Array, pose: Array, frames: Indices, sigma: Array, air: Air, reference: float) -> Flight:
    state, inverse, residual = _least_squares(time[frames] - reference, pose[frames], air)
    covariance = np.zeros((6, 6))
    for k in range(3):
        covariance[k::3, k::3] = sigma[k] ** 2 * inverse[k]
    return Flight(frames=frames, reference=reference, state=state, covariance=covariance, residual=residual, air=air)


def _least_squares(tau: Array, pose: Array, air: Air) -> tuple[Array, Array, Array]:
    """State [6], inverse normal matrices [3, 2, 2] and residual [n, 3]; θ is brought to one turn."""
    slopes = air.slopes(tau)
    y = pose - air.fallen(tau)
    count, mean = len(tau), slopes.mean(0)
    spread = ((slopes - mean) ** 2).sum(0)
    rough = np.median(np.diff(y[:, 2]) / np.diff(tau)) if count > 1 else 0.0
    middle = count // 2
    line = y[middle, 2] + rough * (tau - tau[middle])
    y[:, 2] = line + turn(y[:, 2] - line)
    rate = ((slopes - mean) * y).sum(0) / spread
    place = y.mean(0) - rate * mean
    inverse = np.empty((3, 2, 2))
    inverse[:, 0, 0], inverse[:, 1, 1] = 1 / count + mean**2 / spread, 1 / spread
    inverse[:, 0, 1] = inverse[:, 1, 0] = -mean / spread
    return np.concatenate((place, rate)), inverse, y - place - rate * slopes


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Line fits of all windows of w frames of a track, one after each other start.

    Args:
        count: seen frames [S] of each window.
        residual: of its frames, [S, w, 3]; 0 where a frame was lost.
        leverage: of its frames, [S, w, 3].
        leading: coefficient [S, 3] of the highest power of time.
        information: variance of a frame over that of the leading coefficient, [S, 3].
    """

    count: Int[Indices, " s"]
    residual: Float[Array, "s w 3"]
    leverage: Float[Array, "s w 3"]
    leading: Float[Array, "s 3"]
    information: Float[Array, "s 3"]


def window_blocks(frames: int, width: int) -> Iterator[slice]:
    """Yield the frames of blocks of windows, so that those of a long recording are not in memory at once."""
    for start in range(0, max(frames - width + 1, 0), _BLOCK):
        yield slice(start, min(start + _BLOCK + width - 1, frames))


def windows(time: Float[Array, " t"], pose: Float[Array, "t 3"], width: int, degree: int, air: Air | None) -> Windows:
    """Fit polynomials to all windows of `width` frames.

    Args:
        time: of the frames in s.
        pose: not a number where a frame was lost; θ continuous.
        width: of the windows in frames.
        degree: 1 for free flights in known air, 2 for anything smooth.
        air: gravity and drag of a free flight; None for nothing of the kind.
    """
    when = sliding_window_view(time, width)
    seen = sliding_window_view(finite(pose), width)
    tau = when - when[:, width // 2, None]
    y = np.moveaxis(sliding_window_view(pose, width, axis=0), 1, -1)
    y = np.where(seen[..., None], y, 0.0)
    slopes = np.stack((tau,) * 3, -1)
    if air is not None:
        slopes = air.slopes(tau)
        y = y - air.fallen(tau) * seen[..., None]
    basis = [seen[..., None] * np.ones(3)]
    residual, leverage = y, np.zeros_like(y)
    factor = size = np.zeros(())
    for power in range(degree + 1):  # Gram and Schmidt, one power after the other
        column = basis[0] if power == 0 else basis[0] * slopes**power
        for other in basis[:power]:
            column = column - other * (column * other).sum(1, keepdims=True) / np.maximum(
                (other**2).sum(1, keepdims=True), _NOTHING
            )
        size = (column**2).sum(1, keepdims=True)
        factor = (column * residual).sum(1, keepdims=True) / np.maximum(size, _NOTHING)
        residual = residual - column * factor
        leverage = leverage + column**2 / np.maximum(size, _NOTHING)
        if power:
            basis.append(column)
    count = seen.sum(1)
    return Windows(count=count, residual=residual, leverage=leverage, leading=factor[:, 0], information=size[:, 0])


_LEAST_NOISE = np.array((1e-7, 1e-7, 1e-6))  # m, m, rad: rounding of exact tracks
_WIDEST = 80  # frames
_REST_POWER = 150.0  # χ² that a body at rest makes in the shortest window of a flight; 150 to 750 decide alike
_CONTINUED = 3.0  # standard deviations up to which a frame continues a flight; less loses contacts, 10 decides alike
_SAME = 60.0  # χ² with six degrees of freedom up to which two flights are one; 5 to 180 decide alike
_MARGIN = 3  # frames of a window on each side of a bad one


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """Options of the search for flights and contacts.

    Args:
        air: gravity and drag of free flight.
        fewest: frames of a flight, at least.
        contact_time: duration of a contact in s: frames nearer to its instant are in no flight, and flights may miss
            each other by the difference of their velocities times a quarter of it.
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
    track: Track, options: FlightOptions = FlightOptions(), limits: TrackThresholds = TrackThresholds()
) -> Flights:
    """Find the free flights of a track."""
    pose, time = track.pose.copy(), track.time
    sigma = frame_noise(time, pose, options.fewest)
    width = min(_width(sigma, track.step, options), len(track))
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
    found = _joined(time, track.pose, [flight for flight in found if flight is not None], sigma, width)
    found = [_extended(track, flight, sigma, width) for flight in found]
    freedom = sum(len(f.residual) - 2 for f in found)
    total = sum(((f.residual**2).sum(0) for f in found), np.zeros(3))
    # As if eight frames more had the noise of the windows.
    sigma = np.maximum(np.sqrt((total + 8 * sigma**2) / (freedom + 8)), _LEAST_NOISE)
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


def _width(sigma: Array, step: float, options: FlightOptions) -> int:
    """Frames of the shortest window in which a body at rest makes so large a χ² that it is no free flight."""
    n = np.arange(options.fewest, _WIDEST + 1)
    bend = np.hypot(*options.air.gravity) / 2 * step**2
    chi_square = bend**2 * n * (n**2 - 1) * (n**2 - 4) / 180 / sigma[:2].max() ** 2
    return int(n[min(int(np.searchsorted(chi_square, _REST_POWER)), len(n) - 1)])


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


def apart(one: Flight, other: Flight, time: float, late: float = 0.0) -> tuple[Float[Array, "6"], float]:
    """Difference of two flights' states at an instant, and its squared size in standard deviations.

    The clock of the other flight may be late, in s.
    """
    (a, A), (b, B) = one.at(time), other.at(time - late)
    difference = b - a
    difference[2] = turn(difference[2])
    return difference, float(difference @ np.linalg.solve(A + B, difference))


def same_flight(one: Flight, other: Flight, time: float, late: float = 0.0) -> bool:
    """Whether two flights agree at an instant as one flight does."""
    return apart(one, other, time, late)[1] <= _SAME


def _joined(time: Array, pose: Array, found: Sequence[Flight], sigma: Array, width: int) -> list[Flight]:
    """Neighbouring flights that agree, as one: only bad or lost frames were between them."""
    joined: list[Flight] = []
    for flight in found:
        if joined:
            last = joined[-1]
            middle = (time[last.last] + time[flight.first]) / 2
            if flight.first - last.last <= 2 * width and same_flight(last, flight, middle):
                between = np.arange(last.first, flight.last + 1)
                between = between[finite(pose[between])]
                joined[-1] = fit(time, pose, between, sigma, flight.air)
                continue
        joined.append(flight)
    return joined


def _extended(track: Track, flight: Flight, sigma: Array, reach: int) -> Flight:
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
        continues = scaled.max(1, initial=0.0) <= _CONTINUED
        following = np.append(continues, (False, False))
        ends = np.append(np.flatnonzero(~continues & ~following[1:-1] & ~following[2:]), len(near))
        frames = np.concatenate((frames, near[: ends[0]][continues[: ends[0]]]))
    return replace(flight, frames=np.unique(frames))
