"""Free flights of a track: robust fits with covariance, and the runs of windows that one flight explains.

    x = x₀ + v_x s(τ) + (g_x + a_x) b(τ) + j_x τ³/6      v = v e^{−cτ} + (g + a) s(τ) + j τ²/2
    y = y₀ + v_y s(τ) + (g_y + a_y) b(τ) + j_y τ³/6      s(τ) = (1 − e^{−cτ})/c → τ
    θ = θ₀ + ω τ + a_θ τ²/2 + j_θ τ³/6                   b(τ) = (τ − s(τ))/c → τ²/2 as the drag c → 0

with τ from a reference instant, gravity (g_x, g_y) and a linear drag c that all flights share.  Plates, wind or a spin
that slows give each flight an acceleration a of its own, which may change at a rate j: both are normal about 0, with
the standard deviations that all flights show (empirical Bayes, Efron & Morris 1973).  Each coordinate is then linear in
four numbers with a prior on two, so that any number of windows is fitted at once in closed form.

In space there are three rotations: those of the difference from a body that turns freely (`Turning`), in axes that turn
half as fast.  That difference is small, and the four numbers of each of its coordinates are independent.

Contacts are where flights end: change-point detection by ballistic fits.  In a window of w frames a free flight is six
numbers, and the squared residual in units of the noise follows χ² with 3 (w − 2) degrees of freedom; a contact inside
the window, a floor below the body or a hand makes it larger by orders of magnitude.  The window is as long as it must
be to distinguish a body at rest from one in flight.  A single frame without which a window is a flight is a bad frame.

Source of the idea: detection of impacts from tracked poses of free flights by the TU/e impact laboratory (I.AM.); for
changes between piecewise fits Bai & Perron 1998.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.lib.stride_tricks import sliding_window_view

from contactlearn.core.numerics import MAD_SCALE, median
from contactlearn.data.recordings.poses import (
    Array,
    away,
    conjugate,
    cross,
    free_turn,
    product,
    quaternion,
    rotated,
    rotation_vector,
    turn,
)
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Mask, Track, finite
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.rigid_body import GRAVITY

Indices = np.ndarray
_REJECTED = 4.5  # standard deviations of a frame's residual; one of 150 000 frames by chance
_ROUNDS = 4
_BLOCK = 2048  # windows, some tens of MB
_MIN_SUM = 1e-30  # s², of a window without frames


AccelerationPrior = tuple[tuple[float, ...], tuple[float, ...]]
STEADY: AccelerationPrior = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class Air:
    """Accelerations of free flight.

    Args:
        gravity: (g_x, g_y) in m/s²; in space (g_x, g_y, g_z).
        drag: linear drag in 1/s.
        prior: standard deviations of a flight's own acceleration about both, in m/s², m/s² and rad/s², and of the rate
            at which it changes, in m/s³, m/s³ and rad/s³; in space three of each.
        moments: in space principal moments of inertia, in any unit; None if they are equal.
    """

    gravity: tuple[float, ...] = (0.0, -GRAVITY)
    drag: float = 0.0
    prior: AccelerationPrior = STEADY
    moments: tuple[float, ...] | None = None

    @property
    def d(self) -> int:
        """Components of a position."""
        return len(self.gravity)

    @property
    def k(self) -> int:
        """Coordinates of a pose: 3 in the plane, 6 in space."""
        return 3 * self.d - 3

    def smooth(self) -> "Air":
        """Anything whose acceleration is steady."""
        return Air(gravity=(0.0,) * self.d, prior=((np.inf,) * self.k, (0.0,) * self.k), moments=self.moments)

    def basis(self, tau: Array) -> tuple[Array, Array]:
        """s(τ) and b(τ) of the module's table, in s and s²."""
        c = self.drag
        if c == 0:
            return tau, tau**2 / 2
        if abs(c) * max(float(np.abs(tau).max(initial=0.0)), 1e-12) < 1e-4:  # the closed form loses its digits
            return tau - c * tau**2 / 2, tau**2 / 2 - c * tau**3 / 6
        s = -np.expm1(-c * tau) / c
        return s, (tau - s) / c

    def slopes(self, tau: Array) -> Float[Array, "... k 4"]:
        """Derivatives of the pose in pose and velocity at the reference, an acceleration and its change."""
        slopes, d = np.empty((*tau.shape, self.k, 4)), self.d
        slopes[..., 0], slopes[..., 3] = 1.0, tau[..., None] ** 3 / 6
        s, b = self.basis(tau)
        slopes[..., :d, 1], slopes[..., :d, 2] = s[..., None], b[..., None]
        slopes[..., d:, 1], slopes[..., d:, 2] = tau[..., None], tau[..., None] ** 2 / 2
        return slopes

    def rates(self, tau: Array) -> Float[Array, "... k 4"]:
        """Derivatives of the velocity in the same."""
        rates, d = np.zeros((*tau.shape, self.k, 4)), self.d
        rates[..., 3] = tau[..., None] ** 2 / 2
        rates[..., :d, 1], rates[..., :d, 2] = np.exp(-self.drag * tau)[..., None], self.basis(tau)[0][..., None]
        rates[..., d:, 1], rates[..., d:, 2] = 1.0, tau[..., None]
        return rates

    def pull(self) -> Float[Array, "k"]:
        """Acceleration (g_x, g_y, 0) of a body that is still."""
        return np.array((*self.gravity, *(0.0,) * (self.k - self.d)))


@dataclass(frozen=True, kw_only=True)
class FlightModel:
    """Free flight of a body, as recordings show it.

    Args:
        gravity: in the plane, (g_x, g_y) in m/s²; three numbers of a body that moves in space.
        gravity_error: standard error of its size in m/s².
        drag: linear drag of the air in 1/s that flights have; 0 where none is seen.
        measured: gravity's size in m/s² and the drag in 1/s, fitted together whether the drag is seen or not.
        prior: standard deviations of the own accelerations of flights, as in `Air`.
        moments: of inertia of a body that moves in space, as in `Air`.
        centre: of mass about the tracked point in m, in the body's axes, where flights show that it is off: flights are
            its, contacts are of the point.
    """

    gravity: tuple[float, ...] = (0.0, -GRAVITY)
    gravity_error: float = 0.0
    drag: float = 0.0
    measured: tuple[Estimate, Estimate] = (Estimate(value=GRAVITY, error=0.0), Estimate(value=0.0, error=0.0))
    prior: AccelerationPrior = STEADY
    moments: tuple[float, ...] | None = None
    centre: tuple[float, ...] = (0.0, 0.0)

    @property
    def air(self) -> Air:
        """Free flight with 9.81 m/s² in the measured direction."""
        size = math.hypot(*self.gravity) / GRAVITY
        return Air(
            gravity=tuple(g / size for g in self.gravity), drag=self.drag, prior=self.prior, moments=self.moments
        )

    @property
    def lean(self) -> Estimate:
        """Angle in rad of gravity from straight down to the right."""
        g_x, *_, g_y = self.gravity
        return Estimate(value=math.atan2(g_x, -g_y), error=self.gravity_error / math.hypot(*self.gravity))


@dataclass(frozen=True, eq=False, kw_only=True)
class Turning:
    """Free turning of bodies in space, from which rotations [..., 3] are counted.

    Args:
        q: quaternions [..., 4] at a reference.
        spin: there, in rad/s and world axes [..., 3].
        moments: as in `Air`.
    """

    q: Float[Array, "*batch 4"]
    spin: Float[Array, "*batch 3"]
    moments: tuple[float, ...] | None

    def after(self, tau: Float[Array, "*batch t"]) -> tuple[Array, Array]:
        """Quaternions [..., T, 4] and spins [..., T, 3] after times in s."""
        return free_turn(self.q[..., None, :], self.spin[..., None, :], tau, self.moments)

    def _half(self, tau: Float[Array, "*batch t"]) -> Float[Array, "*batch t 4"]:
        return quaternion(self.spin[..., None, :] * tau[..., None] / 2)

    def beyond(
        self, q: Float[Array, "*batch t 4"], free: Float[Array, "*#batch t 4"], tau: Float[Array, "*batch t"]
    ) -> Float[Array, "*batch t 3"]:
        """Rotations from those of free turning to quaternions, in axes that have turned by half of ω τ less."""
        return rotated(conjugate(self._half(tau)), rotation_vector(product(q, conjugate(free))))

    def counted(self, q: Float[Array, "*batch t 4"], tau: Float[Array, "*batch t"]) -> Float[Array, "*batch t 3"]:
        """Rotations of quaternions: ω τ and the difference from free turning."""
        return self.spin[..., None, :] * tau[..., None] + self.beyond(q, self.after(tau)[0], tau)

    def placed(
        self, turned: Float[Array, "*batch t 3"], rate: Float[Array, "*batch t 3"], tau: Float[Array, "*batch t"]
    ) -> tuple[Float[Array, "*batch t 4"], Float[Array, "*batch t 3"]]:
        """Quaternions and spins of rotations and their rates; the way back from `counted`."""
        (free, spin), half = self.after(tau), self._half(tau)
        off = turned - self.spin[..., None, :] * tau[..., None]
        change = rate - self.spin[..., None, :] - cross(self.spin[..., None, :] / 2, off)
        return product(quaternion(rotated(half, off)), free), spin + rotated(half, change)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A free flight.

    Args:
        frames: of the track that it was fitted to.
        reference: instant in s at which its state is given.
        state: pose, velocity, own acceleration and its change at the reference, (x, y, θ) each; k = 6 in space.
        covariance: of the state, of each coordinate.
        residual: of the frames, (x, y, θ) each.
        sigma: standard deviations of a frame's (x, y, θ) that it was fitted with.
        air: gravity and drag.
        turning: in space, from which rotations are counted.
    """

    frames: Int[Indices, " n"]
    reference: float
    state: Float[Array, "4 k"]
    covariance: Float[Array, "k 4 4"]
    residual: Float[Array, "n k"]
    sigma: Float[Array, "k"]
    air: Air
    turning: Turning | None = None

    @property
    def first(self) -> int:
        """First frame."""
        return int(self.frames[0])

    @property
    def last(self) -> int:
        """Last frame."""
        return int(self.frames[-1])

    @property
    def _pulled(self) -> Float[Array, "4 k"]:
        """The state with the whole acceleration, shared and own."""
        return self.state + np.array((0.0, 0.0, 1.0, 0.0))[:, None] * self.air.pull()

    def states(self, time: Float[Array, "*t"] | float) -> tuple[Float[Array, "*t m"], Float[Array, "*t k"]]:
        """Poses and velocities at instants."""
        when = np.asarray(time) - self.reference
        tau = when.ravel()
        pose, velocity = (
            np.einsum("...kj,jk->...k", move, self._pulled) for move in (self.air.slopes(tau), self.air.rates(tau))
        )
        if self.turning is not None:
            q, spin = self.turning.placed(pose[..., 3:], velocity[..., 3:], tau)
            pose, velocity = np.concatenate((pose[..., :3], q), -1), np.concatenate((velocity[..., :3], spin), -1)
        return pose.reshape(*when.shape, pose.shape[-1]), velocity.reshape(*when.shape, self.air.k)

    def poses(self, time: Float[Array, "*t"] | float) -> Float[Array, "*t m"]:
        """Poses at instants, (x, y, θ), in space a position and a quaternion."""
        return self.states(time)[0]

    def velocities(self, time: Float[Array, "*t"] | float) -> Float[Array, "*t k"]:
        """Velocities (v_x, v_y, ω) at instants; in space six."""
        return self.states(time)[1]

    def spread(self, time: Float[Array, "*t"]) -> Float[Array, "*t k"]:
        """Standard deviations of the poses at instants, of the fit alone."""
        slopes = self.air.slopes(np.asarray(time) - self.reference)
        return np.sqrt(np.einsum("...ki,kij,...kj->...k", slopes, self.covariance, slopes))

    def at(self, time: float) -> tuple[Float[Array, "m"], Float[Array, "k"], Float[Array, "two_k two_k"]]:
        """Pose and velocity at an instant, and the covariance of their errors, small differences of the pose first."""
        tau, k = np.asarray(time - self.reference), self.air.k
        errors, move = np.zeros((2, k, 2, k)), np.stack((self.air.slopes(tau), self.air.rates(tau)), 1)
        errors[:, range(k), :, range(k)] = move @ self.covariance @ move.transpose(0, 2, 1)
        return *self.states(time), errors.reshape(2 * k, 2 * k)

    def acceleration(self, time: float) -> Float[Array, "k"]:
        """Acceleration at an instant, without that of Euler's equations."""
        slowing = self.air.drag * self.velocities(np.asarray(time)) * (np.arange(self.air.k) < self.air.d)
        deviation = self.state[2] + self.state[3] * (time - self.reference)
        return self.air.pull() + deviation - slowing


def fit(
    time: Float[Array, " t"],
    pose: Float[Array, "t m"],
    frames: Int[Indices, " n"],
    sigma: Float[Array, "k"],
    air: Air,
) -> Flight:
    """Fit a flight to frames of a track, without those whose residual is far beyond the noise.

    Args:
        time: of all frames in s.
        pose: of all frames.
        frames: to fit to, three or more.
        sigma: standard deviations of a frame's (x, y, θ).
        air: gravity and drag.
    """
    reference = float(time[frames[len(frames) // 2]])
    flight = _flight(time, pose, frames, sigma, air, reference)
    for _ in range(_ROUNDS):
        off = away(pose[frames], flight.poses(time[frames]))
        scale = np.maximum(sigma, MAD_SCALE * median(np.abs(flight.residual)))
        kept = frames[np.max(np.abs(off) / scale, 1) <= _REJECTED]
        if len(kept) < max(3, len(frames) // 2) or np.array_equal(kept, flight.frames):
            break
        flight = _flight(time, pose, kept, sigma, air, reference)
    return flight


def _flight(time: Array, pose: Array, frames: Indices, sigma: Array, air: Air, reference: float) -> Flight:
    """Least squares with priors, in whose units own accelerations are; θ is brought to one turn.

    In space it is the difference from free turning that is fitted.
    """
    tau, seen, d = time[frames] - reference, pose[frames], air.d
    slopes, units = air.slopes(tau), np.concatenate((np.ones((2, air.k)), air.prior)).T
    design = slopes * units
    across = design / sigma[:, None] ** 2
    inverse = np.linalg.inv(np.einsum("tki,tkj->kij", across, design) + np.diag((0.0, 0.0, 1.0, 1.0)))
    turning, y = None, _on_one_turn(seen, tau, air)
    if d == 3:
        turning = _free_turning(seen[:, 3:], tau, float(sigma[3:].max()), air.moments)
        y = np.concatenate((seen[:, :d], turning.counted(seen[:, d:], tau)), 1) - slopes[..., 2] * air.pull()
    coefficients = np.einsum("kij,tkj,tk->ki", inverse, across, y)
    return Flight(
        frames=frames,
        reference=reference,
        state=(coefficients * units).T,
        covariance=inverse * units[:, :, None] * units[:, None],
        residual=y - np.einsum("tki,ki->tk", design, coefficients),
        sigma=sigma,
        air=air,
        turning=turning,
    )


def _free_turning(
    q: Float[Array, "n 4"], tau: Float[Array, " n"], sigma: float, moments: tuple[float, ...] | None
) -> Turning:
    """The free turning that is nearest to quaternions, by Gauss and Newton's method.

    A body with unequal moments that turns fast is first followed over a part of a turn about the reference, and then
    twice as far in each round: over several turns the nearest one is not found from a rough spin.
    """
    steps = rotation_vector(product(q[1:], conjugate(q[:-1]))) / np.diff(tau)[:, None]
    turning = Turning(q=q[int(np.abs(tau).argmin())], spin=median(steps), moments=moments)
    reach = max(_FIRST_TURN / max(float(np.linalg.norm(turning.spin)), 1e-9), float(np.sort(np.abs(tau))[:3][-1]))
    for _ in range(_TURNS):
        near = np.abs(tau) <= reach
        *moved, free = Turning(
            q=product(quaternion(_TURNED * np.eye(7, 3)), turning.q),
            spin=turning.spin + _TURNED * np.eye(7, 3, -3),
            moments=moments,
        ).after(tau[near])[0]
        *slopes, missed = turning.beyond(np.stack((*moved, q[near])), free, tau[near])
        slopes = np.reshape(slopes, (6, -1)).T / _TURNED
        step = np.linalg.lstsq(slopes, missed.ravel())[0]
        turning = replace(turning, q=product(quaternion(step[:3]), turning.q), spin=turning.spin + step[3:])
        if (np.abs(step) <= _SETTLED * sigma * np.sqrt(np.linalg.pinv(slopes.T @ slopes).diagonal())).all():
            if near.all():
                break
            reach *= 2
    return turning


def _on_one_turn(pose: Array, tau: Array, air: Air) -> Array:
    """Coordinates in the plane without gravity, θ within half a turn of a line."""
    if air.d == 3:
        return pose
    y = pose - air.slopes(tau)[..., 2] * air.pull()
    rough, middle = median(np.diff(y[:, 2]) / np.diff(tau)), len(tau) // 2
    line = y[middle, 2] + rough * (tau - tau[middle])
    y[:, 2] = line + turn(y[:, 2] - line)
    return y


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Flights fitted to all windows of w frames of a track, one after each other start.

    Args:
        count: seen frames [S] of each window.
        misfit: squared residual [S, k] in standard deviations; own accelerations count as their prior allows.
        residual: of its frames, in the same, [S, w, k]; 0 where a frame was lost.
        leverage: of its frames, [S, w, k].
        acceleration: own one, [S, k].
        error: of it, without a prior, [S, k].
        smooth: squared residual [S, k] with any steady acceleration.
    """

    count: Int[Indices, " s"]
    misfit: Float[Array, "s k"]
    residual: Float[Array, "s w k"]
    leverage: Float[Array, "s w k"]
    acceleration: Float[Array, "s k"]
    error: Float[Array, "s k"]
    smooth: Float[Array, "s k"]


def window_blocks(frames: int, width: int) -> Iterator[slice]:
    """Yield the frames of blocks of windows, so that those of a long recording are not in memory at once."""
    for start in range(0, max(frames - width + 1, 0), _BLOCK):
        yield slice(start, min(start + _BLOCK + width - 1, frames))


def windows(
    time: Float[Array, " t"],
    pose: Float[Array, "t m"],
    width: int,
    air: Air,
    sigma: Float[Array, "k"],
    late: float = 0.0,
) -> Windows:
    """Fit flights to all windows of `width` frames.

    Args:
        time: of the frames in s.
        pose: not a number where a frame was lost; θ continuous, or any other third coordinate.
        width: of the windows in frames.
        air: gravity, drag and own accelerations; their change is too small to be seen in a window.
        sigma: standard deviations of a frame's (x, y, θ).
        late: s by which the second half of each window is later than its time stamps.
    """
    when = sliding_window_view(time, width) + late * (np.arange(width) >= width // 2)
    seen = sliding_window_view(finite(pose), width)
    slopes = air.slopes(when - when[:, width // 2, None])[..., :3] * seen[..., None, None]
    y = np.moveaxis(sliding_window_view(pose, width, axis=0), 1, -1)
    if air.d == 3:
        y = np.concatenate((y[..., :3], _rotations(when, y[..., 3:], seen, air)), -1)
    residual = np.where(seen[..., None], y, 0.0) - slopes[..., 2] * air.pull()
    columns, sizes = _orthogonal(np.moveaxis(slopes, -1, 0))
    # Orthogonal columns have a factor each.  Place and speed are free; an acceleration beyond that of the air is as
    # small as those of other flights.
    priors = (0.0, 0.0, (sigma / np.maximum(air.prior[0], _MIN_SUM)) ** 2)
    leverage, line, factor = np.zeros_like(residual), residual, residual
    for column, size, prior in zip(columns, sizes, priors, strict=True):
        line, factor = residual, (column * residual).sum(1, keepdims=True) / (size + prior)
        residual = residual - column * factor
        leverage = leverage + column**2 / (size + prior)
    bend, size = columns[2], sizes[2][:, 0]
    return Windows(
        count=seen.sum(1),
        misfit=(line * residual).sum(1) / sigma**2,
        residual=residual / sigma,
        leverage=leverage,
        acceleration=factor[:, 0],
        error=sigma / np.sqrt(size),
        smooth=((line**2).sum(1) - (bend * line).sum(1) ** 2 / size) / sigma**2,
    )


def _orthogonal(columns: Iterable[Array]) -> tuple[list[Array], list[Array]]:
    """Columns [S, w, k] of a design without what those before them explain, and the sums of their squares."""
    rest, sizes = [], []
    for column in columns:
        for other, size in zip(rest, sizes, strict=True):
            column = column - other * (column * other).sum(1, keepdims=True) / size
        rest.append(column)
        sizes.append(np.maximum((column**2).sum(1, keepdims=True), _MIN_SUM))
    return rest, sizes


def _rotations(when: Array, q: Array, seen: Mask, air: Air) -> Float[Array, "s w 3"]:
    """Rotations of quaternions [S, w, 4] of windows, about their middle frame at the mean spin between frames."""
    last = np.maximum.accumulate(np.where(seen, np.arange(seen.shape[1]), -1), axis=1)
    last = np.where(last < 0, seen.argmax(1)[:, None], last)  # the frame before a lost one
    q = np.where(
        np.asarray(seen.any(1))[:, None, None], np.take_along_axis(q, last[..., None], 1), (1.0, 0.0, 0.0, 0.0)
    )
    when, tau = np.take_along_axis(when, last, 1), when - when[:, seen.shape[1] // 2, None]
    steps = rotation_vector(product(q[:, 1:], conjugate(q[:, :-1]))).sum(1)
    spin = steps / np.maximum(when[:, -1] - when[:, 0], _MIN_SUM)[:, None]
    return Turning(q=q[:, seen.shape[1] // 2], spin=spin, moments=air.moments).counted(q, tau)


_TURNS = 20  # rounds of a fit of free turning; of slow bodies two
_FIRST_TURN = 1.5  # rad, by which a body turns from the reference in the first one
_TURNED = 1e-4  # rad and rad/s, of a difference in place of a derivative
_SETTLED = 0.1  # standard errors by which the last round changes it, at most
_WIDEST = 80  # frames
# χ² that a body at rest makes in the shortest window of a flight, in plane and space; 300 to 750 decide alike
_REST_POWER = {2: 300.0, 3: 100.0}
_STILL_SHARE = 0.1  # of the way of a fast window
# noise of a flight's frames over the recording's, at most; in space 5 and 10 decide alike
_MAX_NOISE_RATIO = {2: 1.0, 3: 5.0}
_FRAMES_AT_SKIP = 3  # frames before and after a skip
# m, by which the lowest point of a body may be lower at one contact than at another; 3 to 12 mm decide alike
_MAX_DROP_OF_LOWEST_POINT = 0.006
_FRAMES_AT_BAD_ONE = 3  # frames of a window on each side of a bad one


def _least_noise(k: int) -> Float[Array, "k"]:
    """Rounding of exact tracks in m, and in rad."""
    return np.array((1e-7, 1e-7, 1e-6) if k == 3 else (1e-7,) * 3 + (1e-6,) * 3)


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """Options of the search for flights and contacts.

    Args:
        fewest: frames of a flight, at least; None for 8 in the plane and 4 in space, where each has twice the numbers.
        contact_time: longest contact in s.  One lasts as long as frames about its instant are in neither flight.
        most_missing: frames that may be missing at contact.
    """

    fewest: int | None = None
    contact_time: float = 3e-3
    most_missing: int = 3

    def narrowest(self, air: Air) -> int:
        """Frames of the narrowest window."""
        return self.fewest or (8 if air.d == 2 else 4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """Free flights of a track, and the noise of a frame's (x, y, θ) about them."""

    flights: tuple[Flight, ...]
    sigma: Float[Array, "k"]
    width: int


def find_flights(
    track: Track,
    air: Air = Air(),
    options: FlightOptions = FlightOptions(),
    limits: TrackThresholds = TrackThresholds(),
) -> Flights:
    """Find the free flights of a track."""
    pose, time, narrowest = track.pose.copy(), track.time, options.narrowest(air)
    sigma = frame_noise(time, pose, max(narrowest, 5), air)
    width = min(_width(sigma, track.step, air, narrowest), len(track))
    if width < narrowest:
        return Flights(flights=(), sigma=sigma, width=narrowest)
    if width > narrowest:
        sigma = frame_noise(time, pose, max(width, 5), air)
    good, uneven = np.zeros(0, dtype=np.bool_), _MAX_NOISE_RATIO[air.d]
    for _ in range(3):
        good, bad_frames = _judged(time, pose, width, air, sigma, limits.excess, uneven)
        if not bad_frames.any():
            break
        pose[bad_frames] = np.nan
    touches = _touches(track)
    good &= ~sliding_window_view(touches, width)[:, 1:-1].any(-1)
    pose[touches] = np.nan  # `_extended` decides on them
    firsts = (_first(time, pose, run, sigma, air, width) for run in _runs(good, width))
    joined = _joined(time, track.pose, [flight for flight in firsts if flight is not None], width, limits)
    extended = [_extended(track, flight, sigma, width, limits) for flight in joined]
    freedom = sum(len(flight.residual) - 2 for flight in extended)
    total = sum(((flight.residual**2).sum(0) for flight in extended), np.zeros(air.k))
    # As if eight frames more had the noise of the windows.
    sigma = _evened(np.maximum(np.sqrt((total + 8 * sigma**2) / (freedom + 8)), _least_noise(air.k)))
    flights = tuple(fit(time, track.pose, f.frames, flight_noise(f, sigma), f.air) for f in extended)
    return Flights(flights=flights, sigma=sigma, width=width)


def _touches(track: Track) -> Bool[Mask, " t"]:
    """Frames next to which a body in space may touch the floor: its lowest point is lower than before and after.

    It is no higher above that of the lowest frame than it moves in a frame, and round corners and edges differ.
    """
    low, touches = np.full(len(track), np.inf) if track.low is None else track.low, np.zeros(len(track), dtype=np.bool_)
    seen = np.flatnonzero(np.isfinite(low))
    if len(seen) > _FRAMES_AT_SKIP:
        there = low[seen]
        before, after = there[:-2] - there[1:-1], there[2:] - there[1:-1]
        near = there[1:-1] - there.min() <= np.maximum(before, after) + _MAX_DROP_OF_LOWEST_POINT
        touches[seen[1:-1]] = (before > 0) & (after >= 0) & near
    return touches


def flight_noise(flight: Flight, sigma: Float[Array, "k"]) -> Float[Array, "k"]:
    """Noise of a flight's frames, in space its own: a tracker sees other sides of a body that turns.

    As if eight frames more had the noise of the recording; positions have one factor, and rotations another.
    """
    if flight.air.d == 2:
        return sigma
    share = ((flight.residual / sigma) ** 2).sum(0).reshape(2, 3).sum(1)
    return sigma * np.repeat(np.sqrt((share + 24) / (3 * len(flight.residual) + 18)), 3)


_WIDEST_PRIOR = {2: ((0.5, 30.0), (10.0, 300.0)), 3: ((0.5, 1.0), (1e-3, 1e-3))}
"""Of position and rotation, at most: with more of it a body at rest would be in flight.  No plates brake one in space,
and short flights would not show that their accelerations are steady."""
_MEDIAN = 0.455  # of χ² with one degree of freedom


def _widest_prior(k: int) -> AccelerationPrior:
    d = k // 3 + 1
    (a, a_turn), (j, j_turn) = _WIDEST_PRIOR[d]
    return (a,) * d + (a_turn,) * (k - d), (j,) * d + (j_turn,) * (k - d)


def long_flights(tracks: Iterable[Track], air: Air) -> list[tuple[Track, Flight, Float[Array, "k"]]]:
    """Flights that are long enough to show more than their velocities, with the noise of a frame about them."""
    air, options, long = replace(air, prior=_widest_prior(air.k)), FlightOptions(), []
    for track in tracks:
        search, bent = (
            find_flights(track, air, options),
            round(options.contact_time / 2 / track.step) + 1,
        )  # by contacts
        for flight in search.flights:
            if len(flight.frames) >= 2 * search.width + 2 * bent:
                frames = flight.frames[bent:-bent]
                long.append((track, fit(track.time, track.pose, frames, search.sigma, air), search.sigma))
    return long


def own_accelerations(long: Sequence[Flight], k: int = 3) -> AccelerationPrior:
    """Standard deviations of own accelerations, as long flights show them.

    Of each flight the likelihood of its own acceleration is normal, with information J and score h.  Under a variance D
    its mean m = (J + 1/D)⁻¹ h has the variance D − (J + 1/D)⁻¹: D is where the median of m² is as large as it should
    be, so that a few stretches which are no flights do not count.
    """
    if len(long) < NEEDED.flights_of_accelerations:
        return (0.0,) * k, (0.0,) * k
    D = most = np.array(_widest_prior(k)).T ** 2
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
    accelerations, changes = np.sqrt(D).T.tolist()
    return tuple(accelerations), tuple(changes)


def restore_skipped_frames(track: Track, air: Air, options: FlightOptions, limits: TrackThresholds) -> Track:
    """Return the track with time stamps that show the frames which it skips in flight without a gap in them.

    Three frames before a skip and three after it are a flight, if the clock of the latter is late by whole frames.
    """
    time = track.time.copy()
    if len(time) < 2 * _FRAMES_AT_SKIP:
        return track
    sigma, k = frame_noise(time, track.pose, max(options.narrowest(air), 5), air), air.k
    for _ in range(_ROUNDS):
        late = [n * track.step for n in range(options.most_missing + 1)]
        chi_square = np.stack(
            [windows(time, track.pose, 2 * _FRAMES_AT_SKIP, air, sigma, seconds).misfit.sum(1) for seconds in late]
        )
        best = chi_square.argmin(0)
        sure = (chi_square.min(0) <= _limit(np.array(2 * k * _FRAMES_AT_SKIP - 2 * k), limits.excess)) & (
            chi_square[0] - chi_square.min(0) > limits.one_flight
        )
        if not sure.any():
            break
        time[_FRAMES_AT_SKIP:] += track.step * np.cumsum(np.append(best * sure, np.zeros(_FRAMES_AT_SKIP - 1)))
    return replace(track, time=time)


def frame_noise(time: Float[Array, " t"], pose: Float[Array, "t m"], width: int, air: Air = Air()) -> Float[Array, "k"]:
    """Standard deviations of a frame about anything smooth: the median over windows of residuals of parabolas.

    Windows in which the body is still do not count: a tracker is better there.
    """
    least = _least_noise(air.k)
    if len(time) < width:
        return least
    counts, squares, moves = list[Indices](), list[Array](), list[Array]()
    for block in window_blocks(len(time), width):
        fits = windows(time[block], pose[block], width, air.smooth(), np.ones(air.k))
        counts.append(fits.count)
        squares.append(fits.misfit)
        moves.append(np.linalg.norm(pose[block][width - 1 :, : air.d] - pose[block][: -width + 1, : air.d], axis=1))
    count, move = np.concatenate(counts), np.nan_to_num(np.concatenate(moves))
    enough = count > 4
    if not enough.any():
        return least
    enough &= move >= _STILL_SHARE * np.quantile(move[enough], 0.95)
    freedom = count[enough] - 3
    share = np.concatenate(squares)[enough] / freedom[:, None]
    typical = (1 - 2 / (9 * np.median(freedom))) ** 3  # median of χ² over its mean; Wilson & Hilferty 1931
    return _evened(np.maximum(np.sqrt(np.median(share, 0) / typical), least))


def _evened(sigma: Float[Array, "k"]) -> Float[Array, "k"]:
    """Noise with one number for all rotations, since a flight has no axes of its own for them."""
    return np.append(sigma[:3], np.full(3, np.sqrt(np.mean(sigma[3:] ** 2)))) if len(sigma) > 3 else sigma


def _width(sigma: Array, step: float, air: Air, narrowest: int) -> int:
    """Frames of the shortest window in which a body at rest makes so large a χ² that it is no free flight."""
    n = np.arange(narrowest, _WIDEST + 1)
    bend = np.linalg.norm(air.gravity) / 2 * step**2
    chi_square = bend**2 * n * (n**2 - 1) * (n**2 - 4) / 180 / sigma[: air.d].max() ** 2
    return int(n[min(int(np.searchsorted(chi_square, _REST_POWER[air.d])), len(n) - 1)])


def _judged(
    time: Array, pose: Array, width: int, air: Air, sigma: Array, excess: float, uneven: float
) -> tuple[Mask, Mask]:
    """Windows that are flights, and frames without which others would be."""
    good, votes = list[Mask](), np.zeros(len(time), dtype=np.intp)
    for block in window_blocks(len(time), width):
        fits = windows(time[block], pose[block], width, air, sigma)
        flies, worst = _worst(fits, excess, uneven)
        good.append(flies)
        votes[block] += np.bincount(worst, minlength=block.stop - block.start)
    return np.concatenate(good), votes >= 2


def _worst(fits: Windows, excess: float, uneven: float) -> tuple[Mask, Indices]:
    """Windows that are flights, and of each of the others that would be one without a frame, this frame.

    A window's noise may be that of a smooth motion there, up to `uneven` times that of the recording.
    """
    _, width, k = fits.residual.shape
    each, total, freedom = fits.residual**2, fits.misfit.sum(1), k * (fits.count - 2)
    enough = fits.count >= max(min(5, width), 0.7 * width)
    noise = np.clip(fits.smooth.sum(1) / np.maximum(k * (fits.count - 3), 1), 1.0, uneven**2)
    good = enough & (total <= noise * _limit(freedom, excess))
    taken = (each / np.maximum(1 - fits.leverage, 1e-3)).sum(2)
    taken[:, : min(_FRAMES_AT_BAD_ONE, width // 3)] = taken[:, width - min(_FRAMES_AT_BAD_ONE, width // 3) :] = 0
    worst = taken.argmax(1)
    without = total - taken[np.arange(len(total)), worst]
    restored = enough & ~good & (without <= noise * _limit(freedom - k, excess))
    return good, (np.arange(len(total)) + worst)[restored]


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
    trim = min(2, max(0, b - a - width + 2)) if air.d == 2 else 0  # in space `_touches` ends a run
    frames = np.arange(a + trim, b + 1 - trim)
    frames = frames[finite(pose[frames])]
    if len(frames) < (4 if air.d == 2 else 3):
        return None
    flight = fit(time, pose, frames, sigma, air)
    return flight if air.d == 2 else fit(time, pose, frames, flight_noise(flight, sigma), air)


def state_difference(
    one: Flight, other: Flight, time: float, late: float = 0.0
) -> tuple[Float[Array, "two_k"], Float[Array, "two_k two_k"]]:
    """Difference of two flights' states at an instant, and its covariance.

    The clock of the other flight may be late, in s.
    """
    (p, v, A), (q, w, B) = one.at(time), other.at(time - late)
    return np.concatenate((away(q, p), w - v)), A + B


def same_flight(one: Flight, other: Flight, time: float, limits: TrackThresholds, late: float = 0.0) -> bool:
    """Whether two flights agree at an instant as one flight does."""
    difference, covariance = state_difference(one, other, time, late)
    return float(difference @ np.linalg.solve(covariance, difference)) <= limits.one_flight


def _joined(time: Array, pose: Array, flights: Sequence[Flight], width: int, limits: TrackThresholds) -> list[Flight]:
    """Neighbouring flights that agree, as one: only bad or lost frames were between them."""
    joined: list[Flight] = []
    for flight in flights:
        if joined:
            last = joined[-1]
            middle = (time[last.last] + time[flight.first]) / 2
            if flight.first - last.last <= 2 * width and same_flight(last, flight, middle, limits):
                between = np.arange(last.first, flight.last + 1)
                between = between[finite(pose[between])]
                joined[-1] = fit(time, pose, between, np.maximum(last.sigma, flight.sigma), flight.air)
                continue
        joined.append(flight)
    return joined


def _extended(track: Track, flight: Flight, sigma: Array, reach: int, limits: TrackThresholds) -> Flight:
    """A flight with the frames before and after it that continue it, up to three in a row that do not."""
    frames = flight.frames
    sigma = flight_noise(flight, sigma)
    for side in (-1, 1):
        edge = flight.first if side < 0 else flight.last
        near = edge + side * np.arange(1, 2 * reach + 1)
        near = near[(near >= 0) & (near < len(track))]
        near = near[track.seen[near]]
        ends_with = flight.frames[-2 * reach :] if side > 0 else flight.frames[: 2 * reach]
        end = fit(track.time, track.pose, ends_with, sigma, flight.air)  # of a long one the acceleration may change
        off = away(track.pose[near], end.poses(track.time[near]))
        scaled = np.abs(off) / np.hypot(sigma, end.spread(track.time[near]))
        continues = scaled.max(1, initial=0.0) <= limits.continues
        following = np.append(continues, (False, False))
        ends = np.append(np.flatnonzero(~continues & ~following[1:-1] & ~following[2:]), len(near))
        frames = np.concatenate((frames, near[: ends[0]][continues[: ends[0]]]))
    return replace(flight, frames=np.unique(frames))
