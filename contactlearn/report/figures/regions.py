"""Regions of the input space in which the law fails, and the improvement by the missing effects there.

    regions_figure   errors of the trials over the variable of each region

A dot is a trial.  Angles are shown in degrees.
"""

import math
from collections.abc import Mapping
from textwrap import wrap
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.diagnosis.failure.variables import Variable, variables
from contactlearn.diagnosis.result import Record, Region
from contactlearn.inference.evaluation.metrics import HEADLINE, METRICS, mass_error
from contactlearn.report.figures import style as st
from contactlearn.report.figures.audit import dots, legend_below
from contactlearn.report.text import fix_spacing, phrase

_BLUE, _RED, _YELLOW = st.CONTRAST
_LOOKS: tuple[dict[str, Any], ...] = ({"color": _BLUE}, {"color": _RED, "linestyle": (0, (4, 1.5))})
_GOLDEN = 0.618  # spreads dots of one label beside each other
ERROR = f"{METRICS[HEADLINE].label} ({METRICS[HEADLINE].unit})"
"""Axis label of the mass error."""


@st.look()
def regions_figure(regions: tuple[Region, ...], record: Record) -> Figure:
    """Draw the error of the law over the variable of each region, the region shaded, and its running median.

    A second median is that with the missing effects, if there are any.  Both models are fitted to all of these
    trials.  The axes leave out the outermost percent of the trials.
    """
    impacts, prediction = record.impacts, record.base.predict(record.impacts)
    known = {variable.name: variable for variable in variables(impacts, prediction)}
    errors = {"Law": mass_error(impacts, prediction)}
    if record.model.effects.keys() - record.base.effects.keys():
        errors["With effects"] = mass_error(impacts, record.model.predict(impacts))
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
    for (name, error), look in zip(errors.items(), _LOOKS, strict=False):
        if variable.labels:
            _draw_medians(axes, variable, error, name, look)
        else:
            axes.plot(*_running_median(x, error), **look, linewidth=1.6, label=f"{name}, running median", zorder=3)
    if variable.labels:
        axes.set_xticks((-1, 0, 1), ["\n".join(wrap(label, 16)) for label in variable.labels])
        axes.set_xlabel("")
    axes.set_xlim(ends)
    axes.set_ylim(0, law.quantile(0.98).item())
    text = wrap(phrase("region_error", region).replace(" = ", "\u00a0=\u00a0"), 48)
    title = st.plain(fix_spacing(region.where), 60), *text
    axes.set_title("\n".join(title))


def _along(region: Region, variable: Variable) -> tuple[Float[Tensor, " n"], tuple[float, float], tuple[float, float]]:
    """Trials along the axis in its units, the region's window there, and the ends of the axis.

    A periodic variable has the region in the middle; trials of a variable with labels stand beside each other.
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
        return x + 0.6 * ((_GOLDEN * torch.arange(len(x))) % 1 - 0.5), (low, high), (-1.5, 1.5)
    first, last = x.quantile(torch.tensor((0.005, 0.995), dtype=x.dtype)).tolist()
    return x, (low, high), (min(first, high), max(last, low))


def _draw_medians(
    axes: Axes, variable: Variable, error: Float[Tensor, " n"], name: str, look: Mapping[str, Any]
) -> None:
    """The median error of each label of a variable."""
    for place in (-1, 0, 1):
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
