"""Forward selection of missing effects over a catalogue, by score tests and held-out error.

    screen    score test of every candidate from the one fit of the present model: does the loss fall if it is let in?
    refit     the most promising are fitted together with the law and the effects chosen so far
    compare   the best of these, on held-out trials of the same folds, trial by trial against the present model
    admit     the best, if the score test survives Bonferroni's correction over all candidates and the held-out
              error falls by more than chance and by more than is worth a name
    re-test   effects chosen earlier whose removal costs no more than chance are taken out again

until no candidate is admitted.  All folds of a candidate are fitted at once.
Source: Stone 1974.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.diagnosis.search.score_test import ScoreTest, score_test
from contactlearn.diagnosis.thresholds import SelectionThresholds
from contactlearn.diagnosis.validation import CrossValidation, Folds, ValidatedFit, paired_gain
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.identification.joint import FitOptions, JointFit, identify_jointly
from contactlearn.impacts import Impacts
from contactlearn.laws import Law

_REFITTED, _COMPARED = 8, 4


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A candidate beside the present model: its score test and, once refitted, its held-out gain.

    `gain` is the fall of the held-out loss in nats a trial with its standard error, `error` the held-out mass error.
    """

    test: ScoreTest
    fitted: ValidatedFit | None = None
    gain: float = math.nan
    gain_error: float = math.nan
    error: float = math.nan

    @property
    def sigmas(self) -> float:
        """The gain in standard errors."""
        return self.gain / self.gain_error if self.gain_error > 0 else math.nan


@dataclass(frozen=True, kw_only=True)
class Step:
    """A round of the selection: the model before it, the comparisons, the admitted effect and the dropped ones."""

    before: ValidatedFit
    comparisons: tuple[Comparison, ...]
    admitted: EffectId | None
    dropped: tuple[str, ...] = ()


class Selection:
    """Forward selection with re-testing.

    Args:
        law: of all models; its own μ and ε are ignored.
        impacts: measurements.
        candidates: by identity; `usable` ones.
        folds: of the cross-validation.
        given: effects that are always in the model, by name.
        options: of all fits.
        thresholds: limits of what is admitted.

    Attributes:
        base: the law with the given effects.
        present: the model chosen so far.
        steps: rounds so far.
    """

    def __init__(
        self,
        law: Law,
        impacts: Impacts,
        candidates: Mapping[EffectId, Effect],
        folds: Folds,
        given: Mapping[str, Effect],
        options: FitOptions = FitOptions(),
        thresholds: SelectionThresholds = SelectionThresholds(),
    ) -> None:
        self.law, self.impacts, self.folds, self.options, self.thresholds = law, impacts, folds, options, thresholds
        self.models = CrossValidation(law=law, impacts=impacts, folds=folds, options=options)
        self.candidates = {key: effect.prepare(impacts) for key, effect in candidates.items()}
        self.given = dict(given)
        first = identify_jointly(law, self.given, impacts, options=options)
        self.base = self.present = self.models.validated(self.given, first)
        self.steps: list[Step] = []

    def run(self, progress: Callable[[Iterable], Iterable] = iter) -> ValidatedFit:
        """Admit and drop until no candidate is admitted; return the chosen model."""
        seen = [frozenset(identities(self.present.effects))]
        while len(self.present.effects) - len(self.given) < self.thresholds.most_effects:
            before, comparisons = self.present, self.comparisons(progress)
            best = max((one for one in comparisons if self._earns(one)), key=lambda one: one.gain, default=None)
            dropped: tuple[str, ...] = ()
            if best is not None:
                self.present = self._searched(best)
                dropped = self._drop(keep=best.test.candidate.name)
            admitted = None if best is None else best.test.candidate
            self.steps.append(Step(before=before, comparisons=tuple(comparisons), admitted=admitted, dropped=dropped))
            chosen = frozenset(identities(self.present.effects))
            if best is None or chosen in seen:
                break
            seen.append(chosen)
        return self.present

    def comparisons(self, progress: Callable[[Iterable], Iterable] = iter) -> list[Comparison]:
        """Test every candidate that is in no form in the model yet; refit and compare the most promising ones."""
        tests = [self.score_test(key) for key in self.candidates if key.name not in self.present.effects]
        tests.sort(key=lambda test: test.p_value)
        fits = {}
        promising = [test for test in tests[:_REFITTED] if test.p_value < self.thresholds.false_alarms]
        for test in progress(promising):
            start = torch.cat((self.present.fit.values, test.start))
            fits[test.candidate] = self.models.fit(self._with(test), start=start)
        trials = len(self.impacts)
        best = sorted(fits, key=lambda key: fits[key].loss.item() + len(fits[key].parameters) / trials)[:_COMPARED]
        return [
            self._compared(test, fits[test.candidate]) if test.candidate in best else Comparison(test=test)
            for test in tests
        ]

    def score_test(self, candidate: EffectId) -> ScoreTest:
        """Test whether the loss falls if the candidate is let in, from the present fit alone; see `score_test`."""
        scatter = self.present.fit.scatter
        effect = self.candidates[candidate]
        return score_test(self.models, self.present.effects, self.present.fit.values, scatter, candidate, effect)

    def without(self, name: str) -> ValidatedFit:
        """Fit and validate the present model without one of its effects."""
        others, values = without(self.present, name)
        return self.models.validated(others, self.models.fit(others, start=values))

    def _compared(self, test: ScoreTest, fit: JointFit) -> Comparison:
        """The candidate with a fit of it beside the present model."""
        fitted = self.models.validated(self._with(test), fit)
        gain, error = paired_gain(self.present, fitted)
        return Comparison(test=test, fitted=fitted, gain=gain, gain_error=error, error=fitted.mean_error)

    def _searched(self, best: Comparison) -> ValidatedFit:
        """The model with the candidate, fitted from other starts as well where those are better."""
        fit = self.models.fit(self._with(best.test))
        if fit.loss < best.fitted.fit.loss - 1e-6:
            return self.models.validated(self._with(best.test), fit)
        return best.fitted

    def _with(self, test: ScoreTest) -> dict[str, Effect]:
        return {**self.present.effects, test.candidate.name: self.candidates[test.candidate]}

    def _earns(self, comparison: Comparison) -> bool:
        """Whether a candidate may be admitted."""
        limits = self.thresholds
        return (
            comparison.test.p_value < limits.false_alarms / len(self.candidates)
            and comparison.sigmas > limits.gain_sigmas
            and comparison.error < (1 - limits.least_gain) * self.present.mean_error
        )

    def _drop(self, keep: str) -> tuple[str, ...]:
        """Take out effects whose removal costs no more than chance, one at a time; never given ones or the last."""
        dropped = []
        while True:
            costs = []
            for name in self.present.effects:
                if name == keep or name in self.given or wald(self.present, name) > self.thresholds.sure:
                    continue
                fitted = self.without(name)
                cost, error = paired_gain(fitted, self.present)
                costs.append((cost / max(error, 1e-300), name, fitted))
            if not costs or min(costs, key=lambda c: c[0])[0] > self.thresholds.gain_sigmas:
                return tuple(dropped)
            _, name, self.present = min(costs, key=lambda c: c[0])
            dropped.append(name)


def without(model: ValidatedFit, name: str) -> tuple[dict[str, Effect], Float[Tensor, " k"]]:
    """Return the other effects of a model, and the values of its parameters but for those of the named effect."""
    kept = ~_own(model, name)
    return {key: effect for key, effect in model.effects.items() if key != name}, model.fit.values[kept]


def wald(model: ValidatedFit, name: str) -> float:
    """Compute the Wald statistic of an effect against its vanishing values, χ² with as many degrees as parameters."""
    own = _own(model, name)
    away = model.fit.values[own] - columns(*model.effects[name].vanished().values)
    return (away @ torch.linalg.solve(model.fit.covariance[own][:, own], away)).item()


def _own(model: ValidatedFit, name: str) -> Bool[Tensor, " k"]:
    """The parameters of a model that are those of one effect."""
    return torch.tensor([p.name.startswith(f"{name}.") for p in model.fit.parameters])


def identities(effects: Mapping[str, Effect]) -> list[EffectId]:
    """Return the identity of each effect of a model."""
    return [EffectId(name, effect.form) for name, effect in effects.items()]
