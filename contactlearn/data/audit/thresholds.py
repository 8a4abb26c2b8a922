"""Thresholds of the audit: every number that decides whether the measurements are doubted.

The row of `benchmarks/sensitivity` that shows false alarms and power over a range of a threshold has its name.
Numbers that only scale an answer between 0 and 1, or guard it against degenerate data, stand where they are used.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AuditThresholds:
    """Limits of every finding of the audit."""

    moment_sigmas: float = 12.0
    """Residual of a trial's moment balance in robust standard deviations beyond which the trial is an outlier; Gaussian
    noise never reaches it, heavy tails rarely."""
    gross_ratio: float = 2.0
    """Factor beyond which a trial cannot be the impact that it claims to be: of kinetic energy after impact to that
    before, where noise of 3 to 15 % of the speed passes 2 in one of 12 sets of 100 drops, and never 3; and of a mass or
    inertia to the median of its object, where a slip of the decimal point is 10."""
    false_outliers: float = 0.05
    """Trials that are expected to be called outliers of a fitted model by chance, in a whole table."""
    dropped_share: float = 0.2
    """Share of outliers up to which they are dropped; with more of them the data are doubted."""
    convention_gain: float = 0.15
    """Fall of the mean sum of contradictions per correction of units or axes; beyond chance only bodies that gain
    energy move it, as much as this in one of 3 sets."""
    consistent: float = 0.5
    """Sum of contradictions that an accepted hypothesis must be below; if the data as given are below it, corrections
    are not combined.  Correct data of every source are below 0.3."""
    sound: float = 0.3
    """The same up to which an inclined floor is not looked for: correct data of every source are below it."""
    inertia_factor: float = 2.5
    """Factor on the moment of inertia from which on it is a mistake; a smaller one is left to the effects, since other
    moments look alike, and `inertia_error` reaches as far."""
    impossible: float = 0.3
    """Mean share of the terms of the moment balance left over, less two standard errors, from which on no rigid impact
    made the data; and share of Δω that the balance explains below which the same holds."""
    open_balance: float = 0.05
    """Relative imbalance of the moments, with 95 %, from which on the balance does not close; the measurement noise of
    clean drops stays below it."""
    doubted_balance: float = 0.4
    """The same from which on the data are doubted, and not only effects of physics are to be expected: the range of
    `inertia_error` ends there."""
    rig_explains: float = 0.8
    """Spread of the moment balance that another rig leaves, of that which the data or the best single cause in physics
    have, below which the rig explains it: a second cause of the same size would leave 0.7."""
    contact_point_off: float = 0.15
    """Distance of the contact point from the shape's, of |r|, in the median; physical effects stay below a quarter
    of this."""
    scale_off: float = 0.01
    """Relative distance of gravity in free flight from 9.81 m/s² above which scale or frame rate are doubted; it
    differs by 0.3 % over the earth."""
