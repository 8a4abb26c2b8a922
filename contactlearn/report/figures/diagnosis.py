"""The figures of a diagnosis: what speaks against the data, where the model fails, and what remains of its error.

    regions_figure     where the law fails, and whether the effects help there
    remainder_figure   what the model leaves of the wrench, against what it depends on
    ladder             law, effect after effect, flexible model: held-out errors
    drawn              all of them, the audit's (module `audit_figures`) and the effects' curves, by file name

A dot is a trial.  Impulses are shown in mN s, moments in mN m s, angles in the figure of regions in degrees.
"""

import math
from textwrap import wrap

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.audit.corrections import correct
from contactlearn.diagnosis.failure.regions import Region
from contactlearn.diagnosis.failure.variables import Variable, variables
from contactlearn.diagnosis.pipeline import Diagnosis
from contactlearn.diagnosis.unexplained.remainder import COMPONENTS
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import SYMBOLS, of_state
from contactlearn.evaluation.metrics import HEADLINE, METRICS, mass_error
from contactlearn.evaluation.partial_residuals import COMPONENTS as LETTERS
from contactlearn.evaluation.partial_residuals import binned, partial_residuals, share_explained
from contactlearn.impacts import Impacts
from contactlearn.report.figures import style as st
from contactlearn.report.figures.audit import audit_figure, dots, legend_below
from contactlearn.report.figures.effects import effect_curve

_BLUE, _RED, _YELLOW = st.CONTRAST
_ERROR = f"{METRICS[HEADLINE].label} ({METRICS[HEADLINE].unit})"


def drawn(found: Diagnosis, raw: Impacts) -> dict[str, Figure]:
    """Every figure of a diagnosis by file name: `audit_<finding>`, `regions`, `remainder`, `effect_<name>`, `ladder`.

    Args:
        found: what `diagnose` returned.
        raw: the impacts that it was given, before its corrections.
    """
    figures, impacts = {}, raw.replace(suspect=True)
    for finding in found.findings:
        names = [finding.correction] if finding.correction else finding.hypothesis
        after = correct(impacts, names)
        figures[f"audit_{finding.name}"] = audit_figure(finding, impacts, after)
        impacts = after
    if found.regions:
        figures["regions"] = regions_figure(found)
    if found.remainder is not None:
        figures["remainder"] = remainder_figure(found)
    for missing in found.missing:
        curve = effect_curve(partial_residuals(found.model, found.impacts, missing.id.name))
        figures[f"effect_{str(missing.id).replace(':', '_')}"] = curve
    if found.ladder:
        figures["ladder"] = ladder(found)
    return figures


# --- Regions -----------------------------------------------------------------------------------


@st.look()
def regions_figure(found: Diagnosis) -> Figure:
    """Error of the law over the variable of each region, the region shaded, and its running median.

    A second median is that with the missing effects.  Both models are fitted to all of these trials.  The axes leave
    out the outermost percent of the trials.
    """
    impacts, prediction = found.impacts, found.base.predict(found.impacts)
    known = {variable.name: variable for variable in variables(impacts, prediction)}
    errors = {"Law": mass_error(impacts, prediction)}
    if found.missing:
        errors["With effects"] = mass_error(impacts, found.model.predict(impacts))
    columns = min(2, len(found.regions))
    rows = math.ceil(len(found.regions) / columns)
    figure = st.new_figure((st.COLUMN, st.PAGE)[columns - 1], 0.4 + 2.2 * rows)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flatten()
    for axes in panels[len(found.regions) :]:
        axes.set_visible(False)
    for axes, region in zip(panels, found.regions, strict=False):
        _region(axes, region, known[region.variable], errors)
    for axes in panels[::columns]:
        axes.set_ylabel(_ERROR)
    legend_below(figure, panels[0])
    return figure


def _region(axes: Axes, region: Region, variable: Variable, errors: dict[str, Tensor]) -> None:
    """One panel; `errors` [N] by model, the law's first."""
    x, low, high = (variable.scale * v for v in (variable.values, region.low, region.high))
    if variable.period:  # with the region in the middle
        period = variable.scale * variable.period
        centre = (low + high) / 2
        shift = (centre + 180) % 360 - 180 - centre if period > 359 else centre % period - centre
        low, high, start = low + shift, high + shift, centre + shift - period / 2
        x = (x - start) % period + start
        ends = start, start + period
    elif variable.labels:
        x = x + 0.6 * ((0.618 * torch.arange(len(x))) % 1 - 0.5)  # beside each other
        ends = -1.5, 1.5
    else:
        first, last = x.quantile(torch.tensor((0.005, 0.995), dtype=x.dtype)).tolist()
        ends = min(first, high), max(last, low)
    law, *_ = errors.values()
    st.name_axes(axes, f"{st.plain(variable.letter)} ({variable.unit})")
    axes.axvspan(
        max(low, ends[0]), min(high, ends[1]), color=st.tint(_YELLOW, 0.35), linewidth=0, label="Region", zorder=0
    )
    dots(axes, x, law, "Trial, law")
    looks = ({"color": _BLUE}, {"color": _RED, "linestyle": (0, (4, 1.5))})
    for (name, error), look in zip(errors.items(), looks, strict=False):
        if variable.labels:
            for place in (-1, 0, 1):
                here = variable.values == place
                if here.any():
                    axes.plot((place - 0.4, place + 0.4), [error[here].median().item()] * 2, **look, linewidth=1.8)
            axes.plot([], [], **look, label=f"{name}, running median")
        else:
            axes.plot(*_running_median(x, error), **look, linewidth=1.6, label=f"{name}, running median", zorder=3)
    if variable.labels:
        axes.set_xticks((-1, 0, 1), ["\n".join(wrap(label, 16)) for label in variable.labels])
        axes.set_xlabel("")
    axes.set_xlim(ends)
    axes.set_ylim(0, law.quantile(0.98).item())
    axes.set_title("\n".join(st.plain(part, 60) for part in str(region).split(": ", 1)))


def _running_median(x: Tensor, y: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Medians of x and y [N] over every run of a twelfth of the trials, along x."""
    order = x.argsort()
    size = min(len(x), max(15, len(x) // 12))
    runs = (np.lib.stride_tricks.sliding_window_view(st.array(part[order]), size) for part in (x, y))
    return tuple(np.median(run, -1) for run in runs)


# --- What remains ------------------------------------------------------------------------------


@st.look()
def remainder_figure(found: Diagnosis) -> Figure:
    """Measured wrench minus the model's, against the one or two symbols that matter most, and means of groups.

    A row for each component that processes predict; where there is none, the one that they come closest to, against
    the symbol along which its means differ most.  The outermost percent of the trials on each side is left out.
    """
    left, impacts = found.remainder, found.impacts
    tested = {component.name: component for component in left.tested}
    known = of_state(State.of(impacts))
    known["theta"] = torch.atan2(known["theta"].sin(), known["theta"].cos())
    residual = (impacts.wrench - found.model.base_prediction(impacts).wrench) * st.MILLI
    names = left.components or (max(tested, key=lambda name: tested[name].r_squared),)
    at = [COMPONENTS.index(name) for name in names]
    symbols = [*left.variables][:2] or [max(known, key=lambda name: share_explained(known[name], residual[:, at[0]]))]
    title = "Nothing remains that Gaussian processes could predict"
    if left.found:
        share = left.share
        title = f"Gaussian processes take {share.mean:.0%} ({share.low:.0%} to {share.high:.0%}) more off the error"
    columns, rows = len(symbols), len(names)
    width = (st.COLUMN, st.PAGE)[columns - 1]
    title = wrap(title, 54 if columns == 1 else 112)
    figure = st.new_figure(width, 0.5 + st.ROW * len(title) + 2.0 * rows)
    figure.suptitle("\n".join(title))
    panels = figure.subplots(rows, columns, sharex="col", sharey="row", squeeze=False)
    for line, name, k in zip(panels, names, at, strict=True):
        y = residual[:, k]
        ends = y.quantile(torch.tensor((0.01, 0.99), dtype=y.dtype))
        shown = (y >= ends[0]) & (y <= ends[1])
        letter, unit = LETTERS["wrench"][k]
        for axes, symbol in zip(line, symbols, strict=True):
            x, values = known[symbol][shown], y[shown]
            bins = max(20, min(40, len(x) // 40))
            middle, mean, square = binned(x, values, values.square(), bins=bins)
            error = ((square - mean.square()).clamp_min(0) * len(mean) / len(x)).sqrt()
            st.name_axes(axes)
            axes.axhline(0, color=st.DARK, linewidth=0.6)
            dots(axes, x, values)
            axes.errorbar(
                st.array(middle), st.array(mean), st.array(error), fmt="o", color=_RED, markersize=3.5, elinewidth=0.9,
                capsize=2, label=f"Mean of {len(x) // bins} trials ± standard error", zorder=3,
            )  # fmt: skip
            axes.xaxis.set_major_locator(MaxNLocator(6))
        line[0].set_ylabel(f"Left of {letter} (m{unit})")
        one = tested[name]
        line[0].set_title(
            f"{letter}: R² = {one.r_squared:.2f} ± {one.standard_error:.2f} on held-out trials", loc="left"
        )
    for axes, symbol in zip(panels[-1], symbols, strict=True):
        part = f", {left.variables[symbol]:.0%} of what they predict" if symbol in left.variables else ""
        axes.set_xlabel(f"{SYMBOLS[symbol].letter} ({SYMBOLS[symbol].unit}){part}")
    legend_below(figure, panels[0, 0])
    return figure


@st.look()
def ladder(found: Diagnosis) -> Figure:
    """Held-out error of the law, and with effect after effect, with 95 % intervals; the IRB bound as a line."""
    figure = st.new_figure(st.PAGE, 0.9 + 0.25 * len(found.ladder))
    axes = st.name_axes(figure.subplots(), _ERROR)
    for place, (_, interval) in enumerate(found.ladder):
        axes.barh(place, interval.mean, color=st.tint(st.CONTRAST[0], 0.45), height=0.6)
        axes.plot((interval.low, interval.high), (place, place), color=st.DARK)
    axes.set_yticks(range(len(found.ladder)), [st.plain(step.replace("_", " ")) for step, _ in found.ladder])
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    style = st.law_style("irb")
    axes.axvline(found.budget["bound"]["mean"], color=style.color, linestyle=style.linestyle, label=style.label)
    axes.set_xlim(left=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center")
    return figure
