"""Train one model from one random subset of the training pool; errors on the held-out trials."""

import math
import shlex
from collections.abc import Mapping
from dataclasses import asdict, replace

import torch

from contactlearn.cli.commands import fitting, loading, record
from contactlearn.cli.commands.fitting import Comparison
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.record import RunRecord
from contactlearn.cli.commands.trained import body_ranges, check_start
from contactlearn.cli.job import Run
from contactlearn.cli.resource_limits import FITTED
from contactlearn.cli.settings import TrainSettings
from contactlearn.core.devices import moved
from contactlearn.core.events import TaskProgress
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import ErrorSums
from contactlearn.inference.identification.joint import Fit
from contactlearn.inference.identification.shared import SubsetFit
from contactlearn.inference.learning.recipe import learn
from contactlearn.laws import Law
from contactlearn.mechanics.features import feature_units
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import quality
from contactlearn.report.tensorboard import Tracker
from contactlearn.report.text.names import model_labels
from contactlearn.report.text.sentences import phrase
from contactlearn.results import estimates, folder
from contactlearn.results.types import BEST_POST_HOC, IRB, Training

CHECKPOINT = "model.pt"


def train(settings: TrainSettings, run: Run) -> None:
    """Train one model, save it, and compare its predictions with the held-out trials."""
    data = loading.split(settings)
    record.save_recordings_page(run.folder, data.tracked)
    loading.show_split(data, str(run.config["device"]), settings.device)
    if settings.fits_all and settings.train.size is None:
        terminal.print_line(
            f"law and effects are fitted to these {data.train_size}, and judged on the others; diagnose fits to all"
        )
    if settings.start is not None:
        check_start(settings.start, data)
    metric = metrics.headline_metric(settings.bounds.norm)
    with record.tracker_of(run, data.train_size, metric, training=settings.recipe is not None) as tracker:
        result = _train(settings, run, data, tracker)
    terminal.show_end(run.folder, phrase("training_headline", model_labels(result), result))
    if run.data_words:
        path = terminal.relative(run.folder / CHECKPOINT)
        terminal.show_next(shlex.join(["contactlearn", "evaluate", f"checkpoint={path}", *run.data_words]))


def _train(settings: TrainSettings, run: Run, data: Split, tracker: Tracker) -> Training:
    device = settings.device
    with progress(run.folder, tracker) as on_event:
        compared = _compared(settings, moved(data.pool, device), data, on_event)
        predictions = compared.predict(data.test)
        sums = ErrorSums((*compared.trained, BEST_POST_HOC, IRB))
        for block in loading.track_blocks(on_event, data.held_out_impacts(), data.held_out_trials, "held-out trials"):
            sums.add(block, predictions if block is data.test else compared.predict(block))
    compared = moved(compared, "cpu")
    result = _result(settings, run, data, compared, sums)
    checkpoint.save(compared.trained[result.model], run.folder / CHECKPOINT, provenance=asdict(result.provenance))
    folder.write_result(run.folder, result)
    terminal.show_models(result)
    if result.joint:
        terminal.show_joint(*list(result.joint.items())[-1])
    if result.processes_kind is not None:
        terminal.show_processes(result.processes, result.processes_kind)
    record.write_record(tracker, run, result.provenance, _record(settings, result, compared, data, predictions))
    return result


def _compared(settings: TrainSettings, pool: Impacts, data: Split, on_event: OnEvent) -> Comparison:
    """Fit the law, with its effects if there are any, and train the learned model on top.

    `trained` has the models of the error table, the trained one last; Best Post Hoc is that of laws identified on the
    same trials.
    """
    law, recipe, effects, how = settings.law, settings.recipe, settings.effects, settings.train
    sizes = (min(data.train_size, FITTED),)
    shared, joint = dict[str, SubsetFit](), dict[str, Fit]()
    if law is not None and recipe is None and not effects:
        shared[law.name] = fitting.identify_law(law, pool, how, data.generator, on_event, sizes=sizes)
    rows = torch.randperm(len(pool), generator=data.generator)[: data.train_size]
    for one in settings.laws.values():
        if one.name not in shared:
            shared[one.name] = fitting.identify_law(
                one, pool, how, data.generator, on_event, sizes=sizes, orders=rows[None]
            )
    base: Law | ContactModel | None = None if law is None else shared[law.name].to_law()
    if law is not None and effects:
        joint = fitting.fit_with_effects(law, effects, pool, rows, settings.fit_options, on_event)
        base = list(joint.values())[-1].model
    models = {name: fit.model for name, fit in joint.items()}
    if law is not None and not effects:
        models = {law.name: ContactModel(shared[law.name].to_law())}
    if recipe is not None:
        on_event(TaskProgress(task=f"training {settings.model} on {len(rows)} trials", done=0, total=None))
        name = fitting.augmented_name(settings.model, effects)
        start = None if settings.start is None else moved(settings.start.model.regressor, settings.device)
        models[name] = learn(
            pool,
            recipe,
            rows=rows,
            base=base,
            impulse=how.target,
            box=how.box,
            like=start,
            held_out=moved(data.test, settings.device),
            on_event=on_event,
        )
    norm, device = settings.bounds.norm, settings.device
    fits = tuple(shared.values())
    return Comparison(fits=fits, joint=joint, trained=models, trials={}, norm=norm, device=device)


def _result(settings: TrainSettings, run: Run, data: Split, compared: Comparison, sums: ErrorSums) -> Training:
    name, model = list(compared.trained.items())[-1]
    recipe, regressor = settings.recipe, model.regressor
    law, fits = settings.law and settings.law.name, () if settings.effects else compared.fits
    provenance = run.provenance(data.blocks, settings.device, data.train_size)
    provenance = replace(provenance, data=replace(provenance.data, **body_ranges(data.pool)))
    if recipe is not None and settings.start is not None:  # of which the configuration names the file alone
        model = {settings.model: {"features": recipe.features, "target": recipe.target}}
        provenance = replace(provenance, config={**provenance.config, "model": model})
    return Training(
        provenance=provenance,
        model=name,
        learned=None if recipe is None else settings.model,
        law=law,
        effects=estimates.effect_ids(settings.effects),
        trained_on=data.train_size,
        equation=str(model),
        fits=tuple(estimates.law_estimate(fit) for fit in fits if fit.law.name == law),
        joint={name: estimates.joint_estimate(fit) for name, fit in compared.joint.items()},
        errors=estimates.error_table(sums, settings.bounds.norm, settings.bootstrap, data.generator),
        back_spin=sums.back_spin(),
        norm=settings.bounds.norm,
        processes=()
        if recipe is None or regressor is None
        else estimates.process_estimates(recipe, regressor, data.test.space),
        processes_kind=None if regressor is None else regressor.kind,
    )


def _record(
    settings: TrainSettings, result: Training, compared: Comparison, data: Split, predictions: Mapping[str, Prediction]
) -> RunRecord:
    """Figures, and for TensorBoard the errors with losses, noise and length scales."""
    test, prediction = data.test, predictions[result.model]
    recipe, regressor = settings.recipe, compared.trained[result.model].regressor
    shown = {name: errors.of(result.metric) for name, errors in result.errors.items()}
    alone = result.learned is None and result.fits
    values = record.scalars(result.fits, result.errors, result.joint)
    values |= zip(record.own_tags(result.metric), (shown[result.model], shown[IRB]), strict=True)
    for process in result.processes:
        values |= {f"loss/{process.output}": process.loss, f"noise/{process.output}": process.noise}
        values |= {f"length_scale/{process.output}/{name}": x for name, x in process.length_scales.items()}
    drawn = record.draw_effects(list(compared.joint.values())[-1].model, test) if settings.effects else {}
    distributions = record.residuals(test, prediction)
    drawn["predicted_against_measured"] = record.draw_predictions(test, prediction)
    if alone and settings.law is not None:
        pool, size = moved(data.pool, settings.device), min(data.train_size, FITTED)
        drawn["cost_surface"] = fitting.draw_cost_surface(settings.law, pool, size, settings.train)
    if recipe is not None and regressor is not None:
        lengths = {one.output: one.length_scales for one in result.processes}
        relevance = {
            output: {name: 1 / known.get(name, math.inf) for name in feature_units(recipe.features, test.space)}
            for output, known in lengths.items()
        }
        distance = metrics.squared_distance(test, prediction)
        drawn |= {
            "calibration": quality.calibration_curve({result.model: metrics.calibration(distance, test.space.D)}),
            "training": quality.training(regressor.training.history, relevance, regressor.objective),
        }
    return RunRecord(
        trained_on=result.trained_on,
        metric=result.metric,
        scalars=[(result.trained_on, values)],
        histograms=[(result.trained_on, distributions)],
        figures=drawn,
        law=result.law,
        effects=list(settings.effects),
        model=settings.model,
        equations=[record.law_equation(fit) for fit in result.fits] if alone else [result.equation],
        errors=shown,
        verdict={} if result.processes_kind is None else {"Gaussian processes": result.processes_kind},
    )
