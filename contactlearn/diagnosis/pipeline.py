"""The diagnosis: from measurements and a law to the effects that are missing, or to the honest alternative.

    audit        mistakes in the measurements; those that can be corrected are, and are reported first
    drift        errors that wander with the sequence; then effects over the order are left out, and folds are blocks
    laws         held-out error of each law alone
    selection    a law, the given one or any, with effects of the catalogue: searched together, fitted jointly
    state        what the state of each trial tells of what remains; effects that only stand for it are left out
    limits       error of the law, of processes that learn all they can, of the best rigid contact
    regions      where the law alone fails, and where the effects help
    ladder       law, each effect, flexible model, noise: held-out errors
    rivals       effects that explain these data as well, and the drops that separate them
    remainder    the part of the residual that a flexible model still predicts, and formulas for it
    choices      every subset of the effects, fitted, for the reader to compare

A table of more than a few thousand trials is diagnosed on subsamples of it, and the answer tested on all of it
(`sampling`).

All errors are the held-out mass error.  `result` holds the types; docs/diagnosis.md is the schema of diagnosis.json.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch

from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.model_checks import outliers_of
from contactlearn.diagnosis.drift import blocked_folds, drift_finding, measurement_drift, ordered_candidates
from contactlearn.diagnosis.events import AuditFindings, LawsCompared, OnEvent, ignore
from contactlearn.diagnosis.record import Record
from contactlearn.diagnosis.result import (
    Diagnosis,
    Finding,
    FrontierModel,
    LawFit,
    MissingEffect,
    PlausibleModel,
    Rung,
    RungKind,
    Verdict,
    clearly_better,
)
from contactlearn.diagnosis.sampling.rounds import Rounds
from contactlearn.diagnosis.search.calibration import calibrated
from contactlearn.diagnosis.search.candidates import all_candidates, all_laws, of_ones_own
from contactlearn.diagnosis.search.choices import FittedChoices, fit_choices
from contactlearn.diagnosis.search.selection import Selection, validated
from contactlearn.diagnosis.stages import (
    EffectComparison,
    ErrorDecomposition,
    SearchResult,
    Study,
    assess_state_dependence,
    compare_effects,
    corrected,
    decompose_error,
    search_effects,
)
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId, named_effects
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import Folds, held_out_interval
from contactlearn.laws import Law, named
from contactlearn.mechanics.impacts import Impacts

_FEW = 600  # trials up to which the cross-validation is repeated


def diagnose(
    impacts: Impacts,
    law: Law | str | None = None,
    effects: Mapping[str, Effect] | Iterable[str] = (),
    *,
    candidates: Mapping[EffectId, Effect] | None = None,
    laws: Sequence[Law] | None = None,
    noise: tuple[float, float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    seconds: float = 60.0,
    memory: float | None = None,
    kept: Path | None = None,
    thresholds: Thresholds = Thresholds(),
    on_event: OnEvent = ignore,
) -> Diagnosis:
    """Find out which physical effects a contact model is missing.

    Args:
        impacts: measurements; those with `validate=False` are audited and corrected, or refused.
        law: an analytical law or its name; if None, that of `laws` with the least held-out error.
        effects: in the model already, by name, or names alone.
        candidates: effects that may be missing; the whole catalogue if None.  `candidates.usable` refuses some.
        laws: to compare; `all_laws()` if None.
        noise: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s) where they are known.
        limits: of the set-up for the next experiment, see `next_experiment`.
        seed: of the folds and resamples.
        seconds: after which the search goes on with the models that it has, and the result says so.
        memory: bytes that the diagnosis may take; a large table is diagnosed on subsamples that need no more.
        kept: folder for finished subsamples of this question, behind which another run goes on.
        thresholds: limits of every decision.
        on_event: receives each result as soon as it is known, and the progress of long tasks; see `events`.

    Raises:
        ContactLearnError: no candidates, too few trials, or limits of something that a drop does not set.
    """
    law = None if law is None else named(law)
    study = Study(
        given=named_effects(effects),
        candidates=candidates or all_candidates(),
        laws={one.name: one for one in (laws or all_laws())} | ({law.name: law} if law else {}),
        options=FitOptions(noise=noise, thresholds=thresholds.fit),
        limits=limits or {},
        thresholds=thresholds,
        seconds=seconds,
        memory=memory,
        kept=kept,
        on_event=on_event,
        generator=torch.Generator().manual_seed(seed),
    )
    study.check(impacts)
    findings = audit(impacts, thresholds.audit)
    on_event(AuditFindings(findings=findings))
    if any(finding.fatal for finding in findings):
        return _refused(law, findings, thresholds)
    impacts = corrected(impacts, findings, thresholds)
    study = replace(study, given={name: effect.prepare(impacts) for name, effect in study.given.items()})
    corrections = tuple(one.correction for one in findings if one.correction)
    rounds = Rounds(study, seed, corrections, lambda asked, some: _diagnosed(asked, law, some, findings))
    return _diagnosed(study, law, impacts, findings) if rounds.whole(len(impacts)) else rounds.run(impacts)


def _diagnosed(study: Study, law: Law | None, impacts: Impacts, findings: tuple[Finding, ...]) -> Diagnosis:
    """The diagnosis of audited impacts, all stages at once."""
    folds = Folds.draw(len(impacts), study.generator, repeats=2 if len(impacts) <= _FEW else 1)
    fits = study.law_fits(impacts, folds)
    study, searched, drift = _searched(study, law, fits, impacts, folds)
    explained = compare_effects(study, searched)
    rest = decompose_error(study, searched, explained.ladder)
    return _assembled(study, searched, explained, rest, fits, (*findings, *drift, *searched.notes))


def _refused(law: Law | None, findings: tuple[Finding, ...], thresholds: Thresholds) -> Diagnosis:
    """The diagnosis of data that no correction mends."""
    name, variant = (law.name, law.variant) if law else (None, None)
    return Diagnosis(verdict=Verdict.BAD_DATA, law=name, variant=variant, findings=findings, thresholds=thresholds)


def _searched(
    study: Study, law: Law | None, fits: Sequence[LawFit], impacts: Impacts, folds: Folds
) -> tuple[Study, SearchResult, tuple[Finding, ...]]:
    """The search, repeated without what follows the order of the trials where the measurement drifts."""
    chosen = law or study.laws[min(fits, key=lambda fit: fit.error).name]
    study.on_event(LawsCompared(law=chosen.name, fits=tuple(fits)))
    searched = search_effects(study, chosen, fits, law is None, impacts, folds)
    drift = measurement_drift(searched.selection, study.thresholds, study.generator)
    rest = study if drift is None else study.without_order(ordered_candidates(searched.selection, drift))
    if drift is None:
        return study, assess_state_dependence(study, searched), ()
    if not rest.candidates:
        return study, searched, ()
    findings = (drift_finding(drift),)
    study.on_event(AuditFindings(findings=findings))
    folds = blocked_folds(drift, searched.selection, study.generator)
    searched = search_effects(rest, chosen, fits, law is None, impacts, folds)
    return rest, assess_state_dependence(rest, searched, drift.found.block), findings


# --- The result --------------------------------------------------------------------------------


def _assembled(
    study: Study,
    searched: SearchResult,
    explained: EffectComparison,
    rest: ErrorDecomposition,
    laws: Sequence[LawFit],
    findings: tuple[Finding, ...],
) -> Diagnosis:
    """The complete diagnosis: what was found, and what is drawn of it."""
    selection, model = searched.selection, searched.selection.present.fit.model
    chosen, missing = _choices(study, selection, explained)
    missing = tuple(replace(one, confidence=_confidence(one, rest)) for one in missing)
    outliers = outliers_of(
        selection.impacts, lambda impacts: model.predict(impacts).v_post, study.thresholds.audit.outliers
    )
    findings = (*findings, *([outliers] if outliers is not None else []))
    if searched.notes:  # the impacts have changed since
        laws = [LawFit.of(study.alone(study.laws[fit.name], selection.impacts), fit.error) for fit in laws]
    if missing:
        laws = [replace(fit, error_with_effects=selection.error_around(study.laws[fit.name])) for fit in laws]
    physics = _physics(missing, rest, laws, selection.complete, study.thresholds)
    return Diagnosis(
        verdict=Verdict.BAD_DATA if any(finding.mistake for finding in findings) else physics,
        physics=physics,
        law=selection.law.name,
        variant=selection.law.variant,
        given=tuple(EffectId(name, effect.form) for name, effect in study.given.items()),
        findings=findings,
        laws=tuple(laws),
        missing=missing,
        ladder=(
            *explained.ladder.rungs,
            Rung(kind=RungKind.PROCESSES, error=rest.budget.flexible),
            Rung(kind=RungKind.NOISE, error=rest.budget.noise),
        ),
        budget=rest.budget,
        regions=searched.regions,
        equation=str(model),
        experiment=explained.experiment,
        remainder=rest.learned.remainder,
        formulas=rest.formulas,
        choices=chosen.choices,
        models=_plausible(selection),
        unwanted=_unwanted(selection, missing),
        frontier=_frontier(study, selection),
        complete=selection.complete,
        thresholds=study.thresholds,
        record=Record(
            impacts=selection.impacts,
            base=selection.base.fit.model,
            model=model,
            outcomes=chosen.outcomes,
            residuals=tuple(partial_residuals(model, selection.impacts, one.effect.name) for one in missing),
        ),
    )


def _choices(
    study: Study, selection: Selection, explained: EffectComparison
) -> tuple[FittedChoices, tuple[MissingEffect, ...]]:
    """Every subset of the missing effects, and these with their rivals and reductions on all trials."""
    impacts, generator = selection.impacts, torch.Generator().manual_seed(0)
    missing = explained.ladder.missing
    chosen = fit_choices(
        impacts,
        selection.present.fit.model,
        [one.effect for one in missing],
        generator=generator,
        options=study.options,
        progress=study.progress("choices of effects"),
    )
    complete = tuple(
        replace(
            one,
            rivals=tuple(rival.rival for rival in explained.rivals[one.effect]),
            reduction_on_all_trials=chosen.reduction(impacts, one.effect, generator),
        )
        for one in missing
    )
    return chosen, complete


def _confidence(one: MissingEffect, rest: ErrorDecomposition) -> float:
    """The probability that a name is right."""
    gain = one.error_reduction / (rest.budget.named.mean + max(one.error_reduction, 0.0) or 1.0)
    return calibrated(one.share, gain, rest.learned.remainder.share.mean)


def _plausible(selection: Selection) -> tuple[PlausibleModel, ...]:
    """The models that the data cannot tell from the chosen one."""
    return tuple(
        PlausibleModel(law=one.model.spec.law, effects=tuple(sorted(one.model.spec.effects)), share=one.share)
        for one in selection.plausible
    )


def _unwanted(selection: Selection, missing: Sequence[MissingEffect]) -> tuple[EffectId, ...]:
    """The user's own candidates that the data do not ask for: in no plausible model, and no rival of an effect."""
    wanted = {effect for one in selection.plausible for effect in one.model.spec.effects} | selection.spec.effects
    wanted |= {rival.effect for one in missing for rival in one.rivals}
    return tuple(key for key in of_ones_own(selection.pool.candidates) if key not in wanted)


def _frontier(study: Study, selection: Selection) -> tuple[FrontierModel, ...]:
    """The best model of each number of effects up to that of the best score, and to one more than were chosen."""
    pool, found = selection.pool, []
    for size in range(max(len(selection.spec.effects) + 1, len(pool.best().spec.effects)) + 1):
        models = [model for model in pool.models.values() if len(model.spec.effects) == size]
        if models:
            best = pool.best(models)
            error = held_out_interval(validated(pool, selection.folds, best).error, study.generator)
            found.append(FrontierModel(law=best.spec.law, effects=tuple(sorted(best.spec.effects)), error=error))
    return tuple(found)


def _physics(
    missing: Sequence[MissingEffect],
    rest: ErrorDecomposition,
    laws: Sequence[LawFit],
    complete: bool,
    thresholds: Thresholds,
) -> Verdict:
    """The verdict about the corrected data: unknown where much is predictable, or a better law is known.

    What is predictable is unknown to a complete search alone.
    """
    if clearly_better(laws, rest.budget.named.mean, thresholds) is not None:
        return Verdict.UNKNOWN
    if rest.learned.remainder.unknown:
        return Verdict.UNKNOWN if complete else Verdict.UNFINISHED
    return Verdict.EFFECTS if missing else Verdict.NONE
