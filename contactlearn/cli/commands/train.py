"""Train one model from one random subset of the training pool; errors on the held-out trials."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig

from contactlearn.cli.commands import fitting, loading, record, results, settings
from contactlearn.cli.commands.fitting import CostSurface
from contactlearn.cli.commands.laws import given_law
from contactlearn.cli.commands.loading import Split, show_split, watched
from contactlearn.cli.commands.means import lower_train_size
from contactlearn.core.devices import moved
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.events import OnEvent, TaskProgress
from contactlearn.effects import Effect
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.sums import ErrorSums
from contactlearn.inference.identification.joint import JointFit
from contactlearn.inference.identification.shared import SharedFit
from contactlearn.inference.learning.recipe import TARGETS, Recipe, learn
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.features import SPACES
from contactlearn.models.regressor import Regressor
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import quality
from contactlearn.report.tensorboard import Tracker
from contactlearn.results import folder as run_folder
from contactlearn.results.estimates import ProcessEstimate
from contactlearn.results.evaluation import IRB
from contactlearn.results.training import Training

CHECKPOINT = "model.pt"


@dataclass(frozen=True, kw_only=True)
class _Task:
    """The model to train: its name in the configuration, its recipe (None for a law alone), law and effects."""

    name: str
    recipe: Recipe | None
    law: Law | None
    effects: Mapping[str, Effect]

    @classmethod
    def of(cls, cfg: DictConfig) -> "_Task":
        """Read from a configuration.

        Raises:
            ContactLearnError: effects around a model that has no law, or that takes (μ, ε) from the law alone.
        """
        name, recipe = settings.one_recipe(cfg)
        effects = settings.effects(cfg)
        if effects and recipe is not None and recipe.law is None:
            raise ContactLearnError(f"effects act around a law, and model {name} has none: {', '.join(effects)}")
        if recipe is not None and name not in settings.recipes_around(cfg):
            raise ContactLearnError(
                f"model {name} takes each trial's (μ, ε) from the law alone, but there are effects "
                f"({', '.join(effects)}); use model=parameters_likelihood"
            )
        law = given_law(cfg) if recipe is None or effects else recipe.law
        return cls(name=name, recipe=recipe, law=law, effects=effects)


@dataclass(frozen=True, kw_only=True)
class _Trained:
    """Fits and models; `models` are those of the error table, the trained one last."""

    fits: tuple[SharedFit, ...]
    joint: Mapping[str, JointFit]
    models: Mapping[str, ContactModel]
    surface: CostSurface | None

    @property
    def model(self) -> ContactModel:
        return list(self.models.values())[-1]

    @property
    def name(self) -> str:
        return list(self.models)[-1]

    @property
    def regressor(self) -> Regressor | None:
        return self.model.parameters or self.model.residual


def train(cfg: DictConfig) -> None:
    """Train the one model of the configuration, save it, and compare its predictions with the held-out trials."""
    settings.check(cfg)
    task, folder = _Task.of(cfg), results.run_folder()
    lower_train_size(cfg)
    data = loading.split(cfg, folder)
    show_split(data, cfg.device, settings.device(cfg))
    device = settings.device(cfg)
    with progress(folder) as on_event:
        trained = _trained(cfg, task, moved(data.pool, device), data.generator, on_event)
        sums = ErrorSums((*trained.models, IRB))
        for block in watched(on_event, data.unseen(), data.unseen_trials, "held-out trials"):
            impacts = moved(block, device)
            predictions = {name: model.predict(impacts) for name, model in trained.models.items()}
            sums.add(impacts, predictions | {IRB: bounds.irb(impacts)})
    trained = moved(trained, "cpu")
    result = _result(cfg, task, data, trained, sums)
    checkpoint.save(trained.model, folder / CHECKPOINT, provenance=asdict(result.provenance))
    run_folder.write_result(folder, result)
    _show(result)
    _record(cfg, folder, result, trained, _drawn(task, trained, data.test))
    terminal.show_folder(folder)


def _trained(cfg: DictConfig, task: _Task, pool: Impacts, generator: torch.Generator, on_event: OnEvent) -> _Trained:
    """Fit the law, with its effects if there are any, and train the learned model on top."""
    law, recipe = task.law, task.recipe
    if law is not None and recipe is None and not task.effects:
        return _identified(cfg, law, pool, generator, on_event)
    rows = torch.randperm(len(pool), generator=generator)[: cfg.train.size]
    fits: tuple[SharedFit, ...] = ()
    joint: dict[str, JointFit] = {}
    base: Law | ContactModel | None = None
    if law is not None and task.effects:
        joint = fitting.fit_with_effects(cfg, law, task.effects, pool, rows, on_event)
        base = list(joint.values())[-1].model
    elif law is not None:
        fits = (fitting.identify_law(cfg, law, pool, generator, on_event, orders=rows[None]),)
        base = fits[0].to_law()
    models = {name: fit.model for name, fit in joint.items()}  # a law alone is not shown beside the model on it
    if recipe is not None:
        on_event(TaskProgress(task=f"training {task.name} on {len(rows)} trials", done=0, total=None))
        model = learn(recipe, pool, rows, base, impulse=cfg.train.target, box=settings.box(cfg))
        models |= {fitting.augmented_name(task.name, task.effects): model}
    return _Trained(fits=fits, joint=joint, models=models, surface=None)


def _identified(cfg: DictConfig, law: Law, pool: Impacts, generator: torch.Generator, on_event: OnEvent) -> _Trained:
    """Identify a law alone, and evaluate its cost surface."""
    fit = fitting.identify_law(cfg, law, pool, generator, on_event)
    surface = fitting.law_surface(cfg, law, pool)
    return _Trained(fits=(fit,), joint={}, models={law.name: ContactModel(fit.to_law())}, surface=surface)


def _result(cfg: DictConfig, task: _Task, data: Split, trained: _Trained, sums: ErrorSums) -> Training:
    errors = results.error_table(sums, cfg.bootstrap, data.generator)
    del errors[IRB]
    recipe, regressor = task.recipe, trained.regressor
    return Training(
        provenance=results.provenance(data.blocks, cfg),
        model=trained.name,
        learned=None if recipe is None else task.name,
        law=None if task.law is None else task.law.name,
        effects=results.effect_ids(task.effects),
        trained_on=cfg.train.size,
        equation=str(trained.model),
        fits=tuple(map(results.law_estimate, trained.fits)),
        joint={name: results.joint_estimate(fit) for name, fit in trained.joint.items()},
        errors=errors,
        irb=sums.interval(metrics.HEADLINE, IRB, data.generator, cfg.bootstrap),
        processes=() if recipe is None or regressor is None else results.process_estimates(recipe, regressor),
        processes_kind=None if regressor is None else regressor.kind,
    )


def _show(result: Training) -> None:
    """Print the tables of a result."""
    terminal.show_models(result.fits, result.errors, joint=result.joint)
    if result.joint:
        terminal.show_joint(*list(result.joint.items())[-1])
    if result.processes_kind is not None:
        terminal.show_processes(result.processes, result.processes_kind)


def _record(cfg: DictConfig, folder: Path, result: Training, trained: _Trained, drawn: Mapping[str, Figure]) -> None:
    """Log the result to TensorBoard, and save the figures."""
    shown = record.headline_errors(result.errors) | {"irb": result.irb}
    equations = [result.equation]
    if result.learned is None and result.fits:
        equations = [record.law_equation(fit) for fit in result.fits]
    with Tracker(folder, result.trained_on) as tracker:
        values = record.scalars(result.fits, result.errors, result.joint) | _hyperparameters(result.processes)
        tracker.scalars(values | {record.MODEL: shown[result.model], record.BOUND: result.irb})
        tracker.charts(record.charts())
        if trained.regressor is not None:
            tracker.series("fit/loss", trained.regressor.training.history.mean(-1).tolist())
        record.save_figures(drawn, folder, tracker)
        effects = [effect.name for effect in result.effects]
        source, model = result.provenance.data.source, next(iter(cfg.model))
        record.log_hyperparameters(tracker, cfg, source, result.trained_on, result.law, effects, model)
        record.log_card(tracker, result.provenance, equations, shown)


def _hyperparameters(processes: Iterable[ProcessEstimate]) -> dict[str, float]:
    """Return losses, noise and length scales by tag."""
    values = {}
    for one in processes:
        values |= {f"loss/{one.output}": one.loss, f"noise/{one.output}": one.noise}
        values |= {f"length_scale/{one.output}/{name}": x for name, x in one.length_scales.items()}
    return values


def _drawn(task: _Task, trained: _Trained, test: Impacts) -> dict[str, Figure]:
    """Draw the figures of a training by file name."""
    drawn = {}
    if task.effects:
        drawn = record.draw_effects(list(trained.joint.values())[-1].model, test)
    if trained.surface is not None:
        drawn["cost_surface"] = record.draw_cost_surface(trained.surface)
    if task.recipe is not None and trained.regressor is not None:
        drawn |= _learned_figures(trained.name, task.recipe, trained.regressor, test, trained.model.predict(test))
    return drawn


def _learned_figures(
    name: str, recipe: Recipe, regressor: Regressor, test: Impacts, prediction: Prediction
) -> dict[str, Figure]:
    """Draw predictions, calibration and training of a learned model by file name."""
    columns = list(SPACES[recipe.features].columns)
    relevance = {
        output: dict(zip(columns, (1 / lengths[: len(columns)]).tolist(), strict=True))
        for output, lengths in zip(TARGETS[recipe.target], regressor.gps.hyperparameters(), strict=True)
    }
    distance, spread = metrics.squared_distance(test, prediction), metrics.predicted_spread(prediction)
    return {
        "predicted_against_measured": quality.predicted_against_measured(test.v_post, prediction.v_post, spread),
        "calibration": quality.calibration_curve({name: metrics.calibration(distance)}),
        "training": quality.training(regressor.training.history, relevance),
    }
