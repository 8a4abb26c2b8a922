"""The subsamples of a large table on which it was diagnosed, and the test of their answer on all its trials."""

from dataclasses import dataclass
from enum import StrEnum

from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis.result.effects import Region, Verdict
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval


class Limit(StrEnum):
    """The reason why the subsamples grew no further before two of them agreed: their largest size, or the memory."""

    SIZE = "size"
    MEMORY = "memory"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer of one subsample: law, missing effects, verdict, and the held-out error of the full model in it."""

    trials: int
    law: str
    effects: tuple[EffectId, ...]
    physics: Verdict
    error: Interval

    def agrees(self, other: "Answer") -> bool:
        """Return whether law, names and verdict are the same; the forms of the effects may differ."""
        mine, theirs = ({effect.name for effect in answer.effects} for answer in (self, other))
        return mine == theirs and (self.law, self.physics) == (other.law, other.physics)


@dataclass(frozen=True, kw_only=True)
class FailingRegion:
    """A window of inputs in which the full model has a clearly higher error, found among all trials of the table.

    Args:
        where: the window in words.
        ratio: mean error inside to that of the rest, with its 95 % interval.
        p_value: of the one-sided rank-sum test, corrected for the number of regions.
        trials: inside, of the table.
        sampled: inside, of the subsample.
    """

    where: str
    ratio: Interval
    p_value: float
    trials: int
    sampled: int

    @classmethod
    def of(cls, region: Region, sampled: int) -> "FailingRegion":
        """Describe a region with so many trials of the subsample."""
        return cls(
            where=region.where, ratio=region.ratio, p_value=region.p_value, trials=region.trials, sampled=sampled
        )


@dataclass(frozen=True, kw_only=True)
class ErrorMap:
    """All trials of the table in cells of two variables, row by row from the low ends of both; `limits` are their ends.

    Args:
        across: name, letter and unit of the variable along a row.
        up: of the other one.
        limits: (left, right, low, high) in these units.
        columns: cells in a row.
        trials: of each cell.
        law: mean error of the law in each cell; None in an empty one.
        named: the same of the full model.
    """

    across: tuple[str, str, str]
    up: tuple[str, str, str]
    limits: tuple[float, float, float, float]
    columns: int
    trials: tuple[int, ...]
    law: tuple[float | None, ...]
    named: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class Confirmation:
    """The full model of a subsample on all trials of the table; errors are of those outside the subsample.

    Args:
        trials: outside the subsample.
        base: error of the law with the given effects.
        named: error of the full model.
        noise: error that noise alone makes; None where a part of the residual is predictable and not named, so that
            the residual of the model is no measure of the noise.
        agrees: whether the error of the full model is that of the subsample, but for chance.
        outliers: of the full model, among all trials; None where there are none.
        regions: in which the full model fails, among all trials, the surest first.
        map: errors over two variables, of all trials.
    """

    trials: int
    base: Interval
    named: Interval
    noise: Interval | None
    agrees: bool
    outliers: Finding | None
    regions: tuple[FailingRegion, ...]
    map: ErrorMap


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The subsamples of a large table: even over objects, sequence and inputs, each twice as large as the one before.

    Args:
        of: trials of the table, after corrections.
        objects: of the table.
        objects_seen: of the last subsample.
        answers: of each subsample; the diagnosis is that of the last one.
        limit: why they grew no further; None where the last two agree.
        confirmation: on all trials.
    """

    of: int
    objects: int
    objects_seen: int
    answers: tuple[Answer, ...]
    limit: Limit | None
    confirmation: Confirmation

    @property
    def trials(self) -> int:
        """Trials of the last subsample."""
        return self.answers[-1].trials
