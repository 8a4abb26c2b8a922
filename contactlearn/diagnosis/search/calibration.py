"""Calibration of the confidence in a named effect: how often such names were right on sets with hidden effects.

The share of belief of the plausible models that have an effect knows what the catalogue has.  It does not know that
nature may be outside of it: where an effect takes little away, or much of the residual is still predictable, the name
may stand for what another effect's form leaves.  A logistic regression with a weak prior turns these into the
probability that the name is right.  It is fitted to one half of the independent suite of `benchmarks/blind`, and the
other half shows how well it does.  The names are those that this catalogue gave and those of a poorer one, since a
user's nature has forms that no catalogue has.
Source: Platt 1999.
"""

import math

COEFFICIENTS = (-0.32, 0.37, 2.15, -9.75)
"""Of `regressors`, fitted by `benchmarks/blind/calibrate.py`."""
_FULL = 0.995  # a share beyond which no set of models is large enough to tell


def calibrated(share: float, gain: float, left: float) -> float:
    """Compute the probability that a named effect is right.

    Args:
        share: of the plausible models that have it.
        gain: share of the held-out error that it takes away, the other effects in the model.
        left: share of the model's held-out error that flexible models still take away.
    """
    log_odds = sum(x * b for x, b in zip(regressors(share, gain, left), COEFFICIENTS, strict=True))
    return 1 / (1 + math.exp(-log_odds))


def regressors(share: float, gain: float, left: float) -> tuple[float, ...]:
    """Compute the regressors: 1, and each quantity on a scale on which it adds up."""
    odds = min(share, _FULL) / (1 - min(share, _FULL))
    return (1.0, math.log(max(odds, 1e-3)), math.log(max(gain, 1e-3) / 0.1), min(max(left, 0.0), 0.5))
