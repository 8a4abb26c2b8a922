"""Unknown physics that follows the sequence of the trials, as g of the impact, and in which order and where they come.

Sources are of the idea; the forms and the numbers are the author's.
"""

from dataclasses import replace

import numpy as np

from fifth_hand.known import lose_energy
from fifth_hand.laboratory import Impact, Trials


def wear_of_the_place(now: Impact):
    """A mat is compacted where it is hit; every 130 trials it is a new one.

    −(1 − exp(−n/9)), n the sum of exp(−(x_i − x_j)²/(2 · 0.015²)) over the earlier hits on it.
    """
    x, n = now.trials.x, np.zeros(len(now.trials.x))
    for i in range(len(n)):
        n[i] = np.exp(-0.5 * ((x[i - i % 130 : i] - x[i]) / 0.015) ** 2).sum()
    return -(1 - np.exp(-n / 9.0))


def self_heating(now: Impact):
    """Hysteresis warms rubber, and a squash ball bounces higher when hot: T_i = 0.93 T_{i−1} + m v_n,{i−1}²."""
    T, heat = np.zeros(len(now.vn)), now.vn**2 * now.mass
    for i in range(1, len(T)):
        T[i] = 0.93 * T[i - 1] + heat[i - 1]
    return (T - T.mean()) / T.std()


def thermostat(now: Impact):
    """The heating goes on and off, and humidity follows: tanh(3 sin(2π order/47 + 0.5))."""
    return np.tanh(3 * np.sin(2 * np.pi * now.trials.order / 47.0 + 0.5))


def tribo_charge(now: Impact, a, plain):
    """Slip charges the body by 0.02 |v_t| (1.6 − q) + 0.004 each trial, and past 1 a spark leaves 0.05.

    A work of a q² is taken on leaving (Matsusaka et al. 2010; Jungmann et al. 2018).
    """
    q, charge = np.zeros(len(now.slip)), 0.0
    for i, speed in enumerate(np.abs(now.slip)):
        q[i] = charge
        charge += 0.02 * speed * (1.6 - charge) + 0.004
        if charge > 1.0:
            charge = 0.05
    lose_energy(now, a * q**2)


def dust(now: Impact):
    """Dust settles and lubricates over 28 trials; a hit above 1.7 m/s blows it off a cell of 5 cm and those beside it.

    Third body: Godet 1984.
    """
    last, g = np.full(9, -25.0), np.zeros(len(now.vn))
    cells = np.clip(np.floor((now.trials.x + 0.225) / 0.05), 0, 8).astype(int)
    for i, k in enumerate(cells):
        g[i] = np.exp(-(i - last[k]) / 28.0) - 1
        if np.abs(now.vn[i]) > 1.7:
            last[max(k - 1, 0) : k + 2] = i
    return g


def blunting(now: Impact):
    """Each corner of a triangle blunts by the v_n² of its own hits; all are ground again every 160 trials."""
    work, g = np.zeros(3), np.zeros(len(now.vn))
    for i, k in enumerate(now.corner):
        if i % 160 == 159:
            work[:] = 0
        g[i] = work[k]
        work[k] += now.vn[i] ** 2
    return -(1 - np.exp(-g / 25.0))


# --- In which order trials come, and where ---------------------------------------------------------


def visits(trials: Trials, rng):
    """A robot visits five places, 7 to 20 trials each time."""
    places = []
    while len(places) < len(trials.x):
        places += [rng.integers(5)] * int(rng.integers(7, 21))
    middles = np.array([-0.16, -0.08, 0, 0.08, 0.16])[places[: len(trials.x)]]
    return replace(trials, x=middles + rng.normal(0, 0.008, len(trials.x)))


def bursts(trials: Trials, rng):
    """Hard sessions and gentle ones in turn, of 12 to 34 trials."""
    by_speed, half = np.argsort(trials.v[:, 1]), len(trials.x) // 2
    waiting = [list(rng.permutation(by_speed[:half])), list(rng.permutation(by_speed[half:]))]
    rows, gentle = [], True
    while any(waiting):
        session = waiting[gentle] or waiting[not gentle]
        length = int(rng.integers(12, 35))
        rows += session[:length]
        del session[:length]
        gentle = not gentle
    return trials.taken(rows)
