"""Effect by effect: its partial residuals and the curve that it explains of them."""

from textwrap import wrap
from typing import Any

import torch
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.core.numerics import wrapped
from contactlearn.inference.evaluation.partial_residuals import Partial
from contactlearn.report.figures import style as st
from contactlearn.report.text.names import capitalize_first, label

_Look = dict[str, Any]
_BLUE, _RED, _ = st.CONTRAST
_GREY: _Look = {"color": st.tint(st.DARK, 0.35), "markersize": 2.5, "zorder": 1}
_PINK: _Look = {"color": st.tint(_RED, 0.7), "markersize": 2, "zorder": 2}
_EFFECT: _Look = {"label": "Effect, mean", "gid": "effect", "color": _RED, "linewidth": 1.6, "zorder": 3}
_REST: _Look = {"label": "Residual of the ticked model, mean", "gid": "rest", "color": _BLUE, "linewidth": 0.9,
                "marker": "s", "markersize": 4, "markerfacecolor": "white", "zorder": 5}  # fmt: skip
_GROUPS = 20
_EMPTY = 0.1  # share of the range of the variable that interrupts a curve

Groups = list[Int[Tensor, " k"] | None]


@st.look()
def effect_curve(partial: Partial, title: str | None = None, *, remaining: bool = False) -> Figure:
    """Draw the measured residuals without the effect, their mean along the variable, and the effect's own change.

    A dot is a trial; many trials are drawn as their density.  Impulses and moments are in mN s and mN m s, angles in
    degrees.  The axis leaves out the outermost percent of the residuals on each side, unless the effect goes there.

    Args:
        partial: residuals with and without the effect.
        title: the effect in words; its name if left out.
        remaining: whether to add the mean residual of the whole model.
    """
    scale, unit = scaled_unit(partial.component_unit)
    x, variable_unit = along(partial)
    measured, explained, groups = scale * partial.measured, scale * partial.explained, grouped(x)
    middle, ends = means(groups, x), _limits(measured, explained)
    figure = st.new_figure(st.COLUMN, 2.9)
    across = f"{partial.variable} ({variable_unit})"
    axes = st.name_axes(figure.subplots(), across, f"Residual of {partial.component} ({unit})")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.axhline(0, color=st.DARK, linewidth=0.6)
    dots: _Look = {"linestyle": "none", "marker": ".", "rasterized": True}
    mean: _Look = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": st.DARK, "zorder": 4}
    if len(x) > st.MANY:
        shown = (measured >= ends[0]) & (measured <= ends[1])
        st.draw_density(axes, st.array(x[shown]), st.array(measured[shown]), st.DARK).set_label("Trials, density")
    else:
        _plot(axes, x, measured, dots | {"label": "Trials", "gid": "measured"} | _GREY)
        _plot(axes, x, explained, dots | {"label": "Effect, by trial", "gid": "explained"} | _PINK)
    _plot(axes, middle, means(groups, measured), mean | {"label": "Mean of each 5 % of trials", "gid": "mean"})
    _plot(axes, middle, means(groups, explained), _EFFECT)
    if remaining:
        _plot(axes, middle, means(groups, measured - explained), _REST)
    axes.set_ylim(*ends)
    title = capitalize_first(label(partial.effect) if title is None else title)
    axes.set_title("\n".join(wrap(st.plain(title, 80), 40, break_on_hyphens=False)))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def scaled_unit(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which a quantity is shown: impulses and moments in thousandths."""
    return (st.MILLI, f"m{unit}") if "N" in unit else (1.0, unit)


def along(partial: Partial) -> tuple[Float[Tensor, " n"], str]:
    """Return the variable of partial residuals as it is shown, and its unit."""
    if partial.variable_unit == "rad":
        return wrapped(partial.x).rad2deg(), "°"
    if partial.variable_unit == partial.component_unit:
        scale, unit = scaled_unit(partial.variable_unit)
        return scale * partial.x, unit
    return partial.x, partial.variable_unit


def grouped(x: Float[Tensor, " n"]) -> Groups:
    """Divide trials into groups of about equal number along x; None where a tenth of the range is empty.

    A few trials far from all others are in no group.
    """
    order, size = x.argsort(), len(x) / min(_GROUPS, len(x))
    steps = x[order].diff()
    breaks = (steps > _EMPTY * (x.max() - x.min())).nonzero()[:, 0] + 1
    groups: Groups = []
    for run in order.tensor_split(breaks.cpu()):
        if len(run) > size / 3:
            groups += [None] * bool(groups) + [*run.tensor_split(max(1, round(len(run) / size)))]
    return groups


def means(groups: Groups, y: Float[Tensor, " n"]) -> Float[Tensor, " groups"]:
    """Average y over each group; nan where there is none."""
    return torch.stack([torch.full_like(y.mean(), torch.nan) if group is None else y[group].mean() for group in groups])


def _plot(axes: Axes, x: Tensor, y: Tensor, look: _Look) -> None:
    axes.plot(st.array(x), st.array(y), **look)


def _limits(measured: Float[Tensor, " n"], explained: Float[Tensor, " n"]) -> tuple[float, float]:
    """Ends of the axis of residuals."""
    cut = len(measured) // 100
    ranked = measured.sort().values
    low, high = min(ranked[cut], explained.min(), 0), max(ranked[-1 - cut], explained.max(), 0)
    margin = 0.05 * (high - low) or 1.0
    return float(low - margin), float(high + margin)
