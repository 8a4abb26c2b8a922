"""Learning curves: the held-out errors of models against their number of training trials.

Each seed draws one random order of the pool; the subset of size n is its first n trials, so subsets
are nested along a curve and the same for every model.  Laws are identified and processes trained on
the subset alone; all seeds of a model at one size are one batch.

Finished trainings may be kept on disk, one NumPy file each, so that curves that were stopped resume.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.core.events import ignore, track
from contactlearn.core.numerics import atomic_write
from contactlearn.core.workers import WorkerPool
from contactlearn.effects import Effect
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.result import Box, SubsetFit
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.inference.learning.events import CurvePoint, OnLearningEvent
from contactlearn.inference.learning.recipe import Recipe, learn, named_numbers, trained_numbers
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import RESIDUALS, ContactModel


@dataclass(frozen=True, kw_only=True)
class Trained:
    """A model trained on subsets of one size, for the held-out trials."""

    key: tuple[str, ...]  # of the curve
    size: int
    prediction: Prediction
    kind: str  # of the processes
    converged: float  # share of the processes whose training converged
    loss: tuple[float, ...]  # of each output in nats a trial, mean over the subsets
    noise: tuple[float, ...]  # standard deviation of each output in its unit, likewise
    length_scales: tuple[tuple[float, ...], ...]  # of each output, by feature; infinite where it is constant


def save_trained(folder: Path, trained: Trained) -> None:
    """Write a finished training.

    Raises:
        OSError: the file cannot be written.
    """
    prediction = moved(trained.prediction, "cpu")
    arrays = {"v_post": prediction.v_post.numpy(), "wrench": prediction.wrench.numpy()}
    arrays |= {"kind": np.array(trained.kind), "converged": np.array(trained.converged)}
    arrays |= {name: np.array(getattr(trained, name)) for name in ("loss", "noise", "length_scales")}
    if prediction.covariance is not None:
        arrays["covariance"] = prediction.covariance.numpy()
    gone = suppress(FileNotFoundError)  # another run of the same command has ended and removed the folder
    with gone, atomic_write(_path(folder, trained.key, trained.size)) as part:
        np.savez(part, allow_pickle=False, **arrays)


def load_trained(folder: Path, key: tuple[str, ...], size: int) -> Trained | None:
    """Read a training; None if it was not finished."""
    try:
        with _path(folder, key, size).open("rb") as file, np.load(file, allow_pickle=False) as held:
            prediction = Prediction(
                torch.from_numpy(held["v_post"]),
                torch.from_numpy(held["wrench"]),
                torch.from_numpy(held["covariance"]) if "covariance" in held else None,
            )
            return Trained(
                key=key,
                size=size,
                prediction=prediction,
                kind=str(held["kind"]),
                converged=float(held["converged"]),
                loss=tuple(held["loss"].tolist()),
                noise=tuple(held["noise"].tolist()),
                length_scales=tuple(map(tuple, held["length_scales"].tolist())),
            )
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile, zlib.error):
        return None


def count_trainings(folder: Path) -> int:
    """Count the finished trainings in a folder and below it; those that were being written are in hidden folders."""
    return sum(not path.parent.name.startswith(".") for path in folder.rglob("*.npz"))


def _path(folder: Path, key: tuple[str, ...], size: int) -> Path:
    return folder / "-".join(key) / f"{size}.npz"


Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class Work:
    """How trainings are run.

    Args:
        processes: number of processes; 1 trains in this one.
        cache: folder of finished trainings with the same trials, recipes and options, which are not repeated.
        task: what a user is told that the trainings are.
        on_event: receives how many of them are done.
    """

    processes: int = 1
    cache: Path | None = None
    task: str = "learned models"
    on_event: OnLearningEvent = ignore


@dataclass(frozen=True, kw_only=True)
class CurveDensity:
    """Predicted densities of the measured v_post of N held-out trials, as `Curve.errors`."""

    negative_log: Tensor  # −log density, [S, R, N] in nats
    distance: Tensor  # squared Mahalanobis distance, [S, R, N]
    covered: Tensor  # whether each component is in its 95 % interval, [S, R, N, D] bool

    @property
    def coverage(self) -> Tensor:
        """Share of the trials inside the predicted 95 % ellipsoid, [S, R]."""
        return (self.distance <= metrics.CHI_SQUARED_95[self.covered.shape[-1]]).double().mean(-1)


@dataclass(frozen=True)
class Curve:
    """Scores of one model on N held-out trials at S sizes, trained on R random subsets each."""

    sizes: tuple[int, ...]
    errors: dict[str, Tensor]  # by name of `metrics.METRICS`, [S, R, N]
    density: CurveDensity | None = None  # of a model that predicts covariances
    kinds: tuple[str, ...] = ()  # of the processes, at each size
    converged: tuple[float, ...] = ()  # share of the processes whose training converged, at each size

    @classmethod
    def of(cls, impacts: Impacts, predictions: Mapping[int, Prediction]) -> "Curve":
        """Score predictions [R, N], or [N] of a single subset, by size."""
        ordered = [predictions[size] for size in sorted(predictions)]

        def scores(score: Callable[[Impacts, Prediction], Tensor], tail: int = 0) -> Tensor:
            values = torch.stack([score(impacts, prediction) for prediction in ordered])
            return values if values.ndim == 3 + tail else values[:, None]

        errors = {name: scores(metric.error) for name, metric in metrics.METRICS.items()}
        sizes = tuple(sorted(predictions))
        if ordered[0].covariance is None:
            return cls(sizes, errors)
        density = CurveDensity(
            negative_log=scores(metrics.negative_log_density),
            distance=scores(metrics.squared_distance),
            covered=scores(metrics.covered, 1),
        )
        return cls(sizes, errors, density)

    def intervals(self, metric: str, generator: torch.Generator, resamples: int) -> tuple[Interval, ...]:
        """Compute the mean of a metric and its 95 % interval over trials and subsets at each size."""
        return tuple(metrics.bootstrap(error, generator, resamples) for error in self.errors[metric])


class CurvePoints:
    """Points of learning curves, each reported as soon as it and all before it on its curve are there.

    All have the same resamples of the trials, so that they depend neither on each other nor on their order.

    Args:
        sizes: of the curves, increasing.
        test: the held-out trials.
        seed, resamples: of the bootstrap.
        on_event: receives a `CurvePoint` for each.
    """

    def __init__(
        self, sizes: Sequence[int], test: Impacts, *, seed: int, resamples: int, on_event: OnLearningEvent
    ) -> None:
        self._sizes, self._space, self._groups = sizes, test.space, test.groups
        self._seed, self._resamples, self._on_event = seed, resamples, on_event
        self.by_model = dict[str, dict[int, CurvePoint]]()

    def add(self, model: str, curve: Curve, trained: Trained | None = None, recipe: Recipe | None = None) -> None:
        """Score some sizes of a model; of one that is trained by a recipe, a single size."""
        loss, noise, lengths = {}, {}, {}
        if trained is not None and recipe is not None:
            loss, noise, lengths = named_numbers(
                recipe, self._space, trained.loss, trained.noise, trained.length_scales
            )
        points = self.by_model.setdefault(model, {})
        before = len(self._reported(points))
        for place, size in enumerate(curve.sizes):
            generator, density = torch.Generator().manual_seed(self._seed), curve.density
            points[size] = CurvePoint(
                model=model,
                trained_on=size,
                errors={
                    name: metrics.bootstrap(error[place], generator, self._resamples, groups=self._groups)
                    for name, error in curve.errors.items()
                },
                loss=loss,
                noise=noise,
                length_scales=lengths,
                negative_log_density=None if density is None else density.negative_log[place].mean().item(),
                coverage=None if density is None else density.coverage[place].mean().item(),
            )
        for size in self._reported(points)[before:]:
            self._on_event(points[size])

    def _reported(self, points: Mapping[int, CurvePoint]) -> list[int]:
        """Sizes up to the first that is missing."""
        return list(takewhile(lambda size: size in points, self._sizes))


def nested_orders(trials: int, seeds: int, generator: torch.Generator) -> Tensor:
    """Draw a random order of the trials for each seed, [seeds, trials]."""
    return torch.stack([torch.randperm(trials, generator=generator) for _ in range(seeds)])


def law_curves(
    laws: Iterable[Law],
    pool: Impacts,
    test: Impacts,
    orders: Int[Tensor, "r k"],
    sizes: Sequence[int],
    *,
    target: str = "momentum",
    box: Box | None = None,
) -> tuple[dict[str, SubsetFit], dict[str, Curve]]:
    """Identify laws on every subset, and compute their curves; `target` and `box` are those of `fit_subsets`."""
    fits = {law.name: fit_subsets(pool, law, sizes=sizes, orders=orders, target=target, box=box) for law in laws}
    curves = {}
    for name, fit in fits.items():
        predictions = {size: ContactModel(law_at(fit, size)).predict(test) for size in sizes}
        curves[name] = Curve.of(test, predictions)
    return fits, curves


def joint_curve(
    law: Law,
    effects: Mapping[str, Effect],
    pool: Impacts,
    test: Impacts,
    orders: Tensor,
    sizes: Iterable[int],
    options: FitOptions,
) -> tuple[dict[int, ContactModel], Curve]:
    """Fit a law with effects to every subset; return the models by size, and their curve."""
    models = {size: joint.fit(pool, law, effects, rows=orders[:, :size], options=options).model for size in sizes}
    return models, Curve.of(test, {size: model.predict(test) for size, model in models.items()})


def law_at(fit: SubsetFit, size: int) -> Law:
    """Return the law with the parameters [R, 1] of each subset of that size."""
    place = fit.sizes.index(size)
    return fit.law.at(fit.mu[:, place, None], fit.eps[:, place, None])


def learning_curves(
    recipes: Mapping[str, Recipe],
    pool: Impacts,
    test: Impacts,
    orders: Tensor,
    sizes: Sequence[int],
    bases: Mapping[str, Mapping[int, Law | ContactModel]],
    *,
    impulse: str = "momentum",
    box: Box | None = None,
    work: Work = Work(),
    points: CurvePoints | None = None,
) -> dict[str, Curve]:
    """Train models on every subset, and compute their curves.

    Args:
        recipes: by name of the model.
        pool, test: trials to learn from, and trials held out.
        orders: of the pool's trials, [R, N], see `nested_orders`.
        sizes: of the subsets, increasing.
        bases: by law and size, the law that a recipe names as identified on these subsets, see `law_at`, with its
            effects if it has any.
        impulse, box: see `learning.learn`.
        work: how the trainings are run.
        points: take each training as soon as it is there, and report it.
    """
    trainings = [
        _Training(
            key=(name,),
            size=size,
            recipe=recipe,
            pool=pool,
            test=test,
            rows=orders[:, :size],
            base=bases[recipe.law.name][size] if recipe.law else None,
            impulse=impulse,
            box=box,
        )
        for size in sorted(sizes)  # so that the curves grow
        for name, recipe in recipes.items()
    ]
    found: list[Trained] = []
    for trained in _trained(trainings, work):
        found.append(trained)
        if points is not None:
            (name,) = trained.key
            points.add(name, Curve.of(test, {trained.size: trained.prediction}), trained, recipes[name])
    return {name: _curve(test, [one for one in found if one.key == (name,)]) for name in recipes}


@dataclass(frozen=True, kw_only=True)
class _Training:
    """A model to train on subsets of one size: the arguments of `learn`, and the trials to predict."""

    key: tuple[str, ...]
    size: int
    recipe: Recipe
    pool: Impacts
    test: Impacts
    rows: Tensor
    base: Law | ContactModel | None
    impulse: str
    box: Box | None

    def run(self) -> Trained:
        """Train the model and predict the held-out trials."""
        model = learn(self.pool, self.recipe, rows=self.rows, base=self.base, impulse=self.impulse, box=self.box)
        processes = model.processes
        loss, noise, length_scales = trained_numbers(processes)
        return Trained(
            key=self.key,
            size=self.size,
            prediction=model.predict(self.test),
            kind=processes.kind,
            converged=processes.training.converged.double().mean().item(),
            loss=loss,
            noise=noise,
            length_scales=length_scales,
        )


def _trained(trainings: Sequence[_Training], work: Work) -> Iterator[Trained]:
    """Run the trainings that the cache does not hold; cache each that is finished, and report their number."""

    def every() -> Iterator[Trained]:
        missing = []
        for one in trainings:
            held = load_trained(work.cache, one.key, one.size) if work.cache is not None else None
            if held is None:
                missing.append((one,))
            else:
                yield moved(held, one.test.v_post.device)
        for trained in run(_Training.run, missing, work.processes):
            if work.cache is not None:
                save_trained(work.cache, trained)
            yield trained

    yield from track(every(), work.task, work.on_event, len(trainings))


def _curve(test: Impacts, trained: Iterable[Trained]) -> Curve:
    """From the models of one curve at each size."""
    ordered = sorted(trained, key=lambda one: one.size)
    curve = Curve.of(test, {one.size: one.prediction for one in ordered})
    return replace(curve, kinds=tuple(one.kind for one in ordered), converged=tuple(one.converged for one in ordered))


def transfer_curves(
    recipe: Recipe,
    source: Impacts,
    bodies: Mapping[str, tuple[Impacts, Impacts]],
    sizes: Sequence[int],
    seeds: int,
    generator: torch.Generator,
    *,
    impulse: str = "momentum",
    box: Box | None = None,
    work: Work = Work(),
) -> tuple[ContactModel, dict[str, dict[str, Curve]]]:
    """Train a model on one body, and compute its curves on others.

    Args:
        recipe: of the model; a learned one.
        source: the trials that it is trained on, all of them.
        bodies: (pool, held-out trials) of other bodies by name.
        sizes: numbers of trials of the other body, increasing.
        seeds: random subsets at each size.
        generator: source of the subsets.
        impulse, box, work: see `learning_curves`.

    Returns:
        The model, and by body the curves `zero_shot` (the model as it is; one size, 0), `prior` (the
        model with processes on its residual, trained on the body's trials) and `scratch` (the recipe
        trained on the body's trials alone).
    """
    model = learn(source, recipe, impulse=impulse, box=box)
    correction = recipe if recipe.target in RESIDUALS else replace(recipe, target="impulse")
    curves, trainings = {}, []
    for body, (pool, test) in bodies.items():
        if max(sizes) > len(pool):
            raise DataError(f"{body}: {max(sizes)} trials were requested, but {len(pool)} are there to draw from")
        curves[body] = {"zero_shot": Curve.of(test, {0: model.predict(test)})}
        orders = nested_orders(len(pool), seeds, generator)
        fit = None
        if recipe.law:
            fit = fit_subsets(pool, recipe.law, sizes=sizes, orders=orders, target=impulse, box=box)
        for size in sorted(sizes, reverse=True):
            rows, law = orders[:, :size], fit and law_at(fit, size)
            training = partial(_Training, size=size, pool=pool, test=test, rows=rows, impulse=impulse, box=box)
            trainings.append(training(key=(body, "prior"), recipe=correction, base=model))
            trainings.append(training(key=(body, "scratch"), recipe=recipe, base=law))
    found = list(_trained(trainings, work))
    for body, (_, test) in bodies.items():
        for way in ("prior", "scratch"):
            curves[body][way] = _curve(test, [one for one in found if one.key == (body, way)])
    return model, curves


def run(job: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], workers: int) -> Iterable[Result]:
    """Run job(*task) in `workers` processes of one thread each; yield the results in the order of their completion."""
    if min(workers, len(tasks)) <= 1:
        yield from (job(*task) for task in tasks)
        return
    with WorkerPool(min(workers, len(tasks))) as pool:
        futures = [pool.submit(job, *task) for task in tasks]
        yield from (future.result() for future in as_completed(futures))


def first_below(curve: Sequence[float], sizes: Sequence[int], reference: Sequence[float]) -> int | None:
    """Find the smallest size at which the curve is below a reference curve; None if it never is."""
    return next((size for size, a, b in zip(sizes, curve, reference, strict=True) if a < b), None)


def settled(curve: Sequence[float], sizes: Sequence[int]) -> int | None:
    """Find the size from which on the curve is within 5 % of its minimum; None if its last value is not."""
    least = min(curve)
    late = [value > 1.05 * least for value in curve]
    if late[-1]:
        return None
    return sizes[len(late) - late[::-1].index(True)] if any(late) else sizes[0]
