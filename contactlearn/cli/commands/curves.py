"""The learning curves of an evaluation: every learned model, at every size, from every seed's subset."""

from collections.abc import Mapping
from pathlib import Path

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig
from torch import Tensor

from contactlearn.cli.commands import fitting, results, settings
from contactlearn.cli.commands.laws import compared_laws, given_law
from contactlearn.cli.commands.loading import Split
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.diagnosis.events import OnEvent, track
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.learning import curves as study
from contactlearn.inference.learning.curves import Curve
from contactlearn.inference.learning.kept import kept_trainings
from contactlearn.inference.learning.recipe import Recipe
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import learning, quality
from contactlearn.report.tensorboard import Tracker
from contactlearn.results.estimates import ModelErrors
from contactlearn.results.evaluation import CurveCalibration, Evaluation, LearningCurve

Bases = Mapping[str, Mapping[int, Law | ContactModel]]


def learning_study(cfg: DictConfig, data: Split, kept: Path) -> tuple[dict[str, Curve], list[str]]:
    """Identify the laws and train the learned models on every subset; `kept` is the folder of finished trainings.

    Returns:
        The curves by model, and the names of those that are no law alone.

    Raises:
        DataError: fewer trials than the least of `curves.sizes`.
    """
    recipes, sizes = settings.recipes_around(cfg), _sizes(cfg, data.pool)
    terminal.show_left_out([name for name in settings.recipes(cfg) if name not in recipes])
    terminal.show_sizes(sizes, cfg.curves.sizes, cfg.curves.seeds, len(data.pool))
    terminal.show_kept(kept_trainings(kept))
    orders = study.nested_orders(len(data.pool), cfg.curves.seeds, data.generator)
    pool, test = moved((data.pool, data.test), settings.device(cfg))
    with progress(results.run_folder()) as on_event:
        bases, curves = _law_curves(cfg, recipes, pool, test, orders, sizes, on_event)
        learned = study.learning_curves(
            recipes,
            pool,
            test,
            orders,
            sizes,
            bases,
            impulse=cfg.train.target,
            box=settings.box(cfg),
            work=study.Work(
                processes=fitting.workers(cfg),
                kept=kept,
                progress=lambda done, total: track(done, "learned models", on_event, total),
            ),
        )
    curves = moved(curves | learned, "cpu")
    return curves, [name for name in curves if name not in compared_laws(cfg)]


def _sizes(cfg: DictConfig, pool: Impacts) -> list[int]:
    """The sizes of `curves.sizes` that the pool can give."""
    least = min(cfg.curves.sizes)
    if len(pool) < least:
        raise DataError(f"{pool.source}: curves.sizes begin at {least}, but {len(pool)} trials are there to draw from")
    return [size for size in cfg.curves.sizes if size <= len(pool)]


def _law_curves(
    cfg: DictConfig,
    recipes: Mapping[str, Recipe],
    pool: Impacts,
    test: Impacts,
    orders: Tensor,
    sizes: list[int],
    on_event: OnEvent,
) -> tuple[Bases, dict[str, Curve]]:
    """Laws on every subset, by name and size, and the curves of those that are shown; effects are around `law`."""
    law, laws, effects = given_law(cfg), compared_laws(cfg), settings.effects(cfg)
    needed = laws | {r.law.name: r.law for r in recipes.values() if r.law}
    every = track(needed.values(), "laws on every subset", on_event)
    fits, curves = study.law_curves(every, pool, test, orders, sizes, target=cfg.train.target, box=settings.box(cfg))
    bases: dict[str, Mapping[int, Law | ContactModel]] = {
        name: {size: study.law_at(fit, size) for size in sizes} for name, fit in fits.items()
    }
    shown = {name: curves[name] for name in laws}
    if effects:
        every = track(sizes, f"{law.name} and its effects on every subset", on_event)
        bases[law.name], curve = study.joint_curve(law, effects, pool, test, orders, every, settings.fit_options(cfg))
        shown[fitting.augmented_name(law.name, effects)] = curve
    return bases, shown


def curve_entry(
    curve: Curve, levels: Mapping[str, Mapping[str, float]], generator: torch.Generator, resamples: int
) -> LearningCurve:
    """Return one model's curve as numbers; `levels` are mean errors of the bounds by name and metric."""
    intervals, below, settled = {}, {}, {}
    for metric in metrics.METRICS:
        rows = curve.intervals(metric, generator, resamples)
        intervals[metric] = tuple(Interval(*row) for row in rows.tolist())
        mean = curve.errors[metric].mean((1, 2)).tolist()
        below[metric] = {name: study.first_below(mean, curve.sizes, level[metric]) for name, level in levels.items()}
        settled[metric] = study.settled(mean, curve.sizes)
    return LearningCurve(sizes=curve.sizes, **intervals, below=below, settled=settled, calibration=_calibration(curve))


def mean_errors(test: Impacts, predictions: Mapping[str, Prediction]) -> dict[str, dict[str, float]]:
    """Return the mean of every metric by model."""
    return {
        name: {key: metric.error(test, prediction).mean().item() for key, metric in metrics.METRICS.items()}
        for name, prediction in predictions.items()
    }


def _calibration(curve: Curve) -> CurveCalibration | None:
    density = curve.density
    if density is None:
        return None
    return CurveCalibration(
        processes=curve.kinds,
        converged=curve.converged,
        negative_log_density=tuple(density.negative_log.mean((1, 2)).tolist()),
        coverage=tuple((density.distance <= metrics.CHI_SQUARED_95).double().mean((1, 2)).tolist()),
        component_coverage=tuple(map(tuple, density.covered.double().mean((1, 2)).tolist())),
    )


def log_curves(tracker: Tracker, curves: Mapping[str, LearningCurve], bounds: Mapping[str, ModelErrors]) -> None:
    """Log every curve and, as lines beside them, the bounds."""
    for place, size in enumerate(next(iter(curves.values())).sizes):
        values = {}
        for metric in metrics.METRICS:
            values |= {f"curve_{metric}/{model}": curve.of(metric)[place] for model, curve in curves.items()}
            values |= {f"curve_{metric}/{model}": errors.of(metric) for model, errors in bounds.items()}
        for model, curve in curves.items():
            if curve.calibration is not None:
                values[f"curve_coverage/{model}"] = curve.calibration.coverage[place]
                values[f"curve_negative_log_density/{model}"] = curve.calibration.negative_log_density[place]
        tracker.scalars(values, size)


def draw_curves(
    result: Evaluation, curves: Mapping[str, Curve], test: Impacts, bounds: Mapping[str, Prediction]
) -> dict[str, Figure]:
    """Draw learning curves, error densities at the largest size, and calibration, by file name."""
    sizes = next(iter(curves.values())).sizes
    drawn = {}
    for metric in (metrics.HEADLINE, "normalised_velocity_error"):
        suffix = "" if metric == metrics.HEADLINE else f"_{metric}"
        axis = f"{metrics.METRICS[metric].label} ({metrics.METRICS[metric].unit})"
        entries = {name: result.learning_curves[name].of(metric) for name in curves}
        intervals = {
            name: torch.tensor([list(one) for one in rows], dtype=torch.float64) for name, rows in entries.items()
        }
        lines = {name: result.errors[name].of(metric) for name in bounds}
        drawn[f"learning_curve{suffix}"] = learning.learning_curve(sizes, intervals, lines, axis)
        densities = {name: curve.errors[metric][-1].flatten() for name, curve in curves.items()}
        densities |= {name: metrics.METRICS[metric].error(test, bound) for name, bound in bounds.items()}
        drawn[f"error_densities{suffix}"] = learning.error_densities(densities, axis)
    sure = {name: curve.density for name, curve in curves.items() if curve.density is not None}
    coverage = {name: metrics.calibration(density.distance[-1].flatten()) for name, density in sure.items()}
    return drawn | {"calibration": quality.calibration_curve(coverage)}
