"""Results about effects: verdict, regions, rivals with the experiment that separates them, ladder, missing effects."""

import math
from dataclasses import dataclass
from enum import StrEnum

from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval


class Verdict(StrEnum):
    """The conclusion: known effects are missing, nothing is, something unknown is, or the data are wrong.

    Unfinished: something is missing, and the search ran out of time before it had compared all known effects.
    """

    EFFECTS = "effects"
    NONE = "none"
    UNKNOWN = "unknown"
    UNFINISHED = "unfinished"
    BAD_DATA = "bad_data"


class Level(StrEnum):
    """Certainty of a name, by the probability that it is right: found ≥ 0.9, probable ≥ 0.5, else a candidate.

    Either: less than 0.5 itself, but at least that together with other effects that do as well in its place.
    """

    FOUND = "found"
    PROBABLE = "probable"
    EITHER = "either"
    CANDIDATE = "candidate"

    @classmethod
    def of(cls, probability: float) -> "Level":
        """Return the level of the probability of one name."""
        return cls.FOUND if probability >= 0.9 else cls.PROBABLE if probability >= 0.5 else cls.CANDIDATE


# --- Regions ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Region:
    """Trials with a variable of the contact before impact in [low, high), where the law's error is clearly higher.

    Args:
        variable: by name, see `failure.variables`.
        where: the window in words.
        low: lower limit in SI units; None if open.
        high: upper limit likewise; of a periodic variable it may lie beyond ±π.
        ratio: mean error inside to that of the rest, with its 95 % interval, on trials that were not searched.
        p_value: of the one-sided rank-sum test on the same trials, corrected for the number of regions.
        rows: all trials inside, counted from 0.
    """

    variable: str
    where: str
    low: float | None
    high: float | None
    ratio: Interval
    p_value: float
    rows: tuple[int, ...]

    @property
    def trials(self) -> int:
        """Number of trials inside."""
        return len(self.rows)

    @property
    def limits(self) -> tuple[float, float]:
        """[low, high), infinite where open."""
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high


@dataclass(frozen=True, kw_only=True)
class Improvement:
    """Mean errors inside a region and in the rest, before and after an effect is added.

    `change` is that of the mean error inside, `excess` the change inside minus that of the rest, both with 95 %
    intervals over paired trials; `share` is the part of the change summed over all trials that comes from inside.
    """

    before: float
    after: float
    rest_before: float
    rest_after: float
    change: Interval
    excess: Interval
    share: float

    @property
    def helped(self) -> bool:
        """The error inside fell beyond chance, and by more than in the rest."""
        return self.change.high < 0 and self.excess.high < 0


# --- Rivals ----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Rival:
    """An effect that explains these data as well as a missing one.

    `similarity` is the share R² of the missing effect's change of v_post that the rival reproduces to first order,
    `loss_difference` the rise of the held-out loss in nats a trial with the rival instead.
    """

    effect: EffectId
    similarity: float
    loss_difference: float
    standard_error: float


@dataclass(frozen=True, kw_only=True)
class Separation:
    """A missing effect and a rival, and the drops expected to decide between them; None if a thousand do not."""

    effect: EffectId
    rival: EffectId
    drops_needed: int | None


@dataclass(frozen=True, kw_only=True)
class Drop:
    """A state before impact in m, rad, m/s, rad/s; the place is None where no model depends on it.

    `body` is its name, None where all measurements are of one.  `differences` are distances of the
    model's outcome from each rival's in standard deviations, in the order of `Experiment.separations`.
    The plane has `theta` and `omega`, space a unit quaternion, `y`, `v_z` and three components of the spin.
    """

    v_x: float
    v_y: float
    differences: tuple[float, ...]
    theta: float | None = None
    omega: float | None = None
    x: float | None = None
    y: float | None = None
    v_z: float | None = None
    w_x: float | None = None
    w_y: float | None = None
    w_z: float | None = None
    orientation: tuple[float, ...] | None = None
    body: str | None = None


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Drops that separate the model from its rivals, the best first."""

    separations: tuple[Separation, ...]
    drops: tuple[Drop, ...]


# --- Effects ---------------------------------------------------------------------------------------


class RungKind(StrEnum):
    """The model of a rung of the ladder.

    `scatter` is the floor of instrument and scatter of the contact, below which is that of the `instrument` alone;
    where both are one it is `noise`.
    """

    LAW = "law"
    EFFECT = "effect"
    PROCESSES = "processes"
    NOISE = "noise"
    SCATTER = "scatter"
    INSTRUMENT = "instrument"


PROCESSES = "Gaussian processes on the residual"
FLOORS = {
    RungKind.NOISE: "noise floor",
    RungKind.SCATTER: "instrument plus scatter of the contact",
    RungKind.INSTRUMENT: "instrument alone",
}
"""Rungs below which no model of the state comes, and what the instrument alone leaves."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """A rung of the ladder: its model, the effect that it adds to the rung before, and its error."""

    kind: RungKind
    error: Interval
    effect: EffectId | None = None


@dataclass(frozen=True, kw_only=True)
class PlausibleModel:
    """A law with effects that the data cannot distinguish from the chosen model, and its share of all belief."""

    law: str
    effects: tuple[EffectId, ...]
    share: float


@dataclass(frozen=True, kw_only=True)
class FrontierModel:
    """The best model with a number of effects, and its held-out error."""

    law: str
    effects: tuple[EffectId, ...]
    error: Interval


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A parameter of an effect: symbol, unit, value and standard error.

    `at_end`: whether the value is an end of its plausible range, so that the true one may lie beyond; `undetermined`:
    whether its standard error exceeds that range.
    """

    name: str
    symbol: str
    unit: str
    value: float
    standard_error: float
    at_end: bool = False
    undetermined: bool = False


@dataclass(frozen=True, kw_only=True)
class MissingEffect:
    """An effect that was missing from the model.

    Args:
        effect: its identity.
        equation: its formula with symbols.
        parameters: fitted values.
        error_before: of the rung before it.
        error_after: of the rung that it adds.
        error_reduction: mean error without it, the other effects refitted, less that of the full model.
        reduction_on_all_trials: the same between fits to all trials, not held out; None if it is always on.
        share: of the plausible models that have the effect, in whatever form.
        confidence: probability that the name is right, see `ladder.name_probability`; the share until that is known.
        level: found or probable, by the confidence; either, by the joint confidence.
        alternatives: what plausible models have in its place, the likeliest first; empty where it is probable itself.
        joint_confidence: probability that it or one of the alternatives is right; None without any.
        inadmissible_before: share of impulses that gain energy, pull or leave penetration, on the rung before.
        inadmissible_after: the same on its rung.
        improvements: one for each region of the diagnosis, in that order.
        rivals: the best first.
        coefficient_ends: the coefficient of the law that drifts, at the first and the last trial; None if none does.
    """

    effect: EffectId
    equation: str
    parameters: tuple[FittedParameter, ...]
    error_before: Interval
    error_after: Interval
    error_reduction: float
    share: float
    confidence: float
    level: Level
    inadmissible_before: float
    inadmissible_after: float
    alternatives: tuple[EffectId, ...] = ()
    joint_confidence: float | None = None
    reduction_on_all_trials: Interval | None = None
    improvements: tuple[Improvement, ...] = ()
    rivals: tuple[Rival, ...] = ()
    coefficient_ends: tuple[float, float] | None = None

    @property
    def claim_confidence(self) -> float:
        """Probability of what the verdict says: that the effect, or else one of its alternatives, is missing."""
        return self.confidence if self.joint_confidence is None else self.joint_confidence

    @property
    def claim_level(self) -> Level:
        """Certainty of what the verdict says."""
        return Level.of(self.claim_confidence)


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that explains a part of the error under a name that is too uncertain for the model.

    Args:
        effect: its identity.
        equation: its formula with symbols.
        parameters: fitted together with the missing effects and all candidates.
        error_after: mean held-out error of the model with it, the missing effects and the other candidates.
        error_reduction: mean error without it, the others refitted, less that with it.
        confidence: probability that the name is right, below 0.5; None of a proxy effect.
        proxy: whether Gaussian processes predict what remains as well without it.
        coefficient_ends: as of a missing effect.
    """

    effect: EffectId
    equation: str
    parameters: tuple[FittedParameter, ...]
    error_after: float
    error_reduction: float
    confidence: float | None
    proxy: bool = False
    coefficient_ends: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Choices:
    """Every subset of the effects in play, each fitted jointly with the law to all trials, so not held out.

    `errors` has 2^E entries for E `effects`: entry k is the mean mass error of the model with effect j if bit j of k
    is set.  Effects of the model beyond the first few are in every choice.
    """

    effects: tuple[EffectId, ...]
    errors: tuple[Interval, ...]
