"""Diagnose a contact model: findings as they come, the verdict, diagnosis.json, the ladder."""

import shlex

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from contactlearn import settings
from contactlearn.app import run
from contactlearn.diagnosis.diagnosis import Diagnosis, all_candidates
from contactlearn.diagnosis.diagnosis import diagnose as find_out
from contactlearn.report import diagnosis as report
from contactlearn.report import terminal
from contactlearn.tracking import Tracker


def diagnose(cfg: DictConfig) -> None:
    """Audit, law, regions, effects, ladder; each is printed as soon as it is known."""
    settings.check(cfg)
    effects = settings.effects(cfg)
    folder = run.run_folder()
    impacts = run.load_data(cfg.data, suspect=True)
    report.show_start(impacts)
    with terminal.progress() as bar:
        found = find_out(
            impacts,
            cfg.law,
            effects,
            candidates=all_candidates(),
            variant=cfg.variant,
            noise=None if cfg.fit.noise is None else tuple(cfg.fit.noise),
            seed=cfg.seed,
            say=report.show_stage,
            progress=lambda items, what: bar.track(items, description=what),
        )
    command = _command(cfg, found)
    report.show_verdict(found, command)
    content = found.to_dict() | {"command": command} | run.provenance(impacts, cfg)
    run.write_json(folder / "diagnosis.json", content)
    with Tracker(folder, len(impacts)) as tracker:
        if found.ladder:
            tracker.scalars({f"ladder/{k}": interval.mean for k, (_, interval) in enumerate(found.ladder)})
            run.save_figures({"ladder": report.ladder(found)}, folder, tracker)
        chosen = {f"effect_{name}": name in (*found.effects, *effects) for name in all_candidates() if ":" not in name}
        tracker.hyperparameters(
            {"law": found.law, "verdict": found.verdict, "seed": cfg.seed} | chosen,
            {"mass_error/model": found.ladder[-1][1].mean} if found.ladder else {},
        )
    terminal.show_folder(folder)


def _command(cfg: DictConfig, found: Diagnosis) -> str:
    """The command that evaluates what was found on these data."""
    task = HydraConfig.get().overrides.task
    words = ["python", "evaluate.py", *(word for word in task if word.startswith("data"))]
    repairs = [finding.correction for finding in found.findings if finding.correction]
    if repairs:
        words = [word for word in words if not word.startswith("data.correct")]
        words.append(f"data.correct=[{','.join([*cfg.data.correct, *repairs])}]")
    words.append(f"law={found.law}")
    given = [word for word in task if word.lstrip("+").startswith("effect.")]
    names = list(dict.fromkeys((*(name for name in cfg.effect if _in_catalogue(name)), *found.effects)))
    words += [f"effect=[{','.join(names)}]", *given]
    forms = (missing.name.partition(":") for missing in found.missing)
    return shlex.join([*words, *(f"effect.{name}.form={form}" for name, _, form in forms if form), "model=[]"])


def _in_catalogue(name: str) -> bool:
    return name in {candidate.partition(":")[0] for candidate in all_candidates()}
