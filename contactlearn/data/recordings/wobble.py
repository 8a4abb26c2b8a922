"""The centre of mass about the tracked point, from the wobble of bodies that spin in free flight.

The centre of mass, c from the tracked point, flies as `Air` says, with an own acceleration of each flight, and the
tracked point of a body that spins wobbles about it.  Each flight shows c by weighted least squares.  A few fast ones
show most of it, so that the error is that of the jackknife over flights (Efron & Stein 1981), and no less than noise
and accelerations make.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.flights import AccelerationPrior, Flight
from contactlearn.data.recordings.poses import Array, arms, orientation
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.apparatus import Estimate

_OFF = 0.01  # m, standard deviation that is expected of c

Wobble = Float[Array, "d e"]
"""Of one flight normal matrix and right-hand side of c, side by side."""


def wobble(track: Track, flight: Flight, prior: AccelerationPrior) -> Wobble:
    """Return the normal equations of c that a flight of the tracked point makes, with own accelerations so large."""
    time, d = track.time[flight.frames], track.d
    units = np.concatenate((np.ones((2, track.k)), prior)).T
    slopes, turned = flight.air.slopes(time - flight.reference), orientation(flight.poses(time))
    y = track.pose[flight.frames, :d] - slopes[:, :d, 2] * flight.air.gravity
    turning, found = -np.stack([arms(one, turned) for one in np.eye(d)], -1), np.zeros((d, d + 1))
    for k in range(d):
        smooth, W = slopes[:, k] * units[k], np.column_stack((turning[:, k], y[:, k]))
        smooth, W = smooth / flight.sigma[k], W / flight.sigma[k]
        inverse = np.linalg.inv(smooth.T @ smooth + np.diag((0.0, 0.0, 1.0, 1.0)))
        found += (W.T @ (W - smooth @ inverse @ (smooth.T @ W)))[:d]
    return found


def centre_of_mass(flights: Sequence[Wobble]) -> tuple[Estimate, ...] | None:
    """Estimate the centre of mass about the tracked point in m, along the body's axes; None of too few flights."""
    count = len(flights)
    if count < NEEDED.flights_of_centre:
        return None
    every = np.stack(flights)
    total = every.sum(0)
    total[:, :-1] += np.eye(len(total)) / _OFF**2
    left = total - np.concatenate((0 * every[:1], every))  # with all flights, and without each
    found, *others = np.linalg.solve(left[..., :-1], left[..., -1:])[..., 0]
    errors = np.maximum(np.std(others, 0) * (count - 1) ** 0.5, np.linalg.inv(total[:, :-1]).diagonal() ** 0.5)
    return tuple(Estimate(value=float(x), error=float(error)) for x, error in zip(found, errors, strict=True))
