"""Thresholds of the diagnosis: every number that decides what is reported, with its unit and its reason.

The row of `benchmarks/sensitivity` that shows false alarms and power over a range of a threshold has its name.  Sizes
of grids, numbers of starts and tolerances of fits are no thresholds and stay where they are used.
"""

from dataclasses import dataclass, field

from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.inference.identification.joint import FitThresholds


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Limits of every decision of a diagnosis."""

    fewest_trials: int = 20
    """Trials below which nothing is diagnosed: five folds of four."""
    whole: int = 5000
    """Trials up to which all are diagnosed at once; time and memory grow with them, the answer barely does.
    Subsamples of larger tables have 0.4 to 1.6 times as many."""
    trials_per_parameter: int = 10
    """Trials that each parameter of a candidate must have to itself; richer candidates explain noise."""
    exact: float = 5e-4
    """Mean mass error of a model up to which nothing is called unknown, nor scatter: integrators of contacts err by as
    much.  At half of it a simulated cube, whose steps err by 3e-4, has something unknown."""
    least_gain: float = 0.02
    """Share of the held-out error that an effect must remove to be named.  A dependence of a coefficient on the state
    or on the sequence must remove as much of the residual for the verdict `unknown`."""
    minor_share: float = 0.05
    """Share below which a part is too small to be named: of an effect in the reduction by all effects together, which
    may only correct the functional form of another effect; of a variable in the predictable residual; and the
    lower end of the 95 % interval of the predictable share for the verdict `unknown`."""
    form_error: float = 0.1
    """Relative change of the held-out error that a wrong functional form may make.  An effect that gains more is
    named however strong the others are; a rival that loses less is indistinguishable if its trace is the same; a
    predictable share, or another law's lead, that is larger gives the verdict `unknown`."""
    gain_level: float = 0.01
    """Probability at most of an effect's held-out gain under random signs of the gains of all trials.  Few trials may
    carry it, such as those that slip."""
    chance_sigmas: float = 2.0
    """Standard errors of a paired difference of held-out losses that are chance: between an effect and its rival,
    between formulas, and between models with and without proxy effects."""
    certain_sigmas: float = 3.0
    """Standard errors from which on a number is certain: the R² of a component of the residual differs from 0, and
    the error of a subsample from that of all other trials."""
    window: float = 7.0
    """Nats above the chosen model's score within which another model is plausible: odds of 1000."""
    dependence_level: float = 0.005
    """Probability of each false statement about independent trials: of a drift of the measurement, of a coefficient
    that depends on the sequence, and of one that depends on the state."""
    region_level: float = 0.05
    """Probability of reporting any region where errors do not depend on the inputs."""
    region_ratio: float = 1.5
    """Mean error inside a region over that of the rest; noise alone, in v_pre as in v_post, makes it 1.3 between some
    orientations of the published ellipse."""
    stated_noise_ratio: float = 1.4
    """Residual over stated noise beyond which the statement is questioned: its units, most often."""
    audit: AuditThresholds = field(default_factory=AuditThresholds)
    """Limits of mistakes in the measurements."""
    fit: FitThresholds = field(default_factory=FitThresholds)
    """Limits of outliers of a fit, and of parameters that are not determined."""
