"""The residual wrench of the full model along the symbols that predict it.

    residual_figure   measured wrench minus the model's, trial by trial, and means of groups

A dot is a trial.  Impulses are shown in mN s, moments in mN m s.
"""

from collections.abc import Sequence
from textwrap import wrap

import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.core.numerics import wrapped
from contactlearn.diagnosis.result import ComponentTest, Record, Remainder, WrenchComponent
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import SYMBOLS, of_state
from contactlearn.inference.evaluation.partial_residuals import QUANTITIES, binned, share_explained
from contactlearn.report.figures import style as st
from contactlearn.report.figures.audit import dots, legend_below
from contactlearn.report.text import percent, phrase

_RED = st.CONTRAST[1]
_SYMBOLS = 2  # columns of panels, at most
_ROWS = tuple(WrenchComponent)  # in the order of the wrench


@st.look()
def residual_figure(found: Remainder, record: Record) -> Figure:
    """Draw the measured wrench minus the model's, against the one or two symbols that matter most.

    A row for each component that processes predict; where there is none, for the one that they predict best, against
    the symbol along which its means differ most.  The outermost percent of the trials on each side is left out.
    """
    known = of_state(State.of(record.impacts))
    known["theta"] = wrapped(known["theta"])
    residual = (record.impacts.wrench - record.model.base_prediction(record.impacts).wrench) * st.MILLI
    tests = _tests(found)
    first = residual[:, _ROWS.index(tests[0].component)]
    shares = {one.symbol: one.share for one in found.variables}
    symbols = [*shares][:_SYMBOLS] or [max(known, key=lambda name: share_explained(known[name], first))]
    figure = _titled(found, len(symbols), len(tests))
    panels = figure.subplots(len(tests), len(symbols), sharex="col", sharey="row", squeeze=False)
    for line, test in zip(panels, tests, strict=True):
        _draw_row(line, test, residual[:, _ROWS.index(test.component)], [known[symbol] for symbol in symbols])
    for axes, symbol in zip(panels[-1], symbols, strict=True):
        part = f", {percent(shares[symbol])} of the prediction" if symbol in shares else ""
        axes.set_xlabel(f"{SYMBOLS[symbol].letter} ({SYMBOLS[symbol].unit}){part}")
    legend_below(figure, panels[0, 0])
    return figure


def _tests(found: Remainder) -> list[ComponentTest]:
    """The named components, or else the one that is predicted best."""
    by_name = {one.component: one for one in found.tested}
    return [by_name[name] for name in found.components] or [max(found.tested, key=lambda one: one.r_squared)]


def _titled(found: Remainder, columns: int, rows: int) -> Figure:
    """An empty figure with the share of the error that is predictable above it."""
    title = phrase("residual_share", found) if found.predictable else phrase("not_predictable")
    lines = wrap(title.replace("\u00a0", " "), 54 if columns == 1 else 112)
    figure = st.new_figure((st.COLUMN, st.PAGE)[columns - 1], 0.5 + st.ROW * len(lines) + 2.0 * rows)
    figure.suptitle("\n".join(lines))
    return figure


def _draw_row(
    panels: Sequence[Axes], test: ComponentTest, residual: Float[Tensor, " n"], along: Sequence[Float[Tensor, " n"]]
) -> None:
    """One component against each symbol."""
    ends = residual.quantile(torch.tensor((0.01, 0.99), dtype=residual.dtype))
    shown = (residual >= ends[0]) & (residual <= ends[1])
    letter, unit = QUANTITIES["wrench"][_ROWS.index(test.component)]
    for axes, x in zip(panels, along, strict=True):
        _draw_means(axes, x[shown], residual[shown])
    panels[0].set_ylabel(f"Residual of {letter} (m{unit})")
    title = f"{letter}: R² = {test.r_squared:.2f} ± {test.standard_error:.2f} on held-out trials"
    panels[0].set_title(title, loc="left")


def _draw_means(axes: Axes, x: Float[Tensor, " n"], values: Float[Tensor, " n"]) -> None:
    """Trials, and means of groups of equal number along x with their standard errors."""
    bins = max(20, min(40, len(x) // 40))
    middle, mean, square = binned(x, values, values.square(), bins=bins)
    error = ((square - mean.square()).clamp_min(0) * len(mean) / len(x)).sqrt()
    st.name_axes(axes)
    axes.axhline(0, color=st.DARK, linewidth=0.6)
    dots(axes, x, values)
    label = f"Mean of {len(x) // bins} trials ± standard error"
    axes.errorbar(
        st.array(middle), st.array(mean), st.array(error), fmt="o", color=_RED, markersize=3.5, elinewidth=0.9,
        capsize=2, label=label, zorder=3,
    )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(6))
