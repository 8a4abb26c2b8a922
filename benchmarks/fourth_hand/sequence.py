"""Unknown physics that follows the sequence of the trials: (laboratory, amplitude) → change.

The sources are from memory of the literature, but for those of `heat` and `pile`, which were looked up.  They are
sources of the idea; the forms and the numbers are the author's.
"""

import numpy as np

from fourth_hand.known import centred
from fourth_hand.laboratory import Change


def standard(g):
    """Of mean 0 and standard deviation 1."""
    return (g - g.mean()) / g.std()


def heat(lab, a):
    """A polymer floor is warmed by the energy that each impact leaves, and keeps 0.8 of it from trial to trial.

    Its resilience rises with the temperature (squash balls: thebounce, ithacasquash.com 2000; Jenkins 2003; loss
    modulus against temperature: Ferry 1980).  Earlier drops had warmed the floor to its mean state.
    """
    warmth = np.full(len(lab.x), 4.0 * lab.lost.mean())
    for k in range(1, len(warmth)):
        warmth[k] = 0.80 * (warmth[k - 1] + lab.lost[k - 1])
    return Change(restitution=a * standard(warmth))


def pile(lab, a):
    """The last slip lays the pile of a fabric floor: more friction against it, less along it.

    Directional friction of pile and fibrils: Hancock, Sekeroglu & Demirel 2012; Filippov & Gorb 2016.
    """
    sign = np.sign(lab.slip)
    return Change(friction=1 + a * np.r_[0, -sign[1:] * sign[:-1]])


def wiped(lab, a):
    """Wear debris gathers and saturates; the floor is wiped after every 26 trials (third body: Godet 1984)."""
    age = lab.order % 26
    return Change(friction=1 + a * standard(1 - np.exp(-age / 9.0)))


def gripper(lab, a):
    """Two release grippers in the order ABBA; B snaps open and leaves the body ringing in its first bending mode.

    That takes energy from the rebound (loss to vibration: Stoianovici & Hurmuzlu 1996; the gripper is the author's).
    """
    return Change(restitution=a * np.where(np.isin(lab.order % 4, (1, 2)), -1.0, 1.0))


def suction(lab, a):
    """A vacuum table whose pump is on for 40 % of a cycle of 11.7 trials takes normal impulse while in contact."""
    on = ((lab.order / 11.7 + 0.2) % 1.0 < 0.4).astype(float)
    return Change(normal=-a * lab.mass.mean() * on)


def foam(lab, a):
    """Memory foam recovers slowly: a hit near one of the last four meets their dent, and loses more.

    Hysteresis and recovery: Hilyard & Cunningham 1994.  It depends on the distance of contact places.
    """
    place, g = lab.x + lab.r[:, 0], np.zeros(len(lab.x))
    for j in range(1, 5):
        d = np.full(len(place), 9.0)
        d[j:] = place[j:] - place[:-j]
        g += 0.75 ** (j - 1) * np.exp(-0.5 * (d / 0.011) ** 2)
    return Change(restitution=-a * centred(g))


def charge(lab, a):
    """Each impact adds a charge in proportion to its slip work; 0.9 of it stays per trial, and it sparks over.

    The image force, as Q², takes rebound speed (Matsusaka et al. 2010; Lacks & Sankaran 2011).
    """
    Q, q = np.zeros(len(lab.x)), np.abs(lab.P[:, 0] * lab.slip)
    q = q / q.mean()
    for k in range(1, len(Q)):
        Q[k] = 0.9 * Q[k - 1] + q[k - 1]
        if Q[k] > 11:
            Q[k] = 0
    g = Q**2
    g = g / g.std()
    return Change(after=np.stack([0 * g, -a * g, 0 * g], -1))


def day(lab, a):
    """Day and night: the temperature of the hall over eleven days moves the floor's resilience, like a square wave."""
    phase = 2 * np.pi * lab.order * 11.3 / len(lab.x)
    return Change(restitution=a * standard(np.tanh(2.5 * np.sin(phase + 1.1))))


def film(lab, a):
    """An oil film is squeezed out by the normal impulses of the last impacts and creeps back, 0.25 of it per trial.

    More film, less friction (squeeze-out and replenishment: Cann & Lubrecht 1999, starvation).
    """
    P, h = lab.P[:, 1] / lab.P[:, 1].mean(), np.ones(len(lab.x))
    for k in range(1, len(h)):
        q = h[k - 1] * np.exp(-0.9 * P[k - 1] ** 2)
        h[k] = q + 0.25 * (1 - q)
    return Change(friction=1 + a * np.clip(-standard(h), -3, 3))
