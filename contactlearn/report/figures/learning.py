"""Errors of learned models: learning curves, distributions, transfer to other bodies; each figure takes plain values.

    error_densities  Fig. 4.1  distributions of the error by model
    learning_curve   Fig. 4.2  error against the number of training impacts
    run_curves                 the same of several runs in one panel, for a browser
    transfer_errors            error on a new body against the number of its trials

A curve is an array [S, 3] of the mean and the ends of its 95 % interval at S sizes.  Class I are
the models learned from data alone, Class II those that correct a law.  The figure numbers are those
of Fazeli et al. (2017).
"""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.figures import style as st

__all__ = ["error_densities", "learning_curve", "run_curves", "transfer_errors"]

_Level = Iterable[float]
"""A mean and the ends of its 95 % interval."""
_Curve = Float[np.ndarray, "sizes 3"]
"""An interval at each size, nan where a size was not run."""

_LINEAR = 5.0
"""Largest error over the least, up to which their axis is linear."""
_ZERO_SHOT = st.LawStyle("Trained model, no trial of this body", st.DARK, "", (0, (2, 2)))


@st.look()
def learning_curve(
    sizes: Sequence[int],
    curves: Mapping[str, Float[Tensor, "sizes 3"]],
    references: Mapping[str, _Level],
    metric: str,
) -> Figure:
    """Draw the mean error against the number of training impacts, with its 95 % interval (Fig. 4.2).

    Where the largest mean is more than five times the least, the axis is logarithmic over three decades
    at most, so that a large error after few impacts does not flatten the rest.  The models of a panel
    stand slightly side by side, so that their intervals are seen.

    Args:
        sizes: numbers of impacts, increasing.
        curves: means and intervals by model, nan where a size was not run; that of a bound is in both panels.
        references: horizontal lines by name, such as the bounds or a law.
        metric: axis label with its unit.

    Raises:
        ContactLearnError: no sizes or models, sizes that do not increase, or curves of another length.
    """
    values, lines = _checked(sizes, curves), []
    bounds = _among(values, st.BOUNDS)  # in every panel
    figure, panels = _class_panels([name for name in values if name not in bounds] or bounds, 2.75)
    styles, levels = st.law_styles(values), st.law_styles(references)
    for axes, title, names in panels:
        st.name_axes(axes, "Number of training impacts (–)", metric).label_outer()
        _draw_curves(axes, sizes, {name: values[name] for name in dict.fromkeys((*bounds, *names))}, styles)
        st.legend_above(axes, title)
        lines = [_draw_level(axes, levels[name], interval) for name, interval in references.items()]
    _scale_errors(figure.axes, [*values.values(), *(np.array([[*level]]) for level in references.values())])
    if references:
        figure.legend(handles=lines, loc="outside lower center", ncols=len(panels))
    return figure


@st.look()
def run_curves(
    sizes: Sequence[float],
    curves: Mapping[str, _Curve],
    levels: Mapping[str, _Level],
    styles: Mapping[str, st.LawStyle],
    metric: str,
) -> Figure:
    """Draw learning curves of several runs in one panel, for a browser, whose script shows some of them.

    Args:
        sizes: numbers of impacts, increasing.
        curves: means and intervals by `gid`, nan where a size was not run; an interval has ", interval" after it.
        levels: errors that depend on no size, by `gid`.
        styles: of all of them.
        metric: axis label with its unit.
    """
    figure = st.new_figure(st.PAGE, 3.5)
    axes = st.name_axes(figure.subplots(), "Number of training impacts (–)", metric)
    _draw_curves(axes, sizes, curves, styles)
    for gid, line, interval in zip(curves, axes.lines, axes.collections, strict=True):
        line.set_gid(gid)
        interval.set_gid(f"{gid}, interval")
    lines = [*axes.lines, *(_draw_level(axes, styles[gid], level) for gid, level in levels.items())]
    for gid, line in zip((*curves, *levels), lines, strict=True):
        line.set_label(st.plain(styles[gid].label, 200))
    return figure


@st.look()
def error_densities(errors: Mapping[str, Float[Tensor, " trials"]], metric: str) -> Figure:
    """Draw the density of each model's error, with a marker at the mean (Fig. 4.1).

    Gaussian kernels of Silverman's robust width, reflected at 0.  The axes leave out outliers, the
    last percent of the other errors, and the part of a bound's peak above 1.5 × the models' highest.

    Args:
        errors: errors of the trials by model; those of the bounds are in both panels.
        metric: axis label with its unit.

    Raises:
        ContactLearnError: no models, or errors that are negative or not finite.
    """
    values = {name: st.array(x).ravel() for name, x in errors.items()}
    bad = [name for name, x in values.items() if not (len(x) and np.isfinite(x).all() and x.min() >= 0)]
    if not values or bad:
        raise ContactLearnError(
            f"error_densities needs finite errors ≥ 0 of each model, got {f'others of {bad}' if bad else 'none'}"
        )
    bounds = _among(values, st.BOUNDS)
    models = [name for name in values if name not in bounds]
    figure, panels = _class_panels(models or bounds, 2.3 + st.ROW * len(bounds))
    x = np.linspace(0, _right_end(np.concatenate(list(values.values()))), 500)
    unit = re.search(r"\(([^()–]+)\)\s*$", metric)  # a density is per m/s for an error in m/s
    densities, styles = {name: _density(sample, x) for name, sample in values.items()}, st.law_styles(values)
    for axes, title, names in panels:
        st.name_axes(axes, metric, f"Density (per {unit[1]})" if unit else "Density (–)").label_outer()
        for name in dict.fromkeys((*bounds, *names)):
            mean = np.searchsorted(x, values[name].mean())
            st.draw_line(axes, x, densities[name], styles[name], markevery=[mean] if mean < len(x) else [])
        st.legend_above(axes, title)
    highest = max(density.max() for density in densities.values())
    top = min(highest, 1.5 * max((densities[name].max() for name in models), default=np.inf))
    figure.axes[-1].set(xlim=(0, x[-1]), ylim=(0, 1.05 * top or 1))
    return figure


@st.look()
def transfer_errors(
    sizes: Sequence[int],
    curves: Mapping[str, Mapping[str, Float[Tensor, "sizes 3"]]],
    zero_shot: Mapping[str, _Level],
    metric: str,
) -> Figure:
    """Draw the mean error on a new body against the number of its trials, one panel a body; both axes are logarithmic.

    Args:
        sizes: numbers of trials, increasing.
        curves: means and intervals by body and label, nan where a size was not run.
        zero_shot: by body, the error of the trained model without any trial of it.
        metric: axis label with its unit.

    Raises:
        ContactLearnError: no sizes, bodies or curves, sizes that do not increase, or curves of another length.
    """
    if not curves:
        raise ContactLearnError("transfer_errors needs the curves of at least one body, got none")
    values = {body: _checked(sizes, by_label) for body, by_label in curves.items()}
    styles = st.law_styles(dict.fromkeys(label for by_label in values.values() for label in by_label), st.CONTRAST)
    columns = 2 if len(values) == 4 else min(3, len(values))
    rows = -(-len(values) // columns)
    figure = st.new_figure(st.PAGE if columns > 1 else st.COLUMN, 0.4 + 2.0 * rows + st.ROW * (1 + len(styles)))
    handles = {}
    for place, (body, by_label) in enumerate(values.items()):
        axes = figure.add_subplot(rows, columns, place + 1, sharey=figure.axes[0] if place else None)
        st.name_axes(axes, "Trials of the new body (–)", "" if place % columns else metric)
        axes.tick_params(labelleft=place % columns == 0)
        _draw_curves(axes, sizes, by_label, styles)
        if body in zero_shot:
            _draw_level(axes, _ZERO_SHOT, zero_shot[body])
        axes.set_title(st.plain(body, 24))
        handles |= {line.get_label(): line for line in axes.get_legend_handles_labels()[0]}
    st.scale_logarithmically(figure.axes[-1])
    figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=1 if columns == 1 else 2)
    return figure


# --- Parts ----------------------------------------------------------------------------------------


def _checked(sizes: Sequence[int], curves: Mapping[str, Tensor]) -> dict[str, _Curve]:
    """The curves as arrays, once they are known to be curves over these sizes."""
    if not len(sizes) or not curves:
        raise ContactLearnError(f"a curve needs sizes and models, got {len(sizes)} and {len(curves)}")
    if min(sizes) < 1 or (np.diff(sizes) <= 0).any():
        raise ContactLearnError(f"sizes must increase and be 1 or more, got {list(sizes)}")
    values = {name: st.array(curve) for name, curve in curves.items()}
    for name, curve in values.items():
        if curve.shape != (len(sizes), 3):
            raise ContactLearnError(f"the curve of {name!r} must be {(len(sizes), 3)}, got {curve.shape}")
    return values


def _among(names: Iterable[str], group: Sequence[str]) -> list[str]:
    """The names or labels that belong to the group."""
    return [name for name in names if st.law_style(name) in [st.STYLES[member] for member in group]]


def _class_panels(names: Iterable[str], height: float) -> tuple[Figure, list[tuple[Axes, str, list[str]]]]:
    """A panel of the Class I models and one of all others, if there are any: axes, title, names."""
    first, reinforced = _among(names, st.CLASS_I), _among(names, st.CLASS_II)
    rest = [name for name in names if name not in first]
    second = (
        "Learned with a law (Class II)" + ", and others" * (rest != reinforced)
        if reinforced
        else "Others" * bool(first)
    )
    groups = [(title, names) for title, names in (("Learned without a law (Class I)", first), (second, rest)) if names]
    rows = max(len(first), len(rest))
    figure = st.new_figure(st.PAGE if len(groups) > 1 else st.COLUMN, height + st.ROW * rows)
    axes = figure.subplots(1, len(groups), sharex=True, sharey=True, squeeze=False)[0]
    return figure, [(panel, *group) for panel, group in zip(axes, groups, strict=True)]


def _draw_curves(
    axes: Axes, sizes: Sequence[float], curves: Mapping[str, _Curve], styles: Mapping[str, st.LawStyle]
) -> None:
    """Curves by name over a logarithmic axis, slightly side by side."""
    numbers = np.asarray(sizes)
    decades = np.log10(numbers[-1] / numbers[0]) or 1
    gap = np.log10(numbers[1:] / numbers[:-1]).min(initial=decades)
    step = min(0.012 * decades, 0.1 * decades / len(curves), 0.3 * gap / len(curves))  # all stay on the axis
    for place, (name, curve) in enumerate(curves.items()):
        run = np.isfinite(curve[:, 0])
        x = numbers[run] * 10 ** (step * (place - (len(curves) - 1) / 2))
        mean, low, high = curve[run].T
        axes.vlines(x, low, high, color=styles[name].color, linewidth=0.8)
        st.draw_line(axes, x, mean, styles[name])
    _label_sizes(axes, numbers, decades)


def _label_sizes(axes: Axes, sizes: np.ndarray, decades: float) -> None:
    """Scale the axis of sizes logarithmically, and label them as far as there is room."""
    inches = axes.get_position().width * axes.figure.get_figure(root=True).get_figwidth() / decades
    ticks = [sizes[-1]]
    for size in sizes[-2::-1]:
        if np.log10(ticks[-1] / size) * inches > 0.05 + 0.06 * len(str(ticks[-1])):
            ticks.append(size)
    margin = 10 ** (0.06 * decades)
    axes.set(xscale="log", xlim=(sizes[0] / margin, sizes[-1] * margin))
    axes.set_xticks(ticks, [str(size) for size in ticks])
    axes.set_xticks([size for size in sizes if size not in ticks], [], minor=True)


def _draw_level(axes: Axes, style: st.LawStyle, interval: _Level) -> Line2D:
    """An error that depends on no size: a line, and its interval as a band."""
    mean, low, high = interval
    axes.axhspan(low, high, color=st.tint(style.color, 0.15), linewidth=0, zorder=0)
    return axes.axhline(mean, color=style.color, linestyle=style.linestyle, zorder=1, label=st.plain(style.label, 36))


def _scale_errors(panels: Sequence[Axes], curves: Iterable[_Curve]) -> None:
    """Scale the axis of errors, which the panels share; `learning_curve` says the rule."""
    errors = np.concatenate([*curves])
    means = errors[np.isfinite(errors[:, 0]), 0]
    highest = np.nanmax(errors) if len(means) else 0.0
    least = max(means.min(), highest / 1000) if len(means) else 0.0
    if highest <= _LINEAR * least or not highest:
        panels[-1].set_ylim(0, 1.05 * highest or 1)
        return
    for axes in panels:
        st.scale_logarithmically(axes)
    panels[-1].set_ylim(0.8 * least, 1.1 * highest)


def _right_end(errors: np.ndarray) -> float:
    """99th percentile of the errors that are at most 3 interquartile ranges above the third quartile."""
    lower, upper = np.percentile(errors, (25, 75))
    return np.percentile(errors[errors <= upper + 3 * (upper - lower)], 99) or 1


def _density(errors: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Kernel density of errors [K] ≥ 0 at x [n]; equal errors, which have none, get a peak one step wide."""
    std, middle = errors.std(), np.subtract(*np.percentile(errors, (75, 25))) / 1.349
    if std <= 1e-9 * errors.max():
        return (np.arange(len(x)) == np.searchsorted(x, errors[0])) / (x[1] - x[0])
    from scipy.stats import gaussian_kde  # takes half a second to load

    kernel = gaussian_kde(errors, 0.9 * min(1, middle / std or 1) * len(errors) ** -0.2)
    return kernel(x) + kernel(-x)
