"""The diagnosis: from measurements and a law to what is missing, or to what can honestly be said instead.

    audit        what is wrong with the measurements; what can be mended is mended and said first
    law          the one that was named, or the one that is best on trials held out, alone and then with the effects
    budget       error of the law, of processes that learn all they can, of the best rigid contact, of the noise
    selection    effects of the catalogue that earn their place, by held-out error
    regions      where the law alone fails, and where the effects help
    equivalents  what could stand in an effect's place on these data, and the drops that would tell
    remainder    what a flexible model still finds, and formulas for it
    ladder       law, each effect, flexible model, noise: held-out errors

All errors are the held-out mass error.  `Diagnosis.to_dict` is diagnosis.json; docs/diagnosis.md is its schema.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from contactlearn.audit.averaging import averaged
from contactlearn.audit.corrections import correct
from contactlearn.audit.findings import audit
from contactlearn.audit.result import Finding
from contactlearn.diagnosis.budget import first_budget, full_budget
from contactlearn.diagnosis.discrimination.equivalents import Equivalent, equivalents
from contactlearn.diagnosis.discrimination.experiment import Experiment, next_experiment, reachable
from contactlearn.diagnosis.failure.regions import Region, find_regions
from contactlearn.diagnosis.noise import noise_floor
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.diagnosis.search.ladder import Missing, interval, ladder
from contactlearn.diagnosis.search.selection import Fitted, Folds, Selection, identities
from contactlearn.diagnosis.unexplained.formulas import Formula, formulas
from contactlearn.diagnosis.unexplained.remainder import CLEARLY, Remainder, remainder
from contactlearn.effects import Effect, EffectId
from contactlearn.errors import ContactLearnError, DataError
from contactlearn.evaluation.metrics import Interval, mass_error
from contactlearn.identification.joint import FitOptions, identify_jointly
from contactlearn.impacts import Impacts
from contactlearn.laws import PAPER_LAWS, Law, find
from contactlearn.model import ContactModel

FEWEST = 20
"""Trials of a diagnosis."""
VERDICTS = ("effects", "none", "unknown", "bad_data")
REPEATS = {True: 2, False: 1}  # of the cross-validation, by whether there are few trials
_FEW = 600
_NEAR = 2.0  # times the error of the chosen law: laws that are tried again with the effects
_BETTER = 0.97  # times the error with the effects, from which on a law replaces the chosen one


@dataclass(frozen=True)
class Diagnosis:
    """What was found; see `to_dict` for the parts.

    `impacts` are those of the models, corrected where they had to be; `base` the law with the effects that were given,
    `model` with those that are missing, both fitted to all of them.
    """

    verdict: str
    law: str
    laws: dict[str, float]  # held-out error of each law, where the law was chosen
    findings: tuple[Finding, ...]
    missing: tuple[Missing, ...] = ()
    ladder: tuple[tuple[str, Interval], ...] = ()
    budget: dict[str, Any] = field(default_factory=dict)
    regions: tuple[Region, ...] = ()
    equation: str = ""
    equivalents: Mapping[str, list[Equivalent]] = field(default_factory=dict)
    experiment: Experiment | None = None  # that would tell the effects from their equivalents
    remainder: Remainder | None = None
    formulas: tuple[Formula, ...] = ()
    impacts: Impacts | None = None
    base: ContactModel | None = None
    model: ContactModel | None = None
    physics: str | None = None  # the verdict but for what had to be corrected; None where the data are refused

    def to_dict(self) -> dict[str, Any]:
        """As diagnosis.json."""
        return {
            "verdict": self.verdict,
            "physics": self.physics,
            "law": self.law,
            "laws": self.laws,
            "missing_effects": [missing.to_dict() for missing in self.missing],
            "data_problems": [asdict(finding) for finding in self.findings],
            "budget": self.budget,
            "equivalents": {
                name: [one.to_dict() for one in others] for name, others in self.equivalents.items() if others
            },
            "unexplained": None
            if self.remainder is None
            else self.remainder.to_dict() | {"formulas": [str(formula) for formula in self.formulas]},
            "next_experiment": None if self.experiment is None else self.experiment.to_dict(),
            "regions": [region.to_dict() for region in self.regions],
            "ladder": [{"step": step, **asdict(interval)} for step, interval in self.ladder],
            "equation": self.equation,
        }

    @property
    def effects(self) -> list[str]:
        """Names of the missing effects, in the order of what they take off."""
        return [missing.id.name for missing in self.missing]


def diagnose(
    impacts: Impacts,
    law: Law | None = None,
    effects: Mapping[str, Effect] | None = None,
    *,
    candidates: Mapping[EffectId, Effect] | None = None,
    laws: Sequence[Law] | None = None,
    noise: tuple[float, float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    say: Callable[[str, Any], None] = lambda stage, result: None,
    progress: Callable[[Iterable, str], Iterable] = lambda items, what: items,
) -> Diagnosis:
    """Find out which physical effects a contact model is missing.

    Args:
        impacts: measurements; `suspect` ones are audited and corrected, or refused.
        law: an analytical law; if None, that of `laws` with the least held-out error.
        effects: that are in the model already.
        candidates: what may be missing, by identity; the whole catalogue if left out.  See `candidates.usable` for
            those that are refused.
        laws: to compare; if None, the textbook laws of the paper.
        noise: standard deviations of the measured v_x, v_y and ω where they are known.
        limits: of the set-up for the next experiment, see `next_experiment`.
        seed: of the folds and resamples.
        say: is told each stage's result as soon as it is known.
        progress: wraps what takes long, with a description.

    Raises:
        ContactLearnError: no candidates, too few trials, or limits of something that a drop does not set.
    """
    effects, generator = dict(effects or {}), torch.Generator().manual_seed(seed)
    if len(impacts) < FEWEST:
        raise DataError(f"{impacts.source}: a diagnosis needs at least {FEWEST} trials, got {len(impacts)}")
    reachable(impacts, limits or {})  # refuses limits that make no sense before anything else is done
    findings = audit(impacts)
    say("audit", findings)
    if any(finding.fatal for finding in findings):
        return Diagnosis("bad_data", law.name if law else "best", {}, findings)
    repairs = [finding.correction for finding in findings if finding.correction]
    impacts = correct(impacts, repairs) if repairs else impacts
    options = FitOptions(noise=noise)
    folds = Folds.draw(len(impacts), generator, repeats=REPEATS[len(impacts) <= _FEW])
    known = {one.name: one for one in (laws or map(find, PAPER_LAWS))} | ({law.name: law} if law else {})
    laws = {name: _held_out(one, effects, impacts, folds, options) for name, one in progress(known.items(), "laws")}
    chosen, law = law is None, known[min(laws, key=laws.get)] if law is None else law
    say("laws", (law.name, laws))
    given = candidates or all_candidates()
    among = usable(given, impacts)
    if left_out := [str(key) for key in given if key not in among]:
        say("left out", left_out)
    selection = Selection(law, impacts, among, folds, effects, options)
    ceiling = _remainder(selection.base, impacts, folds, generator)
    notes = averaged(impacts, ceiling.v_post, lambda drops: _held_out(law, effects, drops, folds, options))
    if notes:
        say("notes", notes)
        findings += notes
        impacts = correct(impacts, [note.correction for note in notes])
        selection = Selection(law, impacts, among, folds, effects, options)
        ceiling = _remainder(selection.base, impacts, folds, generator)
    budget, regions = _failures(selection, ceiling, generator, say)
    selection.run(lambda items: progress(items, f"effects around {law.name}"))
    if chosen:
        selection = _with_better_law(selection, known, laws, among, options, progress)
        if selection.law != law:
            law = selection.law
            say("law", law.name)
            ceiling = _remainder(selection.base, impacts, folds, generator)
            budget, regions = _failures(selection, ceiling, generator, say)
    steps, missing = ladder(selection, regions, generator)
    say("missing", missing)
    alike = equivalents(selection, lambda items: progress(items, "what could stand in its place"))
    experiment = _experiment(selection, alike, limits, generator)
    fit = selection.present.fit
    left = _remainder(selection.present, impacts, folds, generator)
    written = _formulas(impacts, fit.model, left, folds, say) if left.large else []
    better = left.v_post if left.large else None
    floor = noise_floor(impacts, fit.model, generator=generator, noise=noise, usual=fit.inliers, predicted=better)
    steps = (*steps, ("+ processes on what remains", interval(left.error, generator)), ("noise floor", floor.error))
    budget = full_budget(budget, steps, floor)
    unknown = left.large or min(laws.values()) < (1 - CLEARLY) * budget["named"]["mean"]
    physics = "unknown" if unknown else "effects" if missing else "none"
    verdict = "bad_data" if any(finding.mistake for finding in findings) else physics
    return Diagnosis(
        verdict,
        law.name,
        laws,
        findings,
        missing,
        steps,
        budget,
        regions,
        str(fit.model),
        alike,
        experiment,
        left,
        tuple(written),
        impacts,
        selection.base.fit.model,
        fit.model,
        physics,
    )


def _failures(
    selection: Selection, ceiling: Remainder, generator: torch.Generator, say: Callable[[str, Any], None]
) -> tuple[dict[str, Any], tuple[Region, ...]]:
    """What the law leaves, and where."""
    budget = first_budget(selection, ceiling, generator)
    say("budget", budget)
    prediction = selection.base.fit.model.predict(selection.impacts)
    regions = tuple(find_regions(selection.impacts, prediction, generator=generator))
    say("regions", regions)
    return budget, regions


def _remainder(fitted: Fitted, impacts: Impacts, folds: Folds, generator: torch.Generator) -> Remainder:
    return remainder(impacts, fitted.fit.model, folds, generator=generator, usual=fitted.fit.inliers)


def _experiment(
    selection: Selection,
    alike: Mapping[str, list[Equivalent]],
    limits: Mapping[str, tuple[float, float]] | None,
    generator: torch.Generator,
) -> Experiment | None:
    """Drops that would tell the chosen effects from their equivalents."""
    chosen = selection.present.fit.model
    ids = {one.name: one for one in identities(chosen.effects)}
    rivals = {f"{one.id} for {ids[name]}": one.fitted.fit.model for name, others in alike.items() for one in others}
    if not rivals:
        return None
    return next_experiment(selection.impacts, chosen, rivals, generator=generator, limits=limits)


def _formulas(
    impacts: Impacts, model: ContactModel, left: Remainder, folds: Folds, say: Callable[[str, Any], None]
) -> list[Formula]:
    """For the component that takes most off the error; without the library that finds them, word of that."""
    try:
        return formulas(impacts, model, left.components[0], folds)
    except ContactLearnError as error:
        say("no formulas", str(error))
        return []


def _held_out(
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    folds: Folds,
    options: FitOptions,
    start: Tensor | None = None,
) -> float:
    """Mean held-out mass error of a law with effects, fitted from a start if one is given."""
    model = identify_jointly(law, effects, impacts, folds.fitted, options=replace(options, starts=2), start=start).model
    return folds.scores(mass_error(impacts, model.predict(impacts))).nanmean().item()


def _with_better_law(
    selection: Selection,
    known: Mapping[str, Law],
    laws: Mapping[str, float],
    candidates: Mapping[EffectId, Effect],
    options: FitOptions,
    progress: Callable[[Iterable, str], Iterable],
) -> Selection:
    """The selection around another law, if with these effects that law does clearly better after all."""
    present, errors = selection.present, {}
    own = selection.law.name
    near = [name for name, error in laws.items() if name != own and error < _NEAR * laws[own]]
    for name in near:
        fit = identify_jointly(
            known[name], present.effects, selection.impacts, options=options, start=present.fit.values
        )
        errors[name] = _held_out(
            known[name], present.effects, selection.impacts, selection.folds, options, start=fit.values
        )
    other = min(errors, key=errors.get, default=None)
    if other is None or errors[other] > _BETTER * present.error.nanmean().item():
        return selection
    again = Selection(known[other], selection.impacts, candidates, selection.folds, selection.given, options)
    again.run(lambda items: progress(items, f"effects around {other}"))
    return again if again.present.error.nanmean() < present.error.nanmean() else selection
