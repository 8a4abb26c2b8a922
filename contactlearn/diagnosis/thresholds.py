"""Thresholds of the diagnosis: every number that decides what a user is told, with its unit and its reason.

The row of `benchmarks/sensitivity` that shows false alarms and power over a range of a threshold has its name, such
as regions.ratio.  Sizes of grids, numbers of starts and tolerances of fits are no thresholds and stay where they are
used.  Figures draw the same fields.
"""

from dataclasses import dataclass, field

from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.inference.identification.thresholds import FitThresholds


@dataclass(frozen=True, kw_only=True)
class SelectionThresholds:
    """Limits beyond which an effect is named, and within which models are as good."""

    trials_per_parameter: int = 10
    """Trials that each parameter of a candidate must have to itself; richer candidates explain noise
    (row selection.trials_per_parameter)."""
    least_gain: float = 0.02
    """Share of the held-out error that an effect must take away to be worth a name (row selection.least_gain)."""
    least_part: float = 0.05
    """Part that an effect must have in what all effects together take away of the law's error; what is less may be the
    difference of another effect's form from nature's (row selection.least_part)."""
    clear_gain: float = 0.1
    """Share of the held-out error beyond which an effect is worth a name whatever its part beside a strong one
    (row selection.clear_gain)."""
    gain_sigmas: float = 2.5
    """Standard errors by which the held-out gain of an effect must exceed 0 (row selection.gain_sigmas)."""
    window: float = 7.0
    """Nats above the chosen model's score within which another model is plausible: odds of 1000
    (row selection.window)."""
    most_effects: int = 8
    """Effects that are admitted at most (row selection.most_effects)."""


@dataclass(frozen=True, kw_only=True)
class RegionThresholds:
    """Limits beyond which the law is said to fail in a region."""

    level: float = 0.05
    """Probability of reporting any region where errors do not depend on the inputs (row regions.level)."""
    ratio: float = 1.5
    """Mean error inside over that of the rest; noise alone, in v_pre as in v_post, makes it 1.3 between some
    orientations of the published ellipse (row regions.ratio)."""
    most: int = 5
    """Regions that are tested; the correction for their number costs power (row regions.most)."""
    gross: float = 5.0
    """Medians at which an error is curbed, inside and in the rest, so that no outlier makes a region
    (row regions.gross)."""
    new: float = 0.5
    """Share of a region's trials that are in no region before it (row regions.new)."""


@dataclass(frozen=True, kw_only=True)
class RivalThresholds:
    """Limits within which an effect is said to be indistinguishable from a missing one."""

    similarity: float = 0.5
    """Share R² of the effect's change that a rival must reproduce to first order to be refitted
    (row rivals.similarity)."""
    sigmas: float = 2.0
    """Standard errors of the paired difference of held-out losses that are chance (row rivals.sigmas)."""
    same_trace: float = 0.95
    """Share R² from which on what tells two effects apart may be the form of either (row rivals.same_trace)."""
    form_error: float = 0.1
    """Relative rise of the held-out mass error that a form may make: of an effect with the same trace, and of a model
    with fewer effects, whose forms the others may only mend (row rivals.form_error)."""


@dataclass(frozen=True, kw_only=True)
class RemainderThresholds:
    """Limits beyond which something unknown is said to be missing."""

    share: float = 0.1
    """Share of the model's error that processes must take away for the verdict `unknown`; also how much better than
    the full model another law alone must be for the same (row remainder.share)."""
    certain_share: float = 0.05
    """Lower end of the 95 % interval of that share (row remainder.certain_share)."""
    component_sigmas: float = 3.0
    """Standard errors by which the R² of a component must exceed 0 for the component to be named
    (row remainder.component_sigmas)."""
    component_r_squared: float = 0.04
    """Least R² of a component that is named (row remainder.component_r_squared)."""
    variable_share: float = 0.05
    """Least share of a variable that is named (row remainder.variable_share)."""
    follows: float = 0.85
    """Share of a symbol's variance along θ from which on it goes by the name of θ (row remainder.follows)."""


@dataclass(frozen=True, kw_only=True)
class SerialDependenceThresholds:
    """Limits beyond which something is said to depend on the sequence of the trials."""

    level: float = 0.01
    """Probability of any statement where trials are independent: half of it for measurements that drift, half for
    coefficients that follow the sequence (row serial_dependence.level)."""
    share: float = 0.02
    """Share of the residual that a coefficient that follows the sequence must take away for the verdict `unknown`: as
    much as of the error an effect must to be worth a name, since the level bounds false statements (row
    serial_dependence.share)."""


@dataclass(frozen=True, kw_only=True)
class StateDependenceThresholds:
    """Limits beyond which something is said to depend on the state of the trials."""

    level: float = 0.005
    """Probability of any statement where residuals do not depend on the state (row state_dependence.level)."""
    share: float = 0.02
    """Share of the residual that it must take away for the verdict `unknown`: as much as of the error an effect must to
    be worth a name, since the level bounds false statements (row state_dependence.share)."""
    sigmas: float = 2.0
    """Standard errors of the paired difference of held-out residuals that are chance, where models of fewer effects are
    compared with what the state tells of their remainders (row state_dependence.sigmas)."""


@dataclass(frozen=True, kw_only=True)
class FormulaThresholds:
    """Limits beyond which a formula is offered."""

    sigmas: float = 2.0
    """Standard errors by which the held-out gain of a formula must exceed 0 (row formulas.sigmas)."""
    identical: float = 0.995
    """Correlation from which on two terms are the same to these data (row formulas.identical)."""


@dataclass(frozen=True, kw_only=True)
class NoiseThresholds:
    """Limits of the noise floor."""

    stated_ratio: float = 1.4
    """Residual over stated noise, or its inverse, beyond which the statement is questioned: its units, most often
    (row noise.stated_ratio)."""


@dataclass(frozen=True, kw_only=True)
class SampleThresholds:
    """Limits of the subsamples on which a large table is diagnosed."""

    whole: int = 5000
    """Trials up to which all are diagnosed at once; time and memory grow with them, the answer hardly does
    (row sample.whole)."""
    first: int = 2000
    """Trials of the first subsample; each further one is twice as large (row sample.first)."""
    most: int = 8000
    """Trials of the largest subsample: what it does not settle is said to be open (row sample.most)."""
    sigmas: float = 3.0
    """Standard errors by which the error of the named model may differ between the sample and all other trials
    (row sample.sigmas)."""


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Limits of every decision of a diagnosis."""

    fewest_trials: int = 20
    """Trials below which nothing is diagnosed: five folds of four (row fewest_trials)."""
    audit: AuditThresholds = field(default_factory=AuditThresholds)
    """Of mistakes in the measurements."""
    fit: FitThresholds = field(default_factory=FitThresholds)
    """Of outliers of a fit, and of parameters that are not determined."""
    sample: SampleThresholds = field(default_factory=SampleThresholds)
    """Of the subsamples of a large table."""
    selection: SelectionThresholds = field(default_factory=SelectionThresholds)
    """Of the law and of missing effects."""
    regions: RegionThresholds = field(default_factory=RegionThresholds)
    """Of regions in which the law fails."""
    rivals: RivalThresholds = field(default_factory=RivalThresholds)
    """Of effects that cannot be told from missing ones."""
    remainder: RemainderThresholds = field(default_factory=RemainderThresholds)
    """Of the predictable part of the residual."""
    serial_dependence: SerialDependenceThresholds = field(default_factory=SerialDependenceThresholds)
    """Of what depends on the sequence of the trials."""
    state_dependence: StateDependenceThresholds = field(default_factory=StateDependenceThresholds)
    """Of what depends on the state of the trials."""
    formulas: FormulaThresholds = field(default_factory=FormulaThresholds)
    """Of formulas for it."""
    noise: NoiseThresholds = field(default_factory=NoiseThresholds)
    """Of the noise floor."""
