"""What each effect explains: its curve over the residuals that the model would leave without it."""

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from contactlearn.evaluation.partial_residuals import Partial, binned
from contactlearn.report.figures import style as st

_COLOR = st.CONTRAST[1]


@st.look()
def effect_curve(partial: Partial) -> Figure:
    """Measured residuals without the effect, their running mean, and what the effect adds.

    A dot is a trial.  Impulses and moments are in mN s and mN m s.  The axis leaves out the outermost percent
    of the residuals on each side, unless the effect goes there.
    """
    milli = st.MILLI if "N" in partial.component_unit else 1.0
    unit = ("m" if milli != 1 else "") + partial.component_unit
    scale, along = (milli, unit) if partial.variable_unit == partial.component_unit else (1.0, partial.variable_unit)
    x, measured, explained = (
        st.array(v) for v in (partial.x * scale, partial.measured * milli, partial.explained * milli)
    )
    figure = st.new_figure(st.COLUMN, 2.9)
    axes = st.name_axes(
        figure.subplots(),
        f"{partial.variable} ({along})",
        f"Residual of {partial.component} ({unit})",
    )
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.axhline(0, color=st.DARK, linewidth=0.6)
    axes.plot(x, measured, ".", color=st.tint(st.DARK, 0.35), markersize=2.5, label="Trials", rasterized=True, zorder=1)
    axes.plot(x, explained, ".", color=st.tint(_COLOR, 0.7), markersize=2, label="Effect, by trial", zorder=2)
    middle, mean, curve = (
        st.array(v) for v in binned(partial.x * scale, partial.measured * milli, partial.explained * milli)
    )
    axes.plot(middle, mean, "o", color=st.DARK, markersize=3.5, label="Trials, mean of a twentieth", zorder=4)
    axes.plot(middle, curve, color=_COLOR, linewidth=1.6, label="Effect, mean", zorder=3)
    low, high = sorted(measured)[len(measured) // 100], sorted(measured)[-1 - len(measured) // 100]
    low, high = min(low, explained.min(), 0), max(high, explained.max(), 0)
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axes.set_title(st.plain(partial.effect.replace("_", " ")))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure
