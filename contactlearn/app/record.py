"""What the commands share: data, splits, identification, errors, files."""

import json
import os
import platform
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf, flag_override
from torch import Tensor

import contactlearn
from contactlearn import laws
from contactlearn.audit.corrections import correct
from contactlearn.effects import Effect, catalogue
from contactlearn.errors import ContactLearnError, DataError
from contactlearn.evaluation import metrics
from contactlearn.evaluation.metrics import Interval
from contactlearn.evaluation.partial_residuals import partial_residuals
from contactlearn.identification.joint import FitOptions, JointFit, identify_jointly
from contactlearn.identification.shared import Box, SharedFit, cost_surface, identify
from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import Law
from contactlearn.model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.tensorboard import Tracker, ends

MODEL, BOUND = f"{metrics.HEADLINE}/model", f"{metrics.HEADLINE}/irb"
"""Tags that every run has: the error of its one model, and the bound below it."""
NONE = "none"


def load_data(cfg: DictConfig, suspect: bool = False) -> Impacts:
    """The `data` part of a configuration as impacts, corrected; only this package's own sources are run.

    With `suspect` a table is read, and left, without the rule that contacts approach the floor: for the audit.
    """
    source = cfg.copy()  # it still knows its place in the whole, which messages name
    with flag_override(source, ["struct", "readonly"], False):
        names = source.pop("correct", None) or []
    if isinstance(names, str):
        raise ContactLearnError(f"data.correct must be a list of names, such as [{names}], got {names!r}")
    return correct(_read(source, suspect or bool(names)), list(names)).replace(suspect=suspect)


def _read(cfg: DictConfig, suspect: bool) -> Impacts:
    target = str(cfg.get("_target_", ""))
    if not target.startswith("contactlearn.data."):
        raise ContactLearnError(f"data._target_ must be a source under contactlearn.data, got {target!r}")
    for missing in sorted(OmegaConf.missing_keys(cfg)):
        raise ContactLearnError(f"{missing} must be given: {missing}=…; see configs/data")
    try:
        lenient = {"suspect": True} if suspect and target == "contactlearn.data.table.load" else {}
        return instantiate(cfg, _convert_="all", **lenient)
    except InstantiationException as error:
        if isinstance(error.__cause__, ContactLearnError):
            raise error.__cause__ from None
        if isinstance(error.__cause__, TypeError):  # a setting that the source does not have
            raise ContactLearnError(f"{target}: {error.__cause__}") from None
        raise


def command_line() -> str:
    """The command of this run."""
    job = HydraConfig.get()
    return shlex.join(["python", f"{job.job.name}.py", *job.overrides.task])


def run_folder() -> Path:
    """Where this run writes."""
    return Path(HydraConfig.get().runtime.output_dir)


def split(cfg: DictConfig) -> tuple[Impacts, Impacts, Impacts, torch.Generator]:
    """All impacts, the pool to identify from, the held-out trials, and the run's random source."""
    impacts = load_data(cfg.data)
    generator = torch.Generator().manual_seed(cfg.seed)
    pool, test = impacts.split(cfg.test, generator)
    if len(pool) < cfg.train.size:
        raise DataError(
            f"{impacts.source}: train.size={cfg.train.size}, but {len(pool)} of {len(impacts)} trials are left to "
            f"draw from after holding out a share test={cfg.test}; use train.size={len(pool)} or less"
        )
    at_rest = (test.v_post[:, :2] == 0).all(1).nonzero()[:, 0].tolist()
    if at_rest:
        raise DataError(
            f"{impacts.source}: errors are relative to the outcome, which must not be at rest; trial "
            f"{test.trial[at_rest[0]]!r} has vx_post = vy_post = 0: leave it out"
        )
    terminal.show_data(impacts, len(pool), len(test))
    return impacts, pool, test, generator


def box(cfg: DictConfig) -> Box:
    """Where μ and ε are sought."""
    return Box(tuple(cfg.train.mu), tuple(cfg.train.eps))


def identify_law(cfg: DictConfig, law: Law, pool: Impacts, generator: torch.Generator, bar, **changes) -> SharedFit:
    """Shared (μ, ε) of a law as the configuration asks for, with changes to the options of `fit.identify`."""
    options = {"sizes": (cfg.train.size,), "repetitions": cfg.train.repetitions} | changes
    what = "converging" if len(options["sizes"]) > 1 else "identifying"
    return identify(
        law,
        pool,
        generator=generator,
        target=cfg.train.target,
        box=box(cfg),
        progress=lambda blocks: bar.track(blocks, description=f"{what} {law.name}"),
        **options,
    )


def fit_options(cfg: DictConfig) -> FitOptions:
    """Options of joint fits as the configuration asks for."""
    noise = None if cfg.fit.noise is None else tuple(cfg.fit.noise)
    return FitOptions(box=box(cfg), target=cfg.fit.target, noise=noise, starts=cfg.fit.starts)


def fit_with_effects(
    cfg: DictConfig, law: Law, effects: Mapping[str, Effect], impacts: Impacts, rows: Tensor, bar
) -> dict[str, JointFit]:
    """The law alone and with its effects, by name, both fitted to the same trials in the same way."""
    fits = {}
    for chosen in bar.track(({}, effects), description=f"fitting {law.name} and its effects"):
        fits[augmented_name(law.name, chosen)] = identify_jointly(law, chosen, impacts, rows, options=fit_options(cfg))
    return fits


def augmented_name(law: str, effects: Iterable[str]) -> str:
    """Such as `wang_mason + surface_tilt + spin_damping`."""
    return " + ".join((law, *effects))


def workers(cfg: DictConfig) -> int:
    """Processes to train in: as asked for, or one for each core that this process may use."""
    if cfg.workers is not None:
        return cfg.workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def headline_axis(cfg: DictConfig) -> str:
    """Axis label of the headline error; it says so if the bounds are closest in another norm."""
    metric = metrics.METRICS[metrics.HEADLINE]
    closest = "" if cfg.bounds.norm == "mass" else f"\n(bounds are closest in the {cfg.bounds.norm} norm)"
    return f"{metric.label} ({metric.unit}){closest}"


def error_table(test: Impacts, predictions: dict[str, Prediction], resamples: int, generator: torch.Generator) -> dict:
    """{model: {metric: {mean, low, high}, outside_admissible: share}}; all models on the same resamples."""
    state = generator.get_state()
    table = {}
    for name, prediction in predictions.items():
        table[name] = {}
        for key, metric in metrics.METRICS.items():
            generator.set_state(state)
            table[name][key] = asdict(metrics.bootstrap(metric.error(test, prediction), generator, resamples))
        outside = metrics.outside_admissible(test, prediction.wrench[..., :2])
        table[name]["outside_admissible"] = outside.double().mean().item()
    return table


def law_surface(cfg: DictConfig, law: Law, pool: Impacts) -> Figure:
    """The surface of Eq. (3.1) over the whole pool, with its minimum."""
    mu, eps = box(cfg).axes()
    least = identify(law, pool, sizes=(len(pool),), repetitions=1, box=box(cfg), target=cfg.train.target)
    surface = cost_surface(law, pool, mu, eps, target=cfg.train.target)
    return figures.cost_surface(mu, eps, surface, least.mean(), law)


def save_figures(drawn: dict[str, Figure], folder: Path, tracker: Tracker) -> None:
    """As PNG and PDF into the run folder, and to TensorBoard."""
    for name, figure in drawn.items():
        png, _ = figures.save(figure, folder / "figures", name)
        tracker.figure(f"figures/{name}", png.read_bytes())


def fit_entry(fit: SharedFit) -> dict:
    """A law's parameters as results.json holds them."""
    (mu, eps), (mu_std, eps_std) = fit.mean(), fit.std()
    return {
        "law": fit.law.name,
        "variant": fit.law.variant,
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


def joint_entry(fit: JointFit) -> dict:
    """A law with effects as results.json holds it."""
    parameters = {
        p.name: {"symbol": p.symbol, "unit": p.unit, "value": value, "standard_error": error}
        for p, value, error in zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True)
    }
    return {
        "equation": str(fit.model),
        "parameters": parameters,
        "correlation": fit.correlation.tolist(),
        "undetermined": fit.undetermined(),
        "at_bounds": fit.at_bounds(),
        "loss": fit.loss.item(),
        "starts_at_best": fit.agreement.item(),
        "converged": bool(fit.converged),
        "outliers": fit.outliers,
    }


def effect_figures(model: ContactModel, test: Impacts) -> dict[str, Figure]:
    """The curve of each effect over the held-out residuals that it explains."""
    return {f"effect_{name}": effect_curve(partial_residuals(model, test, name)) for name in model.effects}


def scalars(fits: list[SharedFit], errors: dict, joint: Mapping[str, JointFit]) -> dict[str, float | Interval]:
    """What TensorBoard plots of an error table and of fits, by tag."""
    values = {
        f"{metric}/{model}": Interval(**entry[metric]) for model, entry in errors.items() for metric in metrics.METRICS
    }
    values |= {f"outside_admissible/{model}": entry["outside_admissible"] for model, entry in errors.items()}
    for fit in fits:
        values |= {
            f"parameters/{fit.law.name}/{name}": value for name, value in zip(("mu", "eps"), fit.mean(), strict=True)
        }
    for model, fit in joint.items():
        values |= {f"parameters/{model}/{p.name}": x for p, x in zip(fit.parameters, fit.values.tolist(), strict=True)}
    return values


def headline(errors: dict) -> dict[str, Interval]:
    """The headline error of each model in an error table."""
    return {model: Interval(**entry[metrics.HEADLINE]) for model, entry in errors.items()}


def log_hyperparameters(
    tracker: Tracker,
    cfg: DictConfig,
    impacts: Impacts,
    trained_on: int,
    law: str | None,
    effects: Iterable[str],
    model: str = "analytical",
) -> None:
    """What the run differs in from others, under the same names in every run of every command.

    The metrics are those of the run's one model, `MODEL`, and of the bound that is below it.
    """
    job, effects = HydraConfig.get(), list(effects)
    values = {
        "command": job.job.name,
        "data": impacts.source,
        "effects": ", ".join(effects) or NONE,
        "law": law or NONE,
        "model": model,
        "seed": cfg.seed,
        "settings": " ".join(job.overrides.task),
        "train_size": trained_on,
        "variant": cfg.variant,
    }
    values |= {f"effect_{name}": name in effects for name in dict.fromkeys((*catalogue(), *effects))}
    choices = {"command": ("train", "evaluate", "diagnose"), "law": (*laws.names(), NONE)}
    shown = dict(zip((MODEL, *ends(MODEL), BOUND), ("mass error", "low, 95 %", "high, 95 %", "IRB bound"), strict=True))
    tracker.hyperparameters(values, choices, shown)


def log_card(
    tracker: Tracker,
    provenance: dict,
    equations: Iterable[str],
    errors: Mapping[str, Interval],
    verdict: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """What was run on what, the models as they print themselves, and held-out errors by model or rung."""
    data = provenance["data"]
    about = {
        "Command": command_line(),
        **verdict,
        "Data": f"{data['source']}, {data['trials']} impacts",
        "SHA-256 of the data": data["sha256"],
        "Versions": ", ".join(f"{name} {number}" for name, number in provenance["versions"].items()),
    }
    parts = [line.strip().removeprefix("+ ").partition(": ") for equation in equations for line in equation.split("\n")]
    rows = [(name, f"{x.mean:.4f}", f"{x.low:.4f}–{x.high:.4f}") for name, x in errors.items()]
    tracker.card(
        (
            [("Run", ""), *about.items()],
            [("Law and effects", "Equation, parameters ± standard errors"), *((name, rest) for name, _, rest in parts)],
            [("Held-out mass error", "Mean", "95 % interval"), *rows],
        )
    )


def charts(curves: Iterable[str] = ()) -> dict[str, dict[str, str | list[str]]]:
    """The charts of every run, and those of an evaluation with learning curves."""
    chosen = {"Each run's model, and the IRB bound": [f"{MODEL}$", f"{BOUND}$"]}
    if curves := list(curves):
        tag, named = f"curve_{metrics.HEADLINE}/", "|".join(laws.names())
        chosen["Learned models, Best Post Hoc and IRB bound"] = [f"{tag}(?!({named})$)"]
        chosen["Laws, Best Post Hoc and IRB bound"] = [f"{tag}({named}|best_post_hoc|irb)$"]
        chosen |= {f"{name}: learning curve with 95 % interval": f"{tag}{name}" for name in curves}
    return {"Held-out mass error against the number of training impacts": chosen}


def law_equation(fit: SharedFit) -> str:
    """A law with the mean and the spread of its parameters over the subsets, as models print themselves."""
    numbers = zip(("μ", "ε"), fit.mean(), fit.std(), strict=True)
    spread = (f"{symbol} = {mean:.4f}" + (f" ± {std:.4f}" if std == std else "") for symbol, mean, std in numbers)
    return f"{fit.law.name} ({fit.law.variant}): {', '.join(spread)}; ± is the spread over {len(fit.mu)} subsets"


def provenance(impacts: Impacts, cfg: DictConfig) -> dict:
    """What is needed to say which data, code and configuration gave a result."""
    packages = {name: version(name) for name in ("torch", "gpytorch", "numpy")}
    return {
        "data": {"source": impacts.source, "trials": len(impacts), "sha256": impacts.fingerprint()},
        "versions": {"contactlearn": contactlearn.__version__, "python": platform.python_version(), **packages},
        "config": OmegaConf.to_container(cfg, resolve=True),
    }


def write_json(path: Path, content: dict) -> None:
    """Whole or not at all."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(part, path)
