"""Free flight: lines in x and θ, a parabola in y, fitted robustly, with their covariance.

    x = x₀ + v_x s(τ) + g_x b(τ)      v = v e^{−cτ} + g s(τ)        s(τ) = (1 − e^{−cτ})/c → τ
    y = y₀ + v_y s(τ) + g_y b(τ)                                    b(τ) = (τ − s(τ))/c → τ²/2
    θ = θ₀ + ω τ                                                    as the drag c → 0

with τ from a reference instant, gravity (g_x, g_y) and a linear drag c that are known.  Each coordinate is then linear
in two numbers, so that any number of windows is fitted at once in closed form.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from contactlearn.data.recordings.track import Array, finite, turn
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
        told: its variance is that of a frame over this, [S, 3].
    """

    count: Int[Indices, " s"]
    residual: Float[Array, "s w 3"]
    leverage: Float[Array, "s w 3"]
    leading: Float[Array, "s 3"]
    told: Float[Array, "s 3"]


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
    return Windows(count=count, residual=residual, leverage=leverage, leading=factor[:, 0], told=size[:, 0])
