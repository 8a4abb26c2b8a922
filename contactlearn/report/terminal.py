"""Terminal output of a run: the data, progress, tables of its result, and its folder; and the same in its log."""

import logging
import math
import shlex
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from textwrap import fill

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from contactlearn.core.errors import ContactLearnError, terminal_safe
from contactlearn.core.numerics import READABLE_UNITS, measured
from contactlearn.data.audit.corrections import CORRECTIONS
from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis.result import Verdict
from contactlearn.inference.evaluation.metrics import METRICS, bounded_metrics
from contactlearn.report.text.names import join_words, law_label, model_label, model_labels, sentence
from contactlearn.report.text.numbers import NO_INTERVAL
from contactlearn.report.text.sentences import correct_setting, phrase
from contactlearn.results.runs import absolute, as_table, common_metric, distinguishing, read_runs
from contactlearn.results.types import (
    BodyTransfer,
    DiagnosisRun,
    Evaluation,
    JointEstimate,
    LawEstimate,
    LearningCurve,
    Pair,
    ProcessEstimate,
    Training,
)

console = Console()
"""Standard output."""
_log = logging.getLogger("contactlearn")
_MANY = 20  # trials from which on standard errors cover what they should
_COMPUTED = {
    "r": "contact points from the shape and orientation (rad and counter-clockwise, unless data.units says otherwise)",
    "inertia": "the inertia from the shape and the mass, at uniform density",
    "orientation": "no orientation, which a disc does not need: nothing is seen to depend on it",
    "spin": "the spin, which nobody measured: 0 before impact, and after it what the moment of the impulse makes; "
    "friction and slip are those of bodies that did not spin, and depend on the inertia: 2/5 m r² of a solid ball, 1/2 "
    "m r² of a disc",
    "slip": "no velocity along the floor: bounces along the normal show restitution alone",
    "height": "the height from the contact point",
    "place": "positions along the floor are set to 0: no dependence on them can be seen",
}
_NARROWEST = 80  # columns of a terminal that tables are made for
_LONGER, _LONGER_TIMES = 300, 5  # s for the search again after one cut short, or so many times what it had
_CONTINUED = ", continued"
_MAX_RUNS = 20  # runs in the table of a sweep
_MAX_SETTINGS = 5  # settings in it


def print_line(line: str, *, shown: bool = True, copied: bool = False) -> None:
    """Log a line, and print it if it is shown: no markup, plain spaces, nothing that steers a terminal.

    It is folded to the width of a terminal, but for paths and commands that are to be `copied`.
    """
    text = terminal_safe(line.replace("\u00a0", " "))
    if shown:
        folds = not copied and console.is_terminal
        indent = " " * (len(text) - len(text.lstrip()) + 2)
        whole = partial(fill, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
        console.print(Text(whole(text, console.width) if folds else text), soft_wrap=True)
    _log.info("%s", text)


def show_reused_trainings(trainings: int) -> None:
    """Print how many trainings of an earlier run of the same command are reused, if any."""
    if trainings:
        print_line(f"trainings reused from an earlier run of the same command: {trainings}")


def show_models(result: Training | Evaluation) -> None:
    """Print parameters and held-out errors, a row a model.

    The spread over the subsets stands beside a shared fit, the standard error beside a joint fit.
    """
    shown = {name: METRICS[name] for name in (*bounded_metrics(result.norm), "velocity_error")}
    reach = result.reach if isinstance(result, Evaluation) else {}
    labels, errors, rows = model_labels(result), list[Sequence[str]](), list[Sequence[str]]()
    found = {fit.law: ((fit.mu, fit.mu_std), (fit.eps, fit.eps_std)) for fit in result.fits}
    found |= {
        name: tuple((p.value, p.standard_error) for p in fit.parameters[:2]) for name, fit in result.joint.items()
    }
    for model, entry in result.errors.items():
        cells = [f"{entry.intervals[name].mean:.4f}" if name in entry.intervals else "" for name in shown]
        low, high = entry.of(result.metric).low, entry.of(result.metric).high
        cells[0] += f" ({NO_INTERVAL})" if math.isnan(low) else f" ({low:.4f}–{high:.4f})"
        errors.append((labels[model], *cells))
        mu, eps = (_spread(*pair) for pair in found[model]) if model in found else ("", "")
        shares = entry.outside_admissible, entry.back_spin, *([reach[model]] if model in reach else [])
        rows.append((labels[model], mu, eps, *(f"{100 * share:.1f} %" for share in shares)))
    units = [f"{metric.name} {metric.unit}".strip(" –") for metric in shown.values()]
    print_table("Mean error on the held-out trials (95 % interval)", ("model", *units), errors)
    print_line(phrase("bounds", result.norm))
    headings = ("model", "μ", "ε", "impossible", "back-spin", *["reach"] * bool(reach))
    print_table("Coefficients of the laws, and shares of the predictions", headings, rows)
    print_line("impossible: share of predictions that gain energy, pull or penetrate")
    print_line(phrase("back_spin", result.back_spin))
    if reach:
        print_line(phrase("reach"))
    if note := phrase("joint_row", result.fits, result.joint):
        print_line(note)
    for fit in result.fits:
        if fit.mu_undetermined > 0.05:
            print_line(
                f"note: {100 * fit.mu_undetermined:.0f} % of the subsets leave μ of {law_label(fit.law)} undetermined "
                "(flat cost)"
            )


def show_joint(name: str, fit: JointEstimate) -> None:
    """Print a law with effects as an equation, and the parameters that the data do not determine."""
    print_line(fit.equation)
    for parameter, reason in fit.undetermined.items():
        print_line(f"note: the data do not determine {parameter}: {reason}")
    for parameter, meaning in fit.at_bounds.items():
        print_line(f"note: {parameter} {meaning}")
    for parameter in fit.known:
        print_line(f"note: {phrase('known_parameter', parameter)}")
    if fit.trials < _MANY:
        print_line(
            f"note: standard errors from {fit.trials} trials are too small; they are reliable from {_MANY} trials on"
        )
    if fit.outliers:
        are = "is an outlier" if fit.outliers == 1 else "are outliers"
        print_line(f"note: {fit.outliers} of {fit.trials} trials {are} with almost no weight")
    if not fit.converged:
        print_line(f"note: the fit of {name} has not converged; more starts (fit.starts) or fewer effects may help")


def show_reference(fits: Sequence[LawEstimate], reference: Mapping[str, Sequence[Pair]]) -> None:
    """Print published (μ, ε), (mean, standard deviation) each, beside ours; differences in joint deviations of both."""
    title = "Published table beside ours: means ± standard deviations over the subsets"
    halves = ((f"{x} published", f"{x} here", f"Δ{x}", f"Δ{x}/σ") for x in "με")
    rows = list[Sequence[str]]()
    for fit in fits:
        if fit.law not in reference:
            continue
        cells = []
        ours = ((fit.mu, fit.mu_std), (fit.eps, fit.eps_std))
        for (mean, std), (published, published_std) in zip(ours, reference[fit.law], strict=True):
            sigma = math.nan if std is None else (std**2 + published_std**2) ** 0.5
            cells += [f"{published:g} ± {published_std:g}", _spread(mean, std)]
            cells += [f"{mean - published:+.3f}", f"{(mean - published) / sigma:+.1f}"]
        rows.append((law_label(fit.law), *cells))
    print_table(title, ("law", *chain.from_iterable(halves)), rows)


def show_processes(processes: Sequence[ProcessEstimate], kind: str) -> None:
    """Print hyperparameters of a learned model, a row an output; `kind` is that of its processes."""
    features = list(processes[0].length_scales)
    title = "Gaussian processes: length scales in standard deviations of each feature; –: longer than the data span"
    rows = list[Sequence[str]]()
    for entry in processes:
        unit, factor = READABLE_UNITS.get(entry.unit, (entry.unit, 1.0))
        scales = [f"{x:.2f}" if x < 20 else "–" for x in entry.length_scales.values()]
        sizes = [f"{factor * x:.2g}" for x in (entry.spread, entry.noise)]
        rows.append((f"{entry.output} ({unit})".removesuffix(" (–)"), *scales, *sizes))
        if not entry.converged:
            print_line(f"note: the process of {entry.output} has not converged after {entry.evaluations} evaluations")
    print_table(title, ("output", *features, "spread", "noise"), rows)
    print_line(f"Gaussian processes: {kind}")


def show_sizes(sizes: Sequence[int], wanted: Sequence[int], seeds: int, pool: int) -> None:
    """Print the subsets from which learning curves are computed."""
    print_line(f"learning curves: {seeds} random subsets each of {', '.join(map(str, sizes))} trials")
    left_out = [str(size) for size in wanted if size not in sizes]
    if left_out:
        print_line(f"note: sizes {', '.join(left_out)} are skipped: the pool has only {pool} trials")
    if pool in sizes and seeds > 1:
        print_line(f"note: at {pool} trials all subsets are identical")


def show_curves(curves: Mapping[str, LearningCurve], metric: str, published: Mapping[str, int]) -> None:
    """Print an error of each model against the number of trials, and its calibration at the end.

    Beside the number from which an error has settled stands the published one, if there are any.
    """
    first = next(iter(curves.values()))
    below = [f"< {model_label(level)}" for level in first.below[metric]]
    title = f"{METRICS[metric].label} on the held-out trials against the number of training trials"
    settled = ["settled", *["published"] * bool(published)]
    means, needed, calibration = list[Sequence[str]](), list[Sequence[str]](), list[Sequence[str]]()
    for model, curve in curves.items():
        means.append((model_label(model), *(f"{interval.mean:.3f}" for interval in curve.of(metric))))
        reached = [str(size or "never") for size in curve.below[metric].values()]
        ours = [str(curve.settled[metric] or "not yet"), *[str(published.get(model, ""))] * bool(published)]
        needed.append((model_label(model), *reached, *ours))
        if curve.calibration is not None:  # a law with effects predicts no covariance
            coverage, density = curve.calibration.coverage[-1], curve.calibration.negative_log_density[-1]
            calibration.append((model_label(model), f"{100 * coverage:.1f} %", f"{density:.2f}"))
    print_table(title, ("model", *map(str, first.sizes)), means)
    if {*curves} & {"state_velocity", "x1_impulse", "x2_impulse", "x1_wrench"}:
        print_line(phrase("features"))
    below = [f"< {model_label(level)}" for level in first.below[metric]]
    print_table("Training trials from which the mean error is below a bound", ("model", *below, *settled), needed)
    print_line("settled: from here on it stays within 5 % of its best")
    if not calibration:
        return
    print_table(
        f"Predicted 95 % ellipsoids at {first.sizes[-1]} trials", ("model", "coverage", "−log density"), calibration
    )
    print_line("coverage: share of the measured velocities and spins inside")
    described = defaultdict[str, list[str]](list)  # models by the description of their processes
    for model, curve in curves.items():
        if curve.calibration is None:
            continue
        kinds = defaultdict[str, list[str]](list)
        for size, kind in zip(curve.sizes, curve.calibration.processes, strict=True):
            kinds[kind].append(str(size))
        parts = [kind + (f" at {', '.join(sizes)} trials" if len(kinds) > 1 else "") for kind, sizes in kinds.items()]
        for size, share in zip(curve.sizes, curve.calibration.converged, strict=True):
            if share < 1:
                parts.append(f"{100 * (1 - share):.0f} % did not converge at {size} trials")
        described["; ".join(parts)].append(model_label(model))
    for description, models in described.items():
        which = f" of {join_words(models)}" if len(described) > 1 else ""
        print_line(f"Gaussian processes{which}: {description}")


def show_transfer(model: str, bodies: Mapping[str, BodyTransfer], sizes: Sequence[int], metric: str) -> None:
    """Print an error on each other body: as trained, and against the number of its trials."""
    title = f"{model_label(model)} on other bodies: {METRICS[metric].label} against the number of their trials"
    rows = list[Sequence[str]]()
    for body, found in bodies.items():
        zero = f"{found.zero_shot[0].mean:.3f}"
        rows.append((f"{body}, trained model as prior", zero, *(f"{one.mean:.3f}" for one in found.prior)))
        rows.append((f"{body}, from scratch", "", *(f"{one.mean:.3f}" for one in found.scratch)))
    print_table(title, ("body", "0", *map(str, sizes)), rows)


def show_end(folder: Path, learnt: str) -> None:
    """Print what was learnt in a sentence, the run's folder, and the commands that show it."""
    shown = relative(folder)
    if learnt:
        print_line(f"learned: {learnt}")
    print_line(f"results: {shown}", copied=True)
    if (folder / "report.html").exists():
        show_report(folder)
    print_line(f"plots: tensorboard --logdir {shlex.quote(str(shown))}", copied=True)


def show_report(folder: Path) -> None:
    """Print the page of a run."""
    print_line(f"report: {shlex.quote(str(relative(folder / 'report.html')))}", copied=True)


def show_next(*commands: str) -> None:
    """Print the next command, and what may be done in its place."""
    for word, command in zip(("next", "  or"), commands, strict=False):
        print_line(f"{word}: {command}", copied=True)


def relative(path: Path) -> Path:
    """Return a path from the working directory if it is below it."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def next_commands(result: DiagnosisRun, folder: Path) -> tuple[str, ...]:
    """Return the commands that go on from a diagnosis: a search that ran out of time again, else with its model.

    Args:
        result: of the run.
        folder: of the run.
    """
    diagnosis, provenance = result.diagnosis, result.provenance
    coming = model_commands(result.use, folder) if diagnosis.missing else ()
    if diagnosis.physics is not Verdict.UNFINISHED or not provenance.command:
        return coming
    words = [word for word in shlex.split(provenance.command) if not word.startswith("seconds=")]
    longer = max(_LONGER, _LONGER_TIMES * float(provenance.config.get("seconds") or 0.0))
    return (shlex.join([*words, f"seconds={longer:.0f}"]), *coming[:1])


def model_commands(use: str, folder: Path) -> tuple[str, str]:
    """Return the commands that train, and that export, the model of a diagnosis from the folder of its run.

    Args:
        use: the command that evaluates it without that folder; classes of other packages are taken from it.
        folder: of the run.
    """
    classes = [word for word in shlex.split(use) if "_target_=" in word and "=contactlearn.effects." not in word]
    shown = str(relative(folder))
    train, export = ["train", f"model={shown}", *classes], ["export", shown, "--to", "c"]
    return shlex.join(["contactlearn", *train]), shlex.join(["contactlearn", *export])


def show_columns(unused: Sequence[str], computed: Sequence[str], read_as: Sequence[str] = ()) -> None:
    """Print how a table was understood, its unused columns, and the fields that the body's shape gave."""
    if read_as:
        print_line(f"read as: {'; '.join(read_as)}")
    if unused:
        print_line(
            f"columns not used: {', '.join(name if name.isprintable() and name else repr(name) for name in unused)}"
        )
    if computed:
        print_line(f"computed: {'; '.join(_COMPUTED[field] for field in computed)}")


def show_mistakes(findings: Sequence[Finding], corrected: Sequence[str]) -> None:
    """Print a line for each mistake in the measurements, with the setting that corrects all that can be.

    Args:
        findings: mistakes.
        corrected: corrections that were made before.
    """
    setting = correct_setting(corrected, findings)
    for finding in findings:
        name = finding.correction
        if name is None:
            print_line(f"audit: {sentence(finding.sentence)}")
        else:
            text = CORRECTIONS[name].description if finding.hypothesis else finding.sentence
            print_line(f"audit: {text}: use {setting}")


def show_sweep(folders: Sequence[Path], place: Path) -> None:
    """Print the finished runs of a sweep, those with the lowest error where they are many, and how to compare all.

    Args:
        folders: of the runs.
        place: of the sweep.
    """
    try:
        runs, _ = read_runs(absolute(folders))
    except ContactLearnError:  # none of them has one held-out error
        return
    settings = dict(list(distinguishing(runs).items())[:_MAX_SETTINGS])
    rows = as_table(runs).query("own").reset_index(drop=True)
    metric = common_metric(runs)
    best = rows[metric].fillna(math.inf).sort_values(kind="stable").index[:_MAX_RUNS]
    few = f", the {_MAX_RUNS} of {len(runs)} runs with the lowest" if len(runs) > _MAX_RUNS else ""
    found = ["found"] if rows.found.any() else []
    cells = list[Sequence[str]]()
    for k, row in rows.loc[sorted(best)].iterrows():
        error = f"{row[metric]:.4f}", f"{row[f'{metric}_low']:.4f}–{row[f'{metric}_high']:.4f}"
        names = [row.found or "none"] if found else []
        shown = ("", "") if math.isnan(row[metric]) else error
        cells.append((*(values[k] or "" for values in settings.values()), *names, *shown))
    print_table(f"Held-out errors of the sweep{few}", (*settings, *found, METRICS[metric].name, "95 %"), cells)
    for word, ending in (("report", ""), ("results", " -o results.parquet")):
        print_line(f"compare: contactlearn {word} {shlex.quote(str(place))}{ending}", copied=True)


def _spread(mean: float, std: float | None) -> str:
    return f"{mean:.3f}" if std is None else measured(mean, std)


def print_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print and log a table within the width of the terminal, 80 columns at least.

    Columns that do not fit follow in further tables with the first column again, which folds beyond half the width.

    Args:
        title: above the first table.
        headings: of the columns; the first is left-aligned, the others right-aligned.
        rows: cells by column; the last ones may lack.
    """
    rows = [(*row, *[""] * (len(headings) - len(row))) for row in rows]
    wide = Console(width=max(console.width, _NARROWEST), markup=False, emoji=False, record=True)

    def table(columns: Sequence[int]) -> Table:
        made = Table(box=SIMPLE_HEAD, pad_edge=False)
        made.add_column(Text(headings[0]), max_width=wide.width // 2)
        for column in columns:
            made.add_column(Text(headings[column]), justify="right", no_wrap=True)
        whole = len(columns) == len(headings) - 1
        for row in (one for one in rows if whole or any(one[column] for column in columns)):
            made.add_row(*(Text(row[column]) for column in (0, *columns)))
        return made

    unlimited = wide.options.update(max_width=1000)
    width = lambda columns: Measurement.get(wide, unlimited, table(columns)).maximum  # noqa: E731
    columns = [*range(1, len(headings))]
    while columns:
        count = max((k for k in range(1, len(columns) + 1) if width(columns[:k]) <= wide.width), default=1)
        wide.print(Text(title))  # which, as a table's title, would be folded at its width
        wide.print(table(columns[:count]))
        columns, title = columns[count:], title if title.endswith(_CONTINUED) else f"{title}{_CONTINUED}"
    _log.info("\n%s", wide.export_text().rstrip())
