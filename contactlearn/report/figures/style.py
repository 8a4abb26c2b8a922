"""One look for all figures: sizes, colours by model, text that is never markup, and saving.

A figure is one column (3.4 in) or two (7 in) of a paper wide, so it is printed at its own size and
its 8 pt text stays 8 pt.  A law or a learned model has the same colour, marker and line everywhere:
colours differ for any colour vision, markers and lines also in grey.
"""

import itertools
import os
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib.style
import numpy as np
import torch
from jaxtyping import Float, Real, Shaped
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from torch import Tensor

from contactlearn import laws
from contactlearn.core.numerics import atomic_write, bin_edges
from contactlearn.report.text.names import model_label

COLUMN, PAGE = 3.4, 7.0
"""Widths in inches of a figure over one column and over two."""
_CARD_WIDTH, _CARD_PIXELS, _CARD_SHAPE = 5.0, 600, 4 / 3  # of a card of TensorBoard: in of two columns, pixels, ratio

FONT_SIZE = 8
ROW = 0.15  # height of a legend's row in inches
MILLI = 1e3
"""N s to mN s."""
DARK = "#222222"
MAP = "cividis"
"""Colours of a quantity: dark blue to yellow, uniform to the eye and in grey."""
MANY = 5000
"""Points from which on their density is drawn."""
CONTRAST = ("#004488", "#BB5566", "#DDAA33")
"""Colours of what is neither law nor model (Tol, 2021): blue, red and yellow, dark to light in grey."""

_FONT = "DejaVu Sans"  # comes with matplotlib, has Greek
_RC = {
    "font.family": _FONT,
    "font.size": FONT_SIZE,
    "axes.titlesize": FONT_SIZE,
    "axes.labelsize": FONT_SIZE,
    "xtick.labelsize": FONT_SIZE,
    "ytick.labelsize": FONT_SIZE,
    "legend.fontsize": FONT_SIZE,
    "figure.titlesize": FONT_SIZE,
    "figure.labelsize": FONT_SIZE,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 5,
    "hatch.linewidth": 0.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "pdf.fonttype": 42,  # TrueType, which publishers ask for
}


LineStyle = str | tuple[int, tuple[int, ...]]
"""A name of matplotlib's, or (offset, lengths of dashes and gaps) in widths of the line."""


class LawStyle(NamedTuple):
    """How a law, a bound or a learned model is written and drawn."""

    label: str
    color: str
    marker: str
    linestyle: LineStyle


# Okabe & Ito's (2008) colours without yellow, which white paper swallows; wine is Tol's (2021).
_LAW_LOOKS: tuple[tuple[str, str, LineStyle], ...] = (
    ("#0072B2", "o", "-"),
    ("#D55E00", "s", "--"),
    ("#E69F00", "D", "-."),
    ("#009E73", "^", (0, (8, 2))),
    ("#CC79A7", "v", (0, (4, 1, 1, 1, 1, 1))),
    ("#56B4E9", "P", (0, (1, 1))),
    ("#882255", "X", (0, (8, 2, 2, 2))),
)
# For further laws, in turn: markers and lines of their own, and greens and browns of Tol's.
_MORE_LOOKS: tuple[tuple[str, str, LineStyle], ...] = (
    ("#999933", "<", (0, (12, 2, 2, 2, 2, 2))),
    ("#661100", ">", (0, (8, 2, 1, 2))),
    ("#44AA99", "s", (0, (3, 1))),
    ("#6699CC", "^", (0, (12, 2))),
)
_BOUND_STYLE = {
    "best_post_hoc": LawStyle(model_label("best_post_hoc"), "#000000", "*", (0, (2, 2))),
    "irb": LawStyle(model_label("irb"), "#666666", "h", (0, (5, 1))),
}

LAW_STYLE = {
    name: LawStyle(model_label(name), *look) for name, look in zip(laws.names(), _LAW_LOOKS, strict=False)
} | _BOUND_STYLE
"""The first laws of the catalogue by name, and the two bounds, which are black and grey."""

BOUNDS = tuple(_BOUND_STYLE)

# Of Tol's (2021) colours eight that any colour vision tells from each other (ΔE > 18) and from the laws' (> 8).
_MODELS = {
    "state_velocity": ("#332288", "o", "-"),
    "x1_impulse": ("#7EB875", "s", "--"),
    "x2_impulse": ("#B997C7", "^", "-."),
    "x1_wrench": ("#117733", "D", (0, (1, 1))),
    "residual_impulse": ("#E67F33", "v", (0, (8, 2))),
    "residual_wrench": ("#521A13", "P", (0, (4, 1, 1, 1, 1, 1))),
    "parameters_identified": ("#EE99AA", "X", (0, (8, 2, 2, 2))),
    "parameters_likelihood": ("#8C4E99", "<", (0, (12, 2, 2, 2, 2, 2))),
}
MODEL_STYLE = {name: LawStyle(model_label(name), *look) for name, look in _MODELS.items()}
"""Learned models by name: first those of Class I, then those of Class II."""

CLASS_I, CLASS_II = tuple(MODEL_STYLE)[:4], tuple(MODEL_STYLE)[4:]
"""Names of the data-driven models, which know no law, and of the data-reinforced ones, which correct one."""

STYLES = LAW_STYLE | MODEL_STYLE


def law_style(name: str) -> LawStyle:
    """Style of a law, bound or learned model by name or label; any other keeps its name and is neutral grey."""
    known = STYLES | _more_laws()
    by_label = {style.label: style for style in known.values()}
    return known.get(name) or by_label.get(name) or LawStyle(model_label(name), "#4D4D4D", "o", "-")


def _more_laws() -> dict[str, LawStyle]:
    """Styles of the laws of the catalogue beyond those of `LAW_STYLE`."""
    more = [name for name in laws.names() if name not in LAW_STYLE]
    looks = zip(more, itertools.cycle(_MORE_LOOKS), strict=False)
    return {name: LawStyle(model_label(name), *look) for name, look in looks}


def law_styles(names: Iterable[str], colors: Sequence[str] = ("#4D4D4D",)) -> dict[str, LawStyle]:
    """Styles of what one figure shows; names without a style of their own differ in marker and line.

    Args:
        names: names or labels.
        colors: for the names without a style, used in turn.
    """
    styles = {name: law_style(name) for name in names}
    markers, lines = ([getattr(style, part) for style in MODEL_STYLE.values()] for part in ("marker", "linestyle"))
    known = [*STYLES.values(), *_more_laws().values()]
    for place, name in enumerate([name for name, style in styles.items() if style not in known]):
        # 7 markers and 8 lines: the first pair comes back after 56 names.
        styles[name] = LawStyle(styles[name].label, colors[place % len(colors)], markers[place % 7], lines[place % 8])
    return styles


def plain(text: str, length: int = 40) -> str:
    """`text` of a user's as one short line that matplotlib shows as it is, whatever it contains.

    `$` starts no formula, a leading `_` hides nothing from a legend, and what the font cannot draw is "?".  Of a longer
    text the middle is left out: names of runs often differ at their end.
    """
    font = get_font(findfont(_FONT))
    line = "".join(c if c.isprintable() and font.get_char_index(ord(c)) else "?" for c in " ".join(str(text).split()))
    line = line if len(line) <= length else f"{line[: length // 2]}…{line[length // 2 - length + 1 :]}"
    return (" " if line.startswith("_") else "") + line.replace("$", r"\$")


@contextmanager
def look() -> Generator[None]:
    """The package's look, whatever the user's matplotlibrc says; usable as a decorator."""
    with matplotlib.style.context(_RC, after_reset=True):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of `width` × `height` in inches that arranges itself."""
    return Figure((width, height), layout="constrained")


def name_axes(axes: Axes, x: str = "", y: str = "") -> Axes:
    """Axis labels, and ticks that keep their size when drawn outside `look`."""
    axes.set(xlabel=x, ylabel=y)
    axes.tick_params(labelsize=FONT_SIZE, length=2.5)
    return axes


def scale_logarithmically(axes: Axes, way: Literal["x", "y"] = "y") -> None:
    """Scale an axis of a panel logarithmically, with plain numbers at 1, 2 and 5 of each decade."""
    axes.set(**{f"{way}scale": "log"})
    axis = axes.xaxis if way == "x" else axes.yaxis
    ticks = {"major_locator": LogLocator(subs=(1, 2, 5)), "major_formatter": StrMethodFormatter("{x:g}")}
    axis.set(**ticks, minor_formatter=NullFormatter())


def tint(color: str, strength: float) -> tuple[float, float, float]:
    """An opaque mix of `color` with white, `strength` in [0, 1]; unlike a transparent one it shows no overlaps."""
    red, green, blue = (1 - strength * (1 - part) for part in to_rgb(color))
    return red, green, blue


def legend_above(axes: Axes, title: str | None = None) -> None:
    """A legend above the left end of a panel."""
    place = (0, 1)
    axes.legend(title=title, labelspacing=0.25, loc="lower left", bbox_to_anchor=place, alignment="left", borderpad=0)


def draw_line(
    axes: Axes,
    x: Real[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    style: LawStyle,
    markevery: int | Sequence[int] | None = None,
) -> None:
    """Draw a line in the style of a law or model, with markers at some of its points or, by default, at all."""
    axes.plot(
        x, y, color=style.color, linestyle=style.linestyle, marker=style.marker, markersize=6,
        markeredgecolor="white", markeredgewidth=0.4, label=plain(style.label, 30), markevery=markevery,
    )  # fmt: skip


def draw_density(axes: Axes, x: np.ndarray, y: np.ndarray, color: str) -> PolyCollection:
    """Draw how many of many points lie in each cell, on a logarithmic scale from a light tint to the colour."""
    shades = LinearSegmentedColormap.from_list("density", (tint(color, 0.15), to_rgb(color)))
    return axes.hexbin(x, y, gridsize=60, bins="log", mincnt=1, cmap=shades, linewidths=0, zorder=1)


def draw_histogram(axes: Axes, values: Float[np.ndarray, " n"], bins: int, color: str) -> None:
    """Draw how many values lie in each of some bins."""
    axes.hist(values, bin_edges(values, bins).tolist(), color=tint(color, 0.45), edgecolor=color, linewidth=0.4)


def array(x: Shaped[Tensor, "*shape"] | Sequence[float]) -> Float[np.ndarray, "*shape"]:
    """`x` as a float64 array, without its gradient."""
    return torch.as_tensor(x, dtype=torch.float64).detach().cpu().numpy()


def card_png(figure: Figure) -> bytes:
    """Draw a figure as a card of TensorBoard shows it best: 600 × 450 pixels, with letters of 11 to 18 of them.

    A card is some 330 pixels wide whatever it shows; a figure over two columns is arranged again in less width.
    """
    width, height = figure.get_size_inches()
    size = max(_CARD_WIDTH if width > COLUMN else COLUMN, height * _CARD_SHAPE)
    figure.set_size_inches(size, size / _CARD_SHAPE)
    with look(), BytesIO() as drawn:
        figure.savefig(drawn, format="png", dpi=_CARD_PIXELS / size)
        figure.set_size_inches(width, height)
        return drawn.getvalue()


def save(figure: Figure, folder: str | os.PathLike[str], name: str) -> tuple[Path, Path]:
    """Write `name`.png (200 dpi) and `name`.pdf (vector) into `folder`, whole or not at all.

    A figure that is built and saved in the same way gives the same bytes: no date is written.  It is arranged once,
    for the PNG, which takes as long as drawing it.

    Returns:
        The paths of the PNG and of the PDF.
    """
    targets = Path(folder) / f"{name}.png", Path(folder) / f"{name}.pdf"
    engine = figure.get_layout_engine()
    options: tuple[dict[str, Any], ...] = (
        {"format": "png", "dpi": 200},
        {"format": "pdf", "metadata": {"CreationDate": None}},
    )
    with look(), atomic_write(targets[0]) as png, atomic_write(targets[1]) as pdf:
        for part, chosen in zip((png, pdf), options, strict=True):
            # By way of memory: on a full disk matplotlib's own writer raises AttributeError as it tidies up.
            with BytesIO() as drawn:
                figure.savefig(drawn, **chosen)
                part.write_bytes(drawn.getvalue())
            figure.set_layout_engine("none")
    figure.set_layout_engine(engine)
    return targets
