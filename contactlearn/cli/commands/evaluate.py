"""Compare laws and learned models with the bounds on held-out trials, and compute their learning curves."""

import math
import shlex
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace

import torch
from matplotlib.figure import Figure

from contactlearn import laws as catalogue
from contactlearn.cli.commands import curves, fitting, loading, record
from contactlearn.cli.commands.fitting import Comparison
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.record import RunRecord
from contactlearn.cli.commands.trained import check_models
from contactlearn.cli.commands.transfer import transfer
from contactlearn.cli.job import Run
from contactlearn.cli.resource_limits import FITTED, fits_on_disk
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.impulse_space import ImpulseSpace, SlipDiagram
from contactlearn.inference.evaluation.metrics import ErrorSums
from contactlearn.inference.evaluation.reach import reached_share
from contactlearn.inference.learning.curves import Curve
from contactlearn.mechanics.bodies import shapes_entries
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.space import PLANE
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import laws as figures, learning, quality
from contactlearn.report.figures.comparison import error_comparison, patch_curve
from contactlearn.report.figures.contact_in_space import body_at_contact, slip_hodograph
from contactlearn.report.figures.impulse_space import reachable_impulses
from contactlearn.report.figures.style import BOUNDS
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import write
from contactlearn.report.tensorboard import Tracker
from contactlearn.report.text.names import join_words, law_label
from contactlearn.report.text.sentences import best_learned, evaluation_headline, learned_leads, phrase
from contactlearn.results import estimates, folder
from contactlearn.results.tables import HeldOut, save_curves, save_held_out, save_trial_parameters
from contactlearn.results.types import BEST_POST_HOC, IRB, Evaluation

_SIZES = 8  # numbers of trials in the figure of convergence, each about twice the last: every k takes 15 times as long


def evaluate(settings: EvaluateSettings, run: Run) -> None:
    """Compare laws with both bounds, then learned models against the number of trials; or transfer to other bodies."""
    if settings.transfer is not None:
        transfer(settings, settings.transfer, run)
        return
    data = loading.split(settings)
    record.save_recordings_page(run.folder, data.tracked)
    loading.show_split(data, str(run.config["device"]), settings.device)
    check_models(settings.trained, data, settings)
    row = _drawn_row(settings, data)
    size = len(data.pool) if settings.effects else data.train_size
    metric = metrics.headline_metric(settings.bounds.norm)
    with record.tracker_of(run, size, metric, curves=settings.recipes) as tracker:
        result = _evaluate(settings, run, data, row, tracker)
    learned = "" if learned_leads(result) else best_learned(result)  # which the headline says
    terminal.show_end(run.folder, f"{evaluation_headline(result)} {learned}".strip())
    if run.data_words:
        terminal.show_next(shlex.join(["contactlearn", "diagnose", *run.data_words]))


def _evaluate(settings: EvaluateSettings, run: Run, data: Split, row: int | None, tracker: Tracker) -> Evaluation:
    with progress(run.folder, tracker) as on_event:
        compared = fitting.compare_models(settings, data, on_event)
        held_out = HeldOut(impacts=data.test, predictions=compared.predict(data.test))
        sums = _save_predictions(settings, data, compared, held_out, run, on_event)
    compared = moved(compared, "cpu")
    result = _result(settings, run, data, compared, held_out, sums)
    path = run.folder / f"trial_parameters.{settings.tables}"
    save_trial_parameters(data.impacts, list(compared.trials.values()), path)
    folder.write_result(run.folder, result)
    terminal.show_models(result)
    if others := [
        name
        for name in catalogue.names()
        if name not in result.errors and data.test.space in catalogue.find(name).spaces
    ]:
        terminal.print_line(f"not compared: {join_words(map(law_label, others))} (laws=[…])")
    for name, model in result.trained.items():
        terminal.print_line(phrase("judged_model", name, model))
    if result.joint:
        terminal.show_joint(*list(result.joint.items())[-1])
    if settings.reference:
        terminal.show_reference(
            result.fits, {name: (x.mu, x.eps) for name, x in settings.reference.items() if x.mu and x.eps}
        )
    record.write_record(tracker, run, result.provenance, _record(data, held_out, result))
    learned: dict[str, Curve] = {}
    if settings.recipes:
        lines = {f"curve_{metric}/{IRB}": error for metric, error in result.errors[IRB].intervals.items()}
        for size in settings.curves.sizes:
            if size <= len(data.pool):
                tracker.scalars(lines, size)
        studied, points = curves.learning_study(settings, data, run, tracker)
        best = studied[BEST_POST_HOC]
        levels = {
            name: {
                BEST_POST_HOC: error.mean((1, 2)).tolist(),
                IRB: [metrics.METRICS[name].error(data.test, held_out.bounds[IRB]).mean().item()] * len(best.sizes),
            }
            for name, error in best.errors.items()
        }
        entries = {name: curves.curve_entry(curve, levels, points[name]) for name, curve in studied.items()}
        result = replace(result, learning_curves=entries)
        save_curves(studied, run.folder / f"learning_curves.{settings.tables}")
        folder.write_result(run.folder, result)
        learned = {name: curve for name, curve in studied.items() if name not in settings.laws}
        settled = {name: one.settled for name, one in settings.reference.items() if one.settled is not None}
        shown = (name for name in studied if name in learned or name in settled)
        terminal.show_curves({name: entries[name] for name in shown}, result.metric, settled)
        run.remove_partial_results()
    write(run.folder, of_evaluation(result, held_out))  # before the figures: a run that is stopped there has its page
    with progress(run.folder, tracker) as on_event:
        drawn = _laws_drawn(settings, data, compared, _best_law(compared, result), on_event)
    drawn |= _errors_drawn(settings, data, compared, held_out, result, row)
    if result.trained:
        drawn |= _judged_drawn(result, held_out)
    if learned:
        drawn |= _curves_drawn(result, learned, data.test, held_out.bounds[IRB])
    record.write_figures(tracker, run, drawn)
    return result


def _save_predictions(
    settings: EvaluateSettings, data: Split, compared: Comparison, held_out: HeldOut, run: Run, on_event: OnEvent
) -> ErrorSums:
    """Predict all held-out trials, block by block, write them to tables, and add up their errors."""
    sums, count = ErrorSums(held_out.predictions), data.held_out_trials
    tables, norm = settings.tables, settings.bounds.norm

    def predicted() -> Iterator[tuple[Impacts, Mapping[str, Prediction]]]:
        for impacts in loading.track_blocks(on_event, data.held_out_impacts(), count, "held-out trials"):
            predictions = held_out.predictions if impacts is data.test else compared.predict(impacts)
            sums.add(impacts, predictions)
            yield impacts, predictions

    if fits_on_disk(run.folder, count * len(sums.models)):
        save_held_out(run.folder, tables, data.held_out_impacts(), predicted(), norm)
    else:
        deque(predicted(), maxlen=0)
        save_held_out(
            run.folder, settings.tables, [data.test], [(data.test, held_out.predictions)], settings.bounds.norm
        )
    return sums


def _result(
    settings: EvaluateSettings, run: Run, data: Split, compared: Comparison, held_out: HeldOut, sums: ErrorSums
) -> Evaluation:
    """The result without learning curves.

    Runs are compared by the model from a checkpoint, the best of several; else by the law with its effects, else by
    the law, or by the best one if that is not among them.
    """
    metric = metrics.headline_metric(settings.bounds.norm)
    errors = estimates.error_table(sums, settings.bounds.norm, settings.bootstrap, data.generator)
    joint = {name: estimates.joint_estimate(fit) for name, fit in compared.joint.items()}
    best, differences = estimates.ranked(sums, metric)
    law, laws = settings.law.name, [fit.law.name for fit in compared.fits]
    law = law if joint or law in laws else min(laws, key=lambda name: errors[name].of(metric))
    model, effects = list(joint)[-1] if joint else law, settings.effects
    planar = data.test.space is PLANE  # in space a law's impulses are a surface, and the admissible ones fill a volume
    if settings.trained:
        model = min(settings.trained, key=lambda name: errors[name].of(metric))
        chosen = settings.trained[model]
        law, effects = None if chosen.law is None else chosen.law.name, chosen.effects
    return Evaluation(
        provenance=run.provenance(data.blocks, settings.device, data.train_size),
        model=model,
        law=law,
        effects=estimates.effect_ids(effects),
        norm=settings.bounds.norm,
        fits=tuple(map(estimates.law_estimate, compared.fits)),
        joint=joint,
        errors=errors,
        back_spin=sums.back_spin(),
        reach={name: reached_share(law, data.test).mean().item() for name, law in settings.laws.items()}
        if planar
        else {},
        best=best,
        differences=differences,
        tables=settings.tables,
        shape=shapes_entries(data.test.shape),
        trained={name: one.judged(data.test, held_out.predictions[name]) for name, one in settings.trained.items()},
    )


def _drawn_row(settings: EvaluateSettings, data: Split) -> int | None:
    """Row of the held-out trial to draw, if it is given by name."""
    if settings.figures.trial is None:
        return None
    name, test = str(settings.figures.trial), data.test
    if name not in test.trial:
        raise DataError(
            f"figures.trial={name} is not among the {len(test)} held-out trials of {test.source}; "
            f"they begin with {', '.join(test.trial[:5])}"
        )
    return test.trial.index(name)


def _record(data: Split, held_out: HeldOut, result: Evaluation) -> RunRecord:
    """Return what is known before the learning curves; the figures follow them."""
    size = len(data.pool) if result.joint else data.train_size
    errors = {name: entry.of(result.metric) for name, entry in result.errors.items()}
    alone = {name: entry for name, entry in result.errors.items() if name not in {*result.joint, *result.trained}}
    with_effects = {name: result.errors[name] for name in result.joint}
    return RunRecord(
        trained_on=size,
        metric=result.metric,
        scalars=[
            (data.train_size, record.scalars(result.fits, alone, {})),
            *([(size, record.scalars([], with_effects, result.joint))] if result.joint else []),
            *(
                (one.trained_on or size, record.scalars([], {name: result.errors[name]}, {}))
                for name, one in result.trained.items()
            ),
            (size, {record.own_tags(result.metric)[0]: errors[result.model]}),
        ],
        histograms=[(size, record.residuals(data.test, held_out.predictions[result.model]))],
        law=result.law,
        effects=[effect.name for effect in result.effects],
        equations=(
            *map(record.law_equation, result.fits),
            *(fit.equation for fit in result.joint.values()),
            *(f"{name}: {one.equation}" for name, one in result.trained.items()),
        ),
        errors=errors,
    )


def _best_law(compared: Comparison, result: Evaluation) -> str:
    """Name of the law with the lowest held-out error, without effects."""
    return min((fit.law.name for fit in compared.fits), key=lambda name: result.errors[name].of(result.metric))


def _laws_drawn(
    settings: EvaluateSettings, data: Split, compared: Comparison, best: str, on_event: OnEvent
) -> dict[str, Figure]:
    """Convergence and cost surface of a law, per-trial parameters, and the curves of the effects, by file name."""
    most, shown, how = min(data.train_size, FITTED), settings.figures, settings.train
    sizes = torch.logspace(0, math.log10(most), _SIZES).round().int().unique().tolist()
    pool, law = moved(data.pool, settings.device), shown.surface or settings.laws[best]
    convergence = fitting.identify_law(
        law, pool, how, data.generator, on_event, sizes=sizes, repetitions=shown.repetitions
    )
    drawn = record.draw_effects(list(compared.joint.values())[-1].model, data.test) if compared.joint else {}
    per_trial = compared.trials[best if shown.parameters is None else shown.parameters.name]
    return drawn | {
        "cost_surface": fitting.draw_cost_surface(law, pool, most, how),
        "convergence": figures.convergence(moved(convergence, "cpu")),
        "trial_parameters": figures.trial_parameters(per_trial, data.impacts, box=how.box),
    }


def _errors_drawn(
    settings: EvaluateSettings,
    data: Split,
    compared: Comparison,
    held_out: HeldOut,
    result: Evaluation,
    row: int | None,
) -> dict[str, Figure]:
    """Errors of all models, the bound of contact patches, and one trial in impulse space, by file name.

    The trial is the held-out `row`, or that with the median error of the best law.  In space it is drawn as a body with
    its hodograph, and the contact is a point.
    """
    test, how, headline, bounded = data.test, settings.train, metrics.METRICS[result.metric], settings.bounds
    laws = {fit.law.name: fit.to_law() for fit in compared.fits}
    best = _best_law(compared, result)
    if row is None:
        row = int(headline.error(test, held_out.predictions[best]).argsort()[len(test) // 2])
    if test.space is PLANE:
        levels = {name: result.errors[name].of(result.metric).mean for name in (best, BEST_POST_HOC)}
        widths = bounded.patch * torch.linspace(0, 1, 25, dtype=torch.float64) ** 2  # dense where the bound falls
        shown = moved(test, settings.device)
        patched = moved(headline.error(shown, bounds.irb(shown, bounded.norm, patch=widths[:, None])), "cpu")
        rows = torch.tensor([list(metrics.bootstrap(error, data.generator, settings.bootstrap)) for error in patched])
        drawn = {
            "energy_ellipse": reachable_impulses(ImpulseSpace.of(test[[row]], laws, how.box, target=how.target)),
            "patch_curve": patch_curve((1e3 * widths).tolist(), rows, levels, headline.axis),
        }
    else:
        trial, v_post = test[[row]], held_out.predictions[result.model].v_post[[row]]
        prediction = Prediction(v_post, held_out.predictions[result.model].wrench[[row]])
        ordered = {best: laws[best], **laws}
        drawn = {
            "slip_hodograph": slip_hodograph(SlipDiagram.of(trial, ordered, prediction)),
            "body_at_contact": body_at_contact(trial, prediction),
        }
    for name, suffix in _bounded(result).items():
        metric, intervals = metrics.METRICS[name], {model: errors.of(name) for model, errors in result.errors.items()}
        order = sorted(held_out.predictions, key=lambda model: (model in BOUNDS, intervals[model].mean))
        per_trial = {model: metric.error(test, held_out.predictions[model]) for model in order}
        drawn[f"error_comparison{suffix}"] = error_comparison(per_trial, intervals, metric.axis)
    return drawn


def _bounded(result: Evaluation) -> dict[str, str]:
    """The metrics that the bounds of a run bound, with the ending of their figures' file names."""
    return {name: "" if name == result.metric else f"_{name}" for name in metrics.bounded_metrics(result.norm)}


def _judged_drawn(result: Evaluation, held_out: HeldOut) -> dict[str, Figure]:
    """Predictions of the run's own model, and the calibration of all models from checkpoints, by file name."""
    test, predictions = held_out.impacts, held_out.predictions
    coverage = {
        name: metrics.calibration(metrics.squared_distance(test, predictions[name]), test.space.D)
        for name, model in result.trained.items()
        if model.coverage is not None
    }
    drawn = {"predicted_against_measured": record.draw_predictions(test, predictions[result.model])}
    return drawn | ({"calibration_of_trained": quality.calibration_curve(coverage)} if coverage else {})


def _curves_drawn(
    result: Evaluation, learned: Mapping[str, Curve], test: Impacts, irb: Prediction
) -> dict[str, Figure]:
    """Learning curves, error densities at the largest size, and calibration, by file name."""
    sizes = next(iter(learned.values())).sizes
    drawn = {}
    for metric, suffix in _bounded(result).items():
        axis = metrics.METRICS[metric].axis
        intervals = {name: curves.as_rows(result.learning_curves[name].of(metric)) for name in learned}
        lines = {IRB: result.errors[IRB].of(metric)}
        drawn[f"learning_curve{suffix}"] = learning.learning_curve(sizes, intervals, lines, axis)
        densities = {name: curve.errors[metric][-1].flatten() for name, curve in learned.items()}
        densities[IRB] = metrics.METRICS[metric].error(test, irb)
        drawn[f"error_densities{suffix}"] = learning.error_densities(densities, axis)
    predicted = {name: curve.density for name, curve in learned.items() if curve.density is not None}
    coverage = {
        name: metrics.calibration(density.distance[-1].flatten(), test.space.D) for name, density in predicted.items()
    }
    return drawn | {"calibration": quality.calibration_curve(coverage)}
