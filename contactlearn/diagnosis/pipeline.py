"""Diagnosis: from measurements and a law to the effects that are missing, or to the honest alternative.

`diagnose` audits the measurements and applies the corrections that the audit recommends.  A table of up to a few
thousand trials then passes through all `stages` at once.  A larger one is diagnosed on subsamples, and the result is
tested on all trials (`sampling`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import torch
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import DataError
from contactlearn.core.events import ignore
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.evidence import balance_evidence
from contactlearn.data.audit.findings import audit
from contactlearn.diagnosis.discrimination.experiment import state_limits
from contactlearn.diagnosis.events import AuditFindings, OnEvent
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.question import Question
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.diagnosis.sampling import affordable, diagnose_subsamples
from contactlearn.diagnosis.search.candidates import all_candidates, all_laws, without_spin
from contactlearn.diagnosis.stages import diagnose_audited
from contactlearn.effects import Effect, named_effects
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import Law, named
from contactlearn.mechanics.impacts import Impacts, require_impacts


def diagnose(
    impacts: Impacts,
    law: Law | str | None = None,
    effects: Mapping[str, Effect] | Iterable[str | Effect] = (),
    *,
    options: DiagnoseOptions | None = None,
    on_event: OnEvent | None = None,
) -> Diagnosis:
    """Find out which physical effects a contact model is missing; on one thread, with a second core's help.

    Args:
        impacts: measurements; those with `validate=False` are audited and corrected, or refused.
        law: an analytical law or its name; if None, that of `options.laws` with the least held-out error.
        effects: effects that the model has already, by name, or a list of names and effects.
        options: candidates, laws, noise, time and limits; `DiagnoseOptions()` if None.
        on_event: receives each result as soon as it is known, and the progress of long tasks; see `events`.

    Raises:
        ContactLearnError: no candidates, too few trials, or limits of something that a drop does not set.
    """
    options, on_event = options or DiagnoseOptions(), ignore if on_event is None else on_event
    _check(impacts, options)
    law, given = None if law is None else named(law), named_effects(effects, impacts.space)
    thresholds = options.thresholds
    audited = audit(impacts, thresholds.audit)
    findings = tuple(audited)
    on_event(AuditFindings(findings=findings))
    evidence = balance_evidence(findings, impacts)
    if any(finding.fatal for finding in findings):
        name, variant = (law.name, law.variant) if law else (None, None)
        diagnosis = Diagnosis(verdict=Verdict.BAD_DATA, law=name, variant=variant, findings=findings)
        return replace(diagnosis, thresholds=thresholds, evidence=evidence)
    impacts = correct(impacts, audited.corrections, thresholds.audit)
    _refuse_few(impacts, thresholds.fewest_trials)
    laws = options.laws or all_laws(impacts.space)
    candidates = options.candidates or all_candidates(impacts.space, impacts.covariates)
    if any(finding.name == "spin_not_measured" for finding in findings):
        candidates = without_spin(candidates, impacts)
    question = Question(
        law=law,
        given={name: effect.prepare(impacts) for name, effect in given.items()},
        candidates=candidates,
        laws={each.name: each for each in laws} | ({law.name: law} if law else {}),
        options=FitOptions(noise=options.noise, thresholds=thresholds.fit),
        limits=options.limits,
        thresholds=thresholds,
        seconds=options.seconds,
        on_event=on_event,
    )
    with threadpool_limits(1):  # tensors here are small: two threads take longer, up to seven times
        if len(impacts) <= thresholds.whole and affordable(len(impacts), options.memory):
            diagnosis = diagnose_audited(question, impacts, findings, torch.Generator().manual_seed(options.seed))
        else:
            diagnosis = diagnose_subsamples(
                question,
                impacts,
                findings,
                seed=options.seed,
                memory=options.memory,
                resume_folder=options.resume_folder,
            )
    return replace(diagnosis, evidence=evidence)


def _check(impacts: Impacts, options: DiagnoseOptions) -> None:
    """Refuse anything but impacts, too few trials, and limits that make no sense, before any work is done."""
    require_impacts(impacts)
    _refuse_few(impacts, options.thresholds.fewest_trials)
    if options.limits:
        state_limits(impacts, options.limits)  # raises for wrong limits


def _refuse_few(impacts: Impacts, fewest: int) -> None:
    if len(impacts) < fewest:
        raise DataError(f"{impacts.source}: a diagnosis needs at least {fewest} trials, got {len(impacts)}")
