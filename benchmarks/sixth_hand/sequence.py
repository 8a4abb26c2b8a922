"""Physics without a name that follows the sequence of the trials: numbers of a formula → what is hidden."""

from collections.abc import Sequence

import numpy as np

from sixth_hand.impact import Hidden, Impact
from sixth_hand.known import varies


def thermostat(depth: float, period: float) -> Hidden:
    """ε + depth times a saw-tooth over so many trials, which rises in 0.3 of them: a heater's cycle."""

    def change(now: Impact) -> np.ndarray:
        u = (now.order / period) % 1.0
        return depth * (np.where(u < 0.3, u / 0.3, (1 - u) / 0.7) * 2 - 1)

    return varies("room thermostat", "eps", change)


def tired_film(fall: float, by_hit: float, pauses: Sequence[int]) -> Hidden:
    """μ + fall (0.7 − s): s grows with every hit by a share of 1 − s, and recovers in pauses that nobody wrote down."""

    def change(now: Impact) -> np.ndarray:
        state, worn = 0.0, np.zeros(len(now.x))
        for i in range(len(worn)):
            if i in pauses:
                state *= 0.1 + 0.4 * ((i * 7919) % 10) / 10
            worn[i] = state
            state += by_hit * (1 - state)
        return fall * (0.7 - worn)

    return varies("film that recovers in the pauses", "mu", change)


def slow_foam(loss: float, width: float) -> Hidden:
    """ε − loss exp(−((x − x of the last)/width)²), of the point struck: foam has not come back yet."""

    def change(now: Impact) -> np.ndarray:
        foot = now.x + now.r[:, 0]
        last = np.concatenate([[1e3], foot[:-1]])
        return -loss * np.exp(-(((foot - last) / width) ** 2))

    return varies("slow foam", "eps", change)


def healing_wax(fall: float, width: float, trials: float) -> Hidden:
    """μ + fall (0.5 − S/(1 + S)), S the sum of slips at the same spot, forgotten over so many trials."""

    def change(now: Impact) -> np.ndarray:
        worn, rub = np.zeros(len(now.x)), np.minimum(np.abs(now.slip), 2.0)
        for i in range(1, len(worn)):
            j = np.arange(max(0, i - int(6 * trials)), i)
            near = np.exp(-(((now.x[i] - now.x[j]) / width) ** 2) - (i - j) / trials)
            worn[i] = np.sum(rub[j] * near)
        return fall * (0.5 - worn / (1 + worn))

    return varies("wear that heals", "mu", change)


def charging(kick: float, gain: float, leak: float, spark: float) -> Hidden:
    """v_y⁺ − kick q²: q grows with |v_t| of every trial, leaks over so many, and a spark ends it."""

    def after(now: Impact) -> None:
        q, charge = 0.0, np.zeros(len(now.x))
        for i, slip in enumerate(np.abs(now.slip)):
            charge[i] = q
            q = q * (1 - 1 / leak) + gain * slip
            if q > spark:
                q = 0.0
        now.post[:, 1] -= kick * charge**2

    return Hidden("contact charging", after=after)


def swinging_floor(share: float) -> Hidden:
    """The floor moves up with share (|v_n| of the last − 0.6 |v_n| of the one before): it still swings."""

    def before(now: Impact) -> None:
        last = np.concatenate([[0.0], now.approach[:-1]])
        older = np.concatenate([[0.0, 0.0], now.approach[:-2]])
        now.floor = np.stack([0 * last, share * (last - 0.6 * older)], 1)

    return Hidden("floor still swinging", before)
