"""Ground-truth contacts of a rigid body with a floor: rigid ones in steps of impulse, compliant ones in time.

Rigid contacts follow the normal impulse p.  With W the inverse effective inertia at the contact, friction
dP_t/dp = −μ sign v_t while it slips and a moment dτ/dp = c (a length: the offset of the centre of pressure), a step of
dp changes

    dv_t = (W_tn − r_y c / I) dp + W_tt dP_t,    dv_n = (W_nn + r_x c / I) dp + W_tn dP_t,
    dω = (r_x dp − r_y dP_t + c dp) / I.

μ and c may depend on the slip v_t and the spin ω of that very instant, which no law in closed form can follow.  A step
ends where the slip does; at v_t = 0 the contact sticks if the impulse that this takes is within ±μ dp, and slides back
otherwise.  Compression ends at v_n = 0.  Restitution ends

    poisson     after ε times the normal impulse of compression
    stronge     when ε² times the normal work of compression has been given back

and both ends are hit by a step of the right length.  With constant μ and c = 0 every step is exact.

Compliant contacts have springs between body and floor:

    normal       F_n = k δ while the indentation δ grows, then k/ε² (δ − (1 − ε²) δ_max), never negative:
                 the stiffer unloading keeps 1 − ε² of the normal work, whatever the tangent does
    tangential   a spring of stiffness k/c in parallel with a dashpot, together stretched by ξ, in series with
                 a Coulomb slider: F_t = −(k/c) (ξ + T dξ/dt) while it holds, and |F_t| ≤ μ F_n

The tangential spring may spin the body back, as a superball does.  Its c = k_n/k_t is between 1 and 1.5 for an elastic
sphere (Mindlin 1949), and T says how slowly its stretch changes: for a resilience of 1 the dashpot is absent, T = 0,
and for one of 0 it is rigid, T = ∞, and the contact sticks or slides at once.  Only ratios matter: time is counted in
units in which k W_nn = 1, so that compression alone takes π/2.  The normal step is a leapfrog; the tangential one is
implicit, so that a rigid contact is no special case, and loses a little energy but never gains any.
Sources: Routh (1860); Keller (1986); Stronge (1990); Johnson, Kendall & Roberts (1971); Maw, Barber & Fawcett (1976);
Walton & Braun (1986); Walton (1993).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
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


class _Instant(NamedTuple):
    """Velocities and what has accumulated since first touch, each [N]."""

    v_t: np.ndarray
    v_n: np.ndarray
    omega: np.ndarray
    P_t: np.ndarray
    p: np.ndarray
    tau: np.ndarray
    work: np.ndarray  # J, of the normal impulse on the body in this phase


def collide_rigid(contact: ContactState, steps: int = STEPS) -> Tensor:
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

    def until_stopped(now: _Instant, rise: np.ndarray) -> np.ndarray:
        return np.where(rise > 0, -now.v_n / rise, np.inf)

    middle = _follow(contact, start, step, steps, until_stopped)
    stored = -middle.work
    if contact.energetic:

        def until_end(now: _Instant, rise: np.ndarray) -> np.ndarray:
            left = np.maximum(eps**2 * stored - now.work, 0)
            square = torch.from_numpy(np.maximum(now.v_n**2 + 2 * rise * left, 0))
            root = square.sqrt().numpy()  # NumPy's differs in the last digit, and a seed has its bits
            return 2 * left / np.maximum(now.v_n + root, np.finfo(np.float64).tiny)
    else:

        def until_end(now: _Instant, rise: np.ndarray) -> np.ndarray:
            return (1 + eps) * middle.p - now.p

    middle = middle._replace(v_n=zero, work=zero)
    step = np.maximum(eps, 1e-6) * middle.p / steps  # not 0, or rounding would keep ε = 0 from its end
    end = _follow(contact, middle, step, steps, until_end)
    wrench = torch.from_numpy(np.stack((end.P_t, end.p, end.tau), -1))
    return apply_wrench(contact.mass, contact.inertia, contact.r, contact.v, wrench)


def detach(contact: ContactState, v: Tensor, work: float) -> Tensor:
    """Velocity [N, 3] after surfaces that stick together are torn apart, at a cost of `work` in J.

    The normal impulse −d < 0 that does it takes the energy v_n d − W_nn d²/2; where there is not
    enough, the contact point stops.
    """
    v_n = contact_velocity(contact.r, v)[:, 1].clamp_min(0)
    w_nn = inverse_inertia(contact.mass, contact.inertia, contact.r)[:, 1, 1]
    pull = (v_n - (v_n**2 - 2 * w_nn * work).clamp_min(0).sqrt()) / w_nn
    zero = torch.zeros_like(pull)
    return apply_wrench(contact.mass, contact.inertia, contact.r, v, torch.stack((zero, -pull, zero), -1))


def _follow(
    contact: ContactState,
    now: _Instant,
    step: np.ndarray,
    steps: int,
    until_end: Callable[[_Instant, np.ndarray], np.ndarray],
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


COMPLIANT_STEPS = 400  # of a free compression


def collide_compliant(
    contact: ContactState, compliance: float, resilience: float, steps: int = COMPLIANT_STEPS
) -> Tensor:
    """Velocity of the centre of mass [N, 3] after contact.

    Args:
        contact: N contacts on approach with ε > 0; restitution is energetic in any case.
        compliance: c = k_n/k_t of the tangential spring, at least 0.
        resilience: s in [0, 1], T = (1/s − 1) times a free compression.
        steps: of a free compression; the error falls as 1 / steps.

    Raises:
        DataError: a contact that does not come to its end, as with numbers that are not finite.
    """
    W = inverse_inertia(contact.mass, contact.inertia, contact.r)
    w_tt, w_tn, w_nn = W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]
    turn_t, turn_n = -contact.r[:, 1] / contact.inertia, contact.r[:, 0] / contact.inertia
    v_t, v_n = contact_velocity(contact.r, contact.v).unbind(-1)
    omega = contact.v[:, 2]
    dt = 0.5 * math.pi / steps
    depth = deepest = stretch = P_t = p = tau = torch.zeros_like(v_n)
    give = compliance * w_nn  # of the tangential spring: stretch per force
    recall = resilience / (resilience * dt + (1 - resilience) * 0.5 * math.pi)  # 1 / (dt + T)
    normal = torch.zeros_like(v_n)
    for _ in range(50 * steps):
        middle = depth - 0.5 * dt * v_n
        deepest = torch.maximum(deepest, middle)
        back = (middle - (1 - contact.eps**2) * deepest) / contact.eps**2
        normal = torch.minimum(middle, back).clamp_min(0) / w_nn
        if bool((normal == 0).all()):
            return apply_wrench(contact.mass, contact.inertia, contact.r, contact.v, torch.stack((P_t, p, tau), -1))
        lever = contact.lever(omega)
        free = v_t + dt * (w_tn + turn_t * lever) * normal
        tangential = -(recall * stretch + free) / (recall * give + dt * w_tt)
        mu = contact.friction(-tangential.sign() * v_t.abs().clamp_min(_TENDENCY))
        tangential = tangential.clamp(-mu * normal, mu * normal)
        stretch = stretch - dt * recall * (stretch + give * tangential)  # the slider takes the rest
        v_t = free + dt * w_tt * tangential
        v_n = v_n + dt * ((w_nn + turn_n * lever) * normal + w_tn * tangential)
        omega = omega + dt * ((turn_n + lever / contact.inertia) * normal + turn_t * tangential)
        depth = middle - 0.5 * dt * v_n
        P_t, p, tau = P_t + dt * tangential, p + dt * normal, tau + dt * lever * normal
    raise DataError(
        f"{int(normal.count_nonzero())} simulated contacts do not come to an end: are their numbers finite?"
    )
