"""Free flights of a track: robust fits with covariance, and the runs of windows that one flight explains.

    x = x₀ + v_x s(τ) + (g_x + a_x) b(τ) + j_x τ³/6      v = v e^{−cτ} + (g + a) s(τ) + j τ²/2
    y = y₀ + v_y s(τ) + (g_y + a_y) b(τ) + j_y τ³/6      s(τ) = (1 − e^{−cτ})/c → τ
    θ = θ₀ + ω τ + a_θ τ²/2 + j_θ τ³/6                   b(τ) = (τ − s(τ))/c → τ²/2 as the drag c → 0

with τ from a reference instant, gravity (g_x, g_y) and a linear drag c that all flights share.  Plates, wind or a spin
that slows give each flight an acceleration a of its own, which may change at a rate j: both are normal about 0, with
the standard deviations that all flights show (empirical Bayes, Efron & Morris 1973).  Each coordinate is then linear in
four numbers with a prior on two, so that any number of windows is fitted at once in closed form.

Contacts are where flights end: change-point detection by ballistic fits.  In a window of w frames a free flight is six
numbers, and the squared residual in units of the noise follows χ² with 3 (w − 2) degrees of freedom; a contact inside
the window, a floor below the body or a hand makes it larger by orders of magnitude.  The window is as long as it must
be to distinguish a body at rest from one in flight.  A single frame without which a window is a flight is a bad frame.

Source of the idea: detection of impacts from tracked poses of free flights by the TU/e impact laboratory (I.AM.); for
changes between piecewise fits Bai & Perron 1998.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Array, Mask, Track, arms, finite, turn
from contactlearn.mechanics.rigid_body import GRAVITY

Indices = NDArray[np.intp]
_REJECTED = 4.5  # standard deviations of a frame's residual; one of 150 000 frames by chance
_ROUNDS = 4
_BLOCK = 2048  # windows, some tens of MB
_NOTHING = 1e-30  # s², of a window without frames


Own = tuple[tuple[float, float, float], tuple[float, float, float]]
STEADY: Own = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class Air:
    """Accelerations of free flight.

    Args:
        gravity: (g_x, g_y) in m/s².
        drag: linear drag in 1/s.
        own: standard deviations of a flight's own acceleration about both, in m/s², m/s² and rad/s², and of the rate
            at which it changes, in m/s³, m/s³ and rad/s³.
    """

    gravity: tuple[float, float] = (0.0, -GRAVITY)
    drag: float = 0.0
    own: Own = STEADY

    def basis(self, tau: Array) -> tuple[Array, Array]:
        """s(τ) and b(τ) of the module's table, in s and s²."""
        c = self.drag
        if c == 0:
            return tau, tau**2 / 2
        if abs(c) * max(float(np.abs(tau).max(initial=0.0)), 1e-12) < 1e-4:  # the closed form loses its digits
            return tau - c * tau**2 / 2, tau**2 / 2 - c * tau**3 / 6
        s = -np.expm1(-c * tau) / c
        return s, (tau - s) / c

    def slopes(self, tau: Array) -> Float[Array, "... 3 4"]:
        """Derivatives of the pose in pose and velocity at the reference, an acceleration and its change."""
        slopes = np.empty((*tau.shape, 3, 4))
        slopes[..., 0], slopes[..., 3] = 1.0, tau[..., None] ** 3 / 6
        s, b = self.basis(tau)
        slopes[..., :2, 1], slopes[..., :2, 2] = s[..., None], b[..., None]
        slopes[..., 2, 1], slopes[..., 2, 2] = tau, tau**2 / 2
        return slopes

    def rates(self, tau: Array) -> Float[Array, "... 3 4"]:
        """Derivatives of the velocity in the same."""
        rates = np.zeros((*tau.shape, 3, 4))
        rates[..., 3] = tau[..., None] ** 2 / 2
        rates[..., :2, 1], rates[..., :2, 2] = np.exp(-self.drag * tau)[..., None], self.basis(tau)[0][..., None]
        rates[..., 2, 1], rates[..., 2, 2] = 1.0, tau
        return rates

    def pull(self) -> Float[Array, "3"]:
        """Acceleration (g_x, g_y, 0) of a body that is still."""
        return np.array((*self.gravity, 0.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A free flight.

    Args:
        frames: of the track that it was fitted to.
        reference: instant in s at which its state is given.
        state: pose, velocity, own acceleration and its change at the reference, (x, y, θ) each.
        covariance: of the state, of each coordinate.
        residual: of the frames, (x, y, θ) each.
        air: gravity and drag.
    """

    frames: Int[Indices, " n"]
    reference: float
    state: Float[Array, "4 3"]
    covariance: Float[Array, "3 4 4"]
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

    @property
    def _pulled(self) -> Float[Array, "4 3"]:
        """The state with the whole acceleration, shared and own."""
        return self.state + np.array((0.0, 0.0, 1.0, 0.0))[:, None] * self.air.pull()

    def poses(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Poses at instants."""
        return np.einsum("...kj,jk->...k", self.air.slopes(np.asarray(time) - self.reference), self._pulled)

    def spread(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Standard deviations of the poses at instants, of the fit alone."""
        slopes = self.air.slopes(np.asarray(time) - self.reference)
        return np.sqrt(np.einsum("...ki,kij,...kj->...k", slopes, self.covariance, slopes))

    def velocities(self, time: Float[Array, " t"]) -> Float[Array, "t 3"]:
        """Velocities (v_x, v_y, ω) at instants."""
        return np.einsum("...kj,jk->...k", self.air.rates(np.asarray(time) - self.reference), self._pulled)

    def at(self, time: float) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
        """Pose and velocity at an instant, and their covariance."""
        tau, errors = np.asarray(time - self.reference), np.zeros((2, 3, 2, 3))
        move = np.stack((self.air.slopes(tau), self.air.rates(tau)), 1)
        state = np.einsum("kmj,jk->mk", move, self._pulled).ravel()
        errors[:, range(3), :, range(3)] = move @ self.covariance @ move.transpose(0, 2, 1)
        return state, errors.reshape(6, 6)

    def acceleration(self, time: float) -> Float[Array, "3"]:
        """Acceleration at an instant."""
        slowing = self.air.drag * self.velocities(np.asarray(time)) * (1, 1, 0)
        own = self.state[2] + self.state[3] * (time - self.reference)
        return self.air.pull() + own - slowing


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
        scale = np.maximum(sigma, MAD_SCALE * np.median(np.abs(flight.residual), axis=0))
        kept = frames[np.max(np.abs(apart) / scale, 1) <= _REJECTED]
        if len(kept) < max(3, len(frames) // 2) or np.array_equal(kept, flight.frames):
            break
        flight = _flight(time, pose, kept, sigma, air, reference)
    return flight


def _flight(time: Array, pose: Array, frames: Indices, sigma: Array, air: Air, reference: float) -> Flight:
    """Least squares with priors, in whose units own accelerations are; θ is brought to one turn."""
    tau, middle = time[frames] - reference, len(frames) // 2
    slopes, units = air.slopes(tau), np.concatenate((np.ones((2, 3)), air.own)).T
    y = pose[frames] - slopes[..., 2] * air.pull()
    rough = np.median(np.diff(y[:, 2]) / np.diff(tau))
    line = y[middle, 2] + rough * (tau - tau[middle])
    y[:, 2] = line + turn(y[:, 2] - line)
    design = slopes * units
    across = design / sigma[:, None] ** 2
    inverse = np.linalg.inv(np.einsum("tki,tkj->kij", across, design) + np.diag((0.0, 0.0, 1.0, 1.0)))
    found = np.einsum("kij,tkj,tk->ki", inverse, across, y)
    return Flight(
        frames=frames,
        reference=reference,
        state=(found * units).T,
        covariance=inverse * units[:, :, None] * units[:, None],
        residual=y - np.einsum("tki,ki->tk", design, found),
        air=air,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Flights fitted to all windows of w frames of a track, one after each other start.

    Args:
        count: seen frames [S] of each window.
        misfit: squared residual [S, 3] in standard deviations; own accelerations count as their prior allows.
        residual: of its frames, in the same, [S, w, 3]; 0 where a frame was lost.
        leverage: of its frames, [S, w, 3].
        acceleration: own one, [S, 3].
        error: of it, without a prior, [S, 3].
    """

    count: Int[Indices, " s"]
    misfit: Float[Array, "s 3"]
    residual: Float[Array, "s w 3"]
    leverage: Float[Array, "s w 3"]
    acceleration: Float[Array, "s 3"]
    error: Float[Array, "s 3"]


def window_blocks(frames: int, width: int) -> Iterator[slice]:
    """Yield the frames of blocks of windows, so that those of a long recording are not in memory at once."""
    for start in range(0, max(frames - width + 1, 0), _BLOCK):
        yield slice(start, min(start + _BLOCK + width - 1, frames))


SMOOTH = Air(gravity=(0.0, 0.0), own=((np.inf, np.inf, np.inf), STEADY[1]))
"""Anything whose acceleration is steady."""


def windows(
    time: Float[Array, " t"],
    pose: Float[Array, "t 3"],
    width: int,
    air: Air,
    sigma: Float[Array, "3"],
    late: float = 0.0,
) -> Windows:
    """Fit flights to all windows of `width` frames.

    Args:
        time: of the frames in s.
        pose: not a number where a frame was lost; θ continuous.
        width: of the windows in frames.
        air: gravity, drag and own accelerations; their change is too small to be seen in a window.
        sigma: standard deviations of a frame's (x, y, θ).
        late: s by which the second half of each window is later than its time stamps.
    """
    when = sliding_window_view(time, width) + late * (np.arange(width) >= width // 2)
    seen = sliding_window_view(finite(pose), width)
    slopes = air.slopes(when - when[:, width // 2, None])[..., :3] * seen[..., None, None]
    y = np.moveaxis(sliding_window_view(pose, width, axis=0), 1, -1)
    residual = np.where(seen[..., None], y, 0.0) - slopes[..., 2] * air.pull()
    leverage, line, columns = np.zeros_like(residual), residual, [*np.moveaxis(slopes, -1, 0)]
    factor = size = np.zeros(())
    for power, column in enumerate(columns):  # Gram and Schmidt
        for other in columns[:power]:
            column = column - other * (column * other).sum(1, keepdims=True) / np.maximum(
                (other**2).sum(1, keepdims=True), _NOTHING
            )
        columns[power], line = column, residual
        size = np.maximum((column**2).sum(1, keepdims=True), _NOTHING)
        prior = (sigma / np.maximum(air.own[0], _NOTHING)) ** 2 if power == 2 else 0.0
        factor = (column * residual).sum(1, keepdims=True) / (size + prior)
        residual = residual - column * factor
        leverage = leverage + column**2 / (size + prior)
    return Windows(
        count=seen.sum(1),
        misfit=(line * residual).sum(1) / sigma**2,
        residual=residual / sigma,
        leverage=leverage,
        acceleration=factor[:, 0],
        error=sigma / np.sqrt(size[:, 0]),
    )


_LEAST_NOISE = np.array((1e-7, 1e-7, 1e-6))  # m, m, rad: rounding of exact tracks
_WIDEST = 80  # frames
_REST_POWER = 300.0  # χ² that a body at rest makes in the shortest window of a flight; 300 to 750 decide alike
_CONTINUED = 3.0  # standard deviations up to which a frame continues a flight; less loses contacts, 10 decides alike
_SAME = 60.0  # χ² with six degrees of freedom up to which two flights are one; 5 to 180 decide alike
_STILL = 0.1  # of the way of a fast window
_SIDE = 3  # frames before and after a skip
_MARGIN = 3  # frames of a window on each side of a bad one


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """Options of the search for flights and contacts.

    Args:
        air: gravity and drag of free flight.
        fewest: frames of a flight, at least.
        contact_time: longest contact in s.  One lasts as long as frames about its instant are in neither flight.
        most_missing: frames that may be missing at contact.
        centre: of mass about the tracked point in m, in the body's axes: flights are its, contacts are of the point.
    """

    air: Air = Air()
    fewest: int = 8
    contact_time: float = 3e-3
    most_missing: int = 3
    centre: tuple[float, float] = (0.0, 0.0)


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


_OWN = ((0.5, 0.5, 30.0), (10.0, 10.0, 300.0))  # at most: with more of it a body at rest would be in flight
_SHOWN = 8  # flights that show the own accelerations of all
_OFF = 0.01  # m, standard deviation that is expected of a centre of mass about the tracked point
_MEDIAN = 0.455  # of χ² with one degree of freedom


def long_flights(tracks: Iterable[Track], air: Air) -> list[tuple[Track, Flight, Float[Array, "3"]]]:
    """Flights that are long enough to show more than their velocities, with the noise of a frame about them."""
    options, long = FlightOptions(air=replace(air, own=_OWN)), []
    for track in tracks:
        found, bent = find_flights(track, options), round(options.contact_time / 2 / track.step) + 1  # by contacts
        for flight in found.flights:
            if len(flight.frames) >= 2 * found.width + 2 * bent:
                frames = flight.frames[bent:-bent]
                long.append((track, fit(track.time, track.pose, frames, found.sigma, options.air), found.sigma))
    return long


def centre_of_flights(
    long: Sequence[tuple[Track, Flight, Float[Array, "3"]]], own: Own
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]] | None:
    """Centre of mass about the tracked point in m, along the body's axes, and its covariance; None of too few flights.

    It flies as `Air` says, with own accelerations of this size, and the tracked point of a body that spins wobbles
    about it.  Each flight shows the centre by weighted least squares; the scatter between them is the error.
    """
    information, scores = np.zeros((len(long), 2, 2)), np.zeros((len(long), 2))
    for number, (track, flight, sigma) in enumerate(long):
        time, units = track.time[flight.frames], np.concatenate((np.ones((2, 3)), own)).T
        slopes, theta = flight.air.slopes(time - flight.reference), flight.poses(time)[:, 2]
        y = track.pose[flight.frames] - slopes[..., 2] * flight.air.pull()
        turning = -np.stack((arms((1.0, 0.0), theta), arms((0.0, 1.0), theta)), -1)
        for k in range(2):
            smooth, W = slopes[:, k] * units[k] / sigma[k], np.column_stack((turning[:, k], y[:, k])) / sigma[k]
            inverse = np.linalg.inv(smooth.T @ smooth + np.diag((0.0, 0.0, 1.0, 1.0)))
            part = W.T @ (W - smooth @ inverse @ (smooth.T @ W))
            information[number] += part[:2, :2]
            scores[number] += part[:2, 2]
    if len(long) < _SHOWN:
        return None
    inverse = np.linalg.inv(information.sum(0) + np.eye(2) / _OFF**2)
    found = inverse @ scores.sum(0)
    left = scores - information @ found
    return found, inverse @ (left.T @ left) @ inverse * len(long) / (len(long) - 2) + inverse


def own_accelerations(long: Sequence[Flight]) -> Own:
    """Standard deviations of own accelerations, as long flights show them.

    Of each flight the likelihood of its own acceleration is normal, with information J and score h.  Under a variance D
    its mean m = (J + 1/D)⁻¹ h has the variance D − (J + 1/D)⁻¹: D is where the median of m² is as large as it should
    be, so that a few stretches which are no flights do not count.
    """
    if len(long) < _SHOWN:
        return STEADY
    D = most = np.array(_OWN).T ** 2
    inverse = np.linalg.inv(np.stack([flight.covariance[:, 2:, 2:] for flight in long]))
    J, h = (
        inverse - np.apply_along_axis(np.diag, -1, 1 / D),
        inverse @ np.stack([f.state[2:].T for f in long])[..., None],
    )
    for _ in range(60):
        posterior = np.linalg.inv(J + np.apply_along_axis(np.diag, -1, 1 / D))
        variance = np.einsum("fkij,fkji,ki->fki", posterior, J, D)
        m = (posterior @ h)[..., 0]
        D = np.minimum(D * np.clip(np.median(m**2 / np.maximum(variance, 1e-300), axis=0) / _MEDIAN, 0.25, 2.0), most)
    (a_x, a_y, a_θ), (j_x, j_y, j_θ) = np.sqrt(D).T.tolist()
    return (a_x, a_y, a_θ), (j_x, j_y, j_θ)


def mended(track: Track, options: FlightOptions, excess: float) -> Track:
    """Return the track with time stamps that show the frames which it skips in flight without a gap in them.

    Three frames before a skip and three after it are a flight, if the clock of the latter is late by whole frames.
    """
    time = track.time.copy()
    if len(time) < 2 * _SIDE:
        return track
    sigma = frame_noise(time, track.pose, options.fewest)
    for _ in range(_ROUNDS):
        apart = np.stack(
            [
                windows(time, track.pose, 2 * _SIDE, options.air, sigma, n * track.step).misfit.sum(1)
                for n in range(options.most_missing + 1)
            ]
        )
        best = apart.argmin(0)
        sure = (apart.min(0) <= _limit(np.array(6 * _SIDE - 6), excess)) & (apart[0] - apart.min(0) > _SAME)
        if not sure.any():
            break
        time[_SIDE:] += track.step * np.cumsum(np.append(best * sure, np.zeros(_SIDE - 1)))
    return replace(track, time=time)


def frame_noise(time: Float[Array, " t"], pose: Float[Array, "t 3"], width: int) -> Float[Array, "3"]:
    """Standard deviations of a frame about anything smooth: the median over windows of residuals of parabolas.

    Windows in which the body is still do not count: a tracker is better there.
    """
    if len(time) < width:
        return _LEAST_NOISE
    counts, squares, moves = list[Indices](), list[Array](), list[Array]()
    for block in window_blocks(len(time), width):
        fits = windows(time[block], pose[block], width, SMOOTH, np.ones(3))
        counts.append(fits.count)
        squares.append(fits.misfit)
        moves.append(np.linalg.norm(pose[block][width - 1 :, :2] - pose[block][: -width + 1, :2], axis=1))
    count, move = np.concatenate(counts), np.nan_to_num(np.concatenate(moves))
    enough = count > 4
    if not enough.any():
        return _LEAST_NOISE
    enough &= move >= _STILL * np.quantile(move[enough], 0.95)
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
        fits = windows(time[block], pose[block], width, air, sigma)
        flies, worst = _worst(fits, excess)
        good.append(flies)
        votes[block] += np.bincount(worst, minlength=block.stop - block.start)
    return np.concatenate(good), votes >= 2


def _worst(fits: Windows, excess: float) -> tuple[Mask, Indices]:
    """Windows that are flights, and of each of the others that would be one without a frame, this frame."""
    width = fits.residual.shape[1]
    each, total, freedom = fits.residual**2, fits.misfit.sum(1), 3 * (fits.count - 2)
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


def apart(one: Flight, other: Flight, time: float, late: float = 0.0) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
    """Difference of two flights' states at an instant, and its covariance.

    The clock of the other flight may be late, in s.
    """
    (a, A), (b, B) = one.at(time), other.at(time - late)
    difference = b - a
    difference[2] = turn(difference[2])
    return difference, A + B


def same_flight(one: Flight, other: Flight, time: float, late: float = 0.0) -> bool:
    """Whether two flights agree at an instant as one flight does."""
    difference, covariance = apart(one, other, time, late)
    return float(difference @ np.linalg.solve(covariance, difference)) <= _SAME


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
        ends_with = flight.frames[-2 * reach :] if side > 0 else flight.frames[: 2 * reach]
        end = fit(track.time, track.pose, ends_with, sigma, flight.air)  # of a long one the acceleration may change
        away = track.pose[near] - end.poses(track.time[near])
        away[:, 2] = turn(away[:, 2])
        scaled = np.abs(away) / np.hypot(sigma, end.spread(track.time[near]))
        continues = scaled.max(1, initial=0.0) <= _CONTINUED
        following = np.append(continues, (False, False))
        ends = np.append(np.flatnonzero(~continues & ~following[1:-1] & ~following[2:]), len(near))
        frames = np.concatenate((frames, near[: ends[0]][continues[: ends[0]]]))
    return replace(flight, frames=np.unique(frames))
