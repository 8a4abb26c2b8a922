"""Figures and TensorBoard's values of an evaluation, with what is computed for figures alone."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.cli.commands import fitting, record
from contactlearn.cli.commands.curves import as_rows
from contactlearn.cli.commands.fitting import Comparison
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.record import RunRecord, Scalars
from contactlearn.cli.resource_limits import FITTED
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.devices import moved
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.learning.curves import Curve
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures import learning, quality
from contactlearn.report.figures.comparison import error_comparison, patch_curve
from contactlearn.report.figures.impulse_space import reachable_impulses
from contactlearn.results.tables import HeldOut
from contactlearn.results.types import BEST_POST_HOC, IRB, Evaluation, LearningCurve, ModelErrors


def evaluation_record(
    settings: EvaluateSettings,
    data: Split,
    compared: Comparison,
    held_out: HeldOut,
    result: Evaluation,
    learned: Mapping[str, Curve],
    row: int | None,
    on_event: OnEvent,
) -> RunRecord:
    """Return the figures and values of an evaluation; laws with effects are fitted to the whole pool.

    Args:
        settings: of the command.
        data: pool and held-out trials.
        compared: the fits.
        held_out: predictions of the held-out trials.
        result: with its learning curves.
        learned: curves that are no law's, by model.
        row: of the held-out trial to draw; None for the one with the median error of the best law.
        on_event: receives the progress.
    """
    size = len(data.pool) if result.joint else data.train_size
    errors = record.headline_errors(result.errors)
    yardsticks = {name: result.errors[name] for name in (BEST_POST_HOC, IRB)}
    alone = {name: entry for name, entry in result.errors.items() if name not in result.joint}
    with_effects = {name: result.errors[name] for name in result.joint}
    drawn = _laws_drawn(settings, data, compared, on_event)
    drawn |= _errors_drawn(settings, data, compared, held_out, result, row)
    if learned:
        drawn |= _curves_drawn(result, learned, data.test, held_out.bounds)
    return RunRecord(
        trained_on=size,
        scalars=[
            (data.train_size, record.scalars(result.fits, alone, {})),
            *([(size, record.scalars([], with_effects, result.joint))] if result.joint else []),
            (size, {record.MODEL: errors[result.model]}),
            *_curve_scalars(result.learning_curves, yardsticks),
        ],
        figures=drawn,
        law=result.law,
        effects=[effect.name for effect in result.effects],
        equations=(*map(record.law_equation, result.fits), *(fit.equation for fit in result.joint.values())),
        errors=errors,
        curves=(*result.learning_curves, *yardsticks) if result.learning_curves else (),
    )


def _curve_scalars(
    curves: Mapping[str, LearningCurve], yardsticks: Mapping[str, ModelErrors]
) -> list[tuple[int, Scalars]]:
    """Every curve by number of training trials, and the bounds as horizontal lines."""
    found = []
    for place, size in enumerate(next(iter(curves.values())).sizes if curves else ()):
        values: dict[str, float | Interval] = {}
        for metric in metrics.METRICS:
            values |= {f"curve_{metric}/{model}": curve.of(metric)[place] for model, curve in curves.items()}
            values |= {f"curve_{metric}/{model}": errors.of(metric) for model, errors in yardsticks.items()}
        for model, curve in curves.items():
            if curve.calibration is not None:
                values[f"curve_coverage/{model}"] = curve.calibration.coverage[place]
                values[f"curve_negative_log_density/{model}"] = curve.calibration.negative_log_density[place]
        found.append((size, values))
    return found


def _laws_drawn(settings: EvaluateSettings, data: Split, compared: Comparison, on_event: OnEvent) -> dict[str, Figure]:
    """Convergence and cost surface of a law, per-trial parameters, and the curves of the effects, by file name."""
    most, shown, how = min(data.train_size, FITTED), settings.figures, settings.identification
    sizes = (
        torch.linspace(1, most, min(most, 120)).round().int().tolist()
    )  # every k up to 120, as many of a larger range
    pool = moved(data.pool, settings.device)
    convergence = fitting.identify_law(
        shown.surface, pool, how, data.generator, on_event, sizes=sizes, repetitions=shown.repetitions
    )
    surface = fitting.law_surface(shown.surface, pool, how)
    drawn = record.draw_effects(list(compared.joint.values())[-1].model, data.test) if compared.joint else {}
    per_trial = compared.trials[shown.parameters.name]
    return drawn | {
        "cost_surface": record.draw_cost_surface(moved(surface, "cpu")),
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
    """Errors of all models, the bound of contact patches, and one trial in impulse space, by file name."""
    test, how, axis = data.test, settings.identification, record.headline_axis(settings.norm)
    laws = {fit.law.name: fit.to_law() for fit in compared.fits}
    headline = metrics.METRICS[metrics.HEADLINE]
    per_trial = {name: headline.error(test, prediction) for name, prediction in held_out.predictions.items()}
    intervals = {name: (one.mean, one.low, one.high) for name, one in record.headline_errors(result.errors).items()}
    best = min(laws, key=lambda name: intervals[name])
    row = int(per_trial[best].argsort()[len(test) // 2]) if row is None else row
    levels = {name: intervals[name][0] for name in (best, BEST_POST_HOC)}
    widths, patched = _patch_curve(settings, data)
    return {
        "energy_ellipse": reachable_impulses(test, row, laws, how.box, target=how.target),
        "error_comparison": error_comparison(per_trial, intervals, axis),
        "patch_curve": patch_curve((1e3 * widths).tolist(), patched, levels, axis),
    }


def _patch_curve(settings: EvaluateSettings, data: Split) -> tuple[Float[Tensor, " w"], Float[Tensor, "w 3"]]:
    """Half-widths of contact patches in m, and the mean error of their bound with its interval."""
    widths = settings.patch * torch.linspace(0, 1, 25, dtype=torch.float64) ** 2  # dense where the bound falls
    test, headline = moved(data.test, settings.device), metrics.METRICS[metrics.HEADLINE]
    errors = moved(headline.error(test, bounds.irb(test, settings.norm, patch=widths[:, None])), "cpu")
    rows = [list(metrics.bootstrap(error, data.generator, settings.bootstrap)) for error in errors]
    return widths, torch.tensor(rows)


def _curves_drawn(
    result: Evaluation, curves: Mapping[str, Curve], test: Impacts, limits: Mapping[str, Prediction]
) -> dict[str, Figure]:
    """Learning curves, error densities at the largest size, and calibration, by file name."""
    sizes = next(iter(curves.values())).sizes
    drawn = {}
    for metric in (metrics.HEADLINE, "normalised_velocity_error"):
        suffix = "" if metric == metrics.HEADLINE else f"_{metric}"
        axis = f"{metrics.METRICS[metric].label} ({metrics.METRICS[metric].unit})"
        intervals = {name: as_rows(result.learning_curves[name].of(metric)) for name in curves}
        lines = {name: result.errors[name].of(metric) for name in limits}
        drawn[f"learning_curve{suffix}"] = learning.learning_curve(sizes, intervals, lines, axis)
        densities = {name: curve.errors[metric][-1].flatten() for name, curve in curves.items()}
        densities |= {name: metrics.METRICS[metric].error(test, bound) for name, bound in limits.items()}
        drawn[f"error_densities{suffix}"] = learning.error_densities(densities, axis)
    sure = {name: curve.density for name, curve in curves.items() if curve.density is not None}
    coverage = {name: metrics.calibration(density.distance[-1].flatten()) for name, density in sure.items()}
    return drawn | {"calibration": quality.calibration_curve(coverage)}
