"""A model trained on one body, on other bodies: as it is, and corrected from few of their trials."""

from dataclasses import asdict
from pathlib import Path

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.commands import fitting, loading, record, results, settings
from contactlearn.cli.commands.laws import given_law
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.parts import forget, parts_folder
from contactlearn.cli.commands.plain import plain_values
from contactlearn.core.devices import moved
from contactlearn.diagnosis.events import track
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.learning import curves as study
from contactlearn.inference.learning.curves import Curve
from contactlearn.inference.learning.kept import kept_trainings
from contactlearn.inference.learning.recipe import Recipe
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import learning
from contactlearn.report.tensorboard import Tracker
from contactlearn.results import folder as run_folder
from contactlearn.results.transfer import BodyTransfer, Transfer

_ORDER = ("zero_shot", "prior", "scratch")  # of the resamples, whatever is trained first
WAYS = {"scratch": "From scratch", "prior": "Trained model as prior"}

Bodies = dict[str, tuple[Impacts, Impacts]]
"""Pool and held-out trials by body."""


def transfer(cfg: DictConfig) -> None:
    """Train each model on `train.size` trials of the data's body, and follow it on each of `transfer.bodies`.

    The two questions that end the paper: how good is the model on another body, and does it make
    fewer trials of that body enough?
    """
    folder = results.run_folder()
    data = loading.split(cfg, folder)
    loading.show_split(data, cfg.device, settings.device(cfg))
    source = data.pool[torch.randperm(len(data.pool), generator=data.generator)[: cfg.train.size]]
    bodies = _bodies(cfg, data)
    provenance = results.provenance(data.blocks, cfg)
    found, parts = {}, parts_folder(cfg)
    terminal.show_kept(kept_trainings(parts))
    for name, recipe in settings.recipes(cfg).items():
        model, curves = _transferred(cfg, name, recipe, source, bodies, data.generator, parts / name)
        checkpoint.save(model, folder / f"{name}.pt", provenance=asdict(provenance))
        found[name] = {
            body: BodyTransfer(**{way: _intervals(cfg, ways[way], data.generator) for way in _ORDER})
            for body, ways in curves.items()
        }
    result = Transfer(provenance=provenance, sizes=tuple(cfg.transfer.sizes), transfer=found)
    run_folder.write_result(folder, result)
    for name, entries in found.items():
        terminal.show_transfer(name, entries, result.sizes)
    _record(cfg, folder, result)
    forget(parts)
    terminal.show_folder(folder)


def _bodies(cfg: DictConfig, data: Split) -> Bodies:
    """Load and split the other bodies; those without a source of their own are the data with some changes."""
    bodies = {}
    for name, changes in plain_values(cfg.transfer.bodies).items():
        same = {} if "_target_" in changes else plain_values(cfg.data)
        bodies[name] = loading.load_data(OmegaConf.create({**same, **changes})).split(cfg.test, data.generator)
    return bodies


def _transferred(
    cfg: DictConfig, name: str, recipe: Recipe, source: Impacts, bodies: Bodies, generator: torch.Generator, kept: Path
) -> tuple[ContactModel, dict[str, dict[str, Curve]]]:
    """Train one model, and compute its curves by body and way."""
    source, bodies = moved((source, bodies), settings.device(cfg))
    with progress(results.run_folder()) as on_event:
        found = study.transfer_curves(
            recipe,
            source,
            bodies,
            list(cfg.transfer.sizes),
            cfg.transfer.seeds,
            generator,
            impulse=cfg.train.target,
            box=settings.box(cfg),
            work=study.Work(
                processes=fitting.workers(cfg),
                kept=kept,
                progress=lambda done, total: track(done, f"transfer of {name}", on_event, total),
            ),
        )
    return moved(found, "cpu")


def _intervals(cfg: DictConfig, curve: Curve, generator: torch.Generator) -> tuple[Interval, ...]:
    rows = curve.intervals(metrics.HEADLINE, generator, cfg.bootstrap)
    return tuple(Interval(*row) for row in rows.tolist())


def _record(cfg: DictConfig, folder: Path, result: Transfer) -> None:
    """Log the result to TensorBoard, and save the figures."""
    headline = f"transfer_{metrics.HEADLINE}"
    with Tracker(folder, cfg.train.size) as tracker:
        for name, bodies in result.transfer.items():
            for place, size in enumerate(result.sizes):
                for body, found in bodies.items():
                    tags = {f"{headline}/{body}/{name}/{way}": getattr(found, way)[place] for way in WAYS}
                    tracker.scalars(tags, size)
        record.save_figures(_drawn(cfg, result), folder, tracker)
        chart = {"Each model from scratch, and with the trained one as prior": [f"{headline}/"]}
        tracker.charts(record.charts() | {"Transfer to other bodies, against their training impacts": chart})
        source, models = result.provenance.data.source, ", ".join(result.transfer)
        record.log_hyperparameters(tracker, cfg, source, cfg.train.size, given_law(cfg).name, (), models)
        record.log_card(tracker, result.provenance, (), {})


def _drawn(cfg: DictConfig, result: Transfer) -> dict[str, Figure]:
    """Draw the curves of every model on the other bodies, by file name."""
    return {
        f"transfer_{name}": learning.transfer_errors(
            result.sizes,
            {
                body: {label: _rows(getattr(found, way)) for way, label in WAYS.items()}
                for body, found in bodies.items()
            },
            {body: tuple(found.zero_shot[0]) for body, found in bodies.items()},
            record.headline_axis(cfg),
        )
        for name, bodies in result.transfer.items()
    }


def _rows(intervals: tuple[Interval, ...]) -> torch.Tensor:
    """As rows (mean, low, high) of a tensor."""
    return torch.tensor([list(one) for one in intervals], dtype=torch.float64)
