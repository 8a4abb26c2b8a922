"""Diagnose a contact model: each stage as it comes, diagnosis.json and its record, figures, page."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from matplotlib.figure import Figure
from omegaconf import DictConfig

from contactlearn.cli.commands import fitting, loading, record, results, settings
from contactlearn.cli.commands.laws import chosen_law, named_laws
from contactlearn.cli.commands.parts import forget, parts_folder
from contactlearn.cli.sweeps.resources import available_memory
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis import pipeline
from contactlearn.diagnosis.events import OnEvent, track
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS, all_candidates
from contactlearn.effects import Effect, EffectId, catalogue
from contactlearn.inference.evaluation.metrics import HEADLINE
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report import terminal
from contactlearn.report.events import progress, show_verdict
from contactlearn.report.figures.diagnosis import drawn
from contactlearn.report.page.diagnosis import write_page
from contactlearn.report.tensorboard import Tracker
from contactlearn.report.text import base_label, headline, rung_label
from contactlearn.results.diagnosis import DiagnosisRun
from contactlearn.results.folder import write_result


def diagnose(cfg: DictConfig) -> None:
    """Find the missing effects; each stage is printed as soon as it is known, the conclusion once it is on disk."""
    settings.check(cfg)
    folder = results.run_folder()
    impacts = loading.load_data(cfg.data, validate=False, folder=folder)
    terminal.say(f"{impacts.source}: {len(impacts)} impacts")
    parts = parts_folder(cfg)
    with progress(folder) as on_event:
        found = _found(cfg, impacts, on_event, parts)
    command = _command(cfg, found)
    result = DiagnosisRun(provenance=results.provenance(impacts, cfg), use=command, diagnosis=found)
    if found.record is not None:
        found.record.save(folder, asdict(result.provenance))
    write_result(folder, result)
    show_verdict(found, command)
    shown = (
        lambda: _record(cfg, folder, result, drawn(found, impacts)),
        lambda: write_page(folder, found, result.provenance, use=command if found.missing else ""),
    )
    with progress(folder) as on_event:
        for show in track(shown, "figures and page", on_event):
            show()
    forget(parts)
    terminal.show_folder(folder)


def _found(cfg: DictConfig, impacts: Impacts, on_event: OnEvent, parts: Path) -> Diagnosis:
    effects = settings.effects(cfg)
    return pipeline.diagnose(
        impacts,
        chosen_law(cfg),
        effects,
        candidates=_candidates(cfg, effects),
        laws=list(named_laws(cfg, SEARCHED_LAWS).values()),
        noise=settings.stated_noise(cfg),
        limits={name: tuple(ends) for name, ends in cfg.limits.items()},
        seed=cfg.seed,
        seconds=cfg.seconds,
        memory=available_memory(),
        resume_folder=parts,
        on_event=on_event,
    )


def _record(cfg: DictConfig, folder: Path, result: DiagnosisRun, figures: Mapping[str, Figure]) -> None:
    """Log the ladder as a chart, its law and its model as runs of the other commands log theirs, and the figures."""
    found, data, tag = result.diagnosis, result.provenance.data, f"ladder/{HEADLINE}"
    with Tracker(folder, data.trials) as tracker:
        if found.budget is not None and found.law is not None:
            tracker.series(tag, [rung.error for rung in found.ladder])
            base = f"{HEADLINE}/{fitting.augmented_name(found.law, cfg.effect)}"
            model = {base: found.budget.base, record.MODEL: found.budget.named}
            tracker.scalars(model | {record.BOUND: found.budget.bound})
        ladder = {"Mass error by rung; the run card names the rungs": tag}
        tracker.charts(record.charts() | {"Ladder of a diagnosis": ladder})
        law, effects = found.law if found.ladder else None, dict.fromkeys((*cfg.effect, *found.effects))
        record.log_hyperparameters(tracker, cfg, data.source, data.trials, law, effects)
        verdict = {"Verdict": headline(found), "To use it": result.use}
        errors = {rung_label(rung, base_label(found)): rung.error for rung in found.ladder}
        equations = [found.equation] if found.equation else []
        record.log_card(tracker, result.provenance, equations, errors, verdict)
        record.save_figures(figures, folder, tracker)


def _candidates(cfg: DictConfig, effects: Mapping[str, Effect]) -> dict[EffectId, Effect]:
    """The catalogue and the configuration's own, under names that nothing else has."""
    known, own = all_candidates(), settings.effects(cfg, "candidate")
    for name, effect in own.items():  # a class that was imported is in the catalogue under its own name
        if name in effects or (name in catalogue() and type(effect) not in catalogue()[name]):
            raise ContactLearnError(f"candidate.{name} has the name of another effect; give it one of its own")
    return known | {EffectId(name, effect.form): effect for name, effect in own.items()}


def _command(cfg: DictConfig, found: Diagnosis) -> str:
    """The command that evaluates what was found on these data."""
    task = HydraConfig.get().overrides.task
    words = [*results.called("evaluate"), *(word for word in task if word.lstrip("+~").startswith("data"))]
    repairs = found.corrections
    if repairs:
        words = [word for word in words if not word.lstrip("+").startswith("data.correct")]
        words.append(f"data.correct=[{','.join([*cfg.data.correct, *repairs])}]")
    given = [word for word in task if word.startswith("law=") or word.lstrip("+").startswith("law.")]
    words += given if chosen_law(cfg) else [f"law={found.law}"] if found.law else []
    names = [name for name in dict.fromkeys((*cfg.effect, *found.effects)) if _named(name)]
    words.append(f"effect=[{','.join(names)}]")
    words += [word for word in task if word.lstrip("+").startswith(("effect.", "variant=", "fit."))]
    fitted = {} if found.record is None else found.record.model.effects
    for missing in found.missing:
        name, form = missing.effect.name, missing.effect.form
        if name in cfg.candidate:
            own = [word.lstrip("+") for word in task if word.lstrip("+").startswith(f"candidate.{name}.")]
            words += [f"+effect.{word.removeprefix('candidate.')}" for word in own]
        elif not _named(name):
            kind = type(fitted[name])
            words.append(f"+effect.{name}._target_={kind.__module__}.{kind.__name__}")
        elif form:
            words.append(f"effect.{name}.form={form}")
    return shlex.join([*words, "model=[]"])


def _named(name: str) -> bool:
    """Whether `effect=[name]` is all that it takes: it comes with this package, not with another one."""
    return name in catalogue() and catalogue()[name][0].__module__.startswith("contactlearn.effects.")
