"""A figure of matplotlib as plotly shows it in a browser: the same panels, artists, labels and legend.

    as_plotly      traces and layout, for the report and the workbench
    plotly_style   how a law or a model is drawn

Each figure is so built once, for paper and for the browser.  Text, axes and grid have the colours of the page, which
has a light and a dark theme.  The `gid` of an artist is the `meta` of its trace, by which a script finds the arrays
that it exchanges.
"""

import html
import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import AxLine, Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, LogLocator

from contactlearn.report.figures.style import law_style

_PIXELS = 4 / 3  # a point is so many of CSS
_LARGER = 1.9  # markers: a figure of a column is shown larger than it is printed
_GAP = 0.09  # between panels, as a share of the figure
_SYMBOLS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle-up", "v": "triangle-down", "P": "cross",
            "X": "x", "*": "star", "h": "hexagon", "<": "triangle-left", ">": "triangle-right",
            ".": "circle", "x": "x-thin"}  # fmt: skip
_SIDES = {"left": "left", "center": "center", "right": "right", "top": "top", "bottom": "bottom", "baseline": "bottom",
          "center_baseline": "middle"}  # fmt: skip

_Trace = dict[str, Any]


def plotly_style(name: str) -> dict[str, str]:
    """Return how plotly draws a law, bound or learned model."""
    style = law_style(name)
    return {"label": style.label, "color": style.color, "symbol": _SYMBOLS[style.marker]}


def as_plotly(figure: Figure) -> dict[str, Any]:
    """Return `data` and `layout` of a figure made of lines, markers, bars, fills and text.

    Raises:
        TypeError: an artist of another kind.
    """
    data, seen = list[_Trace](), set[str]()
    layout: _Trace = {"shapes": [], "annotations": []}
    panels = [axes for axes in figure.axes if axes.get_visible()]
    for place, axes in enumerate(panels):
        number = str(place + 1) if place else ""
        layout[f"xaxis{number}"], layout[f"yaxis{number}"] = _axes(axes, panels, number)
        for trace in _traces(axes):
            label = trace.pop("label")
            named = bool(label) and not label.startswith("_")
            trace |= {"name": _text(label) if named else "", "showlegend": named and label not in seen}
            trace |= {"legendgroup": trace["name"]} if named else {"hoverinfo": "x+y"}
            seen |= {label} if named else set()
            if trace["type"] in ("line", "rect"):
                trace |= {f"{way}ref": f"{way}{number}{trace.pop(f'{way}ref')}" for way in "xy"}
                trace.pop("hoverinfo", None)
                layout["shapes"].append(trace)
            else:
                data.append(trace | {"xaxis": f"x{number}", "yaxis": f"y{number}"})
        layout["annotations"] += _annotations(axes, number)
    return {"data": data, "layout": layout | {"showlegend": bool(seen)}}


def _axes(axes: Axes, panels: list[Axes], number: str) -> tuple[_Trace, _Trace]:
    """The axes of a panel, with its place in the grid of the figure."""
    spec = axes.get_subplotspec()
    assert spec is not None  # every panel is one of a grid
    rows, columns = spec.get_gridspec().get_geometry()
    across, up = _axis(axes.xaxis, axes.get_autoscalex_on()), _axis(axes.yaxis, axes.get_autoscaley_on())
    across |= {"domain": _share(spec.colspan.start, columns), "anchor": f"y{number}"}
    up |= {"domain": _share(rows - 1 - spec.rowspan.start, rows), "anchor": f"x{number}"}
    for one, way, shared in ((across, "x", axes.get_shared_x_axes()), (up, "y", axes.get_shared_y_axes())):
        first = min(panels.index(other) for other in shared.get_siblings(axes) if other in panels)
        if panels[first] is not axes:
            one["matches"] = f"{way}{first + 1 if first else ''}"
    if axes.get_aspect() == 1:
        up["scaleanchor"] = f"x{number}"
    return across, up


def _share(place: int, count: int) -> list[float]:
    size = (1 - _GAP * (count - 1)) / count
    return [place * (size + _GAP), place * (size + _GAP) + size]


def _axis(axis: Axis, automatic: bool) -> _Trace:
    """Title, scale, ends and ticks; what matplotlib chooses itself is left to plotly."""
    found: _Trace = {"title": {"text": _text(axis.get_label_text())}, "zeroline": False}
    log = axis.get_scale() == "log"
    ends = np.array(axis.get_view_interval())
    if log:
        found["type"] = "log"
    if not automatic:
        found["range"] = (np.log10(ends) if log else ends).tolist()
    locator = axis.get_major_locator()
    if isinstance(locator, FixedLocator | LogLocator):
        places = [float(place) for place in locator()]
        words = [_text(word) for word in axis.get_major_formatter().format_ticks(places)]
        found |= {"tickvals": places, "ticktext": words}
    return found


def _traces(axes: Axes) -> Iterator[_Trace]:
    """Each artist of a panel, the lowest first."""
    bars = [one for one in axes.containers if isinstance(one, BarContainer)]
    inside = {patch for one in bars for patch in one}
    labels = {one[0]: one.get_label() for one in axes.containers if isinstance(one, ErrorbarContainer)}
    artists = [*axes.patches, *axes.collections, *axes.lines, *axes.artists]
    yield from map(_bars, bars)
    for artist in sorted((one for one in artists if one not in inside), key=lambda one: one.get_zorder()):
        if isinstance(artist, Line2D):
            trace = _line(artist, axes)
        elif isinstance(artist, Rectangle) and not all(_in_data(artist, axes)):
            look = {"fillcolor": to_hex(artist.get_facecolor()), "layer": "below", "line": {"width": 0}}
            trace = _crossing("rect", artist, axes, *np.array(artist.get_bbox()).T) | look
        elif isinstance(artist, Patch):
            path = artist.get_patch_transform().transform_path(artist.get_path())
            edge = artist.get_edgecolor()
            trace = _fill(path.to_polygons(closed_only=False), artist.get_facecolor(), edge)
            if artist.get_hatch():
                trace["fillpattern"] = {"shape": "/", "fgcolor": to_hex(edge), "bgcolor": "transparent"}
        elif isinstance(artist, LineCollection):
            trace = _segments(artist)
        elif isinstance(artist, PolyCollection):
            trace = _fill([path.vertices for path in artist.get_paths()], artist.get_facecolor()[0])
        elif isinstance(artist, PathCollection):
            x, y = np.asarray(artist.get_offsets()).T
            trace = {"type": "scatter", "mode": "markers", "x": x.tolist(), "y": y.tolist(),
                     "marker": {"color": to_hex(tuple(np.atleast_2d(artist.get_facecolor())[0]))}}  # fmt: skip
        else:
            raise TypeError(f"{type(artist).__name__} has no counterpart in plotly")
        if trace:
            yield trace | {"label": str(labels.get(artist, artist.get_label())), "meta": artist.get_gid() or ""}


def _bars(bars: BarContainer) -> _Trace:
    upright, first = bars.orientation != "horizontal", bars[0]
    length, width = [one.get_height() for one in bars], [one.get_width() for one in bars]
    middle = [one.get_x() + one.get_width() / 2 for one in bars]
    if not upright:
        length, width = width, length
        middle = [one.get_y() + one.get_height() / 2 for one in bars]
    x, y = (middle, length) if upright else (length, middle)
    return {
        "type": "bar",
        "orientation": "v" if upright else "h",
        "x": [float(one) for one in x],
        "y": [float(one) for one in y],
        "width": [float(one) for one in width],
        "marker": {"color": to_hex(first.get_facecolor())},
        "label": str(bars.get_label()),
        "meta": first.get_gid() or "",
    }


def _line(line: Line2D, axes: Axes) -> _Trace:
    """A line with its markers; one that crosses the whole panel is a shape."""
    color, style = to_hex(line.get_color()), line.get_linestyle() not in ("None", "none", " ", "")
    look = {"color": color, "width": _PIXELS * line.get_linewidth(), "dash": _dashes(line)}
    x, y = (np.atleast_1d(np.asarray(part, float)) for part in line.get_data())
    if isinstance(line, AxLine):
        (x0, y0), x = line.get_xy1() or (0, 0), np.array(axes.get_xlim())
        y = y0 + line.get_slope() * (x - x0)
    elif not all(_in_data(line, axes)):
        return _crossing("line", line, axes, x, y) | {"line": look}
    found: _Trace = {"type": "scatter", "mode": "lines" if style else "markers", "x": _numbers(x), "y": _numbers(y)}
    found |= {"line": look} if style else {}
    symbol = _SYMBOLS.get(str(line.get_marker()))
    if symbol is None:
        return found if style else {}
    size = line.get_markersize() * _LARGER * (0.8 if line.get_marker() == "." else 1)
    face, edge, thin = to_hex(line.get_markerfacecolor()), to_hex(line.get_markeredgecolor()), symbol.endswith("-thin")
    hollow = face == "#ffffff" and not thin
    marker: _Trace = {"symbol": symbol + "-open" * hollow, "color": edge if hollow or thin else face, "size": size}
    if hollow or thin:
        marker["line"] = {"width": 1.5 * _PIXELS, "color": edge}
    every: Any = line.get_markevery()
    if every is not None:
        shown = set(np.arange(len(x))[::every] if isinstance(every, int) else every)
        marker["size"] = [size if k in shown else 0 for k in range(len(x))]
    return found | {"mode": "lines+markers" if style else "markers", "marker": marker}


def _dashes(line: Line2D) -> str:
    """The dashes of a line, which has no public way to ask for those of its own."""
    _, dashes = vars(line)["_unscaled_dash_pattern"]
    return " ".join(f"{_PIXELS * line.get_linewidth() * part:.3g}px" for part in dashes) if dashes else "solid"


def _in_data(artist: Line2D | Rectangle, axes: Axes) -> Sequence[bool]:
    """Whether x and y are data; else they are shares of the panel."""
    return artist.get_transform().contains_branch_seperately(axes.transData)


def _crossing(kind: str, artist: Line2D | Rectangle, axes: Axes, x: np.ndarray, y: np.ndarray) -> _Trace:
    """A shape from one corner to another, across the panel in the direction in which it has no data."""
    ends = {f"{way}{k}": float(part[-k]) for way, part in (("x", x), ("y", y)) for k in (0, 1)}
    return (
        {"type": kind}
        | ends
        | {f"{way}ref": "" if one else " domain" for way, one in zip("xy", _in_data(artist, axes), strict=True)}
    )


def _segments(collection: LineCollection) -> _Trace:
    """Separate lines as one trace."""
    color, width = np.atleast_2d(collection.get_color())[0], np.atleast_1d(collection.get_linewidth())[0]
    look = {"color": to_hex(tuple(color)), "width": _PIXELS * float(width)}
    return {"type": "scatter", "mode": "lines", "line": look, "hoverinfo": "skip"} | _joined(collection.get_segments())


def _fill(polygons: Any, face: Any, edge: Any = None) -> _Trace:
    line: _Trace = {"width": 0}
    if edge is not None and to_hex(edge, keep_alpha=True)[-2:] != "00":
        line = {"width": 1, "color": to_hex(edge)}
    look = {"fill": "toself", "fillcolor": to_hex(face), "line": line, "hoveron": "points"}
    return {"type": "scatter", "mode": "lines", **look} | _joined(polygons)


def _joined(parts: Any) -> _Trace:
    """Points of several parts, with a gap between each two."""
    points = [*itertools.chain.from_iterable([*np.asarray(part, float), (np.nan, np.nan)] for part in parts)][:-1]
    return {"x": _numbers([point[0] for point in points]), "y": _numbers([point[1] for point in points])}


def _numbers(values: Any) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _annotations(axes: Axes, number: str) -> list[_Trace]:
    """The title of a panel, or that of its legend, and the text in it."""
    legend = axes.get_legend()
    titles = axes.get_title(), axes.get_title("left"), legend.get_title().get_text() if legend else ""
    title = "\n".join(filter(None, titles))
    inside = {"showarrow": False, "xref": f"x{number}", "yref": f"y{number}"}
    found = [
        {
            "x": float(text.get_position()[0]),
            "y": float(text.get_position()[1]),
            "text": _text(text.get_text()),
            "align": "left",
            "xanchor": _SIDES[text.get_horizontalalignment()],
            "yanchor": _SIDES[text.get_verticalalignment()],
        }
        | inside
        for text in axes.texts
    ]
    if title:
        above = {"xref": f"x{number} domain", "yref": f"y{number} domain", "x": 0.5, "y": 1, "yanchor": "bottom"}
        found.append({"text": _text(title), "showarrow": False, **above})
    return found


def _text(words: str) -> str:
    """Text of matplotlib as plotly takes it: sub- and superscripts for formulas and for symbols such as v_n."""
    parts = re.split(r"(?<!\\)\$", words)
    for k, part in enumerate(parts):
        part = html.escape(part.replace(r"\$", "$"), quote=False)
        if k % 2:
            part = re.sub(r"_(?:\{([^}]*)\}|(.))", r"<sub>\1\2</sub>", part)
            part = re.sub(r"\^(?:\{([^}]*)\}|(.))", r"<sup>\1\2</sup>", part)
        else:
            part = re.sub(r"(?<![A-Za-z_])([^\W\d_])_([a-z])(?![A-Za-z_])", r"\1<sub>\2</sub>", part)
        parts[k] = part
    return "".join(parts).strip().replace("\n", "<br>")
