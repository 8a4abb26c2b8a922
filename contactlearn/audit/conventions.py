"""Conventions of units and axes: hypotheses about them, compared by the contradictions in the measurements under each.

A hypothesis is a few named corrections; `consistency.contradictions` asks the same questions under each.  The moment
balance alone knows the signs of its two terms only: turning θ looks like turning r.  The other questions tell these
apart, except for what is truly the same (a disc seen from behind).  Contradictions are bounded, so that no outlier
decides; their mean over the trials is compared pairwise, with its standard error.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.audit.consistency import contradictions, inertia_factor, spin_explained
from contactlearn.audit.corrections import CORRECTIONS
from contactlearn.audit.thresholds import ConventionThresholds, OutlierThresholds
from contactlearn.impacts import Impacts

AXES = (
    "swapped_pre_post",
    "mirrored_y",
    "swapped_axes",
    "mirrored_x",
    "mirrored_theta",
    "contact_point_sign",
    "contact_point_mirrored",
)
TURN = {"mirrored_y", "swapped_axes"}
"""Together a turn by 90°, to the one side or, the other way round, to the other."""
DEGREES = ("degrees_omega", "degrees_theta", "degrees")
UNITS = (*DEGREES, "millimetres", "millimetres_velocity", "grams", "inertia_scaled")
BALANCED = set(UNITS) - {"degrees_theta"}
"""Units that the moment balance depends on."""
_DEPTH = 3  # corrections at once


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
    """Find the best of all hypotheses of up to three corrections; longer ones are tried where shorter ones fail."""
    given = best = Hypothesis(names=(), impacts=impacts.replace(suspect=True), thresholds=thresholds)
    tried, equals = 1, []
    for depth in range(1, _DEPTH + 1):
        if depth > 1 and best.score < thresholds.consistent:
            break
        found = [_apply(given, names) for names in _combinations(depth)]
        found = sorted((h for h in found if h is not None), key=lambda h: h.score)
        tried += len(found)
        new = next((h for h in found if _better(h, best, depth)), None)
        if new is not None:
            equal = [h for h in found if new.score <= h.score < new.score + thresholds.indistinct]
            best, *equals = sorted(equal, key=lambda h: [*map([*CORRECTIONS].index, h.names)])
    return ConventionComparison(given=given, best=best, equals=tuple(equals), tried=tried)


def _better(new: Hypothesis, old: Hypothesis, depth: int) -> bool:
    """Other units must also make the moments balance: else they only shrink a Δω that is all noise."""
    gain, thresholds = old.total - new.total, new.thresholds
    if gain.mean().item() < thresholds.gain * (depth - len(old.names)) or _sigmas(gain) < thresholds.sigmas:
        return False
    return not BALANCED.intersection(new.names) or spin_explained(new.impacts) > thresholds.explained


def _combinations(depth: int) -> list[tuple[str, ...]]:
    """Corrections in the order in which they are applied; it matters for a swap and a mirror of y.

    An angle is in degrees once.  Before and after are not swapped with two other changes at once: a mirrored
    film run backwards explains any body that gains energy.
    """
    sets = itertools.combinations((*AXES, *UNITS), depth)
    sensible: list[tuple[str, ...]] = [
        names
        for names in sets
        if len({*names}.intersection(DEGREES)) < 2 and not (depth > 2 and "swapped_pre_post" in names)
    ]
    turned = [names for names in sensible if {*names} >= TURN]
    turns: list[tuple[str, ...]] = [
        ("swapped_axes", "mirrored_y", *(x for x in names if x not in TURN)) for names in turned
    ]
    return sensible + turns


def _apply(given: Hypothesis, names: tuple[str, ...]) -> Hypothesis | None:
    """None where the moment balance asks for a negative inertia, or one that is only a little different."""
    impacts, thresholds = given.impacts, given.thresholds
    for name in names:
        if name == "inertia_scaled" and not wrong_inertia(inertia_factor(impacts), thresholds):
            return None
        impacts = CORRECTIONS[name].function(impacts, OutlierThresholds())  # none of these drops a trial
    return Hypothesis(names=names, impacts=impacts, thresholds=thresholds)


def wrong_inertia(factor: float, thresholds: ConventionThresholds) -> bool:
    """Whether a factor on I is a mistake in the data; a smaller one is the effect `inertia_error`."""
    return 0 < factor < math.inf and abs(math.log(factor)) > math.log(thresholds.inertia_factor)
