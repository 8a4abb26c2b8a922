"""Results of the search: rungs of the ladder and missing effects."""

from dataclasses import dataclass
from enum import StrEnum

from contactlearn.diagnosis.result.regions import Improvement
from contactlearn.diagnosis.result.rivals import Rival
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval


class RungKind(StrEnum):
    """The model of a rung of the ladder."""

    LAW = "law"
    EFFECT = "effect"
    PROCESSES = "processes"
    NOISE = "noise"


@dataclass(frozen=True, kw_only=True)
class Rung:
    """A rung of the ladder: its model, the effect that it adds to the rung before, and its error."""

    kind: RungKind
    error: Interval
    effect: EffectId | None = None


@dataclass(frozen=True, kw_only=True)
class PlausibleModel:
    """A law with effects that the data cannot tell from the chosen model, and its share of all belief."""

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
    """A parameter of an effect: symbol, unit, value and standard error."""

    name: str
    symbol: str
    unit: str
    value: float
    standard_error: float


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
        confidence: probability that the name is right, see `search.ladder.calibrated`; the share until that is known.
        inadmissible_before: share of impulses that gain energy, pull or leave penetration, on the rung before.
        inadmissible_after: the same on its rung.
        improvements: one for each region of the diagnosis, in that order.
        rivals: the best first.
    """

    effect: EffectId
    equation: str
    parameters: tuple[FittedParameter, ...]
    error_before: Interval
    error_after: Interval
    error_reduction: float
    share: float
    confidence: float
    inadmissible_before: float
    inadmissible_after: float
    reduction_on_all_trials: Interval | None = None
    improvements: tuple[Improvement, ...] = ()
    rivals: tuple[Rival, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Choices:
    """Every subset of the effects in play, each fitted jointly with the law to all trials, so not held out.

    `errors` has 2^E entries for E `effects`: entry k is the mean mass error of the model with effect j if bit j of k
    is set.  Effects of the model beyond the first few are in every choice.
    """

    effects: tuple[EffectId, ...]
    errors: tuple[Interval, ...]
