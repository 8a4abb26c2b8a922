"""All figures of a diagnosis.

    drawn            every figure by file name
    audit_figure     the moment balance behind a finding about the measurements
    ladder_figure    errors of the law, effect after effect, Gaussian processes and noise
    laws_figure      errors of the laws alone
    budget_figure    shares of the law's error: explained, unnamed, unexplained, instrument, scatter of the contact
    frontier_figure  errors of the best model of each number of effects
    regions_figure   errors of the trials over the variable of each region in which the law fails
    residual_figure  the residual wrench of the full model along the symbols that predict it
    scatter_figure   deviations of each impact over the sequence and the variable that is most related to them

A dot is a trial.  Impulses are shown in mN s, moments in mN m s, contact points in mm, angles of regions in degrees.
"""

import math
from collections.abc import Mapping, Sequence
from textwrap import fill, wrap
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Real
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.core.numerics import READABLE_UNITS, wrapped
from contactlearn.data.audit.evidence import BalanceEvidence, BalanceSide
from contactlearn.diagnosis.result import (
    ComponentTest,
    Deviations,
    Diagnosis,
    ErrorBudget,
    Finding,
    Record,
    Region,
    Remainder,
    RungKind,
    wrench_columns,
)
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state, symbol_named
from contactlearn.inference.evaluation.impulse_space import ScatterCloud
from contactlearn.inference.evaluation.metrics import METRICS, Interval
from contactlearn.inference.evaluation.partial_residuals import QUANTITIES, binned, share_explained
from contactlearn.inference.evaluation.variables import Variable
from contactlearn.mechanics.space import PLANE
from contactlearn.report.figures import style as st
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.impulse_space import scattered_impulses
from contactlearn.report.text.names import base_label, capitalize_first, effect_label, rung_label
from contactlearn.report.text.numbers import error, fix_spacing, percent
from contactlearn.report.text.sentences import phrase

_BLUE, _RED, _YELLOW = st.CONTRAST
_INKS = {
    RungKind.LAW: st.tint(_BLUE, 0.45), RungKind.EFFECT: st.tint(_BLUE, 0.45),
    RungKind.PROCESSES: st.tint(_YELLOW, 0.6),
}  # fmt: skip
"""Colours of physics and of what is learned without a name; noise is grey."""
_PARTS = {
    "physics": st.tint(_BLUE, 0.8), "unnamed": st.tint(_RED, 0.35), "unexplained": st.tint(_RED, 0.8),
    "noise": st.tint(st.DARK, 0.35), "scatter": st.tint(_YELLOW, 0.8),
}  # fmt: skip
_LOOKS: tuple[dict[str, Any], ...] = ({"color": _BLUE}, {"color": _RED, "linestyle": (0, (4, 1.5))})
_LETTERS = 48  # of a number and a name, in a line over one column
_GOLDEN = 0.618  # spreads the dots of one label
ERROR = METRICS["mass_error"].axis
"""Axis label of the mass error."""
_SYMBOLS = 2  # columns of panels, at most
_QUESTIONS = {
    "moment": "moments do not balance",
    "approach": "does not approach",
    "leaves": "does not leave",
    "push": "floor pulls",
    "below": "floor is above",
    "friction": "friction along slip",
    "energy": "gains energy",
    "units": "implausible units",
    "shape": "contact off shape",
}
_VECTOR = 5000  # dots that a PDF draws one by one


def drawn(diagnosis: Diagnosis) -> dict[str, Figure]:
    """Draw every figure of a diagnosis.

    They are `audit_<finding>`, `regions`, `residual`, `scatter`, `scatter_impulses`, `effect_<name>`, `ladder`,
    `budget` and `frontier`.

    Args:
        diagnosis: the diagnosis with the evidence of its audit, and with its record unless the data were refused.
    """
    figures, record = dict[str, Figure](), diagnosis.record
    for finding in diagnosis.findings:
        if finding.name in diagnosis.evidence:
            figures[f"audit_{finding.name}"] = audit_figure(finding, diagnosis.evidence[finding.name])
    if record is not None and diagnosis.regions:
        figures["regions"] = regions_figure(diagnosis.regions, record)
    if record is not None and diagnosis.remainder is not None:
        figures["residual"] = residual_figure(diagnosis.remainder, record)
    if record is not None and record.deviations:
        figures["scatter"] = scatter_figure(record.deviations)
    if record is not None and record.model.scatter:
        figures["scatter_impulses"] = scattered_impulses(ScatterCloud.along(record.model, record.impacts))
    if record is not None:
        for missing, partial in zip(diagnosis.missing, record.residuals, strict=True):
            name = "_".join(filter(None, ("effect", missing.effect.name, missing.effect.form)))
            figures[name] = effect_curve(partial, effect_label(missing.effect))
    if diagnosis.ladder:
        figures["ladder"] = ladder_figure(diagnosis)
    if diagnosis.budget is not None and diagnosis.budget.shares.noise is not None:
        figures["budget"] = budget_figure(diagnosis.budget)
    if diagnosis.frontier:
        figures["frontier"] = frontier_figure(diagnosis)
    return figures


@st.look()
def ladder_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the held-out error of each rung with its 95 % interval; the IRB bound is a line."""
    names = [rung_label(rung, base_label(diagnosis)) for rung in diagnosis.ladder]
    colors = [_INKS.get(rung.kind, st.tint(st.DARK, 0.35)) for rung in diagnosis.ladder]
    figure = error_bars(names, [rung.error for rung in diagnosis.ladder], colors)
    if diagnosis.budget is not None:
        style = st.law_style("irb")
        look: dict[str, Any] = {"color": style.color, "linestyle": style.linestyle, "zorder": 0.5}
        figure.axes[0].axvline(diagnosis.budget.bound.mean, **look, label=style.label)
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center")
    return figure


@st.look()
def laws_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the held-out error of each law without effects, the least first."""
    laws = sorted(diagnosis.laws, key=lambda one: one.error)
    errors = [Interval(law.error, law.error, law.error) for law in laws]
    return error_bars([st.law_style(law.name).label for law in laws], errors)


@st.look()
def budget_figure(budget: ErrorBudget) -> Figure:
    """Draw the shares of the law's error in one bar.

    Instrument and scatter of the contact are one where they are not told apart.  A share below 0, of effects that do
    harm on held-out trials, is not drawn.
    """
    figure = st.new_figure(st.PAGE, 1.3)
    axes, start = st.name_axes(figure.subplots(), "Share of the law's error (%)"), 0.0
    for kind, (name, share) in budget.shares.parts.items():
        axes.barh([0], [100 * share], left=[start], color=_PARTS[kind], height=0.6, label=capitalize_first(name))
        start += 100 * share
    axes.set(xlim=(0, max(start, 1.0)))
    axes.set_yticks([])
    legend_below(figure, axes)
    return figure


def error_bars(names: Sequence[str], errors: Sequence[Interval], colors: Any = _INKS[RungKind.LAW]) -> Figure:
    """Draw errors from top to bottom, each below its number and name; a line behind strikes no name through.

    Over one column: on a card of TensorBoard, which is narrow, the letters of a page could not be read.
    """
    told = [fill(f"{error(x.mean)}  {st.plain(name, 60)}", _LETTERS) for name, x in zip(names, errors, strict=True)]
    lines = [text.count("\n") + 1 for text in told]
    places = [sum(lines[: k + 1]) + k for k in range(len(told))]  # in lines of text: each bar has one of its own
    figure = st.new_figure(st.COLUMN, 0.7 + 0.19 * (sum(lines) + len(lines)))
    axes, halo = st.name_axes(figure.subplots(), ERROR), [withStroke(linewidth=3, foreground="white")]
    axes.barh(places, [x.mean for x in errors], color=colors, height=0.84)
    axes.hlines(places, [x.low for x in errors], [x.high for x in errors], color=st.DARK, linewidth=1.8)
    for place, text in zip(places, told, strict=True):
        axes.text(0, place - 0.48, text, va="bottom", path_effects=halo)
    last = places[-1] if places else 1
    axes.set(xlim=(0, 1.04 * max(x.high for x in errors) or 1), ylim=(last + 0.8, -0.6))
    axes.set_yticks([])
    return figure


@st.look()
def frontier_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the held-out error of the best model of each number of effects; the chosen number is marked."""
    figure = st.new_figure(st.PAGE, 2.6)
    axes = st.name_axes(figure.subplots(), "Number of effects (–)", ERROR)
    sizes = [len(model.effects) for model in diagnosis.frontier]
    means = [model.error.mean for model in diagnosis.frontier]
    lows, highs = ([getattr(model.error, end) for model in diagnosis.frontier] for end in ("low", "high"))
    axes.vlines(sizes, lows, highs, color=st.DARK)
    axes.plot(sizes, means, color=st.CONTRAST[0], marker="o", label="Best of each number")
    chosen = len(diagnosis.missing)
    if chosen in sizes:
        axes.plot(chosen, means[sizes.index(chosen)], color=st.CONTRAST[1], marker="o", linestyle="", label="Chosen")
    if diagnosis.budget is not None and diagnosis.budget.noise is not None:
        axes.axhline(diagnosis.budget.noise.mean, color=st.DARK, linestyle=":", label="Noise floor")
    axes.set_xticks(sizes)
    axes.set_ylim(bottom=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# --- Regions --------------------------------------------------------------------------------------


@st.look()
def regions_figure(regions: tuple[Region, ...], record: Record) -> Figure:
    """Draw the error of the law over the variable of each region, the region shaded, and its running median.

    A second median is that with the missing effects, if there are any.  Both models are fitted to all of these
    trials.  The axes leave out the outermost percent of the trials.
    """
    known = {variable.name: variable for variable in record.variables()}
    names = {"base": "Law", "model": "With effects"}
    errors = {names[model]: values for model, values in record.errors().items()}
    columns = min(2, len(regions))
    rows = math.ceil(len(regions) / columns)
    figure = st.new_figure((st.COLUMN, st.PAGE)[columns - 1], 0.4 + 2.2 * rows)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flatten()
    for axes in panels[len(regions) :]:
        axes.set_visible(False)
    for axes, region in zip(panels, regions, strict=False):
        _draw_region(axes, region, known[region.variable], errors)
    for axes in panels[::columns]:
        axes.set_ylabel(ERROR)
    legend_below(figure, panels[0])
    return figure


def _draw_region(axes: Axes, region: Region, variable: Variable, errors: Mapping[str, Float[Tensor, " n"]]) -> None:
    """One panel; `errors` by model, the law's first."""
    x, window, ends = _along(region, variable)
    law, *_ = errors.values()
    st.name_axes(axes, f"{st.plain(variable.letter)} ({variable.unit})")
    low, high = max(window[0], ends[0]), min(window[1], ends[1])
    axes.axvspan(low, high, color=st.tint(_YELLOW, 0.35), linewidth=0, label="Region", zorder=0)
    dots(axes, x, law, "Trial, law")
    for (name, values), look in zip(errors.items(), _LOOKS, strict=False):
        if variable.labels:
            _draw_medians(axes, variable, values, name, look)
        else:
            axes.plot(*_running_median(x, values), **look, linewidth=1.6, label=f"{name}, running median", zorder=3)
    if variable.labels:
        axes.set_xticks(_places(variable), ["\n".join(wrap(label, 16)) for label in variable.labels])
        axes.set_xlabel("")
    axes.set_xlim(ends)
    axes.set_ylim(0, law.quantile(0.98).item() or 1)
    text = wrap(phrase("region_error", region).replace(" = ", "\u00a0=\u00a0"), 48)
    title = st.plain(fix_spacing(region.where), 60), *text
    axes.set_title("\n".join(title))


def _along(region: Region, variable: Variable) -> tuple[Float[Tensor, " n"], tuple[float, float], tuple[float, float]]:
    """Trials along the axis in its units, the region's window there, and the ends of the axis.

    A periodic variable has the region in the middle; trials of a variable with labels are spread.
    """
    x = variable.scale * variable.values
    low, high = (variable.scale * end for end in region.limits)
    if variable.period:
        period = variable.scale * variable.period
        centre = (low + high) / 2
        shift = (centre + 180) % 360 - 180 - centre if period > 359 else centre % period - centre
        low, high, start = low + shift, high + shift, centre + shift - period / 2
        return (x - start) % period + start, (low, high), (start, start + period)
    if variable.labels:
        return x + 0.6 * ((_GOLDEN * torch.arange(len(x))) % 1 - 0.5), (low, high), (-1.5, len(variable.labels) - 1.5)
    first, last = x.quantile(torch.tensor((0.005, 0.995), dtype=x.dtype)).tolist()
    return x, (low, high), (min(first, high), max(last, low))


def _places(variable: Variable) -> range:
    """The values of a variable that has labels: −1 is the first."""
    return range(-1, len(variable.labels) - 1)


def _draw_medians(
    axes: Axes, variable: Variable, error: Float[Tensor, " n"], name: str, look: Mapping[str, Any]
) -> None:
    """The median error of each label of a variable."""
    for place in _places(variable):
        here = variable.values == place
        if here.any():
            axes.plot((place - 0.4, place + 0.4), [error[here].median().item()] * 2, **look, linewidth=1.8)
    axes.plot([], [], **look, label=f"{name}, running median")


def _running_median(x: Float[Tensor, " n"], y: Float[Tensor, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """Medians of x and y over every run of a twelfth of the trials, along x."""
    order = x.argsort()
    size = min(len(x), max(15, len(x) // 12))
    along, up = (np.lib.stride_tricks.sliding_window_view(st.array(part[order]), size) for part in (x, y))
    return np.median(along, -1), np.median(up, -1)


# --- Scatter --------------------------------------------------------------------------------------


@st.look()
def scatter_figure(deviations: Sequence[Deviations]) -> Figure:
    """Draw the most probable deviations of each impact with their standard errors, a row for each component.

    On the left they are over the sequence, on the right over the variable that they follow, or are most related to.
    In space a component has two deviations along the surface, of which the larger is drawn.
    """
    figure = st.new_figure(st.PAGE, 0.5 + 2.0 * len(deviations))
    panels = figure.subplots(len(deviations), 2, sharey="row", squeeze=False)
    for line, one in zip(panels, deviations, strict=True):
        unit, scale = READABLE_UNITS.get(one.unit, (one.unit, 1.0))
        k = int(one.u.square().sum(0).argmax())
        u, error = scale * one.u[:, k], scale * one.error[:, k]
        across = (("Order (–)", one.order), (f"{st.plain(one.variable)} ({one.variable_unit})", one.x))
        for axes, (label, x) in zip(line, across, strict=True):
            st.name_axes(axes, label)
            bars = {"color": st.tint(st.DARK, 0.15), "linewidth": 0.6, "zorder": 0.5}
            axes.vlines(st.array(x), st.array(u - error), st.array(u + error), **bars)
            dots(axes, x, u, "Impact, with its standard error")
            axes.xaxis.set_major_locator(MaxNLocator(5))
            axes.plot(*_running_median(x, u), color=_BLUE, linewidth=1.6, label="Running median", zorder=3)
        line[0].set_ylabel(f"Δ{st.plain(one.symbol)} ({unit})")
    legend_below(figure, *panels[0])
    return figure


# --- Residual -------------------------------------------------------------------------------------


@st.look()
def residual_figure(remainder: Remainder, record: Record) -> Figure:
    """Draw the measured wrench minus the model's, against the one or two symbols that matter most.

    A row for each component that processes predict; where there is none, for the one that they predict best, against
    the symbol along which its means differ most.  The outermost percent of the trials on each side is left out.
    """
    impacts, space = record.impacts, record.impacts.space
    known = of_state(State.of(impacts))
    if space is PLANE:
        known["theta"] = wrapped(known["theta"])
    residual = record.residual() * st.MILLI
    columns = {
        name: max(those, key=lambda k: residual[:, k].square().mean()) for name, those in wrench_columns(space).items()
    }
    by_name = {one.component: one for one in remainder.tested}
    tests = [by_name[name] for name in remainder.components] or [max(remainder.tested, key=lambda one: one.r_squared)]
    first = residual[:, columns[tests[0].component]]
    shares = {variable.symbol: variable.share for variable in remainder.variables}
    symbols = [name for name in shares if name in known][:_SYMBOLS] or [
        max(known, key=lambda name: share_explained(known[name], first))
    ]
    title = phrase("residual_share", remainder) if remainder.predictable else phrase("not_predictable")
    lines = wrap(title.replace("\u00a0", " "), 54 if len(symbols) == 1 else 112)
    figure = st.new_figure((st.COLUMN, st.PAGE)[len(symbols) - 1], 0.5 + st.ROW * len(lines) + 2.0 * len(tests))
    figure.suptitle("\n".join(lines))
    panels = figure.subplots(len(tests), len(symbols), sharex="col", sharey="row", squeeze=False)
    for line, test in zip(panels, tests, strict=True):
        k = columns[test.component]
        _draw_row(line, test, QUANTITIES[space]["wrench"][k], residual[:, k], [known[symbol] for symbol in symbols])
    for axes, symbol in zip(panels[-1], symbols, strict=True):
        part = f", {percent(shares[symbol])} of the prediction" if symbol in shares else ""
        axes.set_xlabel(f"{symbol_named(symbol).letter} ({symbol_named(symbol).unit}){part}")
    legend_below(figure, panels[0, 0])
    return figure


def _draw_row(
    panels: Sequence[Axes],
    test: ComponentTest,
    quantity: tuple[str, str],
    residual: Float[Tensor, " n"],
    along: Sequence[Float[Tensor, " n"]],
) -> None:
    """One component against each symbol."""
    ends = residual.quantile(torch.tensor((0.01, 0.99), dtype=residual.dtype))
    shown = (residual >= ends[0]) & (residual <= ends[1])
    letter, unit = quantity
    for axes, x in zip(panels, along, strict=True):
        _draw_means(axes, x[shown], residual[shown])
    panels[0].set_ylabel(f"Residual of {letter} (m{unit})")
    title = f"{letter}: R² = {test.r_squared:.2f} ± {test.standard_error:.2f} on held-out trials"
    panels[0].set_title(title, loc="left")


def _draw_means(axes: Axes, x: Float[Tensor, " n"], values: Float[Tensor, " n"]) -> None:
    """Trials, and means of groups of equal number along x with their standard errors."""
    bins = max(20, min(40, len(x) // 40))
    middle, mean, square = binned(x, values, values.square(), bins=bins)
    error = ((square - mean.square()).clamp_min(0) * len(mean) / len(x)).sqrt()
    st.name_axes(axes)
    axes.axhline(0, color=st.DARK, linewidth=0.6)
    dots(axes, x, values)
    label = f"Mean of {len(x) // bins} trials ± standard error"
    axes.errorbar(
        st.array(middle), st.array(mean), st.array(error), fmt="o", color=_RED, markersize=3.5, elinewidth=0.9,
        capsize=2, label=label, zorder=3,
    )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(6))


# --- Evidence for findings ---------------------------------------------------------------------------


@st.look()
def audit_figure(finding: Finding, evidence: BalanceEvidence) -> Figure:
    """Draw the moment balance behind a finding about units, axes or inertia, under its coefficients.

    Both sides of the balance, and how much the trials contradict themselves, are shown without the correction and with
    it, the outermost percent of the moments left out.
    """
    name = finding.correction
    titles = (f"Without {name}", f"With {name}") if name else ("As read", "Under the best hypothesis")
    sides = (evidence.before,) if evidence.after is None else (evidence.before, evidence.after)
    fits = (", ".join(f"{x} = {value:.2f}" for x, (value, *_) in side.fit.terms.items()) for side in sides)
    figure = st.new_figure(st.PAGE, 2.85 + st.ROW)
    figure.suptitle(f"Moment balance: {' → '.join(fit or 'open' for fit in fits)}".replace("-", "−"))
    shown = dict(zip(titles, sides, strict=False))
    *panels, axes = figure.subplots(1, len(shown) + 1, width_ratios=(*(1 for _ in shown), 0.8))
    for panel, (title, side) in zip(panels, shown.items(), strict=True):
        _draw_balance(panel, title, side)
    _draw_contradictions(axes, shown)
    legend_below(figure, panels[0], axes)
    return figure


def _draw_balance(axes: Axes, title: str, side: BalanceSide) -> None:
    """I Δω against r_x P_n − r_y P_t, trial by trial, with the two slopes of the fitted balance."""
    fit, moments = side.fit, st.MILLI * side.moments
    reach = 1.1 * moments.abs().amax(0).quantile(0.99).item() or 1.0  # central impacts have no moments
    power = 0 if 1e-2 < reach < 1e4 else math.floor(math.log10(reach))
    unit = f"$10^{{{power}}}$ mN m s" if power else "mN m s"
    st.name_axes(axes, f"r_x P_n − r_y P_t ({unit})", f"I Δω ({unit})")
    dots(axes, *moments / 10**power)
    axes.axline((0, 0), slope=1, color=_RED, label="Slope 1: balanced")
    axes.set(xlim=(-reach / 10**power, reach / 10**power), ylim=(-reach / 10**power, reach / 10**power))
    axes.set_box_aspect(1)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    values = (("a", fit.a, fit.a_error), ("b", fit.b, fit.b_error))
    lines = (f"{x} = {y:+#.3g} ± {error:.1g}" if error < math.inf else f"{x} is open" for x, y, error in values)
    axes.set_title("\n".join((title, *lines)).replace("-", "−"))


def _draw_contradictions(axes: Axes, shown: Mapping[str, BalanceSide]) -> None:
    """The mean contradiction of each kind, of both sides by title."""
    means = {title: [*side.contradictions.values()] for title, side in shown.items()}
    questions = [_QUESTIONS[key] for key in next(iter(shown.values())).contradictions]
    places = range(len(questions))
    st.name_axes(axes, "Mean contradiction (–)")
    ends = [*means.values()]
    axes.hlines(places, ends[0], ends[-1], color=st.DARK, linewidth=0.8)
    for size, face, (title, values) in zip((5, 4), ("white", _BLUE), means.items(), strict=False):
        axes.plot(values, places, "o", color=_BLUE, markerfacecolor=face, markersize=size, label=title)
    axes.set_yticks(places, questions)
    axes.set_xlim(-0.04, 1.04)
    axes.set_box_aspect(1 / 0.8)
    axes.invert_yaxis()


def dots(axes: Axes, x: Real[Tensor, " n"], y: Real[Tensor, " n"], label: str = "Trial") -> None:
    """Draw a dot for each trial, x and y in the units of the axes."""
    axes.plot(
        st.array(x), st.array(y), ".", color=st.tint(st.DARK, 0.35), markersize=2.5, label=label, zorder=1,
        rasterized=len(x) > _VECTOR,
    )  # fmt: skip


def legend_below(figure: Figure, *panels: Axes) -> None:
    """Draw one legend below a figure for the artists of some of its panels, each label once."""
    handles = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    columns = 2 if figure.get_figwidth() == st.COLUMN else 5
    figure.legend([*handles.values()], [*handles], loc="outside lower center", ncols=columns)
