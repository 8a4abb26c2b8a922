"""Calibration of the confidence in a named effect: how often names like it were right on planted data.

The share of belief of the plausible models that have an effect knows what the catalogue has.  It does not know that
nature may be outside of it: where much of the residual is still predictable, or few trials speak for a name, the name
is wrong more often than the share says.  A logistic regression on one half of the sets of `benchmarks/second_nature`,
with a weak prior, turns these into the probability that the name is right; the other half shows how well it does.
Source: Platt 1999.
"""

import math

COEFFICIENTS = (-0.38, 0.85, 0.21, -4.03, 1.04)
"""Of `regressors`, fitted by `benchmarks/second_nature/calibrate.py`."""
_FULL = 0.995  # a share beyond which no set of models is large enough to tell


def calibrated(share: float, gain: float, left: float, trials: int) -> float:
    """Compute the probability that a named effect is right.

    Args:
        share: of the plausible models that have it.
        gain: share of the held-out error that it takes away, the other effects in the model.
        left: share of the model's held-out error that flexible models still take away.
        trials: number of them.
    """
    return 1 / (
        1 + math.exp(-sum(x * b for x, b in zip(regressors(share, gain, left, trials), COEFFICIENTS, strict=True)))
    )


def regressors(share: float, gain: float, left: float, trials: int) -> tuple[float, ...]:
    """Compute the regressors: 1, and each quantity on a scale on which it adds up."""
    odds = min(share, _FULL) / (1 - min(share, _FULL))
    return (
        1.0,
        math.log(max(odds, 1e-3)),
        math.log(max(gain, 1e-3) / 0.1),
        min(max(left, 0.0), 0.5),
        math.log(trials / 300),
    )
