"""Models side by side; each figure takes plain values.

    error_comparison   Fig. 3.5  distributions of the error by model
    patch_curve                  the IRB bound against the half-width of the contact patch

The figure number is that of Fazeli et al. (2017).
"""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.figures import style as st


@st.look()
def error_comparison(
    errors: Mapping[str, Float[Tensor, " n"]], intervals: Mapping[str, Iterable[float]], metric: str
) -> Figure:
    """Draw the distribution of each model's error over the trials, from top to bottom as given (Fig. 3.5).

    Boxes hold the middle half with the median, whiskers end at the 5th and 95th percentile; below
    each, a dot and a bar are the mean and its 95 % interval.  The bounds are hatched.  Where the largest mean is more
    than five times the least, the axis is logarithmic and begins at a tenth of the least: a bound may be 0.

    Args:
        errors: per-trial errors by model: a name or label of `LAW_STYLE`, or any other text.
        intervals: (mean, low, high) by model.
        metric: axis label with its unit.

    Raises:
        ContactLearnError: no models, no interval for one, or errors that are not finite.
    """
    if not errors or errors.keys() - intervals.keys():
        missing = ", ".join(errors.keys() - intervals.keys()) or "any model"
        raise ContactLearnError(f"error_comparison needs errors and an interval for each model, got none for {missing}")
    labels = ["\n".join(map(st.plain, wrap(st.law_style(name).label, 16))) for name in errors]
    lines = max(label.count("\n") + 1 for label in labels)
    figure = st.new_figure(st.COLUMN, 0.75 + max(0.34, 0.14 * lines) * len(errors))
    axes = st.name_axes(figure.subplots(), metric)
    means = [mean for mean, *_ in intervals.values()]
    left = min(means) / 10 if max(means) > 5 * min(means) else 0.0
    for place, (name, values) in enumerate(errors.items()):
        if bad := int((~values.isfinite()).sum()):
            raise ContactLearnError(f"errors of {name!r} must be finite, got {bad} that are not")
        _draw_model(axes, place, name, st.array(values.clamp_min(left)), [max(x, left) for x in intervals[name]])
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(labels) - 0.45, -0.55)
    if left > 0:
        st.scale_logarithmically(axes, "x")
    axes.set_xlim(left=left)
    handles, names = axes.get_legend_handles_labels()
    figure.legend(handles[-1:], names[-1:], loc="outside upper right")
    return figure


def _draw_model(axes: Axes, place: int, name: str, values: np.ndarray, interval: Iterable[float]) -> None:
    """A box of the errors, and below it their mean with its interval."""
    style = st.law_style(name)
    bound = style.label in (st.LAW_STYLE[key].label for key in st.BOUNDS)
    face = "white" if bound else st.tint(style.color, 0.45)
    box = axes.boxplot(
        values, positions=[place - 0.1], orientation="horizontal", widths=0.42, whis=(5, 95), showfliers=False,
        patch_artist=True, capwidths=0.2, manage_ticks=False,
        boxprops={"facecolor": face, "edgecolor": style.color},
        medianprops={"color": st.DARK}, whiskerprops={"color": style.color}, capprops={"color": style.color},
    )  # fmt: skip
    if bound:
        box["boxes"][0].set(hatch="/////", linestyle="-")
    mean, low, high = interval
    axes.errorbar(
        mean, place + 0.28, xerr=((mean - low,), (high - mean,)), fmt="o", color=st.DARK, markersize=2.5,
        elinewidth=0.8, capsize=2.5, capthick=0.8, label="Mean, 95 % interval",
    )  # fmt: skip


@st.look()
def patch_curve(
    widths_mm: Sequence[float], errors: Float[Tensor, "k 3"], references: Mapping[str, float], metric: str
) -> Figure:
    """Draw the mean error of the IRB bound against the half-width of the contact patch.

    Args:
        widths_mm: half-widths in mm, increasing.
        errors: mean error, and the ends of its 95 % interval.
        references: mean errors to compare with, by name as in `error_comparison`: the best law and
            Best Post Hoc.
        metric: axis label with its unit.
    """
    figure = st.new_figure(st.COLUMN, 2.6)
    axes = st.name_axes(figure.subplots(), "Half-width of the contact patch (mm)", metric)
    bound, values = st.LAW_STYLE["irb"], st.array(errors)
    for name, value in references.items():
        style = st.law_style(name)
        axes.axhline(value, color=style.color, linestyle=style.linestyle, label=st.plain(style.label))
    axes.fill_between(widths_mm, values[:, 1], values[:, 2], color=st.tint(bound.color, 0.35), linewidth=0)
    line: dict[str, Any] = {"color": bound.color, "linestyle": bound.linestyle, "marker": bound.marker, "markersize": 4}
    axes.plot(widths_mm, values[:, 0], **line, label=f"{bound.label}, 95 % interval")
    axes.margins(x=0.02)
    axes.set_ylim(bottom=0)
    columns = 2 if all(len(st.law_style(name).label) < 22 for name in references) else 1
    spacing = {"columnspacing": 1.0, "handlelength": 1.8, "handletextpad": 0.5}
    figure.legend(loc="outside upper center", ncols=columns, **spacing)
    return figure
