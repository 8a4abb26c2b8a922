"""Thresholds of the audit: every number that decides whether the measurements are doubted.

Each field has its unit, its reason, and the row of `benchmarks/sensitivity` that shows false alarms and power over
a range of its values.  Numbers that only scale an answer between 0 and 1 are defined where they are used.
"""

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class OutlierThresholds:
    """Limits beyond which a trial cannot be the impact that it claims to be."""

    moment_sigmas: float = 12.0
    """Residual of the moment balance in robust standard deviations; Gaussian noise never reaches it, heavy tails
    hardly do (row outliers.moment_sigmas)."""
    imbalance: float = 1 / 3
    """Share of the terms of the balance that the same residual must exceed, since the spread of exact data is tiny
    (row outliers.imbalance)."""
    false_outliers: float = 0.05
    """Trials that are expected to be called outliers of a fitted model by chance, in a whole table
    (row outliers.false_outliers)."""
    energy_ratio: float = 2.0
    """Kinetic energy after impact over that before; noise of 3 to 15 % of the speed passes 2 in one of 12 sets
    of 100 drops, and never 3 (row outliers.energy_ratio)."""
    mass_ratio: float = 2.0
    """Factor between a mass or inertia and the median of its object; a slip of the decimal point is 10
    (row outliers.mass_ratio)."""
    common: float = 0.1
    """Share of an object's trials with such a mass from which on the object is two bodies of one name
    (row outliers.common)."""


@dataclass(frozen=True, kw_only=True)
class ConventionThresholds:
    """Limits of the comparison of hypotheses about units and axes."""

    gain: float = 0.15
    """Fall of the mean sum of contradictions per correction; beyond chance only bodies that gain energy move it, as
    much as this in one of 3 sets (row conventions.gain)."""
    sigmas: float = 5.0
    """Standard errors of the same fall, trial by trial; up to some thousand hypotheses are compared
    (row conventions.sigmas)."""
    consistent: float = 0.5
    """Sum of contradictions that an accepted hypothesis must be below; if the data as given are below it, corrections
    are not combined.  Correct data of every source are below 0.3 (row conventions.consistent)."""
    indistinct: float = 0.02
    """Difference of the sum of contradictions below which two hypotheses are reported as equivalent
    (row conventions.indistinct)."""
    explained: float = 0.5
    """Share of Δω that the moment balance must explain under other units, which else only shrink a Δω that is noise
    (row conventions.explained)."""
    inertia_factor: float = 2.5
    """Factor on the moment of inertia from which on it is a mistake; a smaller one is left to the effects, since other
    moments look alike, and `inertia_error` reaches as far (row conventions.inertia_factor)."""
    inertia_error: float = 0.1
    """Relative standard error of a term of the balance below which it is used to estimate the inertia
    (row conventions.inertia_error)."""
    inertia_agreement: float = 0.2
    """Relative difference up to which the terms ask for the same factor (row conventions.inertia_agreement)."""
    inertia_r_squared: float = 0.8
    """Share of Δω that the fitted balance must explain for the same (row conventions.inertia_r_squared)."""
    gyration: tuple[float, float] = (0.02, 8.0)
    """Plausible (I/m)/|r|²: a rod on its end has 1/3, a disc 1/2, a body that lands flat more
    (row conventions.gyration)."""
    fastest: float = 100.0
    """Plausible speed before impact in m/s, in the median (row conventions.fastest)."""
    largest: float = 10.0
    """Plausible |r| in m, in the median (row conventions.largest)."""
    turned: float = 8 * math.pi
    """Plausible |θ| in rad, in the median: four turns (row conventions.turned)."""


@dataclass(frozen=True, kw_only=True)
class AuditThresholds:
    """Limits of every finding of the audit."""

    outliers: OutlierThresholds = field(default_factory=OutlierThresholds)
    """Of single trials."""
    conventions: ConventionThresholds = field(default_factory=ConventionThresholds)
    """Of units and axes."""
    fewest_trials: int = 10
    """Trials below which nothing is said about units and axes: five standard errors need them
    (row audit.fewest_trials)."""
    imbalance: float = 0.3
    """Mean share of the terms of the moment balance left over, less two standard errors, from which on no rigid
    impact made the data (row audit.imbalance)."""
    unexplained: float = 0.3
    """Share of Δω explained below which the same holds (row audit.unexplained)."""
    open_balance: float = 0.05
    """Relative imbalance of the moments, with 95 %, from which on the balance is said not to close; the measurement
    noise of clean drops stays below it (row audit.open_balance)."""
    doubted_balance: float = 0.4
    """The same from which on the data are doubted, and not only effects of physics are to be expected: the range of
    `inertia_error` ends there (row audit.doubted_balance)."""
    tested_balance: float = 0.1
    """Half-width of the 95 % interval of the better known coefficient above which the data hardly test the balance
    (row audit.tested_balance)."""
    small_moments: float = 0.05
    """Median of a term of the balance, of |Δv| / ρ, up to which it may be noise alone, of some 5 % of the speeds;
    friction makes more (row audit.small_moments)."""
    sure_moments: float = 4.0
    """Standard errors from 0 from which on the coefficient of such a term is judged (row audit.sure_moments)."""
    reversed_trials: float = 0.4
    """Share of trials with a pulling floor, or without approach, from which on the data are refused
    (row audit.reversed_trials)."""
    dropped_share: float = 0.2
    """Share of outliers up to which they are dropped; with more of them the data are doubted
    (row audit.dropped_share)."""
    energy_gain: float = 1.25
    """Ratio of kinetic energies after and before impact above which a trial gains energy; 1 to 1.25 decide the same,
    since the share of such trials guards against noise (row audit.energy_gain)."""
    energy_share: float = 0.05
    """Share of such trials above which the gain is reported (row audit.energy_share)."""
    contact_point_off: float = 0.15
    """Distance of the contact point from the shape's, of |r|, in the median; physical effects stay below a quarter
    of this (row audit.contact_point_off)."""
    scale_off: float = 0.01
    """Relative distance of gravity in free flight from 9.81 m/s² above which scale or frame rate are doubted; it
    differs by 0.3 % over the earth (row audit.scale_off)."""
    apparatus_sigmas: float = 3.0
    """Standard errors by which it must be off, too (row audit.apparatus_sigmas)."""
    seconds_per_trial: float = 0.5
    """Time in s that a trial takes at least: times that span less are no clock of the session
    (row audit.seconds_per_trial)."""
    rank_correlation: float = 0.8
    """Rank correlation of time and order from which on such times are a clock all the same
    (row audit.rank_correlation)."""
    noisy_spread: float = 1.5
    """Standard deviation of a velocity before impact, relative to the residual of flexible models in the same velocity
    after it, below which its mean may replace it (row audit.noisy_spread)."""
