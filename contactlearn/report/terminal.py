"""What a run prints: the data, progress, the tables and where everything lies."""

import math
import shlex
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import MappingProxyType

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from contactlearn.evaluation.metrics import HEADLINE, METRICS
from contactlearn.identification.joint import JointFit
from contactlearn.identification.shared import SharedFit
from contactlearn.impacts import Impacts

_console = Console()
_MANY = 20  # trials from which on standard errors cover what they should
_SHORT = {"mass_error": "mass error", "normalised_velocity_error": "velocity/speed", "velocity_error": "velocity"}


def say(line: str) -> None:
    """A line as it is: no markup, no folding of paths."""
    _console.print(Text(line), soft_wrap=True)


def progress() -> Progress:
    """A progress display; on a terminal it disappears when it is done."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=_console, transient=True)


def show_data(impacts: Impacts, pool: int, test: int) -> None:
    """One line on what is compared on what."""
    say(f"{impacts.source}: {len(impacts)} impacts, {pool} to identify from, {test} held out")


def show_models(
    fits: Sequence[SharedFit],
    errors: Mapping[str, Mapping],
    norm: str | None = None,
    joint: Mapping[str, JointFit] = MappingProxyType({}),
) -> None:
    """Parameters and held-out errors, a row a model; `norm` is that of the bounds if they are among them.

    Beside a shared fit stands the spread over its subsets, beside a joint fit the standard error.
    """
    units = (f"{_SHORT[name]} {metric.unit}".strip(" –") for name, metric in METRICS.items())
    title = "Errors on the held-out trials: means, and the 95 % interval of the first"
    table = _table(title, "model", "μ", "ε", *units, "outside")
    found = {fit.law.name: (fit.mean(), fit.std()) for fit in fits}
    found |= {name: (fit.values[:2].tolist(), fit.standard_errors[:2].tolist()) for name, fit in joint.items()}
    for model, entry in errors.items():
        mu, eps = map(_spread, *found[model]) if model in found else ("", "")
        cells = [f"{entry[name]['mean']:.4f}" for name in METRICS]
        cells[0] += f"  {entry[HEADLINE]['low']:.4f}–{entry[HEADLINE]['high']:.4f}"
        table.add_row(model, mu, eps, *cells, f"{100 * entry['outside_admissible']:.1f} %")
    _print(table)
    say("outside: share of predictions that gain energy, pull or penetrate")
    if norm is not None:
        bounded = "only the mass error is bounded" if norm == "mass" else "none of these errors is bounded"
        say(f"the bounds come closest in the {norm} norm of (v_x, v_y, ω): {bounded}")
    for fit in fits:
        share = fit.mu_flat[:, -1].double().mean().item()
        if share > 0.05:
            say(f"note: {100 * share:.0f} % of the subsets leave μ of {fit.law.name} undetermined (flat cost)")


def show_joint(name: str, fit: JointFit) -> None:
    """A law with effects as an equation, and what the data leave open."""
    say(str(fit.model))
    for parameter, reason in fit.undetermined().items():
        say(f"note: the data do not determine {parameter}: {reason}")
    for parameter, meaning in fit.at_bounds().items():
        say(f"note: {parameter} {meaning}")
    if len(fit.weight) < _MANY:
        say(f"note: from {len(fit.weight)} trials standard errors are too small; {_MANY} or more can be trusted")
    if fit.outliers:
        say(f"note: {fit.outliers} of {len(fit.weight)} trials hardly count, so far off are they")
    if not fit.converged:
        say(f"note: the fit of {name} has not settled; more starts (fit.starts) or fewer effects may help")


def show_reference(fits: Sequence[SharedFit], reference: Mapping[str, Mapping]) -> None:
    """Published parameters beside ours; differences in joint standard deviations of both."""
    title = "Published table beside ours: means ± standard deviations over the subsets"
    halves = ((f"{x} published", f"{x} here", f"Δ{x}", f"Δ{x}/σ") for x in "με")
    table = _table(title, "law", *chain.from_iterable(halves))
    for fit in fits:
        if fit.law.name not in reference:
            continue
        cells = []
        for name, mean, std in zip(("mu", "eps"), fit.mean(), fit.std(), strict=True):
            published, published_std = reference[fit.law.name][name]
            sigma = (std**2 + published_std**2) ** 0.5
            cells += [_spread(published, published_std), _spread(mean, std)]
            cells += [f"{mean - published:+.3f}", f"{(mean - published) / sigma:+.1f}"]
        table.add_row(fit.law.name, *cells)
    _print(table)


def show_processes(entries: Sequence[Mapping], kind: str) -> None:
    """Hyperparameters of a learned model, a row an output; `kind` is that of its processes."""
    features = list(entries[0]["length_scales"])
    table = _table(
        "Length scales, in standard deviations of each feature over the training trials; – is past what they span",
        "output", *features, "spread", "noise", "evaluations",
    )  # fmt: skip
    for entry in entries:
        scales = [f"{x:.2f}" if x < 20 else "–" for x in entry["length_scales"].values()]
        sizes = [f"{entry[name]:.2g} {entry['unit']}".removesuffix(" –") for name in ("spread", "noise")]
        count = f"{entry['evaluations']}" + ("" if entry["converged"] else " (not converged)")
        table.add_row(entry["output"], *scales, *sizes, count)
    _print(table)
    say(f"Gaussian processes: {kind}")


def show_sizes(sizes: Sequence[int], wanted: Sequence[int], seeds: int, pool: int) -> None:
    """What the learning curves are drawn from."""
    say(f"learning curves: {seeds} random subsets each of {', '.join(map(str, sizes))} trials")
    left_out = [str(size) for size in wanted if size not in sizes]
    if left_out:
        say(f"note: sizes {', '.join(left_out)} are left out, since {pool} trials are there to draw from")
    if pool in sizes and seeds > 1:
        say(f"note: at {pool} trials all subsets are the same")


def show_left_out(models: Sequence[str]) -> None:
    """Models that cannot be learnt around effects."""
    if models:
        say(f"note: {', '.join(models)} takes each trial's (μ, ε) from the law alone, and is left out with effects")


def show_curves(curves: Mapping[str, Mapping], sizes: Sequence[int]) -> None:
    """Headline error of each learned model against the number of trials, and how sure it is at the end."""
    levels = list(next(iter(curves.values()))["below"][HEADLINE])
    title = f"{METRICS[HEADLINE].label} on the held-out trials against the number of training trials"
    below = [f"< {level}" for level in levels]
    table = _table(title, "model", *map(str, sizes), *below, "settled", "coverage", "−log density")
    for model, entry in curves.items():
        means = [f"{interval['mean']:.3f}" for interval in entry[HEADLINE]]
        first = [str(entry["below"][HEADLINE][level] or "never") for level in levels]
        sure = ("", "")  # a law with effects predicts no covariance
        if "coverage" in entry:
            sure = f"{100 * entry['coverage'][-1]:.1f} %", f"{entry['negative_log_density'][-1]:.2f}"
        table.add_row(model, *means, *first, str(entry["settled"][HEADLINE] or "not yet"), *sure)
    _print(table)
    say("<: number of trials at which the mean is first below; settled: from which on it is within 5 % of its best")
    for model, entry in curves.items():
        processes = (entry["sizes"], entry["processes"], entry["converged"]) if "coverage" in entry else ((), (), ())
        for size, kind, share in zip(*processes, strict=True):
            if kind != "exact" or share < 1:
                short = "" if share == 1 else f"; {100 * (1 - share):.0f} % of them did not converge"
                say(f"note: the processes of {model} at {size} trials are {kind}{short}")
    say("coverage: share of (v_x, v_y, ω) inside the predicted 95 % ellipsoid, and density, at the largest size")


def show_transfer(model: str, intervals: Mapping[str, Mapping], sizes: Sequence[int]) -> None:
    """Headline error on each other body: as trained, and against the number of its trials."""
    title = f"{model} on other bodies: {METRICS[HEADLINE].label.lower()} against the number of their trials"
    table = _table(title, "body", "", "0", *map(str, sizes))
    for body, ways in intervals.items():
        zero = f"{ways['zero_shot'][0, 0]:.3f}"
        for way, label, first in (("prior", "trained model as prior", zero), ("scratch", "from scratch", "")):
            table.add_row(body if first else "", label, first, *(f"{mean:.3f}" for mean in ways[way][:, 0].tolist()))
    _print(table)


def show_folder(folder: Path) -> None:
    """Where the run's results lie and how to look at them."""
    shown = folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder
    say(f"results  {shown}")
    if (folder / "report.html").exists():
        say(f"open     {shlex.quote(str(shown / 'report.html'))}")
    say(f"look at  tensorboard --logdir {shlex.quote(str(shown))}")


def _spread(mean: float, std: float) -> str:
    return f"{mean:.3f} ± {std:.3f}" if math.isfinite(std) else f"{mean:.3f}"


def _table(title: str, *headings: str) -> Table:
    """A table with its first column on the left and the others on the right."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=True)
    return table


def _print(table: Table) -> None:
    """Print at the table's own width: a narrow terminal wraps lines instead of losing cells."""
    wide = Console(width=1000)
    wide.width = max(_console.width, wide.measure(table).maximum)
    wide.print(table)
