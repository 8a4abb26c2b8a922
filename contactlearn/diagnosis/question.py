"""The question of a diagnosis: what is given, what may be missing, and the settings of all stages."""

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

from contactlearn.core.events import track
from contactlearn.diagnosis.events import OnEvent
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import Law

_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True)
class Question:
    """Data that every stage of a diagnosis reads.

    Args:
        law: the given law; None if the best of `laws` is to be chosen.
        given: effects that every model has, by name.
        candidates: effects that may be missing.
        laws: laws to compare, by name.
        options: options of all fits.
        limits: limits of the set-up for the next experiment, see `next_experiment`.
        thresholds: limits of every decision.
        seconds: time limit of the search, s; after it, the fitted models decide.
        on_event: receives results and progress.
        ordered: whether flexible models may depend on the order of the trials.
    """

    law: Law | None
    given: Mapping[str, Effect]
    candidates: Mapping[EffectId, Effect]
    laws: Mapping[str, Law]
    options: FitOptions
    limits: Mapping[str, tuple[float, float]]
    thresholds: Thresholds
    seconds: float
    on_event: OnEvent
    ordered: bool = True

    def without_order(self, excluded: Container[EffectId]) -> "Question":
        """Return the question without some candidates, and with flexible models that do not see the order either."""
        kept = {key: effect for key, effect in self.candidates.items() if key not in excluded}
        return replace(self, candidates=kept, ordered=False)

    def progress(self, task: str) -> Callable[[Iterable[_Item]], Iterable[_Item]]:
        """Return a wrapper that reports the progress through the items of a long task."""
        return lambda items: track(items, task, self.on_event)
