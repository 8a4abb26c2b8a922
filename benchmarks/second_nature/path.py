"""Impact of a rigid body along Routh's path: the normal impulse grows in fine steps, friction follows the slip.

A step gives the normal impulse h.  The tangential impulse of the step is the one that stops the slip, clipped to the
cone ±μ h (Moreau's implicit step), so that sliding, stopping, sticking and reversed sliding need no cases; the path
converges to Routh's as h → 0.  Compression ends at v_n = 0.  Restitution ends after Newton at v_n = −ε v_n⁻, after
Poisson at P_n = (1 + ε) P_n^c, after Stronge where the work regained is ε² of the work lost.

Everything is in the contact's frame (t, n) with velocities [n, 3] = (v_t of the centre, v_n of the centre, ω).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

NEWTON, POISSON, STRONGE = "newton", "poisson", "stronge"
_LONGEST = 12  # phases of a jammed contact are given up after so many times their usual length


@dataclass(frozen=True)
class Contacts:
    """Bodies at the moment of contact: mass, inertia [n], contact point r [n, 2], velocity [n, 3], μ and ε [n]."""

    mass: np.ndarray
    inertia: np.ndarray
    r: np.ndarray
    v: np.ndarray
    mu: np.ndarray
    eps: np.ndarray

    @cached_property
    def W(self):
        """W_tt, W_tn, W_nn [n]."""
        (x, y), m, inertia = self.r.T, self.mass, self.inertia
        return 1 / m + y**2 / inertia, -x * y / inertia, 1 / m + x**2 / inertia

    def slip(self, v):
        """Tangential velocity of the contact point [n]."""
        return v[:, 0] - self.r[:, 1] * v[:, 2]

    def approach(self, v):
        """Normal velocity of the contact point [n], negative before contact."""
        return v[:, 1] + self.r[:, 0] * v[:, 2]


class Outcome(NamedTuple):
    """Velocity after contact [n, 3] and (P_t, P_n) [n, 2]; NaN where the contact jams."""

    v: np.ndarray
    P: np.ndarray


@dataclass(frozen=True)
class Extras:
    """Physics beyond Coulomb's and restitution's.

    `friction` is a factor of μ by the present slip; `lever` a moment per normal impulse in m by the present velocity;
    `rebound` the share of the tangential impulse of compression that a stuck contact gives back in restitution.
    """

    friction: Callable[[np.ndarray], np.ndarray] | None = None
    lever: Callable[[np.ndarray], np.ndarray] | None = None
    rebound: float = 0.0


def impact(contacts: Contacts, restitution: str, extras: Extras = Extras(), steps: int = 240) -> Outcome:
    """Integrate compression and restitution in about `steps` steps each."""
    walk = _Walk(contacts, extras)
    v_n = contacts.approach(contacts.v)
    h = -v_n / contacts.W[2] / steps
    walk.until(h, lambda before, after: _part(-before.v_n, after.v_n - before.v_n), steps)
    compressed, work = walk.P[:, 1].copy(), -walk.work
    walk.release(compressed * contacts.eps)
    if restitution == POISSON:
        part = contacts.eps * compressed / steps
        for _ in range(steps):
            walk.step(part)
    elif restitution == NEWTON:
        walk.until(h, lambda a, b: _part(-contacts.eps * v_n - a.v_n, b.v_n - a.v_n), steps)
    else:
        lost = (1 - contacts.eps**2) * work
        walk.until(h, lambda before, after: _part_of_work(-lost - before.work, h, before.v_n, after.v_n), steps)
    return Outcome(np.where(walk.jammed[:, None], np.nan, walk.v), walk.P)


def _part(missing, gain):
    """The part of a step after which a quantity linear in it has gained what is missing; infinite if it never does."""
    return np.where(gain > 0, missing / np.where(gain > 0, gain, 1.0), np.where(missing > 0, np.inf, 0.0))


def _part_of_work(missing, h, v_n, after):
    """Likewise for the work h s (v_n + s (v_n' − v_n)/2), quadratic in the part s."""
    root = v_n**2 + 2 * (after - v_n) * missing / h
    speed = np.maximum(v_n, 0) + np.sqrt(np.maximum(root, 0))
    return np.where(
        missing <= 0,
        0.0,
        np.where((root >= 0) & (speed > 0), 2 * missing / h / np.where(speed > 0, speed, 1.0), np.inf),
    )


class _Moment(NamedTuple):
    v: np.ndarray
    P: np.ndarray
    work: np.ndarray
    v_n: np.ndarray


class _Walk:
    """The state along the path: velocity, impulse and normal work."""

    def __init__(self, contacts: Contacts, extras: Extras):
        self.contacts, self.extras = contacts, extras
        n = len(contacts.mass)
        self.v, self.P, self.work = contacts.v.copy(), np.zeros((n, 2)), np.zeros(n)
        self.jammed = np.zeros(n, bool)
        self.rebound = np.zeros(n)
        self.stuck = np.zeros(n, bool)

    def until(self, h, part, steps):
        """Step by h until `part` of the step ends the phase, and go that part of it."""
        active = np.ones(len(h), bool)
        for _ in range(_LONGEST * steps):
            before, after = self._moment(), self._after(h)
            share = part(before, after)
            self._go(before, after, np.where(active, np.minimum(share, 1.0), 0.0))
            active &= share > 1.0
            if not active.any():
                break
        self.jammed |= active

    def step(self, h):
        """One whole step."""
        before = self._moment()
        self._go(before, self._after(h), np.ones(len(h)))

    def release(self, impulse):
        """Begin restitution: what stuck gives back a share of its tangential impulse over the normal `impulse`."""
        slip = self.contacts.slip(self.v)
        self.stuck = (np.abs(slip) < 1e-6 + 0.005 * np.abs(self.contacts.slip(self.contacts.v))) & (
            self.extras.rebound != 0
        )
        self.rebound = self.extras.rebound * self.P[:, 0] / np.maximum(impulse, 1e-12)

    def _moment(self):
        return _Moment(self.v, self.P, self.work, self.contacts.approach(self.v))

    def _after(self, h):
        """The state one step on."""
        c, v = self.contacts, self.v
        w_tt, w_tn, _ = c.W
        lever = 0.0 if self.extras.lever is None else self.extras.lever(v)
        free = v + np.stack((0 * h, h / c.mass, h * (c.r[:, 0] + lever) / c.inertia), -1)
        cone = c.mu * h * (1.0 if self.extras.friction is None else self.extras.friction(c.slip(v)))
        hold = np.where(self.stuck, -w_tn / w_tt * h + self.rebound * h, -c.slip(free) / w_tt)
        P_t = np.clip(hold, -cone, cone)
        new = free + np.stack((P_t / c.mass, 0 * h, -c.r[:, 1] * P_t / c.inertia), -1)
        v_n, before = c.approach(new), c.approach(v)
        return _Moment(new, self.P + np.stack((P_t, h), -1), self.work + h * (v_n + before) / 2, v_n)

    def _go(self, before, after, share):
        self.v = before.v + share[:, None] * (after.v - before.v)
        self.P = before.P + share[:, None] * (after.P - before.P)
        self.work = before.work + share * (after.work - before.work)
