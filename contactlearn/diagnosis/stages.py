"""Stages of a diagnosis after the audit, in the order in which they run and draw from the generator.

    laws         held-out error of each law alone
    selection    a law, the given one or any, with effects of the catalogue: searched together, fitted jointly
    limits       error of the law, of processes that learn all they can, of the best rigid contact
    regions      where the law alone fails
    drift        errors that wander with the sequence; then the search runs again on blocked folds, without effects over
                 the order
    state        dependence of what remains on the state of each trial; proxy effects are dropped
    ladder       law, each effect, flexible model, noise: held-out errors, also by region
    rivals       effects that explain these data as well, and the drops that separate them
    remainder    the part of the residual that a flexible model still predicts, and formulas for it
    scatter      what differs from impact to impact around the full model, tested for structure
    budget       noise of instrument and contact, and the shares of the law's error
    choices      every subset of the effects, fitted, for the reader to compare

All errors are the held-out mass error.  `result` holds the types; docs/results.md is the schema of diagnosis.json.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch

from contactlearn.core.errors import ContactLearnError
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.model_checks import find_model_outliers, noise_notes, one_state_notes
from contactlearn.diagnosis.discrimination.experiment import Substitution, next_experiment
from contactlearn.diagnosis.discrimination.rivals import FittedRival, find_rivals
from contactlearn.diagnosis.drift import blocked_folds, drift_finding, measurement_drift, ordered_candidates
from contactlearn.diagnosis.error_budget import NoiseFloor, error_budget, error_limits, noise_floor, verdict
from contactlearn.diagnosis.events import (
    AuditFindings,
    CandidatesExcluded,
    EffectsFound,
    FormulasSkipped,
    LawChanged,
    LawsCompared,
    LimitsEstimated,
    MeasurementsReplaced,
    RegionsFound,
    RemainderLearned,
)
from contactlearn.diagnosis.law_steps import less_error_of_steps
from contactlearn.diagnosis.question import Question
from contactlearn.diagnosis.record import Record
from contactlearn.diagnosis.regions import find_regions
from contactlearn.diagnosis.result import (
    Candidate,
    ContactScatter,
    Diagnosis,
    ErrorBudget,
    ErrorLimits,
    Experiment,
    Finding,
    Formula,
    FrontierModel,
    LawFit,
    Level,
    MissingEffect,
    NoiseSource,
    PlausibleModel,
    Region,
    StateDependence,
    Verdict,
    clearly_better,
)
from contactlearn.diagnosis.search.candidates import fitted_first, follows_order, usable, user_candidates
from contactlearn.diagnosis.search.choices import FittedChoices, fit_choices
from contactlearn.diagnosis.search.ladder import (
    Ladder,
    coefficient_ends,
    fitted_parameters,
    ladder,
    name_probability,
)
from contactlearn.diagnosis.search.selection import Selection, predict_held_out, select, smaller, validated
from contactlearn.diagnosis.unexplained.contact_scatter import ScatterEstimate, contact_scatter
from contactlearn.diagnosis.unexplained.formulas import formulas
from contactlearn.diagnosis.unexplained.proxy_effects import index_without_proxies
from contactlearn.diagnosis.unexplained.remainder import LearnedRemainder, learn_remainder
from contactlearn.diagnosis.unexplained.serial_dependence import find_serial_dependence
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import CrossValidation, Folds, ValidatedFit, held_out_error, held_out_interval
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts

# probability of a name at most, where the data leave its parameters open: it is a candidate
_MAX_CONFIDENCE_UNDETERMINED = 0.49
_REPEATED_UP_TO = 600  # trials up to which the cross-validation is repeated


def diagnose_audited(
    question: Question, impacts: Impacts, findings: Sequence[Finding], generator: torch.Generator
) -> Diagnosis:
    """Diagnose audited and corrected impacts in one pass through all stages.

    Args:
        question: what is given, what may be missing, and all settings.
        impacts: measurements, corrected.
        findings: findings of the audit.
        generator: random source of all stages.
    """
    if any(finding.name == "sorted_trials" for finding in findings):
        candidates = usable(question.candidates, impacts, question.thresholds)
        question = question.without_order({key for key, effect in candidates.items() if follows_order(effect, impacts)})
    folds = Folds.draw(len(impacts), generator, repeats=2 if len(impacts) <= _REPEATED_UP_TO else 1)
    fits = compare_laws(question, impacts, folds)
    law = question.law or question.laws[min(fits, key=lambda fit: fit.error).name]
    exact = less_error_of_steps(impacts, next(fit.law() for fit in fits if fit.name == law.name))
    if exact is not impacts:
        refitted = _law_fit(law, question.given, exact, folds, question.options)
        impacts, fits = exact, tuple(refitted if fit.name == law.name else fit for fit in fits)
    question.on_event(LawsCompared(law=law.name, fits=fits))
    search = search_effects(question, law, fits, impacts, folds, generator)
    drift = measurement_drift(search.selection, question.thresholds, generator) if question.ordered else None
    if drift is None:
        search = drop_proxy_effects(question, search, generator)
    else:
        unordered = question.without_order(ordered_candidates(search.selection, drift))
        if unordered.candidates:
            question, findings = unordered, (*findings, drift_finding(drift, impacts.space))
            question.on_event(AuditFindings(findings=findings[-1:]))
            folds = blocked_folds(drift, search.selection, generator)
            search = search_effects(question, law, fits, impacts, folds, generator)
            search = drop_proxy_effects(question, search, generator, drift.dependence.block)
    rungs, learned = _fit_ladder(question, search, generator)
    decomposition = decompose_error(question, search, rungs, learned, generator)
    confidence = _confidence(question, search.selection, rungs.missing, decomposition)
    probable = {effect for effect, sure in confidence.items() if sure.level is not Level.CANDIDATE}
    if len(probable) < len(confidence):
        search = without_candidates(question, search, probable, confidence, generator)
        rungs, learned = _fit_ladder(question, search, generator)
        decomposition = decompose_error(question, search, rungs, learned, generator)
    comparison = compare_effects(question, search, rungs, generator)
    question.on_event(EffectsFound(effects=rungs.missing, regions=search.regions))
    question.on_event(RemainderLearned(remainder=learned.remainder))
    findings = (*findings, *search.notes, *one_state_notes(search.selection.impacts))
    return demote_balance(_result(question, search, comparison, decomposition, confidence, fits, findings, generator))


def compare_laws(question: Question, impacts: Impacts, folds: Folds) -> tuple[LawFit, ...]:
    """Compute the held-out error of each law with the given effects, and its coefficients without any."""
    laws = [question.laws[name] for name in fitted_first(question.laws)]
    return tuple(_law_fit(law, question.given, impacts, folds, question.options) for law in laws)


def _law_fit(law: Law, given: Mapping[str, Effect], impacts: Impacts, folds: Folds, options: FitOptions) -> LawFit:
    """Fit a law without any effect, and validate it with the given ones."""
    quick = replace(options, starts=2, standard_errors=False)
    alone = joint.fit(impacts, law, options=quick).model.law
    start = None if given else torch.stack(alone.coefficients)
    return LawFit.of(alone, held_out_error(law, given, impacts, folds, options, start))


# --- Search ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Confidence:
    """Probability of a name, and the joint one of it and its alternatives, which do as well in its place."""

    of_name: float
    joint: float
    alternatives: tuple[EffectId, ...] = ()

    @property
    def level(self) -> Level:
        """Of the name itself, or of it and its alternatives together."""
        alone = Level.of(self.of_name)
        either = alone is Level.CANDIDATE and Level.of(self.joint) is not Level.CANDIDATE
        return Level.EITHER if either else alone


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """The selected model, and the limits and regions of its law's error.

    Args:
        selection: the chosen model.
        notes: measurements that were replaced before the search, since noise dominates them.
        limits: errors between which an effect can move the law.
        regions: regions in which the law fails.
        state_dependence: dependence of what remains on the state of each trial.
        candidates: effects that were left out of the model.
        error_with_candidates: mean held-out error of the model that has them; None without any.
    """

    selection: Selection
    notes: tuple[Finding, ...]
    limits: ErrorLimits
    regions: tuple[Region, ...]
    state_dependence: StateDependence | None = None
    candidates: tuple[Candidate, ...] = ()
    error_with_candidates: float | None = None

    def reduced(self, selection: Selection, confidence: Mapping[EffectId, Confidence]) -> "SearchResult":
        """Choose a smaller model; effects that it lacks become candidates, those without a confidence as proxies.

        An effect that it has in another form is no candidate.
        """
        larger = self.selection
        lacking = [effect for effect in larger.missing if effect.name not in selection.spec.families]
        candidates = tuple(
            Candidate(
                effect=effect,
                equation=larger.present.fit.model.effects[effect.name].shown_equation,
                parameters=fitted_parameters(larger.present, effect.name),
                error_after=larger.present.mean_error,
                error_reduction=less.mean_error - larger.present.mean_error,
                confidence=confidence[effect].of_name if effect in confidence else None,
                coefficient_ends=coefficient_ends(larger.present, larger.impacts, effect.name),
                proxy=effect not in confidence,
            )
            for effect, less in zip(lacking, larger.without_each(lacking), strict=True)
        )
        return replace(
            self,
            selection=selection,
            candidates=tuple(sorted((*self.candidates, *candidates), key=lambda candidate: -candidate.error_reduction)),
            error_with_candidates=self.error_with_candidates or larger.present.mean_error,
        )


def search_effects(
    question: Question,
    law: Law,
    fits: Sequence[LawFit],
    impacts: Impacts,
    folds: Folds,
    generator: torch.Generator,
) -> SearchResult:
    """Select effects around the given law, or a law and effects if none is given; `law` is then the best alone."""
    candidates = usable(question.candidates, impacts, question.thresholds)
    if excluded := [key for key in question.candidates if key not in candidates]:
        question.on_event(CandidatesExcluded(candidates=tuple(excluded)))
    validation = CrossValidation(law=law, impacts=impacts, folds=folds, options=question.options)
    base = validation.validated(question.given, validation.fit(question.given))
    ceiling = _learn(question, base, impacts, folds, generator)
    notes = noise_notes(
        impacts, ceiling.v_post, lambda drops: held_out_error(law, question.given, drops, folds, question.options)
    )
    if notes:
        question.on_event(MeasurementsReplaced(findings=notes))
        corrections = [note.correction for note in notes if note.correction]
        impacts = correct(impacts, corrections, question.thresholds.audit)
    starts = {fit.name: torch.tensor((fit.mu, fit.eps), dtype=torch.float64) for fit in fits}
    selection = select(
        question.laws if question.law is None else {law.name: law},
        impacts,
        candidates,
        folds,
        given=question.given,
        starts={} if question.given else starts,
        options=question.options,
        thresholds=question.thresholds,
        seconds=question.seconds,
        generator=generator,
        progress=question.progress("effects"),
    )
    changed = selection.law.name != law.name
    if changed:
        question.on_event(LawChanged(law=selection.law.name))
    return _with_limits_and_regions(question, selection, notes, None if changed or notes else ceiling, generator)


def _with_limits_and_regions(
    question: Question,
    selection: Selection,
    notes: tuple[Finding, ...],
    ceiling: LearnedRemainder | None,
    generator: torch.Generator,
) -> SearchResult:
    """Add the limits of the law's error, and the regions in which it fails, to a selection.

    `ceiling` is the predictable part of the law's residual, if it has been learned.
    """
    impacts = selection.impacts
    ceiling = ceiling or _learn(question, selection.base, impacts, selection.folds, generator)
    limits = error_limits(selection, ceiling, generator)
    question.on_event(LimitsEstimated(limits=limits))
    prediction = selection.base.fit.model.predict(impacts)
    regions = find_regions(impacts, prediction, generator=generator, thresholds=question.thresholds)
    question.on_event(RegionsFound(regions=tuple(regions)))
    return SearchResult(selection=selection, notes=notes, limits=limits, regions=regions)


def drop_proxy_effects(
    question: Question, search: SearchResult, generator: torch.Generator, block: int = 1
) -> SearchResult:
    """Test what remains against the state, and choose the model without effects that are proxies for this dependence.

    Errors of `block` neighbouring trials may resemble each other.
    """
    selection, impacts = search.selection, search.selection.impacts
    options, thresholds = question.options, question.thresholds
    fit = selection.present.fit
    dependence = find_state_dependence(impacts, fit, selection.pool.best().fit, options, thresholds, block)
    tested = replace(search, state_dependence=dependence)
    removed = selection.base.mean_error - selection.present.mean_error
    form = thresholds.form_error * removed  # an effect whose form is not quite that of the catalogue leaves a part
    if dependence is None or not dependence.large or dependence.share.mean * selection.present.mean_error < form:
        return tested
    path = selection.path()
    spec = path[index_without_proxies(impacts, [model.fit for model in path], options, thresholds, block)].spec
    if spec == selection.spec:
        return tested
    reduced = selection.at(spec, thresholds.window, generator)
    dependence = find_state_dependence(impacts, reduced.present.fit, reduced.present.fit, options, thresholds, block)
    if dependence is None or not dependence.large:
        return tested
    return _reduced(question, replace(search, state_dependence=dependence), reduced, {}, generator)


def without_candidates(
    question: Question,
    search: SearchResult,
    probable: Container[EffectId],
    confidence: Mapping[EffectId, Confidence],
    generator: torch.Generator,
) -> SearchResult:
    """Choose law and model of the probable effects alone; the others become candidates with their confidence."""
    selection, model, pool = search.selection, search.selection.chosen, search.selection.pool
    for effect in selection.missing:
        if effect not in probable:
            (model,) = smaller(pool, model, effect)
    specs = [model.spec.with_law(law) for law in dict.fromkeys((model.spec.law, *fitted_first(pool.laws)))]
    spec = pool.best(pool.all_fitted({spec: pool.start(spec, model, {}) for spec in specs})).spec
    return _reduced(question, search, selection.at(spec, question.thresholds.window, generator), confidence, generator)


def _reduced(
    question: Question,
    search: SearchResult,
    selection: Selection,
    confidence: Mapping[EffectId, Confidence],
    generator: torch.Generator,
) -> SearchResult:
    """Choose a smaller model, see `SearchResult.reduced`; limits and regions are those of its law."""
    reduced = search.reduced(selection, confidence)
    if selection.law.name == search.selection.law.name:
        return reduced
    question.on_event(LawChanged(law=selection.law.name))
    refreshed = _with_limits_and_regions(question, selection, search.notes, None, generator)
    return replace(reduced, limits=refreshed.limits, regions=refreshed.regions)


def _learn(
    question: Question, model: ValidatedFit, impacts: Impacts, folds: Folds, generator: torch.Generator
) -> LearnedRemainder:
    """Learn the predictable part of the residual of a model."""
    if not question.ordered:
        impacts = impacts.replace(order=torch.zeros_like(impacts.order))
    fit, thresholds = model.fit, question.thresholds
    return learn_remainder(impacts, fit.model, folds, generator=generator, inliers=fit.inliers, thresholds=thresholds)


# --- What the effects explain, and what they do not --------------------------------------------


def _fit_ladder(
    question: Question, search: SearchResult, generator: torch.Generator
) -> tuple[Ladder, LearnedRemainder]:
    """Climb the ladder, and learn what the model at its top leaves."""
    selection = search.selection
    impacts, fit, thresholds = selection.impacts, selection.present.fit, question.thresholds
    rungs = ladder(selection, search.regions, generator)
    learned = _learn(question, selection.present, impacts, selection.folds, generator)
    serial = find_serial_dependence(impacts, fit, question.options, thresholds) if question.ordered else None
    remainder = replace(learned.remainder, serial_dependence=serial, state_dependence=search.state_dependence)
    return rungs, replace(learned, remainder=remainder)


@dataclass(frozen=True, kw_only=True)
class EffectComparison:
    """The ladder, rivals of its effects, and the experiment that separates them."""

    ladder: Ladder
    rivals: Mapping[EffectId, tuple[FittedRival, ...]]
    experiment: Experiment | None


def compare_effects(
    question: Question, search: SearchResult, rungs: Ladder, generator: torch.Generator
) -> EffectComparison:
    """Find what else could explain what the effects of the ladder do."""
    selection = search.selection
    rivals = find_rivals(selection, question.thresholds, question.progress("rivals of the effects"))
    models = {Substitution(e, r.rival.effect): r.fitted.fit.model for e, each in rivals.items() for r in each}
    experiment = None
    if models:
        chosen = selection.present.fit.model
        experiment = next_experiment(selection.impacts, chosen, models, generator=generator, limits=question.limits)
    return EffectComparison(ladder=rungs, rivals=rivals, experiment=experiment)


@dataclass(frozen=True, kw_only=True)
class ErrorDecomposition:
    """The remainder of the full model, formulas for it, its contact's scatter, and the error budget.

    `judged` is the budget of the verdict: scatter of which a part follows something is no noise there.
    """

    learned: LearnedRemainder
    formulas: tuple[Formula, ...]
    scatter: ScatterEstimate | None
    budget: ErrorBudget
    judged: ErrorBudget


def decompose_error(
    question: Question, search: SearchResult, rungs: Ladder, learned: LearnedRemainder, generator: torch.Generator
) -> ErrorDecomposition:
    """Find formulas for what the full model leaves, and divide the error of the law."""
    selection, remainder, described = search.selection, learned.remainder, ()
    impacts, fit, thresholds = selection.impacts, selection.present.fit, question.thresholds
    if remainder.large:
        try:
            component = remainder.components[0]
            described = formulas(impacts, fit.model, component, selection.folds, thresholds=thresholds)
        except ContactLearnError as error:  # such as an effect that has their name
            question.on_event(FormulasSkipped(reason=str(error)))
    floor = noise_floor(
        impacts,
        fit.model,
        generator=generator,
        noise=question.options.noise,
        inliers=fit.inliers,
        predicted=learned.v_post if remainder.large else None,
    )
    scatter = contact_scatter(impacts, fit.model, question.options, thresholds)
    divided = partial(
        error_budget,
        search.limits,
        base=rungs.rungs[0].error,
        named=rungs.rungs[-1].error,
        flexible=held_out_interval(learned.error, generator),
        with_candidates=search.error_with_candidates,
    )
    judged = budget = divided(floor=floor)
    if scatter is not None:
        # What follows something differs between similar trials as well, which an estimated floor takes for noise.
        follows = bool(scatter.result.dependences) and floor.source is NoiseSource.ESTIMATED
        if follows or (scatter.result.seen and scatter.floor.mean > floor.error.mean):
            floor = NoiseFloor(error=scatter.floor, source=NoiseSource.SCATTER)
        if follows or scatter.result.seen:
            budget = divided(floor=floor, instrument=scatter.instrument)
        judged = budget if follows or scatter.result.random else judged
    return ErrorDecomposition(learned=learned, formulas=described, scatter=scatter, budget=budget, judged=judged)


# --- The result --------------------------------------------------------------------------------


def _result(
    question: Question,
    search: SearchResult,
    comparison: EffectComparison,
    decomposition: ErrorDecomposition,
    confidence: Mapping[EffectId, Confidence],
    laws: Sequence[LawFit],
    findings: tuple[Finding, ...],
    generator: torch.Generator,
) -> Diagnosis:
    """Assemble the diagnosis."""
    selection, thresholds, budget = search.selection, question.thresholds, decomposition.budget
    impacts, model, remainder = selection.impacts, selection.present.fit.model, decomposition.learned.remainder
    choices, missing = _choices(question, selection, comparison, confidence)
    outliers = find_model_outliers(impacts, lambda some: model.predict(some).v_post, thresholds.audit)
    laws = _law_fits(question, search, laws, bool(missing))
    if (scatter := decomposition.scatter) is not None:
        model = replace(model, scatter=scatter.model.scatter, noise=scatter.model.noise)
    others = [fit for fit in laws if fit.name != selection.law.name]
    physics = verdict(
        decomposition.judged,
        named=bool(missing),
        predictable=remainder.unknown,
        better_law=clearly_better(others, budget.named.mean, thresholds) is not None,
        complete=selection.complete,
        thresholds=thresholds,
    )
    return Diagnosis(
        verdict=Verdict.BAD_DATA if any(finding.mistake for finding in findings) else physics,
        physics=physics,
        law=selection.law.name,
        variant=selection.law.variant,
        given=tuple(EffectId(name, effect.form) for name, effect in question.given.items()),
        findings=findings if outliers is None else (*findings, outliers),
        laws=laws,
        missing=missing,
        candidates=search.candidates,
        ladder=(*comparison.ladder.rungs, *budget.rungs),
        budget=budget,
        regions=search.regions,
        coefficients=fitted_parameters(selection.present),
        equation=str(model),
        experiment=comparison.experiment,
        remainder=remainder,
        formulas=decomposition.formulas,
        scatter=_scatter(decomposition),
        choices=choices.choices,
        models=tuple(
            PlausibleModel(law=p.model.spec.law, effects=tuple(sorted(p.model.spec.effects)), share=p.share)
            for p in selection.plausible
        ),
        shapeless=_shapeless(question, impacts),
        unwanted=_unwanted(selection, missing),
        frontier=_frontier(selection, generator),
        hidden=_hidden(selection, budget.shares.unnamed, generator),
        complete=selection.complete,
        thresholds=thresholds,
        record=Record(
            impacts=impacts,
            base=selection.base.fit.model,
            model=model,
            outcomes=choices.outcomes,
            residuals=tuple(partial_residuals(model, impacts, effect.effect.name) for effect in missing),
            deviations=() if decomposition.scatter is None else decomposition.scatter.deviations,
        ),
    )


def _scatter(decomposition: ErrorDecomposition) -> ContactScatter | None:
    """The scatter with the share of each component in the law's error; 0 of what has structure."""
    if decomposition.scatter is None:
        return None
    scatter, whole = decomposition.scatter.result, decomposition.budget.shares.scatter or 0.0
    return replace(scatter, components=tuple(replace(c, share=whole * c.share) for c in scatter.components))


def demote_balance(diagnosis: Diagnosis) -> Diagnosis:
    """Turn an open moment balance into a note where effects that were found explain the data."""
    if diagnosis.physics is not Verdict.EFFECTS or any(effect.level is not Level.FOUND for effect in diagnosis.missing):
        return diagnosis
    findings = tuple(
        replace(finding, mistake=False, sentence=f"{finding.sentence}; the effects that were found explain it")
        if finding.name == "moment_balance_open" and finding.mistake
        else finding
        for finding in diagnosis.findings
    )
    mistaken = any(finding.mistake for finding in findings)
    return replace(diagnosis, findings=findings, verdict=Verdict.BAD_DATA if mistaken else diagnosis.physics)


def _law_fits(question: Question, search: SearchResult, fits: Sequence[LawFit], missing: bool) -> tuple[LawFit, ...]:
    """Refit the laws alone where measurements were replaced, and add their errors with the missing effects.

    Where the trials are weighed by the scatter of the contact, the errors of laws alone are those with these weights.
    """
    selection = search.selection
    weighed = selection.impacts.outcome_cov is not None
    if all(fit.name != selection.law.name for fit in fits):
        fits = [*fits, LawFit.of(selection.base.fit.model.law, selection.base.mean_error)]
    if search.notes:
        fits = compare_laws(question, selection.impacts, selection.folds)
    around = {fit.name: selection.error_around(question.laws[fit.name]) for fit in fits} if missing or weighed else {}
    if missing:
        fits = [replace(fit, error_with_effects=around[fit.name]) for fit in fits]
    elif weighed:
        fits = [replace(fit, error=around[fit.name] or fit.error) for fit in fits]
    return tuple(fits)


def _choices(
    question: Question, selection: Selection, comparison: EffectComparison, confidence: Mapping[EffectId, Confidence]
) -> tuple[FittedChoices, tuple[MissingEffect, ...]]:
    """Fit every subset of the missing effects; add rivals, reductions on all trials and confidences to these."""
    impacts, generator = selection.impacts, torch.Generator().manual_seed(0)
    missing = comparison.ladder.missing
    choices = fit_choices(
        impacts,
        selection.present.fit.model,
        [effect.effect for effect in missing],
        generator=generator,
        options=question.options,
        progress=question.progress("choices of effects"),
    )
    complete = list[MissingEffect]()
    for effect in missing:
        sure = confidence[effect.effect]
        either = sure.level is Level.EITHER  # its own name is not probable, that or another one is
        complete.append(
            replace(
                effect,
                confidence=sure.of_name,
                level=sure.level,
                alternatives=sure.alternatives if either else (),
                joint_confidence=sure.joint if either else None,
                rivals=tuple(fitted.rival for fitted in comparison.rivals[effect.effect]),
                reduction_on_all_trials=choices.reduction(impacts, effect.effect, generator),
            )
        )
    return choices, tuple(complete)


def _shapeless(question: Question, impacts: Impacts) -> tuple[EffectId, ...]:
    """List the candidates that need the body's shape, where that is unknown."""
    return tuple(key for key, effect in question.candidates.items() if effect.needs_shape and impacts.shape is None)


def _confidence(
    question: Question, selection: Selection, missing: Sequence[MissingEffect], decomposition: ErrorDecomposition
) -> dict[EffectId, Confidence]:
    """Compute the probability that each name is right; effects that cannot be compared share that of their like."""
    impacts, budget, unknown = selection.impacts, decomposition.budget, decomposition.learned.remainder.unknown
    sharing, confidence = 1 + len({key.name for key in _shapeless(question, impacts)}), dict[EffectId, Confidence]()
    for effect in missing:
        removed, candidate = budget.removed(effect.error_reduction), question.candidates[effect.effect]
        alternatives, share = selection.replacements(effect.effect)
        shares = effect.share, effect.share + share
        sure = [name_probability(each, removed, budget.reducible, len(impacts), unknown) for each in shares]
        if _undetermined(candidate, effect):
            sure = [min(each, _MAX_CONFIDENCE_UNDETERMINED) for each in sure]
        if candidate.like_shape:
            sure = [each / sharing for each in sure]
        confidence[effect.effect] = Confidence(*sure, alternatives=tuple(alternatives.values()))
    return confidence


def _undetermined(effect: Effect, missing: MissingEffect) -> bool:
    """Whether no parameter of an effect is known better than by its range, or the only one better than by its value.

    Parameters of a curve may be open each and still make one of a known form.
    """
    declared = {p.name: p for p in effect.parameters}
    known = [(fitted, declared[fitted.name]) for fitted in missing.parameters if fitted.name in declared]
    alone = len(known) == 1 and known[0][1].vanishing is not None
    sizes = [abs(fitted.value - (p.vanishing or 0.0)) if alone else p.high - p.low for fitted, p in known]
    return bool(known) and all(not fitted.standard_error < size for (fitted, _), size in zip(known, sizes, strict=True))


def _unwanted(selection: Selection, missing: Sequence[MissingEffect]) -> tuple[EffectId, ...]:
    """List the user's own candidates that are in no plausible model and are no rival of an effect."""
    wanted = selection.spec.effects.union(*(plausible.model.spec.effects for plausible in selection.plausible))
    wanted |= {rival.effect for effect in missing for rival in effect.rivals}
    return tuple(key for key in user_candidates(selection.pool.candidates) if key not in wanted)


def _frontier(selection: Selection, generator: torch.Generator) -> tuple[FrontierModel, ...]:
    """Validate the best model of each number of effects, up to the best score's and to one more than were chosen."""
    pool = selection.pool
    most = max(len(selection.spec.effects) + 1, len(pool.best().spec.effects))
    sizes = sorted({size for spec in pool.models if (size := len(spec.effects)) <= most})
    models = [pool.best_of_sizes([size]) for size in sizes]
    predict_held_out(pool, selection.folds, models)
    errors = [held_out_interval(validated(pool, selection.folds, model).error, generator) for model in models]
    return tuple(
        FrontierModel(law=model.spec.law, effects=tuple(sorted(model.spec.effects)), error=error)
        for model, error in zip(models, errors, strict=True)
    )


def _hidden(selection: Selection, unnamed: float, generator: torch.Generator) -> float | None:
    """Bound the share of the error that one more effect removes, by the best model of the pool with one more.

    It is at least the share that candidates remove.
    """
    chosen, pool = selection.spec.effects, selection.pool
    larger = [m for m in pool.models.values() if chosen < m.spec.effects and len(m.spec.effects) == len(chosen) + 1]
    if not larger:
        return None
    best = validated(pool, selection.folds, pool.best(larger))
    gain = held_out_interval(selection.present.error - best.error, generator)
    return max(unnamed, gain.high / selection.present.mean_error if selection.present.mean_error else 0.0)
