"""A model trained on one body, on other bodies: as it is, and corrected from few of their trials."""

from dataclasses import asdict

import torch

from contactlearn.cli.commands import curves, loading, record
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.record import RunRecord
from contactlearn.cli.job import Run
from contactlearn.cli.settings import EvaluateSettings, TransferSettings
from contactlearn.core.devices import moved
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.learning import curves as study
from contactlearn.inference.learning.curves import count_trainings
from contactlearn.models import checkpoint
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import learning
from contactlearn.report.tensorboard import TRANSFER, Tracker
from contactlearn.results import folder
from contactlearn.results.types import BodyTransfer, Transfer

WAYS = {"scratch": "From scratch", "prior": "Trained model as prior"}


def transfer(settings: EvaluateSettings, wanted: TransferSettings, run: Run) -> None:
    """Train each model on `train.size` trials of the data's body, and follow it on each of `transfer.bodies`.

    The two questions that end the paper: how good is the model on another body, and does it make
    fewer trials of that body enough?
    """
    data = loading.split(settings)
    record.save_recordings_page(run.folder, data.tracked)
    loading.show_split(data, str(run.config["device"]), settings.device)
    metric = metrics.headline_metric(settings.bounds.norm)
    chart = {"Each model from scratch, and with the trained one as prior": f"{TRANSFER}/"}
    charts = {f"{TRANSFER}: held-out {metrics.METRICS[metric].name} against their training impacts": chart}
    with record.tracker_of(run, data.train_size, metric, charts=charts) as tracker:
        _transfer(settings, wanted, run, data, tracker)
    run.remove_partial_results()
    terminal.show_end(run.folder, "")


def _transfer(settings: EvaluateSettings, wanted: TransferSettings, run: Run, data: Split, tracker: Tracker) -> None:
    source = data.pool[torch.randperm(len(data.pool), generator=data.generator)[: data.train_size]]
    bodies = {
        name: loading.load_data(one).impacts.split(settings.test, data.generator) for name, one in wanted.bodies.items()
    }
    provenance = run.provenance(data.blocks, settings.device, data.train_size)
    terminal.show_reused_trainings(count_trainings(run.partial))
    entries_by_model, metric = {}, metrics.headline_metric(settings.bounds.norm)
    for name, recipe in settings.recipes.items():
        with progress(run.folder, tracker) as on_event:
            learned = study.transfer_curves(
                recipe,
                *moved((source, bodies), settings.device),
                list(wanted.sizes),
                wanted.seeds,
                data.generator,
                impulse=settings.train.target,
                box=settings.train.box,
                work=study.Work(
                    processes=settings.processes,
                    cache=run.partial / name,
                    task=f"transfer of {name}",
                    on_event=on_event,
                ),
            )
        model, by_body = moved(learned, "cpu")
        checkpoint.save(model, run.folder / f"{name}.pt", provenance=asdict(provenance))
        entries_by_model[name] = {
            body: BodyTransfer(
                **{
                    way: ways[way].intervals(metric, data.generator, settings.bootstrap)
                    for way in ("zero_shot", "prior", "scratch")  # order of the resamples, whatever is trained first
                }
            )
            for body, ways in by_body.items()
        }
    result = Transfer(provenance=provenance, norm=settings.bounds.norm, sizes=wanted.sizes, transfer=entries_by_model)
    folder.write_result(run.folder, result)
    for name, entries in entries_by_model.items():
        terminal.show_transfer(name, entries, result.sizes, metric)
    record.write_record(tracker, run, provenance, _record(settings, result, data.train_size, metric))


def _record(settings: EvaluateSettings, result: Transfer, train_size: int, metric: str) -> RunRecord:
    """Figures, and for TensorBoard the errors of every model on every body."""
    headline = f"transfer_{metric}"
    figures = {
        f"transfer_{name}": learning.transfer_errors(
            result.sizes,
            {
                body: {label: curves.as_rows(getattr(found, way)) for way, label in WAYS.items()}
                for body, found in bodies.items()
            },
            {body: tuple(found.zero_shot[0]) for body, found in bodies.items()},
            metrics.METRICS[metric].axis,
        )
        for name, bodies in result.transfer.items()
    }
    return RunRecord(
        trained_on=train_size,
        metric=metric,
        scalars=[
            (size, {f"{headline}/{body}/{name}/{way}": getattr(found, way)[place] for way in WAYS})
            for name, bodies in result.transfer.items()
            for place, size in enumerate(result.sizes)
            for body, found in bodies.items()
        ],
        figures=figures,
        law=settings.law.name,
        effects=(),
        model=", ".join(result.transfer),
        equations=(),
        errors={},
    )
