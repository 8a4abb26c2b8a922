"""What the commands do: train(cfg) and evaluate(cfg), from a composed configuration to a run folder.

A run folder holds the configuration (`.hydra/`), results.json, the tables, the figures as PNG and
PDF, metrics.jsonl and TensorBoard's events.  This module alone knows the configuration's shape.
"""

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf

from contactlearn import bounds, laws, metrics, settings
from contactlearn.errors import ContactLearnError, DataError
from contactlearn.fit import Box, SharedFit, cost_surface, identify
from contactlearn.fit_trials import identify_trials
from contactlearn.impacts import Impacts, Prediction
from contactlearn.model import ContactModel
from contactlearn.report import figures, terminal
from contactlearn.report.impulse_space import energy_ellipse
from contactlearn.report.tables import save_predictions, save_trial_parameters
from contactlearn.tracking import Tracker

BEST_POST_HOC, IRB = "best_post_hoc", "irb"


def load_data(cfg: DictConfig) -> Impacts:
    """The `data` part of a configuration as impacts; only this package's own sources are run."""
    target = str(cfg.get("_target_", ""))
    if not target.startswith("contactlearn.data."):
        raise ContactLearnError(f"data._target_ must be a source under contactlearn.data, got {target!r}")
    for missing in sorted(OmegaConf.missing_keys(cfg)):
        raise ContactLearnError(f"{missing} must be given: {missing}=…; see configs/data")
    try:
        return instantiate(cfg, _convert_="all")
    except InstantiationException as error:
        if isinstance(error.__cause__, ContactLearnError):
            raise error.__cause__ from None
        raise


def train(cfg: DictConfig) -> None:
    """Identify one law from random trials of the training pool; errors on the held-out trials."""
    settings.check(cfg)
    folder = _run_folder()
    impacts, pool, test, generator = _split(cfg)
    with terminal.progress() as bar:
        fit = _identify(cfg, cfg.law, pool, generator, bar)
    prediction = ContactModel(fit.to_law()).predict(test)
    errors = _errors(test, {cfg.law: prediction}, cfg.bootstrap, generator)
    terminal.show_models([fit], errors)
    _write_json(folder / "results.json", {**_provenance(impacts, cfg), "fits": [_fit_entry(fit)], "errors": errors})
    with Tracker(folder, cfg.train.size) as tracker:
        tracker.scalars(_scalars([fit], errors))
        _save_figures({"cost_surface": _cost_surface(cfg, cfg.law, pool)}, folder, tracker)
        tracker.hyperparameters(_hyperparameters(cfg, [cfg.law]), _headline(errors))
    terminal.show_folder(folder)


def evaluate(cfg: DictConfig) -> None:
    """Compare the laws with Best Post Hoc and the IRB bound on held-out trials."""
    settings.check(cfg)
    folder = _run_folder()
    impacts, pool, test, generator = _split(cfg)
    row = _row(cfg, test)
    options = {"variant": cfg.variant, "target": cfg.train.target, "box": _box(cfg)}
    with terminal.progress() as bar:
        fits = [_identify(cfg, law, pool, generator, bar) for law in cfg.laws]
        predictions = {fit.law: ContactModel(fit.to_law()).predict(test) for fit in fits}
        best, _ = bounds.best_post_hoc(test, predictions, cfg.bounds.norm)
        predictions |= {BEST_POST_HOC: best, IRB: bounds.irb(test, cfg.bounds.norm)}
        errors = _errors(test, predictions, cfg.bootstrap, generator)
        every = dict.fromkeys((*cfg.laws, cfg.figures.parameters))
        trials = {law: identify_trials(law, impacts, **options) for law in bar.track(every, description="every trial")}
    terminal.show_models(fits, errors, cfg.bounds.norm)
    if cfg.reference is not None:
        terminal.show_reference(fits, OmegaConf.to_container(cfg.reference))
    save_predictions(test, predictions, folder / f"predictions.{cfg.tables}")
    save_trial_parameters(impacts, list(trials.values()), folder / f"trial_parameters.{cfg.tables}")
    entries = [_fit_entry(fit) for fit in fits]
    _write_json(folder / "results.json", {**_provenance(impacts, cfg), "fits": entries, "errors": errors})
    with Tracker(folder, cfg.train.size) as tracker:
        tracker.scalars(_scalars(fits, errors))
        tracker.hyperparameters(_hyperparameters(cfg, cfg.laws), _headline(errors))
        with terminal.progress() as bar:
            drawn = _figures(cfg, pool, test, fits, predictions, errors, generator, bar, row)
            per_trial = trials[cfg.figures.parameters]
            drawn["trial_parameters"] = figures.trial_parameters(per_trial, impacts, box=_box(cfg))
            _save_figures(drawn, folder, tracker)
    terminal.show_folder(folder)


def _run_folder() -> Path:
    return Path(HydraConfig.get().runtime.output_dir)


def _split(cfg: DictConfig) -> tuple[Impacts, Impacts, Impacts, torch.Generator]:
    """All impacts, the pool to identify from, the held-out trials, and the run's random source."""
    impacts = load_data(cfg.data)
    generator = torch.Generator().manual_seed(cfg.seed)
    pool, test = impacts.split(cfg.test, generator)
    if len(pool) < cfg.train.size:
        raise DataError(
            f"{impacts.source}: train.size={cfg.train.size}, but {len(pool)} of {len(impacts)} trials are left to "
            f"draw from after holding out a share test={cfg.test}; use train.size={len(pool)} or less"
        )
    at_rest = (test.v_post == 0).all(1).nonzero()[:, 0].tolist()
    if at_rest:
        raise DataError(
            f"{impacts.source}: errors are relative to the outcome, which must not be at rest; trial "
            f"{test.trial[at_rest[0]]!r} has vx_post = vy_post = omega_post = 0: leave it out"
        )
    terminal.show_data(impacts, len(pool), len(test))
    return impacts, pool, test, generator


def _box(cfg: DictConfig) -> Box:
    return Box(tuple(cfg.train.mu), tuple(cfg.train.eps))


def _identify(cfg: DictConfig, law: str, pool: Impacts, generator: torch.Generator, bar, **changes) -> SharedFit:
    options = {"sizes": (cfg.train.size,), "repetitions": cfg.train.repetitions} | changes
    what = "converging" if len(options["sizes"]) > 1 else "identifying"
    return identify(
        law,
        pool,
        generator=generator,
        variant=cfg.variant,
        target=cfg.train.target,
        box=_box(cfg),
        progress=lambda blocks: bar.track(blocks, description=f"{what} {law}"),
        **options,
    )


def _errors(test: Impacts, predictions: dict[str, Prediction], resamples: int, generator: torch.Generator) -> dict:
    """{model: {metric: {mean, low, high}, outside_admissible: share}}; all models on the same resamples."""
    state = generator.get_state()
    table = {}
    for name, prediction in predictions.items():
        table[name] = {}
        for key, metric in metrics.METRICS.items():
            generator.set_state(state)
            table[name][key] = metrics.bootstrap(metric.error(test, prediction), generator, resamples)._asdict()
        outside = metrics.outside_admissible(test, prediction.wrench[..., :2])
        table[name]["outside_admissible"] = outside.double().mean().item()
    return table


def _figures(cfg, pool, test, fits, predictions, errors, generator, bar, row) -> dict:
    """The figures of an evaluation by name."""
    box, chosen = _box(cfg), {fit.law: fit for fit in fits}
    # Every k up to 120, and as many of a larger range.
    sizes = torch.linspace(1, cfg.train.size, min(cfg.train.size, 120)).round().int().tolist()
    convergence = _identify(
        cfg, cfg.figures.surface, pool, generator, bar, sizes=sizes, repetitions=cfg.figures.repetitions
    )
    headline = metrics.METRICS[metrics.HEADLINE]
    closest = "" if cfg.bounds.norm == "mass" else f"\n(bounds are closest in the {cfg.bounds.norm} norm)"
    axis = f"{headline.label} ({headline.unit}){closest}"
    per_trial = {name: headline.error(test, prediction) for name, prediction in predictions.items()}
    intervals = {name: tuple(errors[name][metrics.HEADLINE].values()) for name in predictions}
    best = min(chosen, key=lambda law: intervals[law])
    widths = cfg.bounds.patch * torch.linspace(0, 1, 25, dtype=torch.float64) ** 2  # dense where the bound falls
    patched = headline.error(test, bounds.irb(test, cfg.bounds.norm, patch=widths[:, None]))
    bands = torch.tensor([metrics.bootstrap(error, generator, cfg.bootstrap) for error in patched])
    row = int(per_trial[best].argsort()[len(test) // 2]) if row is None else row
    return {
        "energy_ellipse": energy_ellipse(
            test, row, {law: fit.to_law() for law, fit in chosen.items()}, box, target=cfg.train.target
        ),
        "cost_surface": _cost_surface(cfg, cfg.figures.surface, pool),
        "convergence": figures.convergence(convergence),
        "error_comparison": figures.error_comparison(per_trial, intervals, axis),
        "patch_curve": figures.patch_curve(
            1e3 * widths, bands, {name: intervals[name][0] for name in (best, BEST_POST_HOC)}, axis
        ),
    }


def _cost_surface(cfg: DictConfig, law: str, pool: Impacts) -> Figure:
    """The surface of Eq. (3.1) over the whole pool, with its minimum."""
    mu, eps = _box(cfg).axes()
    options = {"variant": cfg.variant, "target": cfg.train.target}
    least = identify(law, pool, sizes=(len(pool),), repetitions=1, box=_box(cfg), **options)
    surface = cost_surface(law, pool, mu, eps, **options)
    return figures.cost_surface(mu, eps, surface, least.mean(), law, variant=cfg.variant)


def _row(cfg: DictConfig, test: Impacts) -> int | None:
    """Row of the trial to draw if one is asked for."""
    if cfg.figures.trial is None:
        return None
    name = str(cfg.figures.trial)
    if name not in test.trial:
        raise DataError(
            f"figures.trial={name} is not among the {len(test)} held-out trials of {test.source}; "
            f"they begin with {', '.join(test.trial[:5])}"
        )
    return test.trial.index(name)


def _save_figures(drawn: dict, folder: Path, tracker: Tracker) -> None:
    for name, figure in drawn.items():
        png, _ = figures.save(figure, folder / "figures", name)
        tracker.figure(f"figures/{name}", png.read_bytes())


def _fit_entry(fit: SharedFit) -> dict:
    (mu, eps), (mu_std, eps_std) = fit.mean(), fit.std()
    return {
        "law": fit.law,
        "variant": fit.variant,
        "trials": fit.sizes[-1],
        "repetitions": len(fit.mu),
        "mu": mu,
        "mu_std": mu_std if len(fit.mu) > 1 else None,
        "eps": eps,
        "eps_std": eps_std if len(fit.mu) > 1 else None,
        "cost": fit.cost[:, -1].mean().item(),
        "mu_range": fit.mu_range[:, -1].mean(0).tolist(),
        "eps_range": fit.eps_range[:, -1].mean(0).tolist(),
        "mu_undetermined": fit.mu_flat[:, -1].double().mean().item(),
    }


def _scalars(fits: list[SharedFit], errors: dict) -> dict[str, float]:
    values = {
        f"{metric}/{model}": entry[metric]["mean"] for model, entry in errors.items() for metric in metrics.METRICS
    }
    values |= {f"outside_admissible/{model}": entry["outside_admissible"] for model, entry in errors.items()}
    for fit in fits:
        values |= {f"parameters/{fit.law}/{name}": value for name, value in zip(("mu", "eps"), fit.mean(), strict=True)}
    return values


def _headline(errors: dict) -> dict[str, float]:
    return {f"{metrics.HEADLINE}/{model}": entry[metrics.HEADLINE]["mean"] for model, entry in errors.items()}


def _hyperparameters(cfg: DictConfig, chosen: list[str]) -> dict:
    keys = {"variant": cfg.variant, "target": cfg.train.target, "train_size": cfg.train.size, "seed": cfg.seed}
    return keys | {"data": cfg.data._target_.split(".")[-2]} | {f"law_{law}": law in chosen for law in laws.names()}


def _provenance(impacts: Impacts, cfg: DictConfig) -> dict:
    """What is needed to say which data, code and configuration gave a result."""
    packages = {name: version(name) for name in ("torch", "gpytorch", "numpy")}
    return {
        "data": {"source": impacts.source, "trials": len(impacts), "sha256": impacts.fingerprint()},
        "versions": {"contactlearn": _own_version(), "python": platform.python_version(), **packages},
        "config": OmegaConf.to_container(cfg, resolve=True),
    }


def _own_version() -> str:
    from contactlearn import __version__

    return __version__


def _write_json(path: Path, content: dict) -> None:
    """Whole or not at all."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(part, path)
