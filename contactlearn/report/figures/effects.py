"""Effect by effect: its partial residuals and the curve that it explains of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from contactlearn.inference.evaluation.partial_residuals import Partial, binned
from contactlearn.report.figures import style as st
from contactlearn.report.text import label

_COLOR = st.CONTRAST[1]


@st.look()
def effect_curve(partial: Partial, title: str | None = None) -> Figure:
    """Draw the measured residuals without the effect, their mean along the variable, and the effect's own change.

    A dot is a trial; many trials are drawn as their density.  Impulses and moments are in mN s and mN m s.  The axis
    leaves out the outermost percent of the residuals on each side, unless the effect goes there.

    Args:
        partial: residuals with and without the effect.
        title: the effect in words; its name if left out.
    """
    milli = st.MILLI if "N" in partial.component_unit else 1.0
    unit = ("m" if milli != 1 else "") + partial.component_unit
    same = partial.variable_unit == partial.component_unit
    shown = _Shown.of(partial, milli if same else 1.0, milli)
    figure = st.new_figure(st.COLUMN, 2.9)
    along = f"{partial.variable} ({unit if same else partial.variable_unit})"
    axes = st.name_axes(figure.subplots(), along, f"Residual of {partial.component} ({unit})")
    _draw(axes, shown)
    axes.set_title(st.plain(label(partial.effect) if title is None else title))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@dataclass(frozen=True)
class _Shown:
    """Partial residuals in the units of the axes: by trial, and means of groups along the variable."""

    x: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    explained: Float[np.ndarray, " n"]
    middle: Float[np.ndarray, " bins"]
    mean: Float[np.ndarray, " bins"]
    curve: Float[np.ndarray, " bins"]

    @classmethod
    def of(cls, partial: Partial, along: float, up: float) -> "_Shown":
        trials = partial.x * along, partial.measured * up, partial.explained * up
        return cls(*map(st.array, (*trials, *binned(*trials))))

    def limits(self) -> tuple[float, float]:
        """Ends of the axis of residuals."""
        ranked = sorted(self.measured)
        cut = len(ranked) // 100
        low, high = min(ranked[cut], self.explained.min(), 0), max(ranked[-1 - cut], self.explained.max(), 0)
        return low - 0.05 * (high - low), high + 0.05 * (high - low)


def _draw(axes: Axes, shown: _Shown) -> None:
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.axhline(0, color=st.DARK, linewidth=0.6)
    if len(shown.x) > st.MANY:
        seen = (shown.measured >= shown.limits()[0]) & (shown.measured <= shown.limits()[1])
        st.draw_density(axes, shown.x[seen], shown.measured[seen], st.DARK).set_label("Trials, density")
    else:
        axes.plot(
            shown.x, shown.measured, ".", color=st.tint(st.DARK, 0.35), markersize=2.5, rasterized=True, label="Trials",
            zorder=1,
        )  # fmt: skip
        axes.plot(
            shown.x, shown.explained, ".", color=st.tint(_COLOR, 0.7), markersize=2, label="Effect, by trial", zorder=2
        )
    label = "Trials, mean of a twentieth"
    axes.plot(shown.middle, shown.mean, "o", color=st.DARK, markersize=3.5, label=label, zorder=4)
    axes.plot(shown.middle, shown.curve, color=_COLOR, linewidth=1.6, label="Effect, mean", zorder=3)
    axes.set_ylim(*shown.limits())
