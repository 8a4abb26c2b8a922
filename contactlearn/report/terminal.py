"""What a run prints: the data, progress, the tables and where everything lies."""

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from contactlearn.fit import SharedFit
from contactlearn.impacts import Impacts
from contactlearn.metrics import HEADLINE, METRICS

_console = Console(soft_wrap=True)


def progress() -> Progress:
    """A progress display; on a terminal it disappears when it is done."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=_console, transient=True)


def show_data(impacts: Impacts, pool: int, test: int) -> None:
    """One line on what is compared on what."""
    _console.print(Text(f"{impacts.source}: {len(impacts)} impacts, {pool} to identify from, {test} held out"))


def show_models(fits: list[SharedFit], errors: dict) -> None:
    """Parameters and held-out errors, a row a model."""
    others = [name for name in METRICS if name != HEADLINE]
    table = Table(title="Held-out errors (mean; 95 % interval of the headline)", title_justify="left")
    for heading in ("model", "μ", "ε", HEADLINE.replace("_", " ")):
        table.add_column(heading, justify="left" if heading == "model" else "right", no_wrap=True)
    for name in others:
        unit = METRICS[name].unit
        table.add_column(name.replace("_", " ") + ("" if unit == "–" else f" {unit}"), justify="right")
    table.add_column("outside admissible", justify="right")
    by_law = {fit.law: fit for fit in fits}
    for model, entry in errors.items():
        mu = eps = ""
        if model in by_law:
            (mu_mean, eps_mean), (mu_std, eps_std) = by_law[model].mean(), by_law[model].std()
            mu, eps = f"{mu_mean:.3f} ± {mu_std:.3f}", f"{eps_mean:.3f} ± {eps_std:.3f}"
        cells = [f"{entry[HEADLINE]['mean']:.4f}  {entry[HEADLINE]['low']:.4f}–{entry[HEADLINE]['high']:.4f}"]
        cells += [f"{entry[name]['mean']:.4f}" for name in others]
        table.add_row(model, mu, eps, *cells, f"{100 * entry['outside_admissible']:.1f} %")
    _console.print(table)
    for fit in fits:
        share = fit.mu_flat[:, -1].double().mean().item()
        if share > 0.05:
            _console.print(f"note: {100 * share:.0f} % of the subsets leave μ of {fit.law} undetermined (flat cost)")


def show_reference(fits: list[SharedFit], reference: dict) -> None:
    """Published parameters beside ours; differences in joint standard deviations of both."""
    table = Table(title="Published table beside ours (mean ± standard deviation over subsets)", title_justify="left")
    for heading in ("law", "μ published", "μ here", "Δμ", "Δμ/σ", "ε published", "ε here", "Δε", "Δε/σ"):
        table.add_column(heading, justify="left" if heading == "law" else "right", no_wrap=True)
    for fit in fits:
        if fit.law not in reference:
            continue
        cells = []
        for name, mean, std in zip(("mu", "eps"), fit.mean(), fit.std(), strict=True):
            published, published_std = reference[fit.law][name]
            sigma = (std**2 + published_std**2) ** 0.5
            difference = mean - published
            cells += [f"{published:.3f} ± {published_std:.3f}", f"{mean:.3f} ± {std:.3f}", f"{difference:+.3f}"]
            cells.append(f"{difference / sigma:+.1f}")
        table.add_row(fit.law, *cells)
    _console.print(table)


def show_folder(folder: Path) -> None:
    """Where the run's results lie and how to look at them."""
    _console.print(Text(f"results  {folder}"))
    _console.print(Text(f"look at  tensorboard --logdir {folder}"))
