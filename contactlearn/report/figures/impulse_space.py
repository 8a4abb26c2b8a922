"""Impulse space of one impact: what can happen, what each law can give, what was measured (Fig. 2.3)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from torch import Tensor

from contactlearn import mechanics
from contactlearn.errors import ContactLearnError
from contactlearn.evaluation.bounds import irb
from contactlearn.identification.shared import Box, measured_impulse
from contactlearn.impacts import Impacts
from contactlearn.laws import Law, impulse
from contactlearn.report.figures.style import (
    COLUMN,
    DARK,
    LAW_STYLE,
    MILLI,
    PAGE,
    array,
    law_style,
    look,
    name_axes,
    new_figure,
    plain,
    tint,
)


@look()
def energy_ellipse(
    impacts: Impacts, row: int, laws: Mapping[str, Law], box: Box | None = None, *, target: str = "momentum"
) -> Figure:
    """Fig. 2.3: which impulses each law can give one impact, with any (μ, ε) in the box.

    One panel a law, in impulse space: the admissible impulses, the law's reach in them, its
    prediction, and what was measured.  A measurement that is not admissible is joined to the
    impulse of the IRB bound (norm `mass`).

    Args:
        impacts, row: the impact, counted from 0.
        laws: at their identified parameters, by name; each panel is titled by its law.
        box: the parameters that a law may take; μ and ε in [0, 1] if left out.
        target: which measured impulse is drawn, see `fit.measured_impulse`.
    """
    if not laws:
        raise ContactLearnError("energy_ellipse needs at least one law, got none")
    trial, box = impacts[[row]], box or Box()
    W, v_c, measured = trial.W[0], trial.v_c[0], measured_impulse(trial, target)[0]
    ellipse = mechanics.energy_ellipse(W, v_c)
    points = [measured]
    if not bool(mechanics.admissible(W, v_c, measured)):
        points.append(irb(trial).wrench[0, :2])
    reaches = [_reach(law, W, v_c, box) for law in laws.values()]
    guesses = [law.impulse(W, v_c).detach() for law in laws.values()]
    low, high = _limits(array(ellipse), array(torch.stack(points + guesses)), np.concatenate(reaches).reshape(-1, 2))

    columns = len(laws) if len(laws) <= 3 else {4: 2, 5: 3, 6: 3}.get(len(laws), 4)
    rows = -(-len(laws) // columns)
    width = COLUMN if columns == 1 else PAGE
    panel = (width - 0.6) / columns * (high - low)[1] / (high - low)[0]
    legend_columns, entries = 2 if columns == 1 else 5, 7 + len(points)
    titles = 0.4 + 0.13 * any(law.variant != "textbook" for law in laws.values())
    ragged = columns * rows > len(laws)  # a panel of the last row but one then has axis labels, too
    height = rows * (panel + titles) + 0.35 * ragged + 0.8 + 0.17 * -(-entries // legend_columns)
    figure = new_figure(width, min(height, 8.5))
    across = "Tangential $P_t$ (mN s)" if columns == 4 else "Tangential impulse $P_t$ (mN s)"
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for place, (axes, law, reach, guess) in enumerate(zip(grid.flat, laws.values(), reaches, guesses, strict=False)):
        style = law_style(law.name)
        _draw_space(axes, array(W), array(v_c), array(ellipse) * MILLI)
        _draw_reach(axes, reach * MILLI, style.color)
        axes.plot(*guess.numpy() * MILLI, style.marker, color=style.color, **_GUESS, zorder=5)
        axes.plot(*array(torch.stack(points)).T * MILLI, color=DARK, linewidth=0.8, zorder=6)
        for point, marker in zip(points, _MEASURED, strict=False):
            axes.plot(*point.numpy() * MILLI, **marker, linestyle="none", zorder=7)
        variant = "" if law.variant == "textbook" else f"({plain(law.variant)})\n"
        axes.set_title(f"{plain(style.label)}\n{variant}μ = {float(law.mu):.3f}, ε = {float(law.eps):.3f}")
        bottom, left = place + columns >= len(laws), place % columns == 0
        name_axes(axes, across * bottom, "Normal impulse $P_n$ (mN s)" * left)
        axes.tick_params(labelbottom=bottom)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    for axes in grid.flat[len(laws) :]:
        axes.set_visible(False)
    state = zip(("θ", "$v_t$", "$v_n$"), (trial.q[0, 2], *v_c), ("rad", "m/s", "m/s"), strict=True)
    values = ", ".join(f"{symbol} = {value.item():.2f} {unit}".replace("-", "−") for symbol, value, unit in state)
    name = plain(trial.trial[0], 25 if columns == 1 else 40)
    figure.suptitle(f"Trial {name}" + ("\n" if columns == 1 or len(name) > 15 else ": ") + values)
    _legend(figure, [law_style(law.name) for law in laws.values()], len(points) > 1, legend_columns)
    return figure


_GUESS: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "markeredgewidth": 0.7, "linestyle": "none"}
_MEASURED: tuple[dict[str, Any], ...] = (
    {"label": "Measured", "marker": "x", "color": "black", "markersize": 5, "markeredgewidth": 1.3},
    {
        "label": "IRB bound",
        "marker": LAW_STYLE["irb"].marker,
        "color": DARK,
        "markersize": 6,
        "markerfacecolor": "white",
    },
)
_LINES: dict[str, dict[str, Any]] = {
    "Maximum compression": {"linestyle": "--", "linewidth": 0.8, "color": DARK},
    "Sticking": {"linestyle": "-.", "linewidth": 0.8, "color": DARK},
    "No friction": {"linestyle": ":", "linewidth": 0.8, "color": DARK},
}
_ADMISSIBLE: dict[str, Any] = {"facecolor": "#EFEFEF", "edgecolor": "none"}
_ELLIPSE: dict[str, Any] = {"color": "#777777", "linewidth": 0.8}


def _reach(law: Law, W: Tensor, v_c: Tensor, box: Box, nodes: tuple[int, int] = (65, 33), finer: int = 4) -> np.ndarray:
    """The cells of a (μ, ε) grid as the law maps them: corners [K, 4, 2] in N s, counter-clockwise.

    Where sticking makes μ void many cells fall on one another; one of them is kept.  Where P̂ jumps
    (Whittaker's does) a cell would hold impulses that the law cannot give: it is split, and what
    still jumps is left out.
    """
    u, w = (torch.linspace(0, 1, finer * (n - 1) + 1, dtype=W.dtype) for n in nodes)
    mu, eps = box.mu[0] + u**2 * (box.mu[1] - box.mu[0]), box.eps[0] + w * (box.eps[1] - box.eps[0])
    P = array(impulse(law.name, W, v_c, mu[:, None], eps, variant=law.variant, e_t=law.e_t))
    size = np.linalg.norm(np.ptp(array(mechanics.energy_ellipse(W, v_c)), axis=0))
    parts, coarse = _cells(P), _cells(P[::finer, ::finer])
    jumps = np.linalg.norm(np.ptp(parts, axis=2), axis=-1) > 0.03 * size
    split = jumps.reshape(nodes[0] - 1, finer, nodes[1] - 1, finer).any((1, 3))
    parts = parts[~jumps & split.repeat(finer, 0).repeat(finer, 1)]
    cells = np.concatenate((coarse[~split], parts))
    unit = size / 4000  # finer than a printer's dot
    cells = np.round(cells / unit)
    cells = np.where((_area(cells) < 0)[:, None, None], cells[:, ::-1], cells)
    return np.unique(cells, axis=0) * unit


def _cells(P: np.ndarray) -> np.ndarray:
    """Corners [A − 1, B − 1, 4, 2] of the cells between nodes [A, B, 2]."""
    return np.stack((P[:-1, :-1], P[1:, :-1], P[1:, 1:], P[:-1, 1:]), 2)


def _area(cells: np.ndarray) -> np.ndarray:
    """Signed areas [K] of cells [K, 4, 2]."""
    across, up = cells[:, 2] - cells[:, 0], cells[:, 3] - cells[:, 1]
    return 0.5 * (across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0])


def _draw_reach(axes: Axes, cells: np.ndarray, color: str) -> None:
    """The union of the cells in a tint with an outline; its one-dimensional parts as lines."""
    # One path a layer, filled by the winding rule: no seams and no overlaps, and a small file.
    solid = cells[_area(cells) > 1e-6 * np.ptp(cells.reshape(-1, 2), axis=0).prod()]
    for corners, fill, linewidth in ((cells, color, 1.4), (solid, tint(color, 0.45), 0.3)):
        closed = np.concatenate((corners, corners[:, :1]), 1)
        codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corners))
        path = Path(closed.reshape(-1, 2), codes)
        axes.add_patch(
            PathPatch(path, facecolor=fill, edgecolor=fill, linewidth=linewidth, joinstyle="round", zorder=3)
        )


def _draw_space(axes: Axes, W: np.ndarray, v_c: np.ndarray, ellipse: np.ndarray) -> None:
    """Energy ellipse [K, 2] in mN s, admissible impulses, and the lines of the contact's kinematics."""
    admissible = _above(_above(ellipse[:-1], np.array((0, 1)), 0.0), W[1], -v_c[1] * MILLI)
    axes.add_patch(Polygon(admissible, **_ADMISSIBLE, zorder=1))
    axes.plot(*ellipse.T, **_ELLIPSE, zorder=2)
    centre = -np.linalg.solve(W, v_c) * MILLI
    # Both lines are chords through the centre: P = centre ± d with dᵀ W d = v_cᵀ M_c v_c.
    for direction, line in zip(((W[1, 1], -W[0, 1]), (W[0, 1], -W[0, 0])), list(_LINES.values())[:2], strict=True):
        d = np.array(direction)
        d *= np.sqrt(-(v_c @ centre) * MILLI / (d @ W @ d))
        axes.plot(*np.stack((centre - d, centre + d)).T, **line, zorder=4)
    axes.axvline(0, **_LINES["No friction"], zorder=4)


def _above(polygon: np.ndarray, normal: np.ndarray, bound: float) -> np.ndarray:
    """The part of a convex polygon [K, 2] where normal·P ≥ bound."""
    kept = []
    height = polygon @ normal - bound
    for p, q, h, k in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
        kept += [p] if h >= 0 else []
        kept += [p + h / (h - k) * (q - p)] if h * k < 0 else []
    return np.array(kept)


def _limits(ellipse: np.ndarray, points: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (low, high) in mN s of the shown part of impulse space, at least 0.8 as wide as high."""
    span = np.ptp(ellipse, axis=0)
    low = np.minimum(ellipse.min(0), np.maximum(reach.min(0), ellipse.min(0) - 0.25 * span))
    high = np.maximum(ellipse.max(0), np.minimum(reach.max(0), ellipse.max(0) + 0.25 * span))
    low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
    margin = 0.06 * (high - low)
    low, high = low - margin, high + margin
    short = max(0.0, 0.8 * (high - low)[1] - (high - low)[0])
    return np.array((low[0] - short / 2, low[1])) * MILLI, np.array((high[0] + short / 2, high[1])) * MILLI


def _legend(figure: Figure, styles: Sequence, outside: bool, columns: int) -> None:
    first = styles[0].color if len(styles) == 1 else "#AAAAAA"
    guesses = tuple(
        Line2D([], [], marker=style.marker, color=style.color, **(_GUESS | {"markersize": 6.0})) for style in styles[:3]
    )
    handles: dict[str, Any] = {label: Line2D([], [], **line) for label, line in _LINES.items()}
    handles |= {
        "Energy ellipse": Line2D([], [], **_ELLIPSE),
        "Admissible": Patch(**_ADMISSIBLE),
        "Reach over (μ, ε)": Patch(facecolor=first, edgecolor=DARK, linewidth=0.8),
        "Identified (μ, ε)": guesses,
    }
    handles |= {marker["label"]: Line2D([], [], **marker, linestyle="none") for marker in _MEASURED[: 1 + outside]}
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside lower center",
        ncols=columns,
        columnspacing=1.0,
        handlelength=2.0,
        handletextpad=0.6,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.6)},
    )
