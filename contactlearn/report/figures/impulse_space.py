"""Impulse space of one impact (Fig. 2.3): admissible impulses, the reach of each law, prediction and measurement.

    reachable_impulses   one panel a law
    compared_impulses    all laws in one panel, for a browser
    scattered_impulses   measured impulses of similar impacts beside those that a contact draws that scatters

Impulses are computed in N s and shown in mN s.  The figure number is that of Fazeli et al. (2017).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path

from contactlearn.inference.evaluation.impulse_space import ImpulseSpace, ScatterCloud
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.hull import signed_areas
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st

_GUESS: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "markeredgewidth": 0.7, "linestyle": "none"}
_IRB = {"marker": st.LAW_STYLE["irb"].marker, "color": st.DARK, "markersize": 6, "markerfacecolor": "white"}
_MEASURED: tuple[dict[str, Any], ...] = (
    {"label": "Measured", "marker": "x", "color": "black", "markersize": 5, "markeredgewidth": 1.3},
    {"label": "IRB bound", **_IRB},
)
_LINES: dict[str, dict[str, Any]] = {
    "Maximum compression": {"linestyle": "--", "linewidth": 0.8, "color": st.DARK},
    "Sticking": {"linestyle": "-.", "linewidth": 0.8, "color": st.DARK},
    "No friction": {"linestyle": ":", "linewidth": 0.8, "color": st.DARK},
}
_ADMISSIBLE: dict[str, Any] = {"facecolor": "#EFEFEF", "edgecolor": "none"}
_ELLIPSE: dict[str, Any] = {"color": "#777777", "linewidth": 0.8}
_HIGHEST = 8.5  # in, of the figure


@st.look()
def reachable_impulses(space: ImpulseSpace) -> Figure:
    """Draw the impulses that each law can give one impact with any (μ, ε) in the box (Fig. 2.3).

    One panel a law, titled by it, in impulse space: the admissible impulses, the law's reach in them, its prediction,
    and the measured impulse.  A measurement that is not admissible is joined to the impulse of the IRB bound.
    """
    laws = space.laws
    low, high = _limits(space)
    columns = len(laws) if len(laws) <= 3 else {4: 2, 5: 3, 6: 3}.get(len(laws), 4)
    legend_columns = 2 if columns == 1 else 5
    figure = _new_figure(space, columns, legend_columns, (high - low)[1] / (high - low)[0])
    grid = figure.subplots(-(-len(laws) // columns), columns, sharex=True, sharey=True, squeeze=False)
    for place, axes in enumerate(grid.flat[: len(laws)]):
        _draw_panel(axes, space, place)
        _name_panel(axes, space, place, columns)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    for axes in grid.flat[len(laws) :]:
        axes.set_visible(False)
    _title(figure, space.trial, columns)
    _legend(figure, space, legend_columns)
    return figure


@st.look()
def compared_impulses(space: ImpulseSpace) -> Figure:
    """Draw all laws and the reach and friction cone of the first in the impulse space of one impact.

    The figure is for a browser, whose script exchanges the impact, the law and the `model`, here the measurement.
    """
    figure = st.new_figure(st.COLUMN, st.COLUMN)
    axes = st.name_axes(figure.subplots(), "Tangential impulse $P_t$ (mN s)", "Normal impulse $P_n$ (mN s)")
    _draw_panel(axes, space, 0)
    for place, law in enumerate(space.laws[1:], 1):
        style, guess = st.law_style(law.name), st.array(space.predicted[place]) * st.MILLI
        label = st.plain(style.label)
        axes.plot(*guess, style.marker, color=style.color, **_GUESS, zorder=5, label=label, gid=f"law {place}")
    mu, top = float(space.laws[0].mu), st.MILLI * space.ellipse[:, 1].max().item()
    cone: dict[str, Any] = {"color": st.law_style(space.laws[0].name).color, "linestyle": "--"}
    axes.plot((-mu * top, 0, mu * top), (top, 0, top), **cone, zorder=3, label="Friction cone", gid="cone")
    model: dict[str, Any] = {
        "markerfacecolor": "white",
        "markeredgecolor": st.CONTRAST[1],
        "markersize": 10,
        "linestyle": "none",
    }
    axes.plot(*st.array(space.measured) * st.MILLI, "o", **model, zorder=6, label="Chosen model", gid="model")
    axes.set_aspect("equal")
    return figure


@st.look()
def scattered_impulses(clouds: Sequence[ScatterCloud]) -> Figure:
    """Draw law and scatter in the impulse plane: the whole energy ellipse above, its part with the impulses below.

    Dots are draws of the model, with noise of the instrument where that is known.
    """
    figure = st.new_figure(st.PAGE, 5.4)
    panels = figure.subplots(2, len(clouds), squeeze=False)
    for cloud, column in zip(clouds, panels.T, strict=True):
        points = st.array(torch.cat((cloud.measured, cloud.drawn.flatten(0, 1)))) * st.MILLI
        low, high = np.quantile(points, (0.002, 0.998), axis=0)
        for axes in column:
            _draw_lines(axes, st.array(cloud.vectors) * st.MILLI)
            axes.plot(*st.array(cloud.ellipse).T * st.MILLI, **_ELLIPSE, zorder=2, label="Energy ellipse")
            look: dict[str, Any] = {"linestyle": "none", "rasterized": True}
            drawn = st.array(cloud.drawn.flatten(0, 1)).T * st.MILLI
            axes.plot(*drawn, ".", color=st.CONTRAST[2], markersize=2, alpha=0.6, zorder=3, label="Drawn", **look)
            expected, measured = (st.array(x).T * st.MILLI for x in (cloud.expected, cloud.measured))
            axes.plot(*expected, "+", color=st.CONTRAST[0], markersize=5, zorder=4, label="Without scatter", **look)
            axes.plot(*measured, "x", color="black", markersize=4, zorder=5, label="Measured", **look)
            st.name_axes(axes, "$P_t$ (mN s)" * (axes is column[1]))
        column[0].set_aspect("equal")
        margin = 0.15 * np.maximum(high - low, 0.02 * (high - low).max())  # bounces along the normal have no P_t
        column[1].set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
        column[0].set_title(f"$v_t/|v_n|$ = {cloud.incidence:.2f}, {len(cloud.measured)} impacts")
    for axes in panels[:, 0]:
        axes.set_ylabel("$P_n$ (mN s)")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _points(space: ImpulseSpace) -> Float[np.ndarray, "p 2"]:
    """The measured impulse, and that of the IRB bound where it is not admissible."""
    return st.array(torch.stack([space.measured] if space.bound is None else [space.measured, space.bound]))


def _limits(space: ImpulseSpace) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Corners (low, high) in mN s of the shown part of impulse space, at least 0.8 as wide as high."""
    ellipse, points = st.array(space.ellipse), np.concatenate((_points(space), st.array(space.predicted)))
    reached, span = np.concatenate(space.reaches).reshape(-1, 2), np.ptp(ellipse, axis=0)
    low = np.minimum(ellipse.min(0), np.maximum(reached.min(0), ellipse.min(0) - 0.25 * span))
    high = np.maximum(ellipse.max(0), np.minimum(reached.max(0), ellipse.max(0) + 0.25 * span))
    low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
    margin = 0.06 * (high - low)
    low, high = low - margin, high + margin
    short = max(0.0, 0.8 * (high - low)[1] - (high - low)[0])
    return np.array((low[0] - short / 2, low[1])) * st.MILLI, np.array((high[0] + short / 2, high[1])) * st.MILLI


def _new_figure(space: ImpulseSpace, columns: int, legend_columns: int, aspect: float) -> Figure:
    """An empty figure whose panels are `aspect` times as high as wide."""
    count = len(space.laws)
    rows, width = -(-count // columns), st.COLUMN if columns == 1 else st.PAGE
    panel = (width - 0.6) / columns * aspect
    titles = 0.4 + 0.13 * any(law.variant != "textbook" for law in space.laws)
    ragged = columns * rows > count  # a panel of the last row but one then has axis labels, too
    legend = 0.8 + 0.17 * -(-(7 + len(_points(space))) // legend_columns)
    return st.new_figure(width, min(rows * (panel + titles) + 0.35 * ragged + legend, _HIGHEST))


def _draw_panel(axes: Axes, space: ImpulseSpace, place: int) -> None:
    """The impact, one law's reach and prediction, and the measurement."""
    style = st.law_style(space.laws[place].name)
    _draw_space(axes, space)
    _draw_reach(axes, space.reaches[place] * st.MILLI, style.color)
    label, guess = st.plain(style.label), st.array(space.predicted[place]) * st.MILLI
    axes.plot(*guess, style.marker, color=style.color, **_GUESS, zorder=5, label=label, gid=f"law {place}")
    axes.plot(*_points(space).T * st.MILLI, color=st.DARK, linewidth=0.8, zorder=6)
    for point, marker in zip(_points(space), _MEASURED, strict=False):
        axes.plot(*point * st.MILLI, **marker, linestyle="none", zorder=7, gid=marker["label"])


def _name_panel(axes: Axes, space: ImpulseSpace, place: int, columns: int) -> None:
    """The law and its parameters above, axis labels at the outer panels."""
    law = space.laws[place]
    variant = "" if law.variant == "textbook" else f"({st.plain(law.variant)})\n"
    label = st.plain(st.law_style(law.name).label)
    axes.set_title(f"{label}\n{variant}μ = {float(law.mu):.3f}, ε = {float(law.eps):.3f}")
    across = "Tangential $P_t$ (mN s)" if columns == 4 else "Tangential impulse $P_t$ (mN s)"
    bottom, left = place + columns >= len(space.laws), place % columns == 0
    st.name_axes(axes, across * bottom, "Normal impulse $P_n$ (mN s)" * left)
    axes.tick_params(labelbottom=bottom)


def _draw_reach(axes: Axes, cells: Float[np.ndarray, "_ 4 2"], color: str) -> None:
    """The union of the cells in a tint with an outline; its one-dimensional parts as lines."""
    # One path a layer, filled by the winding rule: no seams and no overlaps, and a small file.
    solid = cells[signed_areas(cells) > 1e-6 * np.ptp(cells.reshape(-1, 2), axis=0).prod()]
    for corners, fill, linewidth in ((cells, color, 1.4), (solid, st.tint(color, 0.45), 0.3)):
        closed = np.concatenate((corners, corners[:, :1]), 1)
        codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corners))
        path = Path(closed.reshape(-1, 2), codes)
        look = {"facecolor": fill, "edgecolor": fill, "linewidth": linewidth, "joinstyle": "round"}
        name = {"label": "Reach over (μ, ε)", "gid": "reach"} if fill == color else {}
        axes.add_artist(
            PathPatch(path, **look, **name, zorder=3)
        )  # add_patch would fit the axes to all corners, slowly


def _draw_space(axes: Axes, space: ImpulseSpace) -> None:
    """Energy ellipse, admissible impulses, and the lines of the contact's kinematics."""
    W, v_c, ellipse = st.array(space.trial.W[0]), st.array(space.trial.v_c[0]), st.array(space.ellipse) * st.MILLI
    admissible = clipped(clipped(ellipse[:-1], np.array((0.0, 1.0)), 0.0), W[1], -v_c[1] * st.MILLI)
    axes.add_patch(Polygon(admissible, **_ADMISSIBLE, zorder=1, label="Admissible", gid="admissible"))
    axes.plot(*ellipse.T, **_ELLIPSE, zorder=2, label="Energy ellipse", gid="ellipse")
    _draw_lines(axes, st.array(rigid_body.ellipse_vectors(space.trial.W, space.trial.v_c)[0]) * st.MILLI)


def _draw_lines(axes: Axes, vectors: Float[np.ndarray, "4 2"]) -> None:
    """Lines of maximum compression, of sticking and of no friction."""
    centre, compression, _, sticking = vectors
    for chord, name in zip((compression, sticking), ("Maximum compression", "Sticking"), strict=True):
        ends = np.stack((centre - chord, centre + chord))
        axes.plot(*ends.T, **_LINES[name], zorder=4, label=name, gid=name)
    axes.axvline(0, **_LINES["No friction"], zorder=4, label="No friction")


def _title(figure: Figure, trial: Impacts, columns: int) -> None:
    """The trial, its orientation, and the velocity of its contact point."""
    state = zip(("θ", "$v_t$", "$v_n$"), (trial.q[0, 2], *trial.v_c[0]), ("rad", "m/s", "m/s"), strict=True)
    values = ", ".join(f"{symbol} = {value.item():.2f} {unit}".replace("-", "−") for symbol, value, unit in state)
    name = st.plain(trial.trial[0], 25 if columns == 1 else 40)
    figure.suptitle(f"Trial {name}" + ("\n" if columns == 1 or len(name) > 15 else ": ") + values)


def _legend(figure: Figure, space: ImpulseSpace, columns: int) -> None:
    styles = [st.law_style(law.name) for law in space.laws]
    first = styles[0].color if len(styles) == 1 else "#AAAAAA"
    guess: dict[str, Any] = _GUESS | {"markersize": 6.0}
    guesses = tuple(Line2D([], [], marker=style.marker, color=style.color, **guess) for style in styles[:3])
    handles: dict[str, Any] = {label: Line2D([], [], **line) for label, line in _LINES.items()}
    handles |= {
        "Energy ellipse": Line2D([], [], **_ELLIPSE),
        "Admissible": Patch(**_ADMISSIBLE),
        "Reach over (μ, ε)": Patch(facecolor=first, edgecolor=st.DARK, linewidth=0.8),
        "Identified (μ, ε)": guesses,
    }
    handles |= {m["label"]: Line2D([], [], **m, linestyle="none") for m in _MEASURED[: len(_points(space))]}
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=columns, columnspacing=1.0,
        handlelength=2.0, handletextpad=0.6, handler_map={tuple: HandlerTuple(ndivide=None, pad=0.6)},
    )  # fmt: skip


def clipped(polygon: Float[np.ndarray, "n 2"], normal: Float[np.ndarray, "2"], bound: float) -> np.ndarray:
    """The part of a convex polygon where normal·P ≥ bound."""
    kept = []
    height = polygon @ normal - bound
    for p, q, h, k in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
        kept += [p] if h >= 0 else []
        kept += [p + h / (h - k) * (q - p)] if h * k < 0 else []
    return np.array(kept)
