"""Train one model from one random subset of the training pool; errors on the held-out trials."""

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig

from contactlearn import checkpoint
from contactlearn.app import record as run
from contactlearn.app import settings
from contactlearn.errors import ContactLearnError
from contactlearn.evaluation import bounds, metrics
from contactlearn.impacts import Impacts, Prediction
from contactlearn.learning.recipe import OUTPUTS, Recipe, learn
from contactlearn.model import ContactModel
from contactlearn.regression.features import SPACES
from contactlearn.regression.regressor import Regressor
from contactlearn.report import terminal
from contactlearn.report.figures import quality
from contactlearn.report.tensorboard import Tracker

CHECKPOINT = "model.pt"


def train(cfg: DictConfig) -> None:
    """Train the one model of the configuration, save it, and hold its predictions against the held-out trials."""
    settings.check(cfg)
    name, recipe = settings.one_recipe(cfg)
    law, effects = settings.law(cfg), settings.effects(cfg)
    if effects and recipe is not None and recipe.law is None:
        raise ContactLearnError(f"effects act around a law, and model {name} has none: {', '.join(effects)}")
    if recipe is not None and name not in settings.recipes_around(cfg):
        raise ContactLearnError(
            f"model {name} takes each trial's (μ, ε) from the law alone, but there are effects "
            f"({', '.join(effects)}); use model=parameters_likelihood"
        )
    folder = run.run_folder()
    impacts, pool, test, generator = run.split(cfg)
    fits, joint = [], {}
    with terminal.progress() as bar:
        if recipe is not None or effects:
            rows = torch.randperm(len(pool), generator=generator)[: cfg.train.size]
        if effects:
            joint = run.fit_with_effects(cfg, law, effects, pool, rows, bar)
        elif recipe is None:
            fits = [run.identify_law(cfg, law, pool, generator, bar)]
        elif recipe.law:
            fits = [run.identify_law(cfg, recipe.law, pool, generator, bar, orders=rows[None])]
        laws = {fit.law.name: ContactModel(fit.to_law()) for fit in fits} | {
            key: fit.model for key, fit in joint.items()
        }
        model = list(laws.values())[-1] if laws else None
        if recipe is not None:
            bar.add_task(f"training {name} on {len(rows)} trials", total=None)
            base = model if effects else model and model.base
            model = learn(recipe, pool, rows, base, impulse=cfg.train.target, box=run.box(cfg))
    name = list(laws)[-1] if recipe is None else run.augmented_name(name, effects)
    # A law is shown beside the model that it is the base of only if it has effects.
    models = (laws if effects else {}) | {name: model}
    predictions = {key: one.predict(test) for key, one in models.items()}
    errors = run.error_table(test, predictions, cfg.bootstrap, generator)
    terminal.show_models(fits, errors, joint=joint)
    if effects:
        terminal.show_joint(*list(joint.items())[-1])
    processes = [] if recipe is None else _processes(recipe, model.parameters or model.residual)
    if recipe is not None:
        terminal.show_processes(processes, (model.parameters or model.residual).kind)
    provenance = run.provenance(impacts, cfg)
    checkpoint.save(model, folder / CHECKPOINT, provenance=provenance)
    results = {
        "fits": [run.fit_entry(fit) for fit in fits],
        "joint": {key: run.joint_entry(fit) for key, fit in joint.items()},
        "errors": errors,
        "processes": processes,
    }
    run.write_json(folder / "results.json", {**provenance, **results})
    bound = metrics.bootstrap(metrics.mass_error(test, bounds.irb(test)), generator, cfg.bootstrap)
    shown = run.headline(errors) | {"irb": bound}
    with Tracker(folder, cfg.train.size) as tracker:
        values = run.scalars(fits, errors, joint) | _hyperparameter_scalars(processes)
        tracker.scalars(values | {run.MODEL: shown[name], run.BOUND: bound})
        tracker.charts(run.charts())
        drawn = run.effect_figures(laws[list(laws)[-1]], test) if effects else {}
        if recipe is None and not effects:
            drawn["cost_surface"] = run.law_surface(cfg, law, pool)
        if recipe is not None:
            drawn |= _figures(name, recipe, model, test, predictions[name])
            loss = (model.parameters or model.residual).status.history
            tracker.series("fit/loss", loss.mean(-1).tolist())
        run.save_figures(drawn, folder, tracker)
        under = law if recipe is None else recipe.law
        run.log_hyperparameters(
            tracker, cfg, impacts, cfg.train.size, under and under.name, effects, next(iter(cfg.model))
        )
        equations = [run.law_equation(fit) for fit in fits] if recipe is None and fits else [str(model)]
        run.log_card(tracker, provenance, equations, shown)
    terminal.show_folder(folder)


def _processes(recipe: Recipe, regressor: Regressor) -> list[dict]:
    """What was found for each output: length scales in each feature's unit, spread and noise in the output's."""
    status, spread = regressor.status, regressor.outputs.spread[0]
    entries = []
    for o, (output, unit) in enumerate(OUTPUTS[recipe.target].items()):
        *lengths, scale, noise = regressor.gps.hyperparameters()[o].tolist()
        entries.append(
            {
                "output": output,
                "unit": unit,
                "length_scales": dict(zip(SPACES[recipe.features].columns, lengths, strict=True)),
                "spread": scale**0.5 * spread[o].item(),
                "noise": noise**0.5 * spread[o].item(),
                "loss": status.loss[o].item(),
                "converged": bool(status.converged[o]),
                "evaluations": int(status.evaluations[o]),
            }
        )
    return entries


def _hyperparameter_scalars(processes: list[dict]) -> dict[str, float]:
    values = {}
    for entry in processes:
        values |= {f"loss/{entry['output']}": entry["loss"], f"noise/{entry['output']}": entry["noise"]}
        values |= {f"length_scale/{entry['output']}/{name}": x for name, x in entry["length_scales"].items()}
    return values


def _figures(
    name: str, recipe: Recipe, model: ContactModel, test: Impacts, prediction: Prediction
) -> dict[str, Figure]:
    regressor = model.parameters or model.residual
    columns = list(SPACES[recipe.features].columns)
    relevance = {
        output: dict(zip(columns, (1 / lengths[: len(columns)]).tolist(), strict=True))
        for output, lengths in zip(OUTPUTS[recipe.target], regressor.gps.hyperparameters(), strict=True)
    }
    distance = metrics.squared_distance(test, prediction)
    spread = prediction.covariance.diagonal(dim1=-2, dim2=-1).sqrt()
    return {
        "predicted_against_measured": quality.predicted_against_measured(test.v_post, prediction.v_post, spread),
        "calibration": quality.calibration({name: metrics.calibration(distance)}),
        "training": quality.training(regressor.status.history, relevance),
    }
