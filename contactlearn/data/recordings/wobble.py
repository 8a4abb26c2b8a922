"""The centre of mass about the tracked point, from the wobble of bodies that spin in free flight.

The centre of mass, c from the tracked point, flies on a parabola, and the tracked point about that.  The parts of x, y
and of the turned axes that no polynomial of the time makes are compared flight by flight.  Flights whose accelerations
change are cubics: both are fitted, and half their difference is part of the error, as is the scatter between flights.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.flights import Flight
from contactlearn.data.recordings.track import Array, Track
from contactlearn.mechanics.apparatus import Estimate

_DEGREES = (2, 3)  # of the polynomials
_FEWEST = 8  # flights that turn, for the scatter between them to show the error
_TURN = 0.5  # rad, of a flight that counts

Wobble = Float[Array, "2 2 3"]
"""Of one flight normal matrix and right-hand side of c, side by side, with either degree."""


def wobbles(track: Track, flights: Iterable[Flight], sigma: Float[Array, "3"]) -> tuple[Wobble, ...]:
    """Return the normal equations of the flights of a track that turn far enough."""
    found = list[Wobble]()
    for flight in flights:
        time, (x, y, theta) = track.time[flight.frames] - flight.reference, track.pose[flight.frames].T
        if np.ptp(theta) < _TURN or len(time) <= 2 * _DEGREES[-1]:
            continue
        scale = time / max(np.abs(time).max(), 1e-12)
        parts = []
        for degree in _DEGREES:
            Q = np.linalg.qr(np.vander(scale, degree + 1))[0]
            c, s, u, v = (one - Q @ (Q.T @ one) for one in (np.cos(theta), np.sin(theta), x, y))
            design = -np.concatenate((np.stack((c, -s), 1) / sigma[0], np.stack((s, c), 1) / sigma[1]))
            value = np.concatenate((u / sigma[0], v / sigma[1]))
            parts.append(np.column_stack((design.T @ design, design.T @ value)))
        found.append(np.stack(parts))
    return tuple(found)


def centre_of_mass(flights: Sequence[Wobble]) -> tuple[Estimate, Estimate] | None:
    """Estimate the centre of mass about the tracked point in m, along the body's axes; None of too few flights."""
    if len(flights) < _FEWEST:
        return None
    every = np.stack(flights)
    total = every.sum(0)
    parabola, cubic = (np.linalg.solve(part[:, :2], part[:, 2]) for part in total)
    scores = every[:, 1, :, 2] - every[:, 1, :, :2] @ cubic
    inverse = np.linalg.inv(total[1, :, :2])
    covariance = inverse @ (scores.T @ scores) @ inverse * len(every) / (len(every) - 2)
    errors = np.hypot(np.sqrt(covariance.diagonal()), (cubic - parabola) / 2)
    a, b = (Estimate(value=float(x), error=float(error)) for x, error in zip(cubic, errors, strict=True))
    return (a, b) if math.isfinite(a.error + b.error) else None
