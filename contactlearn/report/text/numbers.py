"""Number formats: errors, intervals, shares, comparisons; `numerics` has that of a value with its standard error."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from contactlearn.core.numerics import measured, number, readable
from contactlearn.diagnosis.result import FittedParameter
from contactlearn.inference.evaluation.metrics import Interval

NO_INTERVAL = "one trial: no interval"
"""In place of the interval of a single trial, or of a single group of trials."""

_SMALL = 1e-3  # errors below it are written with two significant digits
_PERCENT = 0.01  # difference below which a percentage has a decimal
_ROUNDED = 0.005  # of a whole, below which a share rounds to 0 %
_TIMES = 2.0  # ratio from which on a comparison is a factor and no percentage


def error(x: float) -> str:
    """Write an error with four decimals, or with two digits where these would be zeros."""
    return f"{x:.4f}".replace("-", "−") if abs(x) >= _SMALL or x == 0 else number(x, 2)


def interval(x: Interval | Mapping[str, float]) -> str:
    """Write a mean error with its 95 % interval: 0.1811 (95 %: 0.1790–0.1832)."""
    mean, low, high = _ends(x)
    if math.isnan(low):
        return f"{error(mean)} ({NO_INTERVAL})"
    return f"{error(mean)} (95\u00a0%: {error(low)}{_dash(low)}{error(high)})"


def brief_interval(x: Interval | Mapping[str, float]) -> str:
    """Write a mean error with its interval where the heading says which: 0.1811 (0.1790–0.1832)."""
    mean, low, high = _ends(x)
    return f"{error(mean)} ({NO_INTERVAL if math.isnan(low) else f'{error(low)}{_dash(low)}{error(high)}'})"


def percent(x: float, decimals: int = 0) -> str:
    """Write a share as 78 %."""
    return f"{100 * x:.{decimals}f}\u00a0%".replace("-", "−")


def share_of_whole(x: float) -> str:
    """Write a share of a whole in percent; neither does a small one read as nothing nor a large one as all of it."""
    if 0 < x < _ROUNDED:
        return "<1\u00a0%"
    return "over 99\u00a0%" if 1 - _ROUNDED <= x < 1 else percent(x)


def fine_percent(x: float) -> str:
    """Write a share in percent, with a decimal below 1 %."""
    return percent(x, 0 if x >= _PERCENT else 1)


def share_interval(x: Interval) -> str:
    """Write a share with its 95 % interval: 40 % (30 % to 50 %)."""
    return f"{percent(x.mean)} ({percent(x.low)} to {percent(x.high)})"


def compared(x: float, y: float) -> str:
    """Compare an error with another one, before "than": 3.9× smaller, 18 % smaller, 18 % larger, 2.1× larger."""
    if not min(x, y) > 0:
        return "no smaller" if x == y else "smaller" if x < y else "larger"
    word, ratio = ("smaller", y / x) if x <= y else ("larger", x / y)
    if ratio >= _TIMES:
        return f"{times(ratio)} {word}"
    return f"{fine_percent(abs(x - y) / y)} {word}"


def times(ratio: float) -> str:
    """Write a ratio as 3.9×."""
    return f"{ratio:.1f}×" if ratio < 10 else f"{ratio:.0f}×"


def counted(number_: int) -> str:
    """Write a number of trials with its thousands apart, from 10 000 on: 100 000."""
    return f"{number_:,}".replace(",", "\u00a0") if number_ >= 10_000 else str(number_)


def p_value(p: float) -> str:
    """Write a probability with one significant digit: p = 3e−8, p = 0.02."""
    return f"p = {number(p, 1)}"


def fix_spacing(text: str) -> str:
    """Write `78%` and `3e-5` in a text as 78 % and 3e−5."""
    return re.sub(r"(?<=\de)-(?=\d)", "−", re.sub(r"(?<=\d)%", "\u00a0%", text))


@dataclass(frozen=True)
class Quantity:
    """A fitted parameter as a sentence formats it, see `Effect.in_words`."""

    parameter: FittedParameter

    def __format__(self, how: str) -> str:
        if self.parameter.undetermined:
            return "an undetermined amount"
        value, error = self.parameter.value, self.parameter.standard_error
        value, how = (-value, how[1:]) if how.startswith("-") else (value, how)
        if how == "exp":
            return measured(math.exp(value), math.exp(value) * error)
        if how == "doubled":  # a power of what doubles
            value, error, how = 2**value - 1, 2**value * math.log(2) * error, "%"
        return measured(100 * value, 100 * error, "%") if how == "%" else readable(value, error, self.parameter.unit)


def _ends(x: Interval | Mapping[str, float]) -> tuple[float, float, float]:
    if isinstance(x, Mapping):  # of a page, which has null for nan
        x = Interval(x["mean"], x["low"], x["high"])
    return x.mean, x.low, x.high


def _dash(low: float) -> str:
    """Between the ends of an interval: a dash would read as the sign of a negative one."""
    return " to " if low < 0 else "–"
