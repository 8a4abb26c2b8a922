"""Diagnosis: from measurements and a law to the effects that are missing, or to the honest alternative.

`diagnose` audits the measurements and applies the corrections that the audit recommends.  A table of up to a few
thousand trials then passes through all `stages` at once.  A larger one is diagnosed on subsamples, and the result is
tested on all trials (`sampling`).
"""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import DataError
from contactlearn.core.workers import second_core
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.diagnosis.discrimination.experiment import state_limits
from contactlearn.diagnosis.events import AuditFindings, OnEvent, ignore
from contactlearn.diagnosis.question import Question
from contactlearn.diagnosis.result import Diagnosis, Finding, Verdict
from contactlearn.diagnosis.sampling import affordable, diagnose_subsamples
from contactlearn.diagnosis.search.candidates import all_candidates, all_laws
from contactlearn.diagnosis.stages import diagnose_audited
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId, named_effects
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import Law, named
from contactlearn.mechanics.impacts import Impacts, require_impacts


def diagnose(
    impacts: Impacts,
    law: Law | str | None = None,
    effects: Mapping[str, Effect] | Iterable[str] = (),
    *,
    candidates: Mapping[EffectId, Effect] | None = None,
    laws: Sequence[Law] | None = None,
    noise: tuple[float, ...] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    seconds: float = 60.0,
    memory: float | None = None,
    resume_folder: Path | None = None,
    thresholds: Thresholds | None = None,
    on_event: OnEvent | None = None,
) -> Diagnosis:
    """Find out which physical effects a contact model is missing; on one thread, with a second core's help.

    Args:
        impacts: measurements; those with `validate=False` are audited and corrected, or refused.
        law: an analytical law or its name; if None, that of `laws` with the least held-out error.
        effects: effects that the model has already, by name, or names alone.
        candidates: effects that may be missing; the whole catalogue if None.  `candidates.usable` refuses some.
        laws: laws to compare; `all_laws(impacts.space)` if None.
        noise: standard deviations of the measured velocities in m/s and rad/s, three or in space six, where known.
        limits: limits of the set-up for the next experiment, see `next_experiment`.
        seed: seed of folds, subsamples and resamples.
        seconds: processor time of the search, s; after it, the fitted models decide, and the result is incomplete.
        memory: bytes that the diagnosis may take; a large table is diagnosed on subsamples that need no more.
        resume_folder: folder for the results of finished subsamples, which a later run of the same question reuses.
        thresholds: limits of every decision; `Thresholds()` if None.
        on_event: receives each result as soon as it is known, and the progress of long tasks; see `events`.

    Raises:
        ContactLearnError: no candidates, too few trials, or limits of something that a drop does not set.
    """
    thresholds, on_event = thresholds or Thresholds(), ignore if on_event is None else on_event
    law, given = None if law is None else named(law), named_effects(effects)
    _check(impacts, limits or {}, thresholds)
    findings = audit(impacts, thresholds.audit)
    on_event(AuditFindings(findings=findings))
    if any(finding.fatal for finding in findings):
        return _refused(law, findings, thresholds)
    impacts = correct(impacts, [one.correction for one in findings if one.correction], thresholds.audit)
    question = Question(
        law=law,
        given={name: effect.prepare(impacts) for name, effect in given.items()},
        candidates=candidates or all_candidates(impacts.space),
        laws={one.name: one for one in (laws or all_laws(impacts.space))} | ({law.name: law} if law else {}),
        options=FitOptions(noise=noise, thresholds=thresholds.fit),
        limits=limits or {},
        thresholds=thresholds,
        seconds=seconds,
        on_event=on_event,
    )
    import_module("contactlearn.models.gp.exact")  # before there is a copy, which would take as long again
    with threadpool_limits(1), second_core():  # tensors here are small: two threads take longer, up to seven times
        if len(impacts) <= thresholds.whole and affordable(len(impacts), memory):
            return diagnose_audited(question, impacts, findings, torch.Generator().manual_seed(seed))
        return diagnose_subsamples(question, impacts, findings, seed=seed, memory=memory, resume_folder=resume_folder)


def _check(impacts: Impacts, limits: Mapping[str, tuple[float, float]], thresholds: Thresholds) -> None:
    """Refuse anything but impacts, too few trials, and limits that make no sense, before any work is done."""
    require_impacts(impacts)
    fewest = thresholds.fewest_trials
    if len(impacts) < fewest:
        raise DataError(f"{impacts.source}: a diagnosis needs at least {fewest} trials, got {len(impacts)}")
    if limits:
        state_limits(impacts, limits)  # raises for wrong limits


def _refused(law: Law | None, findings: tuple[Finding, ...], thresholds: Thresholds) -> Diagnosis:
    """Return the diagnosis of measurements that no correction can repair."""
    name, variant = (law.name, law.variant) if law else (None, None)
    return Diagnosis(verdict=Verdict.BAD_DATA, law=name, variant=variant, findings=findings, thresholds=thresholds)
