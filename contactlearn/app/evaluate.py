"""Compare laws and learned models with the bounds on held-out trials, and draw their learning curves."""

from collections.abc import Mapping

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf

from contactlearn.app import record as run
from contactlearn.app import settings
from contactlearn.app.curves import learning_study, log_curves
from contactlearn.app.transfer import transfer
from contactlearn.errors import DataError
from contactlearn.evaluation import bounds, metrics
from contactlearn.identification.joint import JointFit
from contactlearn.identification.per_trial import identify_trials
from contactlearn.impacts import Impacts
from contactlearn.model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures.impulse_space import energy_ellipse
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import write
from contactlearn.report.tables import save_predictions, save_trial_parameters
from contactlearn.report.tensorboard import Tracker

BEST_POST_HOC, IRB = "best_post_hoc", "irb"


def evaluate(cfg: DictConfig) -> None:
    """Laws and both bounds, then learned models against the number of trials; or transfer to other bodies."""
    settings.check(cfg)
    if cfg.transfer is not None:
        transfer(cfg)
        return
    folder = run.run_folder()
    impacts, pool, test, generator = run.split(cfg)
    row = _row(cfg, test)
    laws, law = settings.named_laws(cfg, cfg.laws), settings.law(cfg)
    with terminal.progress() as bar:
        fits = [run.identify_law(cfg, one, pool, generator, bar) for one in laws.values()]
        predictions = {fit.law.name: ContactModel(fit.to_law()).predict(test) for fit in fits}
        effects, joint = settings.effects(cfg), {}
        if effects:
            rows = torch.arange(len(pool))
            joint = {
                f"{name} (joint)" if name in predictions else name: fit
                for name, fit in run.fit_with_effects(cfg, law, effects, pool, rows, bar).items()
            }
        best, _ = bounds.best_post_hoc(test, predictions, cfg.bounds.norm)
        predictions |= {BEST_POST_HOC: best, IRB: bounds.irb(test, cfg.bounds.norm)}
        predictions |= {name: fit.model.predict(test) for name, fit in joint.items()}
        errors = run.error_table(test, predictions, cfg.bootstrap, generator)
        every = settings.named_laws(cfg, (*cfg.laws, cfg.figures.parameters))
        trials = {
            name: identify_trials(one, impacts, target=cfg.train.target, box=run.box(cfg))
            for name, one in bar.track(every.items(), description="every trial")
        }
    terminal.show_models(fits, errors, cfg.bounds.norm, joint)
    if joint:
        terminal.show_joint(*list(joint.items())[-1])
    if cfg.reference is not None:
        terminal.show_reference(fits, OmegaConf.to_container(cfg.reference))
    save_predictions(test, predictions, folder / f"predictions.{cfg.tables}")
    save_trial_parameters(impacts, list(trials.values()), folder / f"trial_parameters.{cfg.tables}")
    provenance = run.provenance(impacts, cfg)
    results = {
        **provenance,
        "fits": [run.fit_entry(fit) for fit in fits],
        "joint": {name: run.joint_entry(fit) for name, fit in joint.items()},
        "errors": errors,
    }
    run.write_json(folder / "results.json", results)
    with Tracker(folder, cfg.train.size) as tracker:
        tracker.scalars(run.scalars(fits, {name: errors[name] for name in errors if name not in joint}, {}))
        if joint:  # fitted to the whole pool
            tracker.scalars(run.scalars([], {name: errors[name] for name in joint}, joint), len(pool))
        _log_model(tracker, cfg, impacts, len(pool) if joint else cfg.train.size, joint, errors)
        equations = (*map(run.law_equation, fits), *(str(fit.model) for fit in joint.values()))
        run.log_card(tracker, provenance, equations, run.headline(errors))
        curves, yardsticks = {}, {name: predictions[name] for name in (BEST_POST_HOC, IRB)}
        drawn = run.effect_figures(list(joint.values())[-1].model, test) if joint else {}
        if settings.recipes(cfg):
            curves, figures_of_curves = learning_study(cfg, pool, test, yardsticks, generator, folder)
            log_curves(tracker, curves, {name: errors[name] for name in yardsticks})
            drawn |= figures_of_curves
            run.write_json(folder / "results.json", {**results, "learning_curves": curves})
        tracker.charts(run.charts((*curves, *yardsticks) if curves else ()))
        with terminal.progress() as bar:
            drawn |= _figures(cfg, pool, test, fits, predictions, errors, generator, bar, row)
            per_trial = trials[cfg.figures.parameters]
            drawn["trial_parameters"] = figures.trial_parameters(per_trial, impacts, box=run.box(cfg))
            run.save_figures(drawn, folder, tracker)
    fitted = {fit.law.name: fit.to_law() for fit in fits}
    write(folder, of_evaluation(test, predictions, errors, fitted, run.command_line(), provenance, curves=curves))
    terminal.show_folder(folder)


def _log_model(
    tracker: Tracker, cfg: DictConfig, impacts: Impacts, trained_on: int, joint: Mapping[str, JointFit], errors: dict
) -> None:
    """What runs are compared by: the law with its effects, else the law, or the best if that is not there."""
    errors = run.headline(errors)
    law = cfg.law if joint or cfg.law in cfg.laws else min(cfg.laws, key=errors.get)
    tracker.scalars({run.MODEL: errors[list(joint)[-1] if joint else law]}, trained_on)
    run.log_hyperparameters(tracker, cfg, impacts, trained_on, law, cfg.effect)


def _figures(cfg, pool, test, fits, predictions, errors, generator, bar, row) -> dict[str, Figure]:
    """The figures of an evaluation by name."""
    box, chosen = run.box(cfg), {fit.law.name: fit for fit in fits}
    # Every k up to 120, and as many of a larger range.
    sizes = torch.linspace(1, cfg.train.size, min(cfg.train.size, 120)).round().int().tolist()
    options = {"sizes": sizes, "repetitions": cfg.figures.repetitions}
    (surface,) = settings.named_laws(cfg, [cfg.figures.surface]).values()
    convergence = run.identify_law(cfg, surface, pool, generator, bar, **options)
    axis = run.headline_axis(cfg)
    headline = metrics.METRICS[metrics.HEADLINE]
    per_trial = {name: headline.error(test, prediction) for name, prediction in predictions.items()}
    intervals = {name: tuple(errors[name][metrics.HEADLINE].values()) for name in predictions}
    best = min(chosen, key=lambda law: intervals[law])
    widths = cfg.bounds.patch * torch.linspace(0, 1, 25, dtype=torch.float64) ** 2  # dense where the bound falls
    patched = headline.error(test, bounds.irb(test, cfg.bounds.norm, patch=widths[:, None]))
    bands = torch.tensor([list(metrics.bootstrap(error, generator, cfg.bootstrap)) for error in patched])
    row = int(per_trial[best].argsort()[len(test) // 2]) if row is None else row
    return {
        "energy_ellipse": energy_ellipse(
            test, row, {law: fit.to_law() for law, fit in chosen.items()}, box, target=cfg.train.target
        ),
        "cost_surface": run.law_surface(cfg, surface, pool),
        "convergence": figures.convergence(convergence),
        "error_comparison": figures.error_comparison(per_trial, intervals, axis),
        "patch_curve": figures.patch_curve(
            1e3 * widths, bands, {name: intervals[name][0] for name in (best, BEST_POST_HOC)}, axis
        ),
    }


def _row(cfg: DictConfig, test: Impacts) -> int | None:
    """Row of the trial to draw if one is asked for."""
    if cfg.figures.trial is None:
        return None
    name = str(cfg.figures.trial)
    if name not in test.trial:
        raise DataError(
            f"figures.trial={name} is not among the {len(test)} held-out trials of {test.source}; "
            f"they begin with {', '.join(test.trial[:5])}"
        )
    return test.trial.index(name)
