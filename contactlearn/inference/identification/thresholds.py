"""Thresholds of a joint fit: every number that decides which trials count and which parameters are determined.

The row of `benchmarks/sensitivity` that shows a range of a threshold has its name.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class FitThresholds:
    """Limits of the statements about a fit."""

    outlier_weight: float = 0.07
    """Weight of a trial, 1 for an ordinary one, below which it is a gross outlier: that of five standard deviations in
    each of three components."""
    open_share: float = 0.125
    """Standard error of a parameter, relative to its plausible range, above which it is not determined: its 95 %
    interval then covers half of the range."""
    collinearity: float = 0.95
    """Correlation above which two parameters trade off on these data, and share R² of an effect's change that another
    effect reproduces above which only their functional forms differ."""
    effective_trials: float = 5.0
    """Effective number of trials below which too few inform a parameter."""
