"""Nature's contact: a rigid body on a floor, followed in small steps of normal impulse.

The clock is the normal impulse p.  With W the inverse effective inertia at the contact, friction
dP_t/dp = −μ sign v_t while it slips and a moment dτ/dp = c (a length: where the pressure's centre
is), a step of dp changes

    dv_t = (W_tn − r_y c / I) dp + W_tt dP_t,    dv_n = (W_nn + r_x c / I) dp + W_tn dP_t,
    dω = (r_x dp − r_y dP_t + c dp) / I.

μ and c may depend on the slip v_t and the spin ω of that very instant, which no law in closed form
can follow.  A step ends where the slip does; at v_t = 0 the contact sticks if the impulse that this
takes is within ±μ dp, and slides back otherwise.  Compression ends at v_n = 0.  Restitution ends

    poisson     after ε times the normal impulse of compression
    stronge     when ε² times the normal work of compression has been given back

and both ends are hit by a step of the right length.  With constant μ and c = 0 every step is exact.
Sources: Routh (1860); Keller (1986); Stronge (1990); Johnson, Kendall & Roberts (1971).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.mechanics.rigid_body import apply_wrench, contact_velocity, inverse_inertia

STEPS = 200  # of compression, and of restitution
_TENDENCY = 1e-12  # m/s: the slip of a contact that is about to slip, for its sign alone


class ContactState(NamedTuple):
    """N contacts in the floor's axes: tangent x, normal y."""

    mass: Tensor  # [N] kg
    inertia: Tensor  # [N] kg m²
    r: Tensor  # [N, 2] m, contact point minus centre of mass
    v: Tensor  # [N, 3] m/s, rad/s, velocity of the centre of mass before contact
    eps: Tensor  # [N] coefficient of restitution
    energetic: bool  # restitution by Stronge's work, else by Poisson's impulse
    friction: Callable[[Tensor], Tensor]  # slip [N] in m/s → μ [N]
    lever: Callable[[Tensor], Tensor]  # spin [N] in rad/s → moment per normal impulse [N] in m


_Numbers = NDArray[np.float64]


class _Instant(NamedTuple):
    """Velocities and what has accumulated since first touch, each [N]."""

    v_t: _Numbers
    v_n: _Numbers
    omega: _Numbers
    P_t: _Numbers
    p: _Numbers
    tau: _Numbers
    work: _Numbers  # J, of the normal impulse on the body in this phase


def collide(contact: ContactState, steps: int = STEPS) -> Tensor:
    """Velocity of the centre of mass [N, 3] after contact.

    Args:
        contact: N contacts on approach, v_n < 0.
        steps: of each phase; the error of an effect falls as 1 / steps.

    Raises:
        DataError: a contact that does not come to its end, as with numbers that are not finite.
    """
    v_t, v_n = (value.numpy() for value in contact_velocity(contact.r, contact.v).unbind(-1))
    zero, eps = np.zeros_like(v_n), contact.eps.numpy()
    start = _Instant(v_t, v_n, contact.v[:, 2].numpy(), zero, zero, zero, zero)
    step = -v_n / (inverse_inertia(contact.mass, contact.inertia, contact.r)[:, 1, 1].numpy() * steps)
    middle = _follow(contact, start, step, steps, _until_stopped)
    stored = -middle.work
    if contact.energetic:

        def until_end(now: _Instant, rise: _Numbers) -> _Numbers:
            left = np.maximum(eps**2 * stored - now.work, 0)
            square = torch.from_numpy(np.maximum(now.v_n**2 + 2 * rise * left, 0))
            root = square.sqrt().numpy()  # NumPy's differs in the last digit, and a seed has its bits
            return 2 * left / np.maximum(now.v_n + root, np.finfo(np.float64).tiny)
    else:

        def until_end(now: _Instant, rise: _Numbers) -> _Numbers:
            return (1 + eps) * middle.p - now.p

    middle = middle._replace(v_n=zero, work=zero)
    step = np.maximum(eps, 1e-6) * middle.p / steps  # not 0, or rounding would keep ε = 0 from its end
    end = _follow(contact, middle, step, steps, until_end)
    wrench = torch.from_numpy(np.stack((end.P_t, end.p, end.tau), -1))
    return apply_wrench(contact.mass, contact.inertia, contact.r, contact.v, wrench)


def part(contact: ContactState, v: Tensor, work: float) -> Tensor:
    """Velocity [N, 3] after surfaces that stick together are torn apart, at a cost of `work` in J.

    The normal impulse −d < 0 that does it takes the energy v_n d − W_nn d²/2; where there is not
    enough, the contact point stops.
    """
    v_n = contact_velocity(contact.r, v)[:, 1].clamp_min(0)
    w_nn = inverse_inertia(contact.mass, contact.inertia, contact.r)[:, 1, 1]
    pull = (v_n - (v_n**2 - 2 * w_nn * work).clamp_min(0).sqrt()) / w_nn
    zero = torch.zeros_like(pull)
    return apply_wrench(contact.mass, contact.inertia, contact.r, v, torch.stack((zero, -pull, zero), -1))


def _until_stopped(now: _Instant, rise: _Numbers) -> _Numbers:
    """Impulse until v_n = 0, at a rise of dv_n/dp."""
    return np.where(rise > 0, -now.v_n / rise, np.inf)


def _follow(
    contact: ContactState,
    now: _Instant,
    step: _Numbers,
    steps: int,
    until_end: Callable[[_Instant, _Numbers], _Numbers],
) -> _Instant:
    """One phase, in steps of about `step` (N s, per trial), to the end that `until_end` gives.

    The thousands of operations on few numbers take NumPy a third of the time that they take PyTorch.
    """
    W = inverse_inertia(contact.mass, contact.inertia, contact.r).numpy()
    w_tt, w_tn, w_nn = W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]
    r, inertia = contact.r.numpy(), contact.inertia.numpy()
    turn_t, turn_n = -r[:, 1] / inertia, r[:, 0] / inertia
    running = np.ones_like(step, dtype=bool)
    with np.errstate(all="ignore"):  # what is divided by zero is not taken
        for _ in range(50 * steps):
            lever = contact.lever(torch.from_numpy(now.omega)).numpy()
            drive = w_tn + turn_t * lever  # dv_t/dp without friction
            slips = now.v_t != 0
            stick = -drive / w_tt
            slip = np.where(slips, now.v_t, _TENDENCY * np.sign(drive))
            mu = contact.friction(torch.from_numpy(slip)).numpy()
            slope = np.where(slips, -np.sign(now.v_t) * mu, np.minimum(np.maximum(stick, -mu), mu))
            sticks = ~slips & (np.abs(stick) <= mu)
            slip_rate = np.where(sticks, 0.0, drive + w_tt * slope)
            rise = w_nn + turn_n * lever + w_tn * slope
            until_stick = np.where(slips & (slip_rate * now.v_t < 0), -now.v_t / slip_rate, np.inf)
            remaining = until_end(now, rise)
            # The way is long, and so are the steps, where W is nearly singular or friction drives the body into the
            # floor.
            event = np.minimum(until_stick, remaining)
            far = np.where(event < np.inf, event / steps, 0.0)
            dp = np.minimum(np.maximum(step, far), event)
            ends = remaining <= dp
            dp = np.where(running, dp, 0.0)
            now = _Instant(
                v_t=np.where(running & (until_stick <= dp), 0.0, now.v_t + slip_rate * dp),
                v_n=now.v_n + rise * dp,
                omega=now.omega + (turn_n + turn_t * slope + lever / inertia) * dp,
                P_t=now.P_t + slope * dp,
                p=now.p + dp,
                tau=now.tau + lever * dp,
                work=now.work + (now.v_n + 0.5 * rise * dp) * dp,
            )
            running = running & ~ends
            if not running.any():
                return now
    raise DataError(f"{int(running.sum())} simulated contacts do not come to an end: are their numbers finite?")
