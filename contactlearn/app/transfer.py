"""A model trained on one body, on other bodies: as it is, and corrected from few of their trials."""

from dataclasses import asdict

import torch
from omegaconf import DictConfig, OmegaConf

from contactlearn import checkpoint
from contactlearn.app import record as run
from contactlearn.app import settings
from contactlearn.evaluation import metrics
from contactlearn.learning import curves as study
from contactlearn.report import terminal
from contactlearn.report.figures import learning
from contactlearn.report.tensorboard import Tracker

WAYS = {"scratch": "From scratch", "prior": "Trained model as prior"}


def transfer(cfg: DictConfig) -> None:
    """Train each model on `train.size` trials of the data's body, and follow it on each of `transfer.bodies`.

    The two questions that end the paper: how good is the model on another body, and does it make
    fewer trials of that body enough?
    """
    folder = run.run_folder()
    impacts, pool, _, generator = run.split(cfg)
    source = pool[torch.randperm(len(pool), generator=generator)[: cfg.train.size]]
    bodies = {}
    for name, changes in OmegaConf.to_container(cfg.transfer.bodies, resolve=True).items():
        same = {} if "_target_" in changes else OmegaConf.to_container(cfg.data, resolve=True)
        bodies[name] = run.load_data(OmegaConf.create(same | changes)).split(cfg.test, generator)
    sizes, metric, results, drawn = list(cfg.transfer.sizes), metrics.HEADLINE, {}, {}
    options = {"impulse": cfg.train.target, "box": run.box(cfg), "workers": run.workers(cfg)}
    with Tracker(folder, cfg.train.size) as tracker:
        for name, recipe in settings.recipes(cfg).items():
            with terminal.progress() as bar:
                track = lambda done, total, name=name: bar.track(done, total, description=f"transfer of {name}")  # noqa: E731
                model, curves = study.transfer_curves(
                    recipe, source, bodies, sizes, cfg.transfer.seeds, generator, progress=track, **options
                )
            checkpoint.save(model, folder / f"{name}.pt", provenance=run.provenance(impacts, cfg))
            intervals = {
                body: {way: curve.intervals(metric, generator, cfg.bootstrap) for way, curve in ways.items()}
                for body, ways in curves.items()
            }
            results[name] = {
                body: {way: [asdict(metrics.Interval(*row)) for row in rows.tolist()] for way, rows in ways.items()}
                for body, ways in intervals.items()
            }
            terminal.show_transfer(name, intervals, sizes)
            for place, size in enumerate(sizes):
                for body, ways in intervals.items():
                    tags = {f"transfer_{metric}/{body}/{name}/{way}": ways[way][place].tolist() for way in WAYS}
                    tracker.scalars({tag: metrics.Interval(*interval) for tag, interval in tags.items()}, size)
            drawn[f"transfer_{name}"] = learning.transfer(
                sizes,
                {body: {label: ways[way] for way, label in WAYS.items()} for body, ways in intervals.items()},
                {body: tuple(ways["zero_shot"][0].tolist()) for body, ways in intervals.items()},
                run.headline_axis(cfg),
            )
        run.write_json(folder / "results.json", {**run.provenance(impacts, cfg), "sizes": sizes, "transfer": results})
        run.save_figures(drawn, folder, tracker)
        bodies_chart = {"Each model from scratch, and with the trained one as prior": [f"transfer_{metric}/"]}
        tracker.charts(run.charts() | {"Transfer to other bodies, against their training impacts": bodies_chart})
        run.log_hyperparameters(tracker, cfg, impacts, cfg.train.size, cfg.law, (), ", ".join(settings.recipes(cfg)))
        run.log_card(tracker, run.provenance(impacts, cfg), (), {})
    terminal.show_folder(folder)
