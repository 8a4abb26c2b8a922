"""A plan in the space of what the rig sets, beside what was measured, and its forecast."""

from collections.abc import Mapping
from itertools import combinations

from jaxtyping import Float
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.planning.result import Goal, Plan, Purpose
from contactlearn.report.figures import style as st
from contactlearn.report.text.plan import PURPOSES, setting

_MAX_SETTINGS = 3  # settings that are drawn against each other
_MARKERS = {
    Purpose.NAMES: ("o", st.CONTRAST[1]),
    Purpose.PARAMETERS: ("o", st.CONTRAST[1]),
    Purpose.PREDICTION: ("o", st.CONTRAST[1]),
    Purpose.EFFECTS: ("s", st.CONTRAST[0]),
    Purpose.SPACE: ("^", st.CONTRAST[2]),
}


@st.look()
def plan_figure(plan: Plan, measured: Mapping[str, Float[Tensor, "n"]]) -> Figure:
    """Draw the drops over the settings of the rig, what was measured behind them, and the forecast.

    Args:
        plan: a batch of drops.
        measured: values of settings at the measured impacts; nothing where there are none.
    """
    names = [name for name, one in plan.rig.items() if one.chosen][:_MAX_SETTINGS]
    pairs = [*combinations(names, 2)] or [(names[0], names[0])]
    forecast = plan.forecast.right_name or plan.forecast.error
    figure = st.new_figure(st.PAGE, 2.5)
    panels = figure.subplots(1, len(pairs) + bool(forecast), squeeze=False)[0]
    for axes, pair in zip(panels, pairs, strict=False):
        (x, x_unit, x_factor), (y, y_unit, y_factor) = map(setting, pair)
        if all(name in measured for name in pair):
            at = [st.array(measured[name]) * factor for name, factor in zip(pair, (x_factor, y_factor), strict=True)]
            axes.plot(*at, ".", color="#999999", markersize=2.5, label="Measured")
        for purpose, (marker, color) in _MARKERS.items():
            own = [drop.settings for drop in plan.drops if drop.purpose is purpose]
            if own:
                across, up = (
                    [one[name] * f for one in own] for name, f in zip(pair, (x_factor, y_factor), strict=True)
                )
                axes.plot(across, up, marker, color=color, markersize=4, label=st.plain(f"To {PURPOSES[purpose]}"))
        st.name_axes(axes, f"{x} ({x_unit})", f"{y} ({y_unit})")
    if forecast:
        names_first = plan.goal is Goal.NAMES and plan.forecast.right_name
        values = plan.forecast.right_name if names_first else plan.forecast.error
        panels[-1].plot(plan.forecast.drops[: len(values)], values, "o-", color=st.DARK, markersize=3)
        label = "Expected probability" if names_first else "Expected error over noise"
        panels[-1].set_ylim(0, 1.05 * max(1.0, *values) if names_first else 1.05 * max(values))
        st.name_axes(panels[-1], "Further drops", label)
    handles = {h.get_label(): h for axes in panels[: len(pairs)] for h in axes.lines}
    figure.legend(handles=[*handles.values()], loc="outside upper left", ncols=4)
    return figure
