"""Record of a run: figures as files, and the values, charts and card of TensorBoard."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from torch import Tensor

from contactlearn import laws
from contactlearn.cli.job import Run
from contactlearn.data.tracks import Tracked
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import NORMS, Interval
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures import quality
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.style import card_png, save
from contactlearn.report.page.page import RECORDINGS
from contactlearn.report.page.recordings import shown_recordings, write_recordings_page
from contactlearn.report.tensorboard import CURVES, NO_CHARTS, TRAINING, Charts, Tracker, ends, shown_as
from contactlearn.report.terminal import print_line
from contactlearn.report.text.names import MODELS
from contactlearn.report.text.numbers import NO_INTERVAL
from contactlearn.report.text.tracks import tracks_headline
from contactlearn.results.types import IRB, JointEstimate, LawEstimate, ModelErrors, Provenance

_NONE = "none"  # hyperparameter of a run without a law, or without effects
Scalars = Mapping[str, float | Interval]


def save_recordings_page(folder: Path, tracked: Tracked | None) -> None:
    """Write recordings.html into a folder of a run whose data are recordings, and print what they are worth."""
    if tracked is not None:
        write_recordings_page(folder / RECORDINGS, tracked, tracked.reload({*shown_recordings(tracked)}))
        print_line(f"{RECORDINGS}: {tracks_headline(tracked)}")


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Figures and values that a run shows in addition to its result.

    Args:
        trained_on: number of training trials of its model.
        metric: by which its models are compared.
        scalars: values by tag, each set with its number of training trials.
        figures: by file name.
        histograms: values to draw the distribution of by tag, each set with its number of training trials.
        law: name of the law, if the run has one.
        effects: names of the effects.
        equations: models as they print themselves.
        errors: held-out error by model, or by rung of a ladder.
        model: name of the learned model, or analytical.
        series: values by tag, against their number.
        verdict: further lines of the card.
    """

    trained_on: int
    metric: str
    scalars: Sequence[tuple[int, Scalars]]
    law: str | None
    effects: Sequence[str]
    equations: Sequence[str]
    errors: Mapping[str, Interval]
    model: str = "analytical"
    figures: Mapping[str, Figure] = field(default_factory=dict)
    series: Mapping[str, Sequence[float | Interval]] = field(default_factory=dict)
    verdict: Mapping[str, str] = field(default_factory=dict)
    histograms: Sequence[tuple[int, Mapping[str, Tensor]]] = ()


def own_tags(metric: str) -> tuple[str, str]:
    """Return the tags that every run with this headline has: the error of its one model, and the bound below it."""
    return f"{metric}/model", f"{metric}/{IRB}"


def tracker_of(
    run: Run,
    trained_on: int,
    metric: str,
    *,
    curves: Iterable[str] = (),
    training: bool = False,
    charts: Charts = NO_CHARTS,
) -> Tracker:
    """Open the record of a run with its charts, before anything is computed.

    Args:
        run: whose folder it is written to.
        trained_on: number of training trials of its model.
        metric: by which its models are compared.
        curves: learned models that have learning curves.
        training: whether one model is trained in rounds.
        charts: further charts by category.
    """
    error, named = metrics.METRICS[metric].name, "|".join(laws.names())
    chosen = dict(charts)
    if curves:
        learned = [f"curve_{metric}/{model}" for model in dict.fromkeys((*MODELS, *curves))]
        chosen[f"{CURVES}: held-out {error} against the number of training impacts"] = {
            "Learned models, Best Post Hoc and IRB bound": learned
        }
    if training:
        parts = {f"Held-out {error}": [f"fit/{metric}"], "Loss of the fit": ["fit/loss"]}
        chosen[f"{TRAINING}: {error}"] = parts
    shown = (
        rf"(interval/)?(\w+_error/model|ladder/{metric})(/low|/high)?|floor/{metric}|\w+_error/irb"
        rf"|curve_{metric}/(?!({named})$).+|transfer_{metric}/.+|fit/(loss|{metric}|negative_log_density)"
    )
    return Tracker(run.folder, trained_on, chosen, shown=shown)


def write_record(tracker: Tracker, run: Run, provenance: Provenance, record: RunRecord) -> None:
    """Save the figures, and log what a run shows beside its events."""
    for trained_on, values in record.scalars:
        tracker.scalars(values, trained_on)
    for tag, values in record.series.items():
        tracker.series(tag, values)
    for trained_on, distributions in record.histograms:
        for tag, values in distributions.items():
            tracker.histogram(tag, values, trained_on)
    write_figures(tracker, run, record.figures)
    _log_hyperparameters(tracker, run, provenance, record)
    _log_card(tracker, provenance, record)


def write_figures(tracker: Tracker, run: Run, drawn: Mapping[str, Figure]) -> None:
    """Save figures by file name as PNG and PDF in the run folder, and log them with larger letters."""
    for name, figure in drawn.items():
        save(figure, run.folder / "figures", name)
        tracker.figure(f"figures/{name}", card_png(figure))


def draw_effects(model: ContactModel, test: Impacts) -> dict[str, Figure]:
    """Draw the curve of each effect over the held-out residuals that it explains, by file name."""
    return {f"effect_{name}": effect_curve(partial_residuals(model, test, name)) for name in model.effects}


def draw_predictions(test: Impacts, prediction: Prediction) -> Figure:
    """Draw the predicted against the measured velocities, with the predicted spread where there is one."""
    spread = None if prediction.covariance is None else metrics.predicted_spread(prediction)
    return quality.predicted_against_measured(test.v_post, prediction.v_post, spread)


def scalars(
    fits: Iterable[LawEstimate], errors: Mapping[str, ModelErrors], joint: Mapping[str, JointEstimate]
) -> dict[str, float | Interval]:
    """Return the plotted values of an error table and of fits, by tag."""
    values = {
        f"{metric}/{model}": interval for model, entry in errors.items() for metric, interval in entry.intervals.items()
    }
    values |= {f"outside_admissible/{model}": entry.outside_admissible for model, entry in errors.items()}
    values |= {f"back_spin/{model}": entry.back_spin for model, entry in errors.items()}
    for fit in fits:
        values |= {f"parameters/{fit.law}/mu": fit.mu, f"parameters/{fit.law}/eps": fit.eps}
    for model, fit in joint.items():
        values |= {f"parameters/{model}/{p.name}": p.value for p in fit.parameters}
    return values


def residuals(test: Impacts, prediction: Prediction) -> dict[str, Tensor]:
    """Return the residuals of a model on the held-out trials, by tag."""
    left = test.v_post - prediction.v_post
    return {f"residuals/{name}": x for name, x in zip(test.space.symbols, left.T, strict=True)}


def law_equation(fit: LawEstimate) -> str:
    """Return a law with the mean and the spread of its parameters over the subsets, as models print themselves."""
    numbers = (("μ", fit.mu, fit.mu_std), ("ε", fit.eps, fit.eps_std))
    spread = (f"{symbol} = {mean:.4f}" + ("" if std is None else f" ± {std:.4f}") for symbol, mean, std in numbers)
    return f"{fit.law} ({fit.variant}): {', '.join(spread)}; ± is the spread over {fit.repetitions} subsets"


def _log_hyperparameters(tracker: Tracker, run: Run, provenance: Provenance, record: RunRecord) -> None:
    """Log the settings in which runs differ, under the same names in every run of every command.

    The metrics are the error of the run's one model and that of the bound below it, in every norm of the bounds; a run
    has those of its own norm.
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
    choices = {"command": ("train", "evaluate", "diagnose"), "law": (*laws.names(), _NONE)}
    shown = {}
    for metric in map(metrics.headline_metric, NORMS):
        (model, bound), error = own_tags(metric), metrics.METRICS[metric].name
        names = error, f"{error}, low, 95 %", f"{error}, high, 95 %", f"{error}, IRB bound"
        shown |= zip(map(shown_as, (model, *ends(model), bound)), names, strict=True)
    tracker.hyperparameters(values, choices, shown)


def _log_card(tracker: Tracker, provenance: Provenance, record: RunRecord) -> None:
    """Log the command and the data, the models as they print themselves, and the held-out errors."""
    data = provenance.data
    about = {
        **record.verdict,
        "Command": provenance.command,
        "Data": f"{data.source}, {data.trials} impacts",
        "SHA-256 of the data": data.sha256,
        "Device": provenance.device,
        "Versions": ", ".join(f"{name} {number}" for name, number in provenance.versions.items()),
    }
    lines = (line for equation in record.equations for line in equation.split("\n"))
    parts = [line.strip().removeprefix("+ ").partition(": ") for line in lines]
    rows = [
        (name, f"{x.mean:.4f}", NO_INTERVAL if math.isnan(x.low) else f"{x.low:.4f}–{x.high:.4f}")
        for name, x in record.errors.items()
    ]
    tracker.card(
        about,
        (
            [("Law and effects", "Equation, parameters ± standard errors"), *((name, rest) for name, _, rest in parts)],
            [(f"Held-out {metrics.METRICS[record.metric].axis}", "Mean", "95 % interval"), *rows],
        ),
    )
