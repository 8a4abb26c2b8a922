"""The learning curves of an evaluation: every learned model, at every size, from every seed's subset."""

from dataclasses import asdict
from pathlib import Path

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig
from torch import Tensor

from contactlearn.app import record as run
from contactlearn.app import settings
from contactlearn.errors import DataError
from contactlearn.evaluation import metrics
from contactlearn.impacts import Impacts, Prediction
from contactlearn.learning import curves as study
from contactlearn.report import terminal
from contactlearn.report.figures import learning, quality
from contactlearn.report.tables import save_curves
from contactlearn.report.tensorboard import Tracker


def learning_study(
    cfg: DictConfig,
    pool: Impacts,
    test: Impacts,
    yardsticks: dict[str, Prediction],
    generator: torch.Generator,
    folder: Path,
) -> tuple[dict, dict[str, Figure]]:
    """Train, score and print; the entry for results.json and the figures.

    Curves of the laws, identified on the same subsets, are part of the entry and the tables.
    """
    recipes = settings.recipes_around(cfg)
    terminal.show_left_out([name for name in settings.recipes(cfg) if name not in recipes])
    if len(pool) < min(cfg.curves.sizes):
        least = min(cfg.curves.sizes)
        raise DataError(f"{pool.source}: curves.sizes begin at {least}, but {len(pool)} trials are there to draw from")
    sizes = [size for size in cfg.curves.sizes if size <= len(pool)]
    terminal.show_sizes(sizes, cfg.curves.sizes, cfg.curves.seeds, len(pool))
    orders = study.nested_orders(len(pool), cfg.curves.seeds, generator)
    law, options = settings.law(cfg), {"target": cfg.train.target, "box": run.box(cfg)}
    needed = settings.named_laws(cfg, cfg.laws) | {r.law.name: r.law for r in recipes.values() if r.law}
    with terminal.progress() as bar:
        fits, law_curves = study.law_curves(
            bar.track(needed.values(), description="laws on every subset"), pool, test, orders, sizes, **options
        )
        bases = {name: {size: study.law_at(fit, size) for size in sizes} for name, fit in fits.items()}
        augmented = {}
        if effects := settings.effects(cfg):
            every = bar.track(sizes, description=f"{law.name} and its effects on every subset")
            bases[law.name], curve = study.effect_curve(law, effects, pool, test, orders, every, run.fit_options(cfg))
            augmented = {run.augmented_name(law.name, effects): curve}
        learned = study.learning_curves(
            recipes,
            pool,
            test,
            orders,
            sizes,
            bases,
            impulse=cfg.train.target,
            box=run.box(cfg),
            workers=run.workers(cfg),
            progress=lambda done, total: bar.track(done, total, description="learned models"),
        )
    curves = {name: law_curves[name] for name in cfg.laws} | augmented | learned
    levels = {name: _all_errors(test, prediction) for name, prediction in yardsticks.items()}
    entry = {name: _entry(curve, levels, generator, cfg.bootstrap) for name, curve in curves.items()}
    terminal.show_curves({name: entry[name] for name in augmented | learned}, sizes)
    save_curves(curves, folder / f"learning_curves.{cfg.tables}")
    return entry, _figures(cfg, augmented | learned, levels, generator)


def _all_errors(test: Impacts, prediction: Prediction) -> dict[str, Tensor]:
    return {name: metric.error(test, prediction) for name, metric in metrics.METRICS.items()}


def _entry(curve: study.Curve, levels: dict, generator: torch.Generator, resamples: int) -> dict:
    """One model's curve as results.json holds it."""
    entry = {"sizes": list(curve.sizes), "below": {}, "settled": {}}
    for metric in metrics.METRICS:
        intervals = curve.intervals(metric, generator, resamples)
        entry[metric] = [asdict(metrics.Interval(*interval)) for interval in intervals.tolist()]
        mean = curve.errors[metric].mean((1, 2)).tolist()
        below = {
            name: study.first_below(mean, curve.sizes, errors[metric].mean().item()) for name, errors in levels.items()
        }
        entry["below"][metric], entry["settled"][metric] = below, study.settled(mean, curve.sizes)
    if curve.density is not None:
        entry["processes"], entry["converged"] = list(curve.kinds), list(curve.converged)
        entry["negative_log_density"] = curve.density.mean((1, 2)).tolist()
        entry["coverage"] = (curve.distance <= metrics.CHI_SQUARED_95).double().mean((1, 2)).tolist()
        entry["component_coverage"] = curve.covered.double().mean((1, 2)).tolist()
    return entry


def log_curves(tracker: Tracker, entry: dict, bounds: dict) -> None:
    """Every curve and, as lines beside them, the bounds' entries of an error table."""
    for place, size in enumerate(next(iter(entry.values()))["sizes"]):
        rows = {model: {metric: curve[metric][place] for metric in metrics.METRICS} for model, curve in entry.items()}
        values = {
            f"curve_{metric}/{model}": metrics.Interval(**row[metric])
            for model, row in (rows | bounds).items()
            for metric in metrics.METRICS
        }
        for model, curve in entry.items():
            if "coverage" in curve:
                values[f"curve_coverage/{model}"] = curve["coverage"][place]
                values[f"curve_negative_log_density/{model}"] = curve["negative_log_density"][place]
        tracker.scalars(values, size)


def _figures(cfg: DictConfig, curves: dict, levels: dict, generator: torch.Generator) -> dict[str, Figure]:
    sizes = next(iter(curves.values())).sizes
    drawn = {}
    for metric in (metrics.HEADLINE, "normalised_velocity_error"):
        suffix = "" if metric == metrics.HEADLINE else f"_{metric}"
        axis = f"{metrics.METRICS[metric].label} ({metrics.METRICS[metric].unit})"
        intervals = {name: curve.intervals(metric, generator, cfg.bootstrap) for name, curve in curves.items()}
        lines = {name: metrics.bootstrap(errors[metric], generator, cfg.bootstrap) for name, errors in levels.items()}
        drawn[f"learning_curve{suffix}"] = learning.learning_curve(sizes, intervals, lines, axis)
        densities = {name: curve.errors[metric][-1].flatten() for name, curve in curves.items()}
        densities |= {name: errors[metric] for name, errors in levels.items()}
        drawn[f"error_densities{suffix}"] = learning.error_densities(densities, axis)
    sure = {name: curve for name, curve in curves.items() if curve.distance is not None}
    coverage = {name: metrics.calibration(curve.distance[-1].flatten()) for name, curve in sure.items()}
    return drawn | {"calibration": quality.calibration(coverage)}
