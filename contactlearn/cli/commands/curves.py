"""Learning curves of an evaluation: every learned model, at every size, from every seed's subset."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.cli.commands import fitting
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.job import Run
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.core.events import track
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.metrics import Interval, Norm
from contactlearn.inference.learning import curves as study
from contactlearn.inference.learning.curves import Curve, CurvePoints, count_trainings
from contactlearn.inference.learning.events import CurvePoint
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.tensorboard import Tracker
from contactlearn.results.types import BEST_POST_HOC, CurveCalibration, LearningCurve

Bases = Mapping[str, Mapping[int, Law | ContactModel]]


def learning_study(
    settings: EvaluateSettings, data: Split, run: Run, tracker: Tracker
) -> tuple[dict[str, Curve], dict[str, dict[int, CurvePoint]]]:
    """Identify the laws and train the learned models on every subset.

    Returns:
        The curves by model, those of the laws first; and their points by model and size.

    Raises:
        DataError: fewer trials than the least of `curves.sizes`.
    """
    recipes, sizes = settings.learnable, [size for size in settings.curves.sizes if size <= len(data.pool)]
    if not sizes:
        least, there = settings.curves.sizes[0], f"{len(data.pool)} trials are there to draw from"
        raise DataError(f"{data.pool.source}: curves.sizes begin at {least}, but {there}")
    if skipped := ", ".join(name for name in settings.recipes if name not in recipes):
        terminal.print_line(
            f"note: {skipped} uses each trial's (μ, ε) of the law alone and is skipped when there are effects"
        )
    terminal.show_sizes(sizes, settings.curves.sizes, settings.curves.seeds, len(data.pool))
    terminal.show_reused_trainings(count_trainings(run.partial))
    orders = study.nested_orders(len(data.pool), settings.curves.seeds, data.generator)
    pool, test = moved((data.pool, data.test), settings.device)
    with progress(run.folder, tracker) as on_event:
        points = CurvePoints(sizes, test, seed=settings.seed, resamples=settings.bootstrap, on_event=on_event)
        bases, curves = _law_curves(settings, pool, test, orders, sizes, points, on_event)
        learned = study.learning_curves(
            recipes,
            pool,
            test,
            orders,
            sizes,
            bases,
            impulse=settings.train.target,
            box=settings.train.box,
            work=study.Work(processes=settings.processes, cache=run.partial, on_event=on_event),
            points=points,
        )
    return moved(curves | learned, "cpu"), points.by_model


def _law_curves(
    settings: EvaluateSettings,
    pool: Impacts,
    test: Impacts,
    orders: Tensor,
    sizes: list[int],
    points: CurvePoints,
    on_event: OnEvent,
) -> tuple[Bases, dict[str, Curve]]:
    """Laws on every subset, by name and size, and the curves of those that are shown; effects are around `law`."""
    law, effects, how = settings.law, settings.effects, settings.train
    needed = {**settings.laws, **{r.law.name: r.law for r in settings.learnable.values() if r.law}}
    bases: dict[str, Mapping[int, Law | ContactModel]] = {}
    shown: dict[str, Curve] = {}
    for name, needed_law in track(needed.items(), "laws on every subset", on_event):
        fits, curves = study.law_curves((needed_law,), pool, test, orders, sizes, target=how.target, box=how.box)
        bases[name] = {size: study.law_at(fits[name], size) for size in sizes}
        if name in settings.laws:
            shown[name] = curves[name]
            points.add(name, shown[name])
    shown[BEST_POST_HOC] = _best_post_hoc(test, {name: bases[name] for name in settings.laws}, settings.bounds.norm)
    points.add(BEST_POST_HOC, shown[BEST_POST_HOC])
    if effects:
        every = track(sizes, f"{law.name} and its effects on every subset", on_event)
        bases[law.name], curve = study.joint_curve(law, effects, pool, test, orders, every, settings.fit_options)
        shown[fitting.augmented_name(law.name, effects)] = curve
        points.add(fitting.augmented_name(law.name, effects), curve)
    return bases, shown


def _best_post_hoc(test: Impacts, by_law: Bases, norm: Norm) -> Curve:
    """The bound of laws by name and size, on each subset, in the metrics that it bounds."""
    best = {}
    for size in next(iter(by_law.values())):
        predictions = {name: ContactModel(laws[size]).predict(test) for name, laws in by_law.items()}
        best[size], _ = bounds.best_post_hoc(test, predictions, norm)
    curve = Curve.of(test, best)
    return replace(curve, errors={metric: curve.errors[metric] for metric in metrics.bounded_metrics(norm)})


def curve_entry(
    curve: Curve, levels: Mapping[str, Mapping[str, Sequence[float]]], points: Mapping[int, CurvePoint]
) -> LearningCurve:
    """Return one model's curve as numbers; `levels` are mean errors of the bounds by metric and name at each size."""
    intervals, below, settled = {}, {}, {}
    for metric in curve.errors:
        intervals[metric] = tuple(points[size].errors[metric] for size in curve.sizes)
        mean = curve.errors[metric].mean((1, 2)).tolist()
        if metric in levels:
            below[metric] = {
                name: study.first_below(mean, curve.sizes, level) for name, level in levels[metric].items()
            }
        settled[metric] = study.settled(mean, curve.sizes)
    calibration, density = None, curve.density
    if density is not None:
        calibration = CurveCalibration(
            processes=curve.kinds,
            converged=curve.converged,
            negative_log_density=tuple(density.negative_log.mean((1, 2)).tolist()),
            coverage=tuple(density.coverage.mean(1).tolist()),
            component_coverage=tuple(map(tuple, density.covered.double().mean((1, 2)).tolist())),
        )
    return LearningCurve(sizes=curve.sizes, **intervals, below=below, settled=settled, calibration=calibration)


def as_rows(intervals: tuple[Interval, ...]) -> Float[Tensor, "n 3"]:
    """Return intervals as rows (mean, low, high)."""
    return torch.tensor([list(interval) for interval in intervals], dtype=torch.float64)
