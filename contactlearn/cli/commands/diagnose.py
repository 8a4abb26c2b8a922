"""The command diagnose: prints each stage, writes diagnosis.json and its record, and draws figures and page."""

import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from matplotlib.figure import Figure

from contactlearn.cli.commands import fitting, loading, record
from contactlearn.cli.commands.record import RunRecord
from contactlearn.cli.job import Run
from contactlearn.cli.resource_limits import available_memory
from contactlearn.cli.settings import DiagnoseSettings
from contactlearn.core import devices
from contactlearn.core.events import track
from contactlearn.data.blocks import Blocks
from contactlearn.diagnosis import pipeline
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.result import FLOORS, Diagnosis
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.effects import EffectId, catalogue
from contactlearn.effects.functions import OfCovariate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report import terminal
from contactlearn.report.events import progress, show_verdict
from contactlearn.report.figures.diagnosis import drawn
from contactlearn.report.page.diagnosis import write_page
from contactlearn.report.tensorboard import Tracker
from contactlearn.report.text.names import base_label, rung_label
from contactlearn.report.text.sentences import headline, names_by_level
from contactlearn.results.folder import write_result
from contactlearn.results.types import DiagnosisRun

_METRIC = "mass_error"  # of every diagnosis
_LADDER, _FLOOR = f"ladder/{_METRIC}", f"floor/{_METRIC}"


def diagnose(settings: DiagnoseSettings, run: Run) -> None:
    """Find the missing effects; print each stage when it is known, and the verdict when it is on disk."""
    loaded = loading.load_data(settings.data, validate=False)
    record.save_recordings_page(run.folder, loaded.tracked)
    impacts = loaded.impacts
    terminal.print_line(f"{impacts.source}: {len(impacts)} impacts")
    charts = {"Ladder of a diagnosis": {"Ladder: error after each effect": [_LADDER, _FLOOR]}}
    with record.tracker_of(run, len(impacts), _METRIC, charts=charts) as tracker:
        coming = _diagnose(settings, run, impacts, tracker)
    run.remove_partial_results()
    terminal.show_report(run.folder)
    terminal.show_next(*coming)


def _diagnose(settings: DiagnoseSettings, run: Run, impacts: Impacts, tracker: Tracker) -> tuple[str, ...]:
    """Diagnose, write everything, and return the commands that go on from there."""
    with progress(run.folder, tracker, verbose=settings.verbose) as on_event:
        own = {EffectId(name, effect.form): effect for name, effect in settings.candidates.items()}
        kinds = {type(effect) for effect in own.values()}  # a class that is imported is also in the catalogue
        every = all_candidates(impacts.space, impacts.covariates).items()
        others = {key: effect for key, effect in every if type(effect) not in kinds}
        laws = tuple(law for law in settings.laws if impacts.space in law.spaces)
        diagnosis = pipeline.diagnose(
            impacts,
            settings.law,
            settings.effects,
            options=DiagnoseOptions(
                candidates=others | own,
                laws=laws or settings.laws,  # where none exists in this space, the first is refused by name
                noise=settings.fit.noise,
                limits=settings.limits,
                seed=settings.seed,
                seconds=settings.seconds,
                memory=available_memory(),
                resume_folder=run.partial,
            ),
            on_event=on_event,
        )
    command = _evaluation_command(settings, run, diagnosis)
    provenance = run.provenance(Blocks.of(impacts), devices.find("cpu"))
    result = DiagnosisRun(provenance=provenance, use=command, headline=headline(diagnosis), diagnosis=diagnosis)
    if diagnosis.record is not None:
        diagnosis.record.save(run.folder, asdict(provenance))
    write_result(run.folder, result)
    coming = terminal.next_commands(result, run.folder)
    show_verdict(diagnosis, verbose=settings.verbose)
    shown = (
        lambda: record.write_record(tracker, run, provenance, _record(settings, result, drawn(diagnosis), coming)),
        lambda: write_page(
            run.folder, diagnosis, provenance, use=command if diagnosis.missing else "", next_commands=coming
        ),
    )
    with progress(run.folder) as on_event:
        for show in track(shown, "figures and page", on_event):
            show()
    return coming


def _record(
    settings: DiagnoseSettings, result: DiagnosisRun, figures: Mapping[str, Figure], coming: Sequence[str]
) -> RunRecord:
    """The ladder as a chart, its law and its model as runs of the other commands log theirs, and the figures."""
    diagnosis, data = result.diagnosis, result.provenance.data
    scalars, series = {}, {}
    if diagnosis.budget is not None and diagnosis.law is not None:
        base = f"{_METRIC}/{fitting.augmented_name(diagnosis.law, settings.effects)}"
        errors = diagnosis.budget.base, diagnosis.budget.named, diagnosis.budget.bound
        scalars = dict(zip((base, *record.own_tags(_METRIC)), errors, strict=True))
        steps = [rung.error for rung in diagnosis.ladder if rung.kind not in FLOORS]
        floors = {f"floor/{_METRIC}/{rung.kind}": rung.error for rung in diagnosis.ladder if rung.kind in FLOORS}
        series = {_LADDER: steps, _FLOOR: [next(iter(floors.values()))] * len(steps)} if floors else {_LADDER: steps}
        scalars |= floors
        named = [("effect", one) for one in diagnosis.missing] + [("candidate", one) for one in diagnosis.candidates]
        scalars |= {
            f"{kind}/{one.effect.name}/confidence": one.confidence for kind, one in named if one.confidence is not None
        }
    card = defaultdict[str, list[str]](list, {"Verdict": [headline(diagnosis)]})
    for level, named in names_by_level(diagnosis):
        card[level.capitalize()].append(named)
    return RunRecord(
        trained_on=data.trials,
        metric=_METRIC,
        scalars=[(data.trials, scalars)] if scalars else [],
        series=series,
        figures=figures,
        law=diagnosis.law if diagnosis.ladder else None,
        effects=list(dict.fromkeys((*settings.effects, *diagnosis.effects))),
        equations=[diagnosis.equation] if diagnosis.equation else [],
        errors={rung_label(rung, base_label(diagnosis)): rung.error for rung in diagnosis.ladder},
        verdict={name: "; ".join(texts) for name, texts in card.items()} | ({"Next": coming[0]} if coming else {}),
    )


def _evaluation_command(settings: DiagnoseSettings, run: Run, diagnosis: Diagnosis) -> str:
    """The command that evaluates the found model on these data."""
    task = run.overrides
    words = ["contactlearn", "evaluate"]
    words += [word for word in task if word.lstrip("+~").startswith(("data", "experiment="))]
    repairs = diagnosis.corrections
    if repairs:
        words = [word for word in words if not word.lstrip("+").startswith("data.correct")]
        words.append(f"data.correct=[{','.join([*settings.data.corrections, *repairs])}]")
    given = [word for word in task if word.startswith("law=") or word.lstrip("+").startswith("law.")]
    words += given if settings.law else [f"law={diagnosis.law}"] if diagnosis.law else []
    names = [name for name in dict.fromkeys((*settings.effects, *diagnosis.effects)) if _named(name)]
    words.append(f"effect=[{','.join(names)}]")
    words += [word for word in task if word.lstrip("+").startswith(("effect.", "variant=", "fit."))]
    fitted = {} if diagnosis.record is None else diagnosis.record.model.effects
    for missing in diagnosis.missing:
        name, form = missing.effect.name, missing.effect.form
        if name in settings.candidates:
            own = [word.lstrip("+") for word in task if word.lstrip("+").startswith(f"candidate.{name}.")]
            words += [f"+effect.{word.removeprefix('candidate.')}" for word in own]
        elif not _named(name):
            kind = type(fitted[name])
            words.append(f"+effect.{name}._target_={kind.__module__}.{kind.__name__}")
            if isinstance(effect := fitted[name], OfCovariate):
                words.append(f"+effect.{name}.covariate={effect.covariate}")
        elif form:
            words.append(f"effect.{name}.form={form}")
    return shlex.join([*words, "model=[]"])


def _named(name: str) -> bool:
    """Whether `effect=[name]` suffices: the effect comes with this package, not with another one."""
    return name in catalogue() and catalogue()[name][0].__module__.startswith("contactlearn.effects.")
