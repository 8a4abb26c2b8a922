"""Conventions of units and axes: hypotheses about them, compared by the contradictions in the measurements under each.

A hypothesis is a few named corrections; `consistency.contradictions` asks the same questions under each.  The moment
balance alone knows the signs of its two terms only: turning θ looks like turning r.  The other questions tell these
apart, except for what is truly the same (a disc seen from behind).  Contradictions are bounded, so that no outlier
decides; their mean over the trials is compared pairwise, with its standard error.

All sensible combinations of up to five corrections are compared, shorter ones first.  Those of one correction are
compared on all trials, longer ones on a sample of them, from which the best few go on to all trials.  A hypothesis is
accepted only if the moments balance under it and hardly any contradiction is left; otherwise the data stay as given.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.columns import Columns
from contactlearn.data.audit.consistency import contradictions, torque
from contactlearn.data.audit.corrections import CORRECTIONS, units_and_axes
from contactlearn.data.audit.moments import Balance, balance
from contactlearn.data.audit.thresholds import ConventionThresholds, OutlierThresholds
from contactlearn.mechanics.impacts import Impacts

AXES = (
    "swapped_pre_post",
    "mirrored_y",
    "swapped_axes",
    "mirrored_x",
    "mirrored_theta",
    "mirrored_omega",
    "contact_point_sign",
    "contact_point_mirrored",
)
DEGREES = ("degrees_omega", "degrees_theta", "degrees")
UNITS = (*DEGREES, "millimetres", "millimetres_velocity", "grams", "inertia_scaled")
BALANCED = set(UNITS) - {"degrees_theta"}
"""Units that the moment balance depends on."""
_STEPS = (*AXES[:3], "mirrored_y", *AXES[3:], *UNITS)
"""Corrections in the order in which they are applied.

A swap of the axes and a mirror of y are a turn by 90°, whose sense depends on which of them comes first.
"""
_TURN = 3  # step of the mirror of y that follows a swap
_DEPTH = 5  # corrections at once
_SAMPLE, _FOLLOWED = 64, 8  # trials on which combinations are compared, and combinations that go on to all trials


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Corrections by name, in the order in which they are applied, and the impacts that they give."""

    names: tuple[str, ...]
    impacts: Impacts
    thresholds: ConventionThresholds

    @cached_property
    def answers(self) -> dict[str, Float[Tensor, " n"]]:
        """Contradictions of each trial by question."""
        return contradictions(self.impacts, self.thresholds)

    @cached_property
    def total(self) -> Float[Tensor, " n"]:
        """Sum of the contradictions of each trial."""
        first, *others = self.answers.values()
        return sum(others, first)

    @property
    def score(self) -> float:
        """Mean sum of the contradictions."""
        return self.total.mean().item()

    @cached_property
    def balance(self) -> Balance:
        """The moment balance, fitted."""
        return balance(self.impacts)

    @property
    def closed(self) -> bool:
        """Whether hardly a contradiction is left, of the moments as of all else."""
        return self.score < self.thresholds.consistent

    def means(self) -> dict[str, float]:
        """Mean contradiction by question."""
        return {question: answer.mean().item() for question, answer in self.answers.items()}

    def __str__(self) -> str:
        return hypothesis_text(self.names)


def hypothesis_text(names: tuple[str, ...]) -> str:
    """Write a hypothesis as its corrections; for display alone."""
    return " + ".join(names) or "as they are"


@dataclass(frozen=True, kw_only=True)
class ConventionComparison:
    """The data as given, the best hypothesis, those of the same length as good as it, and the number compared."""

    given: Hypothesis
    best: Hypothesis
    equals: tuple[Hypothesis, ...]
    tried: int

    @property
    def gain(self) -> float:
        """Fall of the mean sum of contradictions under the best hypothesis."""
        return (self.given.total - self.best.total).mean().item()

    @property
    def sigmas(self) -> float:
        """The same in standard errors."""
        return _sigmas(self.given.total - self.best.total)


def _sigmas(gain: Float[Tensor, " n"]) -> float:
    error = gain.std() / math.sqrt(len(gain)) if len(gain) > 1 else torch.tensor(math.inf)
    return (gain.mean() / error.clamp_min(1e-3)).item()


def compare(impacts: Impacts, thresholds: ConventionThresholds = ConventionThresholds()) -> ConventionComparison:
    """Find the best of the smallest hypotheses that are accepted, or the data as given where there is none."""
    given = Hypothesis(names=(), impacts=impacts.replace(validate=False), thresholds=thresholds)
    tried = 1
    for depth in range(1, _DEPTH + 1):
        if depth > 1 and given.closed:
            break
        screened = _screened(given.impacts, depth, thresholds)
        tried += len(screened.names)
        applied = (_applied(given, names) for names in screened.best())
        found = sorted((h for h in applied if h is not None), key=lambda h: h.score)
        new = next((h for h in found if _better(h, given)), None)
        if new is not None:
            equal = [h for h in found if h is new or new.score <= h.score < new.score + thresholds.indistinct]
            best, *equals = sorted(equal, key=lambda h: [*map([*CORRECTIONS].index, h.names)])
            return ConventionComparison(given=given, best=best, equals=tuple(equals), tried=tried)
    return ConventionComparison(given=given, best=given, equals=(), tried=tried)


def _better(new: Hypothesis, given: Hypothesis) -> bool:
    """Whether a hypothesis is clearly better; other units must not merely shrink a Δω that is all noise."""
    gain, thresholds = given.total - new.total, new.thresholds
    if gain.mean().item() < thresholds.gain * len(new.names) or _sigmas(gain) < thresholds.sigmas:
        return False
    explained = torque(new.impacts).explained.item() > thresholds.explained
    return (explained or not BALANCED.intersection(new.names)) and new.closed


class _Screened(NamedTuple):
    """Hypotheses by name, and the mean sum of the contradictions under each; infinite for those that are excluded."""

    names: list[tuple[str, ...]]
    scores: Float[Tensor, " hypotheses"]

    def best(self) -> list[tuple[str, ...]]:
        """The few with the fewest contradictions."""
        ranked = self.scores.argsort(stable=True)[:_FOLLOWED].tolist()
        return [self.names[k] for k in ranked if self.scores[k] < math.inf]


def _screened(impacts: Impacts, depth: int, thresholds: ConventionThresholds) -> _Screened:
    """Compare all hypotheses of so many corrections, more than one of them on a sample of the trials."""
    if depth > 1 and len(impacts) > _SAMPLE:
        impacts = impacts[torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0))[:_SAMPLE]]
    names: list[tuple[str, ...]] = [()]
    columns = Columns.of(impacts)
    for step, name in enumerate(_STEPS):
        before = [k for k, have in enumerate(names) if len(have) < depth and _sensible(have, step)]
        changed, meant = _changed(columns[torch.tensor(before, dtype=torch.long)], name, thresholds)
        names += [(*names[k], name) for k, good in zip(before, meant.tolist(), strict=True) if good]
        columns = columns.and_also(changed[meant])
    long = torch.tensor([len(have) == depth for have in names])
    names, columns = [have for have in names if len(have) == depth], columns[long]
    first, *others = contradictions(columns, thresholds).values()
    shrunk = torch.tensor([bool(BALANCED.intersection(have)) for have in names])
    shrunk &= torque(columns).explained <= thresholds.explained
    return _Screened(names, sum(others, first).mean(-1).masked_fill(shrunk, math.inf))


def _sensible(have: tuple[str, ...], step: int) -> bool:
    """Whether a step may follow others.

    An angle is converted from degrees once, and only one correction changes I relative to m.  Before and after are not
    swapped together with two other changes of the axes: a mirrored film run backwards explains any body that gains
    energy.
    """
    name, names = _STEPS[step], {*have, _STEPS[step]}
    if name in have or (step == _TURN and "swapped_axes" not in have):
        return False
    if len(names.intersection(DEGREES)) > 1 or names >= {"grams", "inertia_scaled"}:
        return False
    return "swapped_pre_post" not in names or len(names.intersection(AXES)) < 3


def _changed(columns: Columns, name: str, thresholds: ConventionThresholds) -> tuple[Columns, Tensor]:
    """Columns [B] after a correction, and the hypotheses [B] for which it is plausible.

    Another inertia is not where the balance requires a negative one, or one that is only a little different.
    """
    if name != "inertia_scaled":
        return units_and_axes(columns, name), torch.ones(len(columns.mass), dtype=torch.bool)
    factor = torque(columns).inertia_factor
    meant = (factor.log().abs() > math.log(thresholds.inertia_factor)) & factor.isfinite()
    return columns.replace(inertia=columns.inertia * factor[:, None]), meant


def _applied(given: Hypothesis, names: tuple[str, ...]) -> Hypothesis | None:
    """Apply corrections to all trials; None where these require no other inertia, though the sample did."""
    impacts, thresholds = given.impacts, given.thresholds
    for name in names:
        if name == "inertia_scaled" and not wrong_inertia(torque(impacts).inertia_factor.item(), thresholds):
            return None
        impacts = CORRECTIONS[name].function(impacts, OutlierThresholds())  # none of these drops a trial
    return Hypothesis(names=names, impacts=impacts, thresholds=thresholds)


def wrong_inertia(factor: float, thresholds: ConventionThresholds) -> bool:
    """Whether a factor on I is a mistake in the data; a smaller one is the effect `inertia_error`."""
    return 0 < factor < math.inf and abs(math.log(factor)) > math.log(thresholds.inertia_factor)
