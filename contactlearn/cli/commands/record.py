"""Record of a run: figures as files, and the values, charts and card of TensorBoard."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from contactlearn import laws
from contactlearn.cli.commands.fitting import CostSurface
from contactlearn.cli.job import Run
from contactlearn.effects import catalogue
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.style import save
from contactlearn.report.tensorboard import Tracker, ends
from contactlearn.results.types import JointEstimate, LawEstimate, ModelErrors, Provenance

MODEL, BOUND = f"{metrics.HEADLINE}/model", f"{metrics.HEADLINE}/irb"
"""Tags that every run has: the error of its one model, and the bound below it."""
_NONE = "none"  # hyperparameter of a run without a law, or without effects
_HEADLINE_CHARTS = "Held-out mass error against the number of training impacts"
Scalars = Mapping[str, float | Interval]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Figures and values that a run shows in addition to its result.

    Args:
        trained_on: number of training trials of its model.
        scalars: values by tag, each set with its number of training trials.
        figures: by file name.
        law: name of the law, if the run has one.
        effects: names of the effects.
        equations: models as they print themselves.
        errors: held-out mass error by model, or by rung of a ladder.
        model: name of the learned model, or analytical.
        series: values by tag, against their number.
        charts: further charts of TensorBoard by category.
        curves: models that have a learning curve to chart.
        verdict: further lines of the card.
    """

    trained_on: int
    scalars: Sequence[tuple[int, Scalars]]
    figures: Mapping[str, Figure]
    law: str | None
    effects: Sequence[str]
    equations: Sequence[str]
    errors: Mapping[str, Interval]
    model: str = "analytical"
    series: Mapping[str, Sequence[float | Interval]] = field(default_factory=dict)
    charts: Mapping[str, Mapping[str, str | Sequence[str]]] = field(default_factory=dict)
    curves: Sequence[str] = ()
    verdict: Mapping[str, str] = field(default_factory=dict)


def write_record(run: Run, provenance: Provenance, record: RunRecord) -> None:
    """Save the figures as PNG and PDF, and log everything to TensorBoard and metrics.jsonl, in the run folder."""
    with Tracker(run.folder, record.trained_on) as tracker:
        for trained_on, values in record.scalars:
            tracker.scalars(values, trained_on)
        for tag, values in record.series.items():
            tracker.series(tag, values)
        chosen: dict[str, str | Sequence[str]] = {"Each run's model, and the IRB bound": [f"{MODEL}$", f"{BOUND}$"]}
        if record.curves:
            tag, named = f"curve_{metrics.HEADLINE}/", "|".join(laws.names())
            chosen["Learned models, Best Post Hoc and IRB bound"] = [f"{tag}(?!({named})$)"]
            chosen["Laws, Best Post Hoc and IRB bound"] = [f"{tag}({named}|best_post_hoc|irb)$"]
            chosen |= {f"{name}: learning curve with 95 % interval": f"{tag}{name}" for name in record.curves}
        tracker.charts({_HEADLINE_CHARTS: chosen, **record.charts})
        for name, figure in record.figures.items():
            png, _ = save(figure, run.folder / "figures", name)
            tracker.figure(f"figures/{name}", png.read_bytes())
        _log_hyperparameters(tracker, run, provenance, record)
        _log_card(tracker, provenance, record)


def headline_axis(norm: str) -> str:
    """Return the axis label of the headline error; it says so if the bounds are closest in another norm."""
    metric = metrics.METRICS[metrics.HEADLINE]
    closest = "" if norm == "mass" else f"\n(bounds are closest in the {norm} norm)"
    return f"{metric.label} ({metric.unit}){closest}"


def draw_cost_surface(surface: CostSurface) -> Figure:
    """Draw the surface of Eq. (3.1) with its minimum."""
    return figures.cost_map(surface.mu, surface.eps, surface.cost, surface.minimum, surface.law, surface.trials)


def draw_effects(model: ContactModel, test: Impacts) -> dict[str, Figure]:
    """Draw the curve of each effect over the held-out residuals that it explains, by file name."""
    return {f"effect_{name}": effect_curve(partial_residuals(model, test, name)) for name in model.effects}


def scalars(
    fits: Iterable[LawEstimate], errors: Mapping[str, ModelErrors], joint: Mapping[str, JointEstimate]
) -> dict[str, float | Interval]:
    """Return the plotted values of an error table and of fits, by tag."""
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


def law_equation(fit: LawEstimate) -> str:
    """Return a law with the mean and the spread of its parameters over the subsets, as models print themselves."""
    numbers = (("μ", fit.mu, fit.mu_std), ("ε", fit.eps, fit.eps_std))
    spread = (f"{symbol} = {mean:.4f}" + ("" if std is None else f" ± {std:.4f}") for symbol, mean, std in numbers)
    return f"{fit.law} ({fit.variant}): {', '.join(spread)}; ± is the spread over {fit.repetitions} subsets"


def _log_hyperparameters(tracker: Tracker, run: Run, provenance: Provenance, record: RunRecord) -> None:
    """Log the settings in which runs differ, under the same names in every run of every command.

    The metrics are those of the run's one model, `MODEL`, and of the bound below it.
    """
    effects = record.effects
    values = {
        "command": run.command,
        "data": provenance.data.source,
        "effects": ", ".join(effects) or _NONE,
        "law": record.law or _NONE,
        "model": record.model,
        "seed": run.config["seed"],
        "settings": " ".join(run.overrides),
        "train_size": record.trained_on,
        "variant": run.config["variant"],
    }
    values |= {f"effect_{name}": name in effects for name in dict.fromkeys((*catalogue(), *effects))}
    choices = {"command": ("train", "evaluate", "diagnose"), "law": (*laws.names(), _NONE)}
    shown = dict(zip((MODEL, *ends(MODEL), BOUND), ("mass error", "low, 95 %", "high, 95 %", "IRB bound"), strict=True))
    tracker.hyperparameters(values, choices, shown)


def _log_card(tracker: Tracker, provenance: Provenance, record: RunRecord) -> None:
    """Log the command and the data, the models as they print themselves, and the held-out errors."""
    data = provenance.data
    about = {
        "Command": provenance.command,
        **record.verdict,
        "Data": f"{data.source}, {data.trials} impacts",
        "SHA-256 of the data": data.sha256,
        "Device": provenance.device,
        "Versions": ", ".join(f"{name} {number}" for name, number in provenance.versions.items()),
    }
    lines = (line for equation in record.equations for line in equation.split("\n"))
    parts = [line.strip().removeprefix("+ ").partition(": ") for line in lines]
    rows = [(name, f"{x.mean:.4f}", f"{x.low:.4f}–{x.high:.4f}") for name, x in record.errors.items()]
    tracker.card(
        (
            [("Run", ""), *about.items()],
            [("Law and effects", "Equation, parameters ± standard errors"), *((name, rest) for name, _, rest in parts)],
            [("Held-out mass error", "Mean", "95 % interval"), *rows],
        )
    )
