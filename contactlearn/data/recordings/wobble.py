"""The centre of mass about the tracked point, from the wobble of bodies that spin in free flight.

The centre of mass, c from the tracked point, flies on a parabola, and the tracked point about that.  The parts of its position
and of the turned axes that no polynomial of the time makes are compared flight by flight.  Flights whose accelerations
change are cubics: both are fitted, and half their difference is part of the error, as is the scatter between flights.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.flights import Flight
from contactlearn.data.recordings.poses import Array, arms, orientation
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import Estimate

_DEGREES = (2, 3)  # of the polynomials
_FEWEST = 8  # flights that turn, for the scatter between them to show the error
_TURN = 0.5  # rad, of a flight that counts

Wobble = Float[Array, "two d e"]
"""Of one flight normal matrix and right-hand side of c, side by side, with either degree."""


def wobbles(track: Track, flights: Iterable[Flight], sigma: Float[Array, "k"]) -> tuple[Wobble, ...]:
    """Return the normal equations of the flights of a track that turn far enough."""
    found = list[Wobble]()
    for flight in flights:
        time, pose, d = track.time[flight.frames] - flight.reference, track.pose[flight.frames], track.d
        turned = np.linalg.norm(flight.state[1, d:]) * np.ptp(time) if d == 3 else np.ptp(pose[:, 2])
        if turned < _TURN or len(time) <= 2 * _DEGREES[-1]:
            continue
        scale = time / max(np.abs(time).max(), 1e-12)
        axes = np.stack([arms(axis, orientation(pose)) for axis in np.eye(d)], -1) / sigma[:d, None]
        parts = []
        for degree in _DEGREES:
            Q = np.linalg.qr(np.vander(scale, degree + 1))[0]
            design, value = (
                (one - np.tensordot(Q, np.tensordot(Q, one, (0, 0)), 1)).reshape(len(time) * d, -1)
                for one in (-axes, pose[:, :d] / sigma[:d])
            )
            parts.append(np.concatenate((design.T @ design, design.T @ value.reshape(-1, 1)), 1))
        found.append(np.stack(parts))
    return tuple(found)


def centre_of_mass(flights: Sequence[Wobble]) -> tuple[Estimate, ...] | None:
    """Estimate the centre of mass about the tracked point in m, along the body's axes; None of too few flights."""
    if len(flights) < _FEWEST:
        return None
    every = np.stack(flights)
    total = every.sum(0)
    parabola, cubic = (np.linalg.solve(part[:, :-1], part[:, -1]) for part in total)
    scores = every[:, 1, :, -1] - every[:, 1, :, :-1] @ cubic
    inverse = np.linalg.inv(total[1, :, :-1])
    covariance = inverse @ (scores.T @ scores) @ inverse * len(every) / (len(every) - 2)
    errors = np.hypot(np.sqrt(covariance.diagonal()), (cubic - parabola) / 2)
    if not np.isfinite(errors).all():
        return None
    return tuple(Estimate(value=float(x), error=float(error)) for x, error in zip(cubic, errors, strict=True))
