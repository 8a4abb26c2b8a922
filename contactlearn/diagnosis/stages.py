"""Stages of a diagnosis after the audit: search, what the effects explain, what they do not.

    Study            the question: given effects, candidates, laws, options, and the random source of all stages
    search_effects   the selection around a law, and the failures of that law
    assess_state_dependence  dependence of what remains on the state, and the model without proxy effects
    compare_effects  the ladder of the effects, their rivals, and the experiment that separates them
    decompose_error  the predictable part of the residual, formulas for it, and the error budget

Each stage is a function of the study and of the results before it.  The generator is drawn from in this order.
"""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import torch

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.model_checks import averaged
from contactlearn.diagnosis.budget import error_budget, error_limits
from contactlearn.diagnosis.discrimination.experiment import Substitution, next_experiment, reachable
from contactlearn.diagnosis.discrimination.rivals import FittedRival, find_rivals
from contactlearn.diagnosis.events import (
    CandidatesExcluded,
    EffectsFound,
    FormulasSkipped,
    LawChanged,
    LimitsEstimated,
    OnEvent,
    RegionsFound,
    RemainderLearned,
    VelocitiesAveraged,
    track,
)
from contactlearn.diagnosis.failure.regions import find_regions
from contactlearn.diagnosis.noise import noise_floor
from contactlearn.diagnosis.result import (
    ErrorBudget,
    ErrorLimits,
    Experiment,
    Finding,
    Formula,
    LawFit,
    Region,
    StateDependence,
)
from contactlearn.diagnosis.search.candidates import usable
from contactlearn.diagnosis.search.ladder import Ladder, ladder
from contactlearn.diagnosis.search.selection import Selection, select
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.formulas import formulas
from contactlearn.diagnosis.unexplained.proxy_effects import drop_proxies
from contactlearn.diagnosis.unexplained.remainder import LearnedRemainder, learn_remainder
from contactlearn.diagnosis.unexplained.serial_dependence import find_serial_dependence
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.inference.validation import CrossValidation, Folds, ValidatedFit, held_out_error, held_out_interval
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, require_impacts

_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True)
class Study:
    """The question: given effects, candidates, laws, options, and the random source of all stages."""

    given: Mapping[str, Effect]
    candidates: Mapping[EffectId, Effect]
    laws: Mapping[str, Law]
    options: FitOptions
    limits: Mapping[str, tuple[float, float]]
    thresholds: Thresholds
    seconds: float
    memory: float | None
    kept: Path | None
    on_event: OnEvent
    generator: torch.Generator
    ordered: bool = True

    def check(self, impacts: Impacts) -> None:
        """Refuse what are no impacts, too few trials, and limits that make no sense, before any work is done."""
        require_impacts(impacts)
        fewest = self.thresholds.fewest_trials
        if len(impacts) < fewest:
            raise DataError(f"{impacts.source}: a diagnosis needs at least {fewest} trials, got {len(impacts)}")
        reachable(impacts, self.limits)

    def without_order(self, ordered: Container[EffectId]) -> "Study":
        """Return the question without some candidates, and with flexible models that do not see the order either."""
        kept = {key: effect for key, effect in self.candidates.items() if key not in ordered}
        return replace(self, candidates=kept, ordered=False)

    def progress(self, task: str) -> Callable[[Iterable[_Item]], Iterable[_Item]]:
        """Return a wrapper that reports the progress through the items of a long task."""
        return lambda items: track(items, task, self.on_event)

    def law_fits(self, impacts: Impacts, folds: Folds) -> tuple[LawFit, ...]:
        """Each law: its held-out error with the given effects, and its coefficients alone."""
        laws = track(self.laws.values(), "laws", self.on_event)
        return tuple(self._law_fit(law, impacts, folds) for law in laws)

    def _law_fit(self, law: Law, impacts: Impacts, folds: Folds) -> LawFit:
        """One law: its coefficients alone, and its held-out error with the given effects."""
        alone = self.alone(law, impacts)
        start = None if self.given else torch.stack(alone.coefficients)
        return LawFit.of(alone, held_out_error(law, self.given, impacts, folds, self.options, start))

    def alone(self, law: Law, impacts: Impacts) -> Law:
        """A law without any effect, fitted to all trials."""
        return identify_jointly(law, {}, impacts, options=replace(self.options, starts=2)).model.law

    def base(self, law: Law, impacts: Impacts, folds: Folds) -> ValidatedFit:
        """Fit a law with the given effects and validate it."""
        models = CrossValidation(law=law, impacts=impacts, folds=folds, options=self.options)
        return models.validated(self.given, models.fit(self.given))

    def held_out(self, law: Law, impacts: Impacts, folds: Folds) -> float:
        """Held-out error of a law with the given effects."""
        return held_out_error(law, self.given, impacts, folds, self.options)

    def usable(self, impacts: Impacts) -> dict[EffectId, Effect]:
        """The candidates that these measurements can decide about."""
        among = usable(self.candidates, impacts, self.thresholds.selection)
        if left_out := [candidate for candidate in self.candidates if candidate not in among]:
            self.on_event(CandidatesExcluded(candidates=tuple(left_out)))
        return among

    def remainder(self, model: ValidatedFit, impacts: Impacts, folds: Folds) -> LearnedRemainder:
        """The predictable part of the residual of a model."""
        fit, limits = model.fit, self.thresholds.remainder
        impacts = impacts if self.ordered else impacts.replace(order=torch.zeros_like(impacts.order))
        return learn_remainder(
            impacts, fit.model, folds, generator=self.generator, inliers=fit.inliers, thresholds=limits
        )

    def failures(self, selection: Selection, ceiling: LearnedRemainder) -> tuple[ErrorLimits, tuple[Region, ...]]:
        """The limits of the law's error, and the regions in which it fails."""
        limits = error_limits(selection, ceiling, self.generator)
        self.on_event(LimitsEstimated(limits=limits))
        prediction = selection.base.fit.model.predict(selection.impacts)
        regions = find_regions(
            selection.impacts, prediction, generator=self.generator, thresholds=self.thresholds.regions
        )
        self.on_event(RegionsFound(regions=tuple(regions)))
        return limits, regions


def corrected(impacts: Impacts, findings: Iterable[Finding], thresholds: Thresholds) -> Impacts:
    """The impacts with the corrections of all findings."""
    names = [finding.correction for finding in findings if finding.correction]
    return correct(impacts, names, thresholds.audit.outliers)


# --- Search ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """The selection after its run, and the failures of the law that it is around."""

    selection: Selection
    notes: tuple[Finding, ...]
    limits: ErrorLimits
    regions: tuple[Region, ...]
    state_dependence: StateDependence | None = None

    @classmethod
    def around(
        cls, study: Study, selection: Selection, notes: tuple[Finding, ...], ceiling: LearnedRemainder | None = None
    ) -> "SearchResult":
        """Find the failures of a selection's law, with the predictable part of its residual if that is known."""
        if ceiling is None:
            ceiling = study.remainder(selection.base, selection.impacts, selection.folds)
        limits, regions = study.failures(selection, ceiling)
        return cls(selection=selection, notes=notes, limits=limits, regions=regions)


def search_effects(
    study: Study, law: Law, fits: Sequence[LawFit], chosen: bool, impacts: Impacts, folds: Folds
) -> SearchResult:
    """Select a law and effects; the law is the given one, or any where it was only `chosen` as the best alone."""
    among = study.usable(impacts)
    ceiling = study.remainder(study.base(law, impacts, folds), impacts, folds)
    notes = averaged(impacts, ceiling.v_post, lambda drops: study.held_out(law, drops, folds), study.thresholds.audit)
    if notes:
        study.on_event(VelocitiesAveraged(findings=notes))
        impacts = corrected(impacts, notes, study.thresholds)
    selection = select(
        study.laws if chosen else {law.name: law},
        impacts,
        among,
        folds,
        given=study.given,
        starts={} if study.given else {one.name: torch.tensor((one.mu, one.eps), dtype=torch.float64) for one in fits},
        options=study.options,
        thresholds=study.thresholds.selection,
        seconds=study.seconds,
        generator=study.generator,
        progress=study.progress("effects"),
    )
    same = selection.law.name == law.name
    if not same:
        study.on_event(LawChanged(law=selection.law.name))
    return SearchResult.around(study, selection, notes, ceiling if same and not notes else None)


def assess_state_dependence(study: Study, searched: SearchResult, block: int = 1) -> SearchResult:
    """Find what the state of the trials tells, and choose the model without effects that only stand for it.

    Errors of so many neighbouring trials, a `block`, may resemble each other.
    """
    selection, impacts, limits = searched.selection, searched.selection.impacts, study.thresholds
    ask = partial(find_state_dependence, impacts, options=study.options, thresholds=limits, block=block)
    found = ask(selection.present.fit, selection.pool.best().fit)
    asked = replace(searched, state_dependence=found)
    if found is None or not found.large:
        return asked
    path = selection.path()
    fewest = drop_proxies(impacts, [one.fit for one in path], study.options, limits.state_dependence, block)
    spec = path[fewest].spec
    if spec == selection.spec:
        return asked
    less = selection.at(spec, limits.selection.window, study.generator)
    found = ask(less.present.fit, less.present.fit)
    if found is None or not found.large:
        return asked
    found = replace(found, superseded_effects=tuple(sorted(selection.spec.effects - spec.effects)))
    if spec.law == selection.spec.law:
        return replace(searched, selection=less, state_dependence=found)
    study.on_event(LawChanged(law=spec.law))
    return replace(SearchResult.around(study, less, searched.notes), state_dependence=found)


# --- What the effects explain, and what they do not --------------------------------------------


@dataclass(frozen=True, kw_only=True)
class EffectComparison:
    """The ladder, rivals of its effects, and the experiment that separates them."""

    ladder: Ladder
    rivals: Mapping[EffectId, tuple[FittedRival, ...]]
    experiment: Experiment | None


def compare_effects(study: Study, searched: SearchResult) -> EffectComparison:
    """Order the effects, and look for what else could explain the same."""
    selection = searched.selection
    rungs = ladder(selection, searched.regions, study.generator)
    study.on_event(EffectsFound(effects=tuple(rungs.missing), regions=searched.regions))
    rivals = find_rivals(selection, study.thresholds.rivals, study.progress("rivals of the effects"))
    models = {
        Substitution(effect, one.rival.effect): one.fitted.fit.model for effect, some in rivals.items() for one in some
    }
    experiment = None
    if models:
        chosen = selection.present.fit.model
        experiment = next_experiment(selection.impacts, chosen, models, generator=study.generator, limits=study.limits)
    return EffectComparison(ladder=rungs, rivals=rivals, experiment=experiment)


@dataclass(frozen=True, kw_only=True)
class ErrorDecomposition:
    """The remainder of the full model, formulas for it, and the error budget."""

    learned: LearnedRemainder
    formulas: tuple[Formula, ...]
    budget: ErrorBudget


def decompose_error(study: Study, searched: SearchResult, rungs: Ladder) -> ErrorDecomposition:
    """Learn what the full model leaves, and divide the error of the law."""
    selection = searched.selection
    impacts, fit = selection.impacts, selection.present.fit
    learned = study.remainder(selection.present, impacts, selection.folds)
    large = learned.remainder.large
    serial_dependence = find_serial_dependence(impacts, fit, study.options, study.thresholds) if study.ordered else None
    told = replace(learned.remainder, serial_dependence=serial_dependence, state_dependence=searched.state_dependence)
    learned = replace(learned, remainder=told)
    study.on_event(RemainderLearned(remainder=told))
    written = _formulas(study, selection, learned) if large else ()
    floor = noise_floor(
        impacts,
        fit.model,
        generator=study.generator,
        noise=study.options.noise,
        inliers=fit.inliers,
        predicted=learned.v_post if large else None,
    )
    budget = error_budget(
        searched.limits,
        base=rungs.rungs[0].error,
        named=rungs.rungs[-1].error,
        flexible=held_out_interval(learned.error, study.generator),
        floor=floor,
    )
    return ErrorDecomposition(learned=learned, formulas=written, budget=budget)


def _formulas(study: Study, selection: Selection, learned: LearnedRemainder) -> tuple[Formula, ...]:
    """For the component that reduces the error most; none without the library that finds them."""
    component, model = learned.remainder.components[0], selection.present.fit.model
    try:
        return formulas(selection.impacts, model, component, selection.folds, thresholds=study.thresholds.formulas)
    except ContactLearnError as error:
        study.on_event(FormulasSkipped(reason=str(error)))
        return ()
