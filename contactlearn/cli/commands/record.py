"""Record of a run beside its result: figures as files, and TensorBoard's scalars, charts, card and hyperparameters."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from hydra.core.hydra_config import HydraConfig
from matplotlib.figure import Figure
from omegaconf import DictConfig

from contactlearn import laws
from contactlearn.cli.commands.fitting import CostSurface
from contactlearn.effects import catalogue
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.tensorboard import Tracker, ends
from contactlearn.results.estimates import JointEstimate, LawEstimate, ModelErrors
from contactlearn.results.provenance import Provenance

MODEL, BOUND = f"{metrics.HEADLINE}/model", f"{metrics.HEADLINE}/irb"
"""Tags that every run has: the error of its one model, and the bound below it."""
NONE = "none"
"""Hyperparameter of a run without a law, or without effects."""


def headline_axis(cfg: DictConfig) -> str:
    """Return the axis label of the headline error; it says so if the bounds are closest in another norm."""
    metric = metrics.METRICS[metrics.HEADLINE]
    closest = "" if cfg.bounds.norm == "mass" else f"\n(bounds are closest in the {cfg.bounds.norm} norm)"
    return f"{metric.label} ({metric.unit}){closest}"


def draw_cost_surface(surface: CostSurface) -> Figure:
    """Draw the surface of Eq. (3.1) over the whole pool, with its minimum."""
    return figures.cost_map(surface.mu, surface.eps, surface.cost, surface.minimum, surface.law)


def save_figures(drawn: Mapping[str, Figure], folder: Path, tracker: Tracker) -> None:
    """Save as PNG and PDF into the run folder, and log to TensorBoard."""
    for name, figure in drawn.items():
        png, _ = figures.save(figure, folder / "figures", name)
        tracker.figure(f"figures/{name}", png.read_bytes())


def draw_effects(model: ContactModel, test: Impacts) -> dict[str, Figure]:
    """Draw the curve of each effect over the held-out residuals that it explains, by file name."""
    return {f"effect_{name}": effect_curve(partial_residuals(model, test, name)) for name in model.effects}


def scalars(
    fits: Iterable[LawEstimate], errors: Mapping[str, ModelErrors], joint: Mapping[str, JointEstimate]
) -> dict[str, float | Interval]:
    """Return everything that TensorBoard plots of an error table and of fits, by tag."""
    values = {f"{metric}/{model}": entry.of(metric) for model, entry in errors.items() for metric in metrics.METRICS}
    values |= {f"outside_admissible/{model}": entry.outside_admissible for model, entry in errors.items()}
    for fit in fits:
        values |= {f"parameters/{fit.law}/mu": fit.mu, f"parameters/{fit.law}/eps": fit.eps}
    for model, fit in joint.items():
        values |= {f"parameters/{model}/{p.name}": p.value for p in fit.parameters}
    return values


def headline_errors(errors: Mapping[str, ModelErrors]) -> dict[str, Interval]:
    """Return the headline error of each model in an error table."""
    return {model: entry.headline for model, entry in errors.items()}


def log_hyperparameters(
    tracker: Tracker,
    cfg: DictConfig,
    source: str,
    trained_on: int,
    law: str | None,
    effects: Iterable[str],
    model: str = "analytical",
) -> None:
    """Log the settings in which runs differ, under the same names in every run of every command.

    The metrics are those of the run's one model, `MODEL`, and of the bound that is below it.
    """
    job, effects = HydraConfig.get(), list(effects)
    values = {
        "command": job.job.name,
        "data": source,
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
    provenance: Provenance,
    equations: Iterable[str],
    errors: Mapping[str, Interval],
    verdict: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Log the command and the data, the models as they print themselves, and held-out errors by model or rung."""
    data = provenance.data
    about = {
        "Command": provenance.command,
        **verdict,
        "Data": f"{data.source}, {data.trials} impacts",
        "SHA-256 of the data": data.sha256,
        "Device": provenance.device,
        "Versions": ", ".join(f"{name} {number}" for name, number in provenance.versions.items()),
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
    """Return the charts of every run, and those of an evaluation with learning curves."""
    chosen: dict[str, str | list[str]] = {"Each run's model, and the IRB bound": [f"{MODEL}$", f"{BOUND}$"]}
    if curves := list(curves):
        tag, named = f"curve_{metrics.HEADLINE}/", "|".join(laws.names())
        chosen["Learned models, Best Post Hoc and IRB bound"] = [f"{tag}(?!({named})$)"]
        chosen["Laws, Best Post Hoc and IRB bound"] = [f"{tag}({named}|best_post_hoc|irb)$"]
        chosen |= {f"{name}: learning curve with 95 % interval": f"{tag}{name}" for name in curves}
    return {"Held-out mass error against the number of training impacts": chosen}


def law_equation(fit: LawEstimate) -> str:
    """Return a law with the mean and the spread of its parameters over the subsets, as models print themselves."""
    numbers = (("μ", fit.mu, fit.mu_std), ("ε", fit.eps, fit.eps_std))
    spread = (f"{symbol} = {mean:.4f}" + ("" if std is None else f" ± {std:.4f}") for symbol, mean, std in numbers)
    return f"{fit.law} ({fit.variant}): {', '.join(spread)}; ± is the spread over {fit.repetitions} subsets"
